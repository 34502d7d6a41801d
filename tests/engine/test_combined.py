# SPDX-License-Identifier: GPL-3.0-or-later
"""Combinations of two features: tiles and bands, atlases and samples, cages that touch, maps and misses."""

import bpy
import numpy as np
import pytest

from addon.core.settings import Settings
from addon.engine import bands, margins, tree_cache
from addon.jobs import Job, bake_all, bake_pair
from addon.output import map_names, outputs
from addon.passes import target
from tests.support import scenes, zoo
from tests.support.maps import pixels, texel_uv

pytestmark = pytest.mark.usefixtures("gpu_context")

SIZE = 48
METHODS = ["FLATTEN", "CAST"]
RAYS = {"extrusion": 0.5, "max_distance": 1.0}


def bake(low, *highs, cage=None, **settings):
    """The report and, by name, the texels of the normal map and the other maps, as float images in memory."""
    report = scenes.bake(low, *highs, cage=cage, **{"method": "AUTO", "image": "map", "size": SIZE} | settings)
    beside = {name: pixels(bpy.data.images[found["image"]]) for name, found in report.maps.items()}
    return report, {"normal": pixels(bpy.data.images["map"]), **beside}


def move_uvs(obj, scale=(1.0, 1.0), offset=(0.0, 0.0)):
    for corner in obj.data.uv_layers[0].uv:
        corner.vector = [value * s + o for value, s, o in zip(corner.vector, scale, offset, strict=True)]


@pytest.fixture
def in_bands(monkeypatch):
    """Treat small maps as large ones, with bands of 10 rows and a margin wider than their halo."""

    def shrink():
        monkeypatch.setattr(bands, "BAND_TEXELS", 10 * SIZE)
        for module in (bands, margins):
            monkeypatch.setattr(module, "REACH", 3)
        monkeypatch.setattr(margins, "ROWS", 7)

    return shrink


# Rays


def test_the_tree_that_was_used_last_stays_cached(monkeypatch):
    trees = tree_cache.trees
    monkeypatch.setattr(trees, "most_trees", 2)
    trees.free()
    before = trees.built
    low, first, second, third = (zoo.plane(name, n) for name, n in (("lo", 1), ("a", 2), ("b", 3), ("c", 4)))
    for high in (first, second, first, third, first):
        bake(low, high, method="CAST", **RAYS)
    assert trees.built == before + 3


def test_each_of_several_high_meshes_shows_its_own_normals():
    """The meshes have different numbers of points and corners, unlike single faces."""
    low, highs = zoo.plane("lo"), [zoo.terrain(name, n=n, height=0.2) for name, n in (("a", 12), ("b", 6), ("c", 8))]
    alone = []
    for number, high in enumerate(highs):
        high.scale.x, high.location.x = 1.0 / 3.0, (number - 1) * 2.0 / 3.0
        alone.append(bake(low, high, method="CAST", space="WORLD", **RAYS)[1]["normal"])
    _, found = bake(low, *highs, method="CAST", space="WORLD", **RAYS)
    for number, expected in enumerate(alone):
        columns = np.s_[:, 16 * number + 1 : 16 * number + 15]
        assert len(np.unique(expected[columns])) > 100
        assert np.allclose(found["normal"][columns], expected[columns], atol=1e-5)


def test_high_meshes_beside_the_low_one_are_within_reach_of_measured_distances():
    low, near, beside = zoo.plane("lo"), zoo.plane("near"), zoo.plane("beside")
    for high, side, height in ((near, -1.0, 0.0), (beside, 1.0, 0.3)):
        high.scale.x, high.location = 0.5, (0.5 * side, 0.0, height)
    report, found = bake(low, near, beside, method="CAST")
    assert not any("left out" in warning for warning in report.warnings)
    assert (found["normal"][..., 3] == 1.0).all()


@pytest.mark.parametrize("method", METHODS)
def test_each_face_has_its_own_material_seed_4(method):
    low, high = zoo.plane("lo"), zoo.terrain("hi", n=16, height=0.02)
    for name in ("a", "b", "c"):
        high.data.materials.append(bpy.data.materials.new(name))
    owner = np.random.default_rng(4).integers(0, 3, (16, 16))
    high.data.polygons.foreach_set("material_index", owner.ravel())
    report, found = bake(low, high, method=method, maps=("MATERIAL_ID",), **RAYS)
    colors = np.array([report.maps["material_id"]["colours"][name] for name in ("a", "b", "c")])
    expected = colors[np.kron(owner, np.ones((3, 3), int))]
    assert np.allclose(found["material_id"][1::3, 1::3, :3], expected[1::3, 1::3], atol=2 / 255)  # the middles of faces


def test_a_face_without_its_material_has_the_last_one():
    low, high = zoo.plane("lo"), zoo.plane("hi")
    for name in ("a", "b"):
        high.data.materials.append(bpy.data.materials.new(name))
    high.data.polygons[0].material_index = 4
    report, found = bake(low, high, method="FLATTEN", maps=("MATERIAL_ID",))
    assert np.allclose(found["material_id"][..., :3], report.maps["material_id"]["colours"]["b"], atol=2 / 255)


def test_rays_follow_low_normals_where_the_cage_touches_the_low_mesh():
    """The left half of the cage is on the low mesh."""
    low, cage, high = zoo.plane("lo", 2), zoo.plane("cage", 2), zoo.plane("hi", slope=0.2)
    high.location.z = -0.3
    for vertex in cage.data.vertices:
        vertex.co.z = 0.25 * (vertex.co.x > 0.5)
    _, found = bake(low, high, cage=cage, method="CAST", space="OBJECT", max_distance=2.0)
    assert (found["normal"][..., 3] == 1.0).all()
    assert np.allclose(found["normal"][..., 0], 0.5 - 0.5 * 0.2 / np.hypot(0.2, 1.0), atol=1e-5)


def test_ignore_backfaces_measures_surfaces_outside():
    low, high = zoo.plane("lo"), zoo.plane("hi")
    high.location.z = 0.2
    report, found = bake(low, high, method="CAST", facing_only=True)
    assert report.distances["extrusion"] >= 0.2
    assert (found["normal"][..., 3] == 1.0).all()


def test_distances_are_measured_on_all_tiles():
    low, high = zoo.plane("lo", 2), zoo.plane("hi", 2)
    for obj in (low, high):
        move_uvs(obj, scale=(2.0, 1.0))
    for vertex in high.data.vertices:
        vertex.co.z = 0.3 * max(0.0, vertex.co.x)  # above the low mesh only on the second tile
    report, _ = bake(low, high, method="CAST", udim=True, storage="PACK")
    assert report.tiles == [1001, 1002]
    assert report.distances["extrusion"] > 0.3
    assert report.missed == 0.0


@pytest.mark.parametrize("scale", [1e-20, 1e5])
@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("space", ["TANGENT", "OBJECT", "WORLD"])
def test_the_scale_of_objects_does_not_change_the_map(method, space, scale):
    low, high = zoo.plane("lo"), zoo.plane("hi", slope=0.2)
    _, expected = bake(low, high, method=method, space=space)
    low.scale = high.scale = (scale,) * 3
    _, found = bake(low, high, method=method, space=space)
    assert np.allclose(found["normal"], expected["normal"], atol=1e-5)


# Maps other than the normal map


@pytest.mark.parametrize("name", ["HEIGHT", "DISPLACEMENT", "DISTANCE"])
def test_distances_are_empty_where_there_is_only_one_surface(name):
    """The high mesh covers the whole map, the low one its left half."""
    low, high = zoo.plane("lo"), zoo.plane("hi")
    move_uvs(low, scale=(0.5, 1.0))
    _, found = bake(low, high, method="FLATTEN", space="OBJECT", maps=(name, "POSITION"))
    assert np.array_equal(found[name.lower()][0, :, 3], np.repeat([1.0, 0.0], SIZE // 2))
    assert (found["position"][..., 3] == 1.0).all()


def test_rays_that_miss_do_not_count_in_the_mean():
    low, high = zoo.plane("lo"), zoo.plane("hi")
    high.scale.x, high.location.z = 0.5 + 1.0 / SIZE, 0.1  # ends in the middle of a texel
    _, found = bake(low, high, method="CAST", samples=64, maps=("HEIGHT", "COVERAGE"), **RAYS)
    assert ((found["coverage"][..., 0] > 0.4) & (found["coverage"][..., 0] < 0.6)).any()
    known = found["height"][..., 3] > 0.0
    assert np.allclose(found["height"][known, 0], 0.1, atol=1e-6)


def test_positions_of_a_tall_object_fit_into_whole_numbers():
    low, high = zoo.plane("lo"), zoo.plane("hi", slope=3.0)
    report, found = bake(low, high, method="FLATTEN", space="OBJECT", maps=("POSITION",), depth=8)
    how = report.maps["position"]
    z = found["position"][..., 2] * how["scale"] + how["offset"][2]
    assert np.allclose(z, 3.0 * (texel_uv(SIZE, SIZE)[..., 0] * 2 - 1), atol=0.51 * how["scale"] / 255)


@pytest.mark.parametrize("storage", ["PACK", "MEMORY"])
def test_images_of_16_bits_store_numbers_unchanged(storage):
    low, high = zoo.plane("lo"), zoo.plane("hi")
    high.location.z = -7.0
    report, found = bake(low, high, method="FLATTEN", maps=("HEIGHT",), depth=16, storage=storage)
    assert (report.maps["height"]["midlevel"], report.maps["height"]["scale"]) == (0.0, 1.0)
    assert np.allclose(found["height"][..., :3], -7.0)


def test_ids_are_not_dithered():
    low, high = zoo.plane("lo"), zoo.plane("hi")
    report, found = bake(low, high, method="FLATTEN", maps=("OBJECT_ID", "COVERAGE"), depth=8, dither=True, mask=True)
    assert len(np.unique(found["object_id"].reshape(-1, 4), axis=0)) == 1
    assert np.allclose(found["object_id"][0, 0, :3], report.maps["object_id"]["colours"]["hi"], atol=0.51 / 255)


def test_maps_of_few_values_take_few_bits():
    expected = map_names.settings_by_map(Settings(maps=("COVERAGE", "OBJECT_ID", "HEIGHT"), mask=True, depth=16))
    depths = {name: own.storing.depth for name, own in expected.items()}
    assert depths == {"NORMAL": 16, "MASK": 8, "COVERAGE": 8, "OBJECT_ID": 8, "HEIGHT": 16}


@pytest.mark.parametrize("blue", ["+Z", "-Z"])
@pytest.mark.parametrize("is_inside_out", [False, True])
def test_normals_that_point_inwards_raise_a_warning_whatever_is_in_blue(blue, is_inside_out):
    normals = np.tile((0.0, 0.0, -1.0 if is_inside_out else 1.0), (1, 4, 1))  # the faces point to the right side
    report, _ = bake(zoo.plane("lo"), zoo.plane("hi", normals=normals), method="CAST", blue=blue)
    assert any("normals point into" in warning for warning in report.warnings) == is_inside_out


# Tiles, bands and atlases


@pytest.mark.parametrize("tile", [1001, 1002, 1011, 1034])
@pytest.mark.parametrize("margin_type", ["EXTEND", "ADJACENT_FACES"])
def test_bands_of_any_tile_equal_those_of_the_first(in_bands, tile, margin_type):
    low, high = zoo.two_islands("lo", gap=0.5), zoo.two_islands("hi", gap=0.5)
    for obj in (low, high):
        move_uvs(obj, scale=(0.5, 0.5), offset=(0.25, 0.25))  # exact in single precision on all of these tiles
    high.rotation_euler = 0.2, 0.1, 0.0
    options = {"method": "FLATTEN", "margin": 8, "margin_type": margin_type}
    _, whole = bake(low, high, **options)
    for obj in (low, high):
        move_uvs(obj, offset=((tile - 1001) % 10, (tile - 1001) // 10))
    in_bands()
    settings = Settings(width=SIZE, height=SIZE, udim=True, tiles=(tile,), depth=32, image="tile", **options)
    bake_pair(bpy.context, low, [high], settings)
    assert np.allclose(pixels(bpy.data.images["tile"]), whole["normal"], atol=1e-5)


@pytest.mark.parametrize("size", [(64, 256), (256, 64)])
def test_bands_hold_each_row_once_and_few_texels(size, monkeypatch):
    monkeypatch.setattr(bands, "BAND_TEXELS", 4096)
    found = list(bands.bands(*size, 2))
    assert [row for band in found for row in range(band.start, band.stop)] == list(range(size[1]))
    assert {(band.stop - band.start) * band.width for band in found} == {4096}


def test_each_tile_has_only_its_own_seams():
    """Two tiles with seams at different positions: baked together, they equal single bakes."""
    low = zoo.cube("lo")
    uv = low.data.uv_layers[0].uv
    for face in low.data.polygons:
        for corner in face.loop_indices:
            u, v = uv[corner].vector
            uv[corner].vector = (u + 1.0, v * 0.7) if face.index % 2 else (u * 0.8, v)
    high = zoo.cube("hi", smooth=True)
    options = {"method": "CAST", "margin": 6, "margin_type": "ADJACENT_FACES", "udim": True, "storage": "PACK", **RAYS}
    for name, tiles in (("both", ()), ("first", (1001,)), ("second", (1002,))):
        settings = Settings(width=SIZE, height=SIZE, material=False, image=name, tiles=tiles, **options)
        bake_pair(bpy.context, low, [high], settings)

    def packed(name):
        return {part.tile_number: part.packed_file.data for part in bpy.data.images[name].packed_files}

    assert packed("both") == {1001: packed("first")[1001], 1002: packed("second")[1002]}


def atlas(names=("a", "b"), **settings):
    """The texels of a shared image for two terrains side by side, and those of the other maps."""
    jobs = []
    for number, name in enumerate(names):
        low, high = zoo.plane(f"{name}_low"), zoo.terrain(f"{name}_high", n=8)
        for obj in (low, high):
            # The meshes cover rows 12 to 38: the margin below and above is on other bands of 10 rows.
            move_uvs(obj, scale=(0.375, 0.55), offset=(0.03125 + 0.5 * number, 0.25))
        high.data.materials.append(bpy.data.materials.new(name))
        jobs.append(Job(low, [high]))
    image = f"atlas of {' '.join(names)}"  # texels in an image of others would stay theirs
    values = {"method": "FLATTEN", "depth": 32, "storage": "MEMORY", "material": False, "image": image}
    reports = bake_all(bpy.context, jobs, Settings(width=SIZE, height=SIZE, **values | settings), share_image=True)
    beside = {name: pixels(bpy.data.images[found["image"]]) for name, found in reports[0].maps.items()}
    return reports[0], {"normal": pixels(bpy.data.images[image]), **beside}


@pytest.mark.parametrize("margin", [0, 3])
def test_an_atlas_in_bands_equals_the_whole_one(in_bands, margin):
    _, whole = atlas(margin=margin)
    in_bands()
    _, banded = atlas(("c", "d"), margin=margin)
    assert np.count_nonzero(whole["normal"][..., 3]) > 800
    assert np.allclose(whole["normal"], banded["normal"], atol=1e-6)


def test_materials_of_an_atlas_are_numbered_together():
    report, found = atlas(maps=("MATERIAL_ID",), margin=0)
    colors = report.maps["material_id"]["colours"]
    assert list(colors) == ["a", "b"]
    left, right = found["material_id"][SIZE // 2, [8, SIZE - 12], :3]
    assert np.allclose([left, right], [colors["a"], colors["b"]], atol=2 / 255)


def test_a_high_object_of_two_jobs_has_one_number_in_their_atlas():
    high = zoo.plane("hi")
    jobs = [Job(zoo.plane("a"), [high]), Job(zoo.plane("b"), [zoo.plane("other"), high])]
    for number, job in enumerate(jobs):
        move_uvs(job.low, scale=(0.5, 1.0), offset=(0.5 * number, 0.0))
    jobs[1].highs[0].location.z = -0.01
    settings = Settings(
        width=SIZE, height=SIZE, method="CAST", storage="MEMORY", image="atlas", maps=("OBJECT_ID",), margin=0
    )
    report = bake_all(bpy.context, jobs, settings, share_image=True)[0]
    found, colors = pixels(bpy.data.images["atlas_object_id"]), report.maps["object_id"]["colours"]
    assert list(colors) == ["hi", "other"]
    assert np.allclose(found[..., :3], colors["hi"], atol=2 / 255)


def test_high_objects_with_the_same_name_have_different_colors(tmp_path):
    """One of the objects is linked from a library."""
    zoo.plane("hi")
    bpy.data.libraries.write(str(tmp_path / "library.blend"), {bpy.data.objects["hi"]})
    with bpy.data.libraries.load(str(tmp_path / "library.blend"), link=True) as (_, expected):
        expected.objects = ["hi"]
    bpy.context.scene.collection.objects.link(expected.objects[0])
    highs = [bpy.data.objects["hi", None], expected.objects[0]]
    highs[0].location.x = 1.0
    report, found = bake(zoo.plane("lo"), *highs, method="CAST", maps=("OBJECT_ID",))
    assert list(report.maps["object_id"]["colours"]) == ["hi"]
    assert len(np.unique(found["object_id"][..., :3].reshape(-1, 3), axis=0)) == 2


def test_an_atlas_is_not_sampled_again(monkeypatch):
    seen, bind = [], target.bind

    def counting(compiled, program, **bindings):
        seen.append(program.compute or program.fragment)
        return bind(compiled, program, **bindings)

    monkeypatch.setattr(target, "bind", counting)
    atlas(samples=4, adaptive=False)
    assert seen.count("bake/accumulate_comp.glsl") == 2 * 4  # each object once


@pytest.mark.parametrize("dither", [False, True])
def test_only_8_bits_are_dithered_and_only_integers_lose_precision(dither):
    texels = np.full((16, 16, 4), 0.3, np.float32)
    for depth, values, is_lossy in ((8, 2 if dither else 1, True), (16, 1, False), (32, 1, False)):
        settings = Settings(width=16, height=16, depth=depth, dither=dither, image="map", storage="MEMORY")
        with outputs.MapWriter("lo", settings, is_normal=True) as writer:
            writer.add(1001, texels)
            assert bool(writer.loss) == is_lossy
            assert len(np.unique(pixels(writer.commit())[..., 0])) == values


def test_the_loss_includes_all_tiles():
    settings = Settings(width=16, height=16, udim=True, depth=8, image="map")
    exact, rough = np.ones((16, 16, 4), np.float32), np.random.default_rng(0).random((16, 16, 4), np.float32)
    rough[..., 3] = 1.0
    with outputs.MapWriter("lo", settings, is_normal=True) as writer:
        writer.add(1001, rough)
        writer.add(1002, exact)
        assert writer.loss["maximum"] > 0.1
