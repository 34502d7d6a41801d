# SPDX-License-Identifier: GPL-3.0-or-later
"""Cast at high meshes whose triangles are in parts, compared to the bit with the same bake in one part."""

import itertools
from dataclasses import replace

import bpy
import numpy as np
import pytest

from addon.core.errors import BakeError
from addon.core.map_types import OTHERS, Family
from addon.core.progress import Pace
from addon.core.settings import Settings
from addon.engine import bands
from addon.engine.rays import part_tables, tree_cache
from addon.jobs import Job, bake_all, bake_jobs, bake_pair
from addon.jobs.live_session import Session
from addon.mesh.spatial import bvh, tree_parts
from addon.passes.bake import cast
from tests.support import layered_scenes, maps, zoo
from tests.support.snapshot import difference, snapshot

pytestmark = pytest.mark.usefixtures("gpu_context")

RULES = ["OWN", "NEAREST", "OUTERMOST"]


@pytest.fixture
def in_parts(monkeypatch):
    """A function that limits parts to so many triangles, and the memory of those that stay to so many bytes."""

    def limit(triangles, kept=2**30):
        tree_cache.trees.free()
        monkeypatch.setattr(tree_cache, "most_in_one_part", lambda: triangles)
        monkeypatch.setattr(part_tables, "KEPT_BYTES", kept)

    yield limit
    tree_cache.trees.free()


def layers(n=24):
    """A plane, and two crossing terrains of n x n quads above and below it, the second with its back up."""
    low, first, second = zoo.plane("low"), zoo.terrain("first", n), zoo.terrain("second", n, waves=3)
    second.location = (0.05, 0.02, 0.04)
    second.scale = (1.0, -1.0, 1.0)
    bpy.context.view_layer.update()
    return low, first, second


@pytest.mark.parametrize("rule", RULES)
@pytest.mark.parametrize(
    "options", [{}, {"samples": 4, "adaptive": False}, {"samples": 16}, {"facing_only": True}], ids=str
)
def test_a_map_from_parts_is_the_map_from_one(in_parts, rule, options):
    low, *highs = layers()
    wanted = maps.bake(low, *highs, method="CAST", hit=rule, **options)
    in_parts(500)
    assert np.array_equal(maps.bake(low, *highs, method="CAST", hit=rule, **options), wanted)
    assert tree_cache.trees.scenes[-1].tables.count == 5
    assert len(np.unique(wanted)) > 1000


def texels_or_message(low, highs, settings):
    try:
        bake_pair(bpy.context, low, highs, settings)
    except BakeError as error:
        return str(error)
    return maps.pixels(bpy.data.images["map"])


@pytest.mark.parametrize("seed", range(30))
def test_random_layers_in_parts_bake_as_in_one_seed_0_to_29(in_parts, seed):
    low, highs, settings = layered_scenes.make(seed)
    settings = replace(settings, method="CAST", maps=())
    wanted = texels_or_message(low, highs, settings)
    in_parts(40)
    assert np.array_equal(texels_or_message(low, highs, settings), wanted)


def test_bands_of_a_map_in_parts(in_parts, monkeypatch):
    low, *highs = layers()
    monkeypatch.setattr(bands, "BAND_TEXELS", 64 * 16)
    wanted = maps.bake(low, *highs, method="CAST", margin=4)
    in_parts(500)
    assert np.array_equal(maps.bake(low, *highs, method="CAST", margin=4), wanted)


def test_tiles_and_a_cage_in_parts(in_parts):
    low, *highs = layers()
    cage = zoo.plane("cage")
    cage.location.z = 0.3
    bpy.context.view_layer.update()
    low.data.uv_layers[0].uv[2].vector = 2.0, 1.0  # onto a second tile
    options = {"udim": True, "storage": "PACK", "material": False}
    packed = []
    for name in ("one", "parts"):
        settings = Settings(method="CAST", width=32, height=32, image=name, **options)
        bake_pair(bpy.context, low, highs, settings, cage)
        packed.append([part.packed_file.data for part in bpy.data.images[name].packed_files])
        in_parts(500)
    assert len(packed[0]) == 2
    assert packed[0] == packed[1]


def test_the_report_of_parts_is_that_of_one(in_parts):
    low, *highs = layers()
    found = []
    for _ in range(2):
        report = bake_pair(
            bpy.context, low, highs, Settings(method="CAST", width=64, height=64, storage="MEMORY")
        ).to_dict()
        found.append({key: value for key, value in report.items() if key not in {"seconds", "startup", "image"}})
        in_parts(500)
    assert found[0] == found[1]
    assert found[0]["checks"]["unsure"]["of"] > 0


@pytest.fixture
def built(monkeypatch):
    """A list of the triangles that each table has, from now on."""
    counts, upload = [], cast.upload

    def noted(nodes, points, vertices, *arguments, **options):
        counts.append(len(vertices))
        return upload(nodes, points, vertices, *arguments, **options)

    monkeypatch.setattr(cast, "upload", noted)
    return counts


RAYS = {"method": "CAST", "extrusion": 0.5, "max_distance": 1.0}


def test_parts_that_fit_in_memory_are_built_once(in_parts, built):
    low, *highs = layers()
    in_parts(500)
    maps.bake(low, *highs, samples=4, adaptive=False, **RAYS)
    assert sorted(built) == [304, 500, 500, 500, 500]  # two terrains of 24 x 24 quads


def test_parts_that_do_not_fit_are_built_again_and_those_in_memory_come_first(in_parts, built, monkeypatch):
    low, *highs = layers()
    wanted = maps.bake(low, *highs, samples=4, adaptive=False, **RAYS)
    built.clear()
    in_parts(500, kept=1)
    asked, parts = [], part_tables.PartTables.parts
    monkeypatch.setattr(part_tables.PartTables, "parts", lambda self: asked.append(self) or parts(self))
    assert np.array_equal(maps.bake(low, *highs, samples=4, adaptive=False, **RAYS), wanted)
    assert len(asked) >= 4  # for the samples, and for checks
    assert len(built) == 5 + 4 * (len(asked) - 1)


def test_parts_that_are_built_again_count_for_the_bake_that_does_it(in_parts):
    low, *highs = layers()
    in_parts(500, kept=1)
    settings = Settings(method="CAST", width=32, height=32, storage="MEMORY", material=False)
    first = bake_pair(bpy.context, low, highs, settings)
    before = dict(first.seconds)
    tables = tree_cache.trees.scenes[-1].tables
    timings = tables.timings
    second = bake_pair(bpy.context, low, highs, settings)
    assert tree_cache.trees.scenes[-1].tables is tables
    assert tables.timings is not timings
    assert second.seconds["upload"] > 0.0
    assert first.seconds == before


def test_the_order_of_parts_does_not_matter(in_parts, monkeypatch):
    low, *highs = layers()
    wanted = maps.bake(low, *highs, samples=4, **RAYS)
    parts = part_tables.PartTables.parts
    monkeypatch.setattr(part_tables.PartTables, "parts", lambda self: reversed(list(parts(self))))
    in_parts(300)
    assert np.array_equal(maps.bake(low, *highs, samples=4, **RAYS), wanted)


def test_progress_goes_on_while_parts_are_cast_at(in_parts):
    low, *highs = layers()
    in_parts(300)
    settings = Settings(method="CAST", width=64, height=64, storage="MEMORY", material=False)
    steps = []
    bake_all(bpy.context, [Job(low, highs)], settings, on_progress=lambda step: steps.append(step.done))
    assert steps == sorted(steps)
    assert len(set(steps)) > 8


POINT_MAPS = [map_type.name for map_type in OTHERS if map_type.family is Family.POINTS]


@pytest.mark.parametrize("rule", RULES)
@pytest.mark.parametrize("samples", [1, 4])
def test_points_and_numbers_from_parts_are_those_from_one(in_parts, rule, samples):
    low, *highs = layers()
    for number, high in enumerate(highs):
        for name in "ab":
            high.data.materials.append(bpy.data.materials.new(f"{name} {number}"))
        high.data.polygons.foreach_set("material_index", np.arange(len(high.data.polygons)) % 2)
    options = {"method": "CAST", "hit": rule, "samples": samples}
    _, wanted = maps.bake_all_maps(low, *highs, maps=POINT_MAPS, **options)
    in_parts(300)
    _, found = maps.bake_all_maps(low, *highs, maps=POINT_MAPS, **options)
    assert len(wanted) == len(POINT_MAPS)
    for name, texels in wanted.items():
        assert np.array_equal(found[name], texels), name
    assert len(np.unique(wanted["position"])) > 1000
    assert len(np.unique(wanted["material_id"].reshape(-1, 4), axis=0)) > 2


@pytest.mark.parametrize("name", ["AO", "BENT_NORMAL", "THICKNESS", "CURVATURE", "BASE_COLOR", "ATTRIBUTE"])
def test_maps_that_need_all_triangles_at_once_are_refused_before_a_part_is_built(in_parts, built, name):
    low, *highs = layers()
    in_parts(500)
    with pytest.raises(BakeError, match=r"2,304 triangles together; maps of materials, .* take 500 on this GPU"):
        maps.bake_all_maps(low, *highs, maps=[name], method="CAST")
    assert built == []


def test_texture_sets_in_parts(in_parts):
    _, *highs = layers()
    low = zoo.plane("low of sets", 2)
    for name in "ab":
        low.data.materials.append(bpy.data.materials.new(name))
    low.data.polygons.foreach_set("material_index", np.arange(len(low.data.polygons)) % 2)
    settings = Settings(method="CAST", width=32, height=32, storage="MEMORY", texture_sets=True, maps=("HEIGHT",))
    found = []
    for _ in range(2):
        reports = bake_all(bpy.context, [Job(low, highs)], settings)
        images = [[report.image, report.maps["height"]["image"]] for report in reports]
        found.append([maps.pixels(bpy.data.images[name]).copy() for names in images for name in names])
        in_parts(500)
    assert len(found[0]) == 4
    assert all(map(np.array_equal, *found))
    assert not np.array_equal(found[0][0], found[0][2])


def test_a_bake_in_parts_may_end_at_each_step(in_parts, tmp_path):
    """It leaves nothing, and the parts that it has built are whole: later bakes take them."""
    low, *highs = layers()
    options = {"width": 32, "height": 32, "samples": 4, "maps": ("HEIGHT",), "material": False}
    bake_pair(bpy.context, low, highs, Settings(method="CAST", image="map", storage="MEMORY", **options))
    wanted = maps.pixels(bpy.data.images["map"])
    bpy.data.images.remove(bpy.data.images["map"])
    settings = Settings(method="CAST", storage="FILE", output=str(tmp_path / "map.png"), **options)
    before, number, ended = snapshot(), 0, 0
    in_parts(500)
    while True:
        if not ended % 3:
            in_parts(500)  # the parts are built again, some of them before the end
        work = bake_jobs.work(bpy.context, [Job(low, highs)], settings, Pace(0.0))
        if len(list(itertools.islice(work, number + 1))) <= number:
            break  # it was finished
        work.close()
        assert difference(before, snapshot()) == {}
        assert not list(tmp_path.iterdir())
        ended, number = ended + 1, number + 1 + number // 4
    assert ended > 8
    bake_pair(bpy.context, low, highs, Settings(method="CAST", image="map", storage="MEMORY", **options))
    assert np.array_equal(maps.pixels(bpy.data.images["map"]), wanted)


@pytest.mark.parametrize("name", ["HEIGHT", "BASE_COLOR"])
def test_flatten_says_that_other_maps_need_all_triangles_at_once(in_parts, name):
    low, *highs = layers()
    in_parts(500)
    with pytest.raises(
        BakeError, match="2,304 triangles together; by Flatten, other maps than the normal map, .* take 500"
    ):
        maps.bake_all_maps(low, *highs, maps=[name], method="FLATTEN")
    assert maps.bake(low, *highs, method="FLATTEN").any()


def test_live_in_parts_shows_the_map_of_one(in_parts):
    low, *highs = layers()
    settings = Settings(method="CAST", width=64, height=64, storage="MEMORY", modifiers="VIEWPORT", material=False)
    found = []
    for _ in range(2):
        session = Session(bpy.context, Job(low, highs), settings, Pace())
        session.run(bpy.context)
        found.append(session.texels.copy())
        session.free()
        in_parts(500)
    assert np.array_equal(*found)


def test_more_triangles_than_hits_can_number_are_refused(in_parts, monkeypatch):
    low, *highs = layers()
    in_parts(500)
    monkeypatch.setattr(tree_cache, "MOST_TRIANGLES", 2000)
    with pytest.raises(BakeError, match=r"2,304 triangles together; rays take 2,000"):
        maps.bake(low, *highs, method="CAST")


@pytest.mark.parametrize("count", [5, 64, 1000])
def test_the_order_of_blocks_is_that_of_one_tree_seed_7(count, monkeypatch):
    monkeypatch.setattr(tree_parts, "BLOCK", 64)
    points = np.random.default_rng(7).random((count, 3)).astype(np.float32)
    triangles = np.random.default_rng(7).integers(0, count, (count, 3))
    tree = bvh.build(points, triangles)
    order, grid = tree_parts.order(points, triangles.__getitem__, count)
    assert np.array_equal(order, tree.order)
    nodes, first_leaf = tree_parts.nodes(points, triangles[order], grid)
    assert first_leaf == tree.first_leaf
    assert np.array_equal(nodes.view(np.uint32), tree.nodes.view(np.uint32))
    assert np.array_equal((grid.origin, grid.scale), (tree.origin, tree.scale))
