# SPDX-License-Identifier: GPL-3.0-or-later
"""The maps other than the normal map, compared with closed forms: positions, heights, distances, IDs."""

import bmesh
import bpy
import numpy as np
import pytest

from addon.core import map_types
from addon.core.errors import BakeError
from addon.core.map_types import BY_NAME
from addon.core.settings import Settings
from addon.engine.ray_maps import meanings
from addon.jobs import Job, bake_all, bake_pair
from addon.mesh.local_space import LocalSpace
from addon.output import value_encoding
from tests.support import lanes, zoo
from tests.support.manual import encodings
from tests.support.maps import pixels, texel_uv

pytestmark = pytest.mark.usefixtures("gpu_context")


HEIGHT, WAVES, SCALE, PLACE = 0.1, 2, 2.0, (3.0, 4.0, 5.0)
TRIANGLES = 1e-3
"""The most that 128 quads of flat triangles may differ from the closed form, in the object's units."""


def expected_height(size):
    """The terrain's height (N, N) at the texels' centers, in the object's units."""
    u, v = np.moveaxis(texel_uv(size, size), -1, 0)
    return HEIGHT * np.sin(2 * np.pi * WAVES * u) * np.sin(2 * np.pi * WAVES * v)


def pair():
    """A plane and a terrain over it, with the same location and scale."""
    low, high = zoo.plane("lo"), zoo.terrain("hi", n=128, height=HEIGHT, waves=WAVES)
    for obj in (low, high):
        obj.location, obj.scale = PLACE, (SCALE,) * 3
    return low, high


def bake(low, *highs, maps=map_types.NAMES, size=64, **settings):
    """The report and the maps by name, as arrays."""
    values_ = {
        "method": "FLATTEN",
        "depth": 32,
        "storage": "MEMORY",
        "material": False,
        "margin": 0,
        "rays": 16,
        **settings,
    }
    report = bake_pair(
        bpy.context, low, highs, Settings(width=size, height=size, image="map", maps=tuple(maps), **values_)
    )
    return report, {name: pixels(bpy.data.images[found["image"]]) for name, found in report.maps.items()}


@pytest.mark.parametrize(("method", "space"), [("FLATTEN", "TANGENT"), ("CAST", "OBJECT"), ("FLATTEN", "WORLD")])
@pytest.mark.parametrize("samples", lanes.slow_but([1], [1, 4]))
def test_distances_and_positions_match_the_surface(method, space, samples):
    report, maps = bake(*pair(), method=method, space=space, samples=samples)
    z = expected_height(64)
    assert set(maps) == {name.lower() for name in map_types.NAMES}
    assert np.abs(maps["height"][..., 0] - SCALE * z).max() < SCALE * TRIANGLES
    # Samples are on both sides of zero, where distances must not cancel out.
    assert np.abs(maps["distance"][..., 0] - SCALE * np.abs(z)).max() < SCALE * (TRIANGLES if samples == 1 else 0.01)
    place = np.concatenate([texel_uv(64, 64) * 2 - 1, z[..., None]], axis=-1)
    separation = np.stack([0 * z, 0 * z, z], axis=-1)
    if space == "WORLD":
        place, separation = place * SCALE + PLACE, separation * SCALE
    assert np.abs(maps["position"][..., :3] - place).max() < SCALE * TRIANGLES
    assert np.abs(maps["displacement"][..., :3] - separation).max() < SCALE * TRIANGLES
    assert all((texels[..., 3] == 1.0).all() for texels in maps.values())
    assert report.maps["height"]["scale"] == 1.0


@pytest.mark.parametrize(("ending", "depth"), [(".png", 16), (".exr", 32)])
def test_the_report_has_the_range_to_decode_the_file(tmp_path, ending, depth):
    report, maps = bake(*pair(), storage="FILE", output=str(tmp_path / f"map{ending}"), depth=depth, space="WORLD")
    z = expected_height(64) * SCALE
    expected = {
        "height": z[..., None],
        "distance": np.abs(z)[..., None],
        "displacement": np.stack([0 * z, 0 * z, z], axis=-1),
        "position": np.concatenate([(texel_uv(64, 64) * 2 - 1) * SCALE, z[..., None]], axis=-1) + PLACE,
    }
    for name, value in expected.items():
        how = report.maps[name]
        found = (maps[name][..., : value.shape[-1]] - how["midlevel"]) * how["scale"] + how.get("offset", 0.0)
        step = 0.5 * how["scale"] / (2**depth - 1) if ending == ".png" else 0.0
        assert np.abs(found - value).max() < step + SCALE * TRIANGLES, name
        assert (tmp_path / f"map_{name}{ending}").is_file()


@pytest.mark.parametrize(("depth", "step"), [(8, 1 / 255), (32, 0.0)])
def test_a_displace_modifier_with_the_scale_of_the_bake_makes_the_high_surface(depth, step):
    """The strength is in the object's units, the map in those of the scene."""
    low, high = pair()
    report, _ = bake(low, high, maps=["HEIGHT"], depth=depth, size=128)
    how = report.maps["height"]
    fine = zoo.plane("fine", n=32)
    fine.location, fine.scale = low.location, low.scale
    modifier = fine.modifiers.new("Displace", "DISPLACE")
    modifier.texture = bpy.data.textures.new("height", "IMAGE")
    modifier.texture.image = bpy.data.images[how["image"]]
    modifier.texture.extension = "EXTEND"
    modifier.texture_coords, modifier.mid_level, modifier.strength = "UV", how["midlevel"], how["scale"] / SCALE
    data = fine.evaluated_get(bpy.context.evaluated_depsgraph_get()).data
    x, y, z = np.array([vertex.co for vertex in data.vertices]).T
    expected = HEIGHT * np.sin(np.pi * WAVES * (x + 1)) * np.sin(np.pi * WAVES * (y + 1))
    inner = (np.abs(x) < 0.95) & (np.abs(y) < 0.95)
    assert np.abs(z - expected)[inner].max() < 0.02 * HEIGHT + step * how["scale"] / SCALE
    assert np.abs(z[inner]).max() > 0.9 * HEIGHT


@pytest.mark.slow
def test_curvature_at_the_corner_of_a_cube_is_beyond_1_in_floats_alone():
    low, high = zoo.cube("lo", gap=0.0), zoo.cube("hi", gap=0.0)
    maps = ["CURVATURE", "CONVEXITY"]
    options = {
        "maps": maps,
        "method": "CAST",
        "size": 192,
        "rays": 512,
        "distance_unit": "SCENE",
        "curvature_radius": 0.5,
    }
    _, floats = bake(low, high, **options)
    _, steps = bake(low, high, depth=8, **options)
    assert floats["curvature"][..., 0].max() == pytest.approx(1.25, abs=0.06)
    assert floats["convexity"][..., 0].max() == pytest.approx(1.5, abs=0.12)
    assert (steps["curvature"][..., 0].max(), steps["convexity"][..., 0].max()) == (1.0, 1.0)


@pytest.mark.parametrize("distance", [1_000.0, 100_000.0])
def test_positions_far_from_the_origin_are_exact_in_files_of_floats(tmp_path, distance):
    """16-bit floats have steps of half a unit at 1,000 units, and end at 65,504."""
    low, high = pair()
    for obj in (low, high):
        obj.location.x += distance
    _, maps = bake(low, high, maps=["POSITION"], storage="FILE", output=str(tmp_path / "map.exr"), space="WORLD")
    expected = (texel_uv(64, 64) * 2 - 1) * SCALE + PLACE[:2] + (distance, 0.0)
    error = np.abs(maps["position"][..., :2] - expected).max()
    assert error <= np.spacing(np.float32(distance * 2)) + SCALE * TRIANGLES


@pytest.mark.parametrize("height", [-0.35, 0.35], ids=["below", "above"])
@pytest.mark.parametrize("name", ["HEIGHT", "DISPLACEMENT"])
def test_integers_store_ranges_that_are_not_symmetric(name, height):
    low, high = zoo.plane("lo"), zoo.plane("hi", slope=0.45)
    high.location.z = height
    report, maps = bake(low, high, maps=[name], depth=8, size=32)
    how = report.maps[name.lower()]
    found = (maps[name.lower()][..., 0 if name == "HEIGHT" else 2] - how["midlevel"]) * how["scale"]
    expected = height + 0.45 * (texel_uv(32, 32)[..., 0] * 2 - 1)
    assert np.abs(found - expected).max() <= 0.51 * how["scale"] / 255


@pytest.mark.parametrize("method", ["FLATTEN", "CAST"])
@pytest.mark.parametrize(("border", "owner"), [(0.25, "right"), (0.75, "left")])
def test_a_texel_belongs_to_the_object_at_its_center(method, border, owner):
    """Two planes that meet inside column 16, not at its center."""
    low, edge = zoo.plane("lo"), (16 + border) / 32
    for name, start, stop in (("left", 0.0, edge), ("right", edge, 1.0)):
        u = np.array([start, stop, stop, start])
        uv = np.stack([u, [0, 0, 1, 1]], axis=1)
        zoo.build(name, np.pad(uv * 2 - 1, ((0, 0), (0, 1))), [range(4)], uv[None])
    highs = bpy.data.objects["left"], bpy.data.objects["right"]
    report, maps = bake(low, *highs, method=method, maps=["OBJECT_ID"], size=32, samples=16)
    colors = report.maps["object_id"]["colours"]
    assert np.allclose(maps["object_id"][:, 16, :3], colors[owner], atol=2 / 255)
    assert np.allclose(maps["object_id"][:, 15, :3], colors["left"], atol=2 / 255)
    assert np.allclose(maps["object_id"][:, 17, :3], colors["right"], atol=2 / 255)


@pytest.mark.parametrize("method", ["FLATTEN", "CAST"])
def test_objects_and_materials_have_their_own_colors(method):
    low = zoo.plane("lo", n=2)
    half = zoo.plane("left", n=2)
    other = zoo.plane("right", n=2)
    for obj, keep in ((half, 0), (other, 1)):
        for name in ("moss", "stone"):
            obj.data.materials.append(bpy.data.materials.get(name) or bpy.data.materials.new(name))
        obj.data.polygons.foreach_set("material_index", np.array([0, 0, 1, 1]))
        # Left and right halves: the columns of the 2 x 2 quads.
        mesh = bmesh.new()
        mesh.from_mesh(obj.data)
        mesh.faces.ensure_lookup_table()
        bmesh.ops.delete(mesh, geom=[mesh.faces[i] for i in (1 - keep, 3 - keep)], context="FACES")
        mesh.to_mesh(obj.data)
        mesh.free()
    report, maps = bake(low, half, other, method=method, maps=["OBJECT_ID", "MATERIAL_ID"], size=32, samples=4)
    colors = report.maps["object_id"]["colours"]
    assert list(colors) == ["left", "right"]
    assert np.allclose(maps["object_id"][:, :16, :3], colors["left"], atol=2 / 255)
    assert np.allclose(maps["object_id"][:, 16:, :3], colors["right"], atol=2 / 255)
    colors = report.maps["material_id"]["colours"]
    assert list(colors) == ["moss", "stone"]
    assert np.allclose(maps["material_id"][:16, :, :3], colors["moss"], atol=2 / 255)
    assert np.allclose(maps["material_id"][16:, :, :3], colors["stone"], atol=2 / 255)


def test_coverage_is_the_covered_share_of_a_texel(tmp_path):
    """A high mesh over u < 1/2 + 1/4 texel: one or none of the four samples of a texel at its border hits."""
    low, high = zoo.plane("lo"), zoo.plane("hi")
    layer = high.data.uv_layers[0].uv
    uv = np.empty(len(layer) * 2, np.float32)
    layer.foreach_get("vector", uv)
    layer.foreach_set("vector", (uv.reshape(-1, 2) * (0.5 + 0.5 / 32, 1.0)).ravel())
    _, maps = bake(low, high, maps=["COVERAGE"], size=32, samples=64, storage="MEMORY")
    cover = maps["coverage"][..., 0]
    assert (cover[:, :16] == 1.0).all() and (cover[:, 17:] == 0.0).all()
    assert np.allclose(cover[:, 16], 0.5, atol=1 / 64)


def test_values_in_an_atlas_stay_with_their_objects():
    lows = [zoo.plane(f"{name}_low") for name in "ab"]
    highs = [zoo.plane(f"{name}_high") for name in "ab"]
    for number, (low, high) in enumerate(zip(lows, highs, strict=True)):
        high.location.z = 0.1 * (number + 1)
        for obj in (low, high):
            layer = obj.data.uv_layers[0].uv
            uv = np.empty(len(layer) * 2, np.float32)
            layer.foreach_get("vector", uv)
            layer.foreach_set("vector", (uv.reshape(-1, 2) * (0.4, 1.0) + (0.55 * number, 0.0)).ravel())
    jobs = [Job(low, [high]) for low, high in zip(lows, highs, strict=True)]
    settings = Settings(
        method="FLATTEN", width=32, height=32, image="atlas", maps=("HEIGHT", "OBJECT_ID"), depth=32, storage="MEMORY"
    )
    reports = bake_all(bpy.context, jobs, settings, share_image=True)
    height, owner = (pixels(bpy.data.images[reports[0].maps[name]["image"]]) for name in ("height", "object_id"))
    assert np.allclose(height[:, :12, 0], 0.1, atol=1e-6)
    assert np.allclose(height[:, 18:30, 0], 0.2, atol=1e-6)
    colors = reports[1].maps["object_id"]["colours"]
    assert list(colors) == ["a_high", "b_high"]
    assert np.allclose(owner[:, :12, :3], colors["a_high"], atol=2 / 255)
    assert np.allclose(owner[:, 18:30, :3], colors["b_high"], atol=2 / 255)


def test_colors_differ():
    colors = np.array([value_encoding.color(number) for number in range(40)])
    distances = np.abs(colors[:, None] - colors[None]).max(axis=-1) + np.eye(40)
    assert distances.min() > 0.04


def test_missed_texels_have_no_object():
    low, high = zoo.plane("lo"), zoo.plane("hi")
    high.scale.x = 0.5
    rays = {"method": "CAST", "extrusion": 0.1, "max_distance": 0.2, "missed": (1.0, 0.0, 0.0)}
    _, maps = bake(low, high, maps=["OBJECT_ID", "HEIGHT"], size=32, **rays)
    missed = maps["object_id"][..., 3] == 0.0
    assert missed.sum() == 16 * 32
    assert (maps["object_id"][missed] == 0.0).all()
    assert (maps["height"][missed] == 0.0).all()


@pytest.mark.parametrize(
    ("names", "case_settings"),
    [
        (("a_low", "b_low"), {"image": "Normal", "output": "{low}.png"}),
        (("rock", "rock_height"), {"output": "{low}.png", "maps": ("HEIGHT",)}),
    ],
)
def test_two_bakes_share_no_image_and_no_file(tmp_path, names, case_settings):
    jobs = [Job(zoo.plane(name), [zoo.plane(f"high of {name}")]) for name in names]
    settings = {**case_settings, "output": str(tmp_path / case_settings["output"]), "storage": "FILE"}
    with pytest.raises(BakeError, match="would both"):
        bake_all(bpy.context, jobs, Settings(method="FLATTEN", width=32, height=32, **settings))
    assert list(tmp_path.iterdir()) == []


# Decoding table


def test_the_table_of_encodings_has_the_scales_of_reports():
    lengths = {"distance_unit": "SCENE", "curvature_radius": 0.5, "thickness_distance": 0.25}
    settings = Settings(maps=("CURVATURE", "CONVEXITY", "CAVITY", "THICKNESS"), **lengths)
    scales = {
        "8 / (3 radii)": 16.0 / 3.0,
        "4 / (3 radii)": 8.0 / 3.0,
        "-4 / (3 radii)": -8.0 / 3.0,
        "The thickness distance": 0.25,
    }
    found = meanings(settings, LocalSpace(np.zeros(3), 1.0))
    assert len(found) == len(settings.map.maps)
    for name, how in found.items():
        midlevel, scale, _ = encodings()[BY_NAME[name].label]
        assert (float(midlevel), scales[scale]) == pytest.approx((how["midlevel"], how["scale"]))


def test_lights_change_no_map():
    low, high = pair()
    names = ["AO", "BASE_COLOR", "ROUGHNESS"]
    _, dark = bake(low, high, maps=names)
    sun = bpy.data.objects.new("sun", bpy.data.lights.new("sun", "SUN"))
    bpy.context.scene.collection.objects.link(sun)
    _, lit = bake(low, high, maps=names)
    assert set(dark) >= {name.lower() for name in names}
    for name, values in dark.items():
        assert np.array_equal(values, lit[name]), name
