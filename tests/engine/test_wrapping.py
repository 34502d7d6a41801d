# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests tiles that repeat: bakes onto a low mesh whose map wraps around."""

import bpy
import numpy as np
import pytest
from mathutils import Matrix

from addon.core import progress
from addon.core.errors import BakeError
from addon.core.map_types import NORMAL
from addon.core.settings import Run, Settings
from addon.engine import bands, margins
from addon.engine.baking import texels_of
from addon.engine.bands import DrawnMaps
from addon.jobs import Job, live_session
from addon.jobs.bake_jobs import bake_all
from tests.support import angles, scenes, zoo
from tests.support.maps import bake_all_maps, pixels, texel_uv

pytestmark = pytest.mark.usefixtures("gpu_context")

SIDE = 64
TILE = 2.0
"""The side of zoo.plane, in scene units."""
SNAP = 0.06
"""Degrees. A corner may be up to 1/512 texel off, on reliefs whose normals change by up to 20 degrees per texel."""
SAME = 1e-3
"""Degrees. Of a bent quad, Blender takes one normal to join those of vertices, and Imprint those of its two triangles."""
FAR = {"distance_unit": "SCENE", "ao_distance": 0.7, "thickness_distance": 0.4, "curvature_radius": 0.2, "rays": 64}
MAPS = ("AO", "BENT_NORMAL", "HEIGHT", "THICKNESS", "CURVATURE", "POSITION")


def relief(name="relief", tiles=1, n=48, height=0.12):
    """A relief that repeats, in no way symmetric at the borders, on the square of zoo.plane or on so many beside each other."""

    def surface(u, v):
        x, y = (tiles * (2 * each - 1) for each in (u, v))
        return np.stack([x, y, height_at(x, y, height)], axis=1)

    return zoo.sheet(name, surface, tiles * n, tiles * n)


def height_at(x, y, height=0.12):
    return height * (np.sin(np.pi * x + 0.7) * np.cos(np.pi * y - 0.4) + 0.5 * np.sin(2 * np.pi * (x + y) + 0.3))


def stone(at, name="stone", radius=0.3):
    ball = zoo.ball(name)
    ball.matrix_world = Matrix.Translation((*at, 0.1)) @ Matrix.Scale(radius, 4)
    return ball


def bake(low, *highs, maps=MAPS, **settings):
    """The maps by name, texels (SIDE, SIDE, 4); the normal map as normals in tangent space."""
    values = {"method": "AUTO", "size": SIDE, **FAR, **settings}
    report, found = bake_all_maps(low, *highs, maps=maps, **values)
    return report, found | {"normal": pixels(bpy.data.images["map"])}


def steps(texels, axis):
    """The largest change from texel to texel inside the map, and across its border."""
    change = np.abs(np.diff(texels, axis=axis, append=np.take(texels, [0], axis)))[..., :3].max(axis=-1)
    return np.take(change, range(SIDE - 1), axis).max(), np.take(change, SIDE - 1, axis).max()


def test_a_relief_equals_its_formula_up_to_the_border():
    _, found = bake(zoo.plane("lo"), relief(n=512), maps=("HEIGHT",), wrap="UV")
    x, y = np.moveaxis(TILE * texel_uv(SIDE, SIDE) - 1.0, -1, 0)
    step = 1e-4
    dx, dy = (
        (height_at(x + step * a, y + step * b) - height_at(x - step * a, y - step * b)) / (2 * step)
        for a, b in ((1, 0), (0, 1))
    )
    expected = np.stack([-dx, -dy, np.ones_like(dx)], axis=-1)
    expected /= np.linalg.norm(expected, axis=-1, keepdims=True)
    assert angles.degrees(angles.decode(found["normal"]), expected).max() < SNAP


@pytest.mark.parametrize("has_stones", [False, True])
@pytest.mark.parametrize("wrap", ["U", "V", "UV"])
def test_no_step_across_the_border_is_larger_than_inside(wrap, has_stones):
    stones = [stone((0.95, 0.9)), stone((-0.3, -0.97), "other")] if has_stones else []
    report, found = bake(zoo.plane("lo"), relief(), *stones, wrap=wrap)
    assert report.method == "CAST"
    assert report.repeats == {axis: [TILE * (axis == "u"), TILE * (axis == "v"), 0.0] for axis in wrap.lower()}
    assert f"Repeats {' and '.join(f'along {axis} by 2' for axis in wrap)}" in report.summary()
    for name in ("normal", "ao", "bent_normal", "height", "thickness", "curvature"):
        for axis in [1] * ("U" in wrap) + [0] * ("V" in wrap):
            inside, across = steps(found[name], axis)
            assert across <= inside, (name, axis)


def test_without_wrap_there_are_steps():
    _, found = bake(zoo.plane("lo"), relief(n=24))
    for name, least in (("normal", 1.2), ("ao", 1.0)):
        inside, across = steps(found[name], 1)
        assert across > least * inside, name


def test_it_equals_a_bake_of_tiles_made_by_hand():
    low, highs = zoo.plane("lo"), (relief(), stone((0.95, 0.9)))
    _, found = bake(low, *highs, wrap="UV")
    around = [(x, y) for x in (-TILE, 0.0, TILE) for y in (-TILE, 0.0, TILE)]
    by_hand = [relief("large", tiles=3), *(stone((0.95 + x, 0.9 + y), f"stone {x} {y}") for x, y in around)]
    _, expected = bake(low, *by_hand)
    assert angles.degrees(*(angles.decode(each["normal"]) for each in (found, expected))).max() < SAME
    for name in ("height", "position"):
        assert np.abs(found[name] - expected[name]).max() < 1e-5, name
    # Rays that pass an edge of a triangle may meet it in one tree and not in the other: of curvature, many do.
    for name, most in (("ao", 1e-4), ("bent_normal", 1e-4), ("thickness", 1e-4), ("curvature", 2e-3)):
        difference = found[name] - expected[name]
        assert np.abs(difference).mean() < most and np.abs(difference.mean()) < 1e-4, name


def test_smoothed_normals_go_on_in_the_next_tile():
    low = zoo.plane("lo")
    _, found = bake(low, relief(), maps=(), wrap="UV", smooth_high=3)
    _, expected = bake(low, relief("large", tiles=3), maps=(), smooth_high=3)
    assert angles.degrees(*(angles.decode(each["normal"]) for each in (found, expected))).max() < SAME


def test_what_moves_out_comes_in_again():
    low, highs = zoo.plane("lo"), (relief(), stone((0.5, 0.3)))
    maps, shift = ("HEIGHT", "BENT_NORMAL"), (16, 48)
    _, before = bake(low, *highs, maps=maps, wrap="UV")
    for high in highs:
        high.matrix_world = (
            Matrix.Translation((TILE * shift[0] / SIDE, TILE * shift[1] / SIDE, 0.0)) @ high.matrix_world
        )
    _, after = bake(low, *highs, maps=maps, wrap="UV")
    rolled = {name: np.roll(texels, shift[::-1], axis=(0, 1)) for name, texels in before.items()}
    assert np.abs(after["height"] - rolled["height"]).max() < 1e-5
    assert angles.degrees(angles.decode(after["normal"]), angles.decode(rolled["normal"])).max() < 0.02


def test_occlusion_without_a_distance_is_the_same_from_all_places():
    """A texel casts the same rays again 64 texels on. Against tiles to the horizon, occlusion lacks little."""
    low, high = zoo.plane("lo"), relief(n=32, height=0.4)
    free = {"maps": ("AO",), "ao_distance": None, "size": 128}
    _, found = bake(low, high, wrap="UV", **free)
    _, expected = bake(low, relief("large", tiles=9, n=32, height=0.4), **free)
    assert np.abs((found["ao"] - expected["ao"])[..., :3]).mean() < 2e-3
    high.matrix_world = Matrix.Translation((TILE / 2, TILE / 2, 0.0))
    _, moved = bake(low, high, wrap="UV", **free)
    difference = np.abs(moved["ao"] - np.roll(found["ao"], (64, 64), axis=(0, 1)))
    assert difference.mean() < 2e-4


def test_what_lies_some_tiles_away_comes_in():
    low, high, ball = zoo.plane("lo"), relief(n=8), stone((0.3, -0.2))
    _, expected = bake(low, high, ball, maps=("HEIGHT",), wrap="UV")
    ball.matrix_world = Matrix.Translation((3 * TILE, -4 * TILE, 0.0)) @ ball.matrix_world
    _, found = bake(low, high, ball, maps=("HEIGHT",), wrap="UV")
    assert np.abs(found["height"] - expected["height"]).max() < 1e-5


def test_margins_of_a_tile_repeat_the_nearest_texel():
    """Between two halves of a plane, Adjacent Faces would continue the other half."""
    low, high = zoo.plane("lo", n=2), relief()
    scenes.move_uvs(low, (1.0, 0.8), (0.0, 0.0), slice(0, 8))
    scenes.move_uvs(low, (1.0, 0.8), (0.0, 0.2), slice(8, 16))
    kinds = [{"margin_type": kind, "maps": (), "margin": 5} for kind in ("EXTEND", "ADJACENT_FACES")]
    one, other = (bake(low, high, wrap="U", **kind)[1]["normal"] for kind in kinds)
    assert np.array_equal(one, other)
    one, other = (bake(low, high, method="CAST", **kind)[1]["normal"] for kind in kinds)
    assert not np.array_equal(one, other)


@pytest.mark.parametrize("margin", [0, 5, None])
@pytest.mark.parametrize("rows", [None, 16])
def test_margins_come_in_from_the_other_side(margin, rows, monkeypatch):
    if rows:
        monkeypatch.setattr(bands, "BAND_TEXELS", SIDE * rows)
    random = np.random.default_rng(3)
    values = random.random((SIDE, SIDE, 4), np.float32)
    values[..., 3] = np.where(random.random((SIDE, SIDE)) < 0.01, 1.0, 0.0)
    settings = Settings(width=SIDE, height=SIDE, margin=margin, wrap="UV", space="OBJECT")

    def finished(values):
        steps = texels_of(DrawnMaps({NORMAL.name: values}), 1001, Run(settings), margins.for_maps([], settings))
        return progress.finish(steps)[NORMAL.name]

    texels, state = finished(values)
    shift = (21, 37)
    others, other_state = finished(np.roll(values, shift, axis=(0, 1)))
    assert np.array_equal(other_state, np.roll(state, shift, axis=(0, 1)))
    # Of two texels as near, either may be repeated.
    same = (others == np.roll(texels, shift, axis=(0, 1))).all(axis=-1)
    assert same.mean() > (0.9 if margin else 0.999)


def test_modifiers_of_the_low_object_make_a_tile():
    low = zoo.plane("lo")
    low.modifiers.new("Subdivision", "SUBSURF").subdivision_type = "SIMPLE"
    low.modifiers[0].levels = low.modifiers[0].render_levels = 6
    waves = low.modifiers.new("Waves", "WAVE")
    waves.height, waves.width, waves.narrowness, waves.use_normal = 0.1, 0.5, 3.0, False
    report, found = bake(low, low, maps=("AO",), wrap="UV")
    assert report.method == "CAST" and np.ptp(found["normal"][..., :2]) > 0.2
    for axis in (0, 1):
        inside, across = steps(found["normal"], axis)
        assert across <= inside


def test_strips_in_one_image_each_repeat():
    """Two strips of a trim sheet, above each other in the image."""
    lows = [moved_uvs((1.0, 0.5), (0.0, 0.5 * number), f"strip {number}") for number in range(2)]
    highs = [relief(f"{low.name} high") for low in lows]
    for number, obj in enumerate((*lows, *highs)):
        obj.location.z = number % 2 * 5.0
    chosen = Settings(
        width=SIDE, height=SIDE, wrap="U", method="CAST", image="both", depth=32, storage="MEMORY", material=False
    )
    jobs = [Job(low, [high]) for low, high in zip(lows, highs, strict=True)]
    bake_all(bpy.context, jobs, chosen, share_image=True)
    inside, across = steps(pixels(bpy.data.images["both"]), 1)
    assert across <= inside


def test_what_comes_in_brings_its_materials_and_ids():
    """Also where Cycles evaluates a material in the object's own coordinates: as if the object lay on the other side."""
    low, high, ball = zoo.plane("lo"), relief(n=8), stone((0.95, 0.2), "stone")
    noise = scenes.material("noise", ball).node_tree.nodes.new("ShaderNodeTexNoise")
    tree = noise.id_data
    noise.inputs["Scale"].default_value = 3.0
    tree.links.new(tree.nodes.new("ShaderNodeTexCoord").outputs["Object"], noise.inputs["Vector"])
    shader = next(node for node in tree.nodes if node.type == "BSDF_PRINCIPLED")
    tree.links.new(noise.outputs["Color"], shader.inputs["Base Color"])
    maps = ("BASE_COLOR", "OBJECT_ID")
    _, found = bake(low, high, ball, maps=maps, wrap="U")
    ball.matrix_world = Matrix.Translation((-TILE, 0.0, 0.0)) @ ball.matrix_world
    _, moved = bake(low, high, ball, maps=maps, method="CAST")
    left = slice(0, SIDE // 4)
    is_stone = (moved["object_id"] != moved["object_id"][0, SIDE // 2])[..., :3].any(axis=-1)[:, left]
    assert 40 < is_stone.sum() < 200
    for name, most in (("object_id", 0.0), ("base_color", 1e-3)):
        difference = np.abs(found[name] - moved[name])[:, left]
        assert np.quantile(difference[is_stone], 0.98) <= most, name
    assert np.ptp(found["base_color"][:, left][is_stone], axis=0).max() > 0.1


def test_what_comes_in_is_cut_out_as_it_is():
    """A card over the border whose material is clear on one half."""
    low, high, card = zoo.plane("lo"), zoo.plane("ground"), zoo.plane("card")
    alpha = np.repeat(np.arange(64)[None] < 32, 64, axis=0).astype(np.float32)
    pixels_of = scenes.image("leaf", np.ones((64, 64, 3)), alpha=alpha)
    node = scenes.texture(scenes.material("leaf", card), pixels_of)
    scenes.set_inputs(card.data.materials[0], Alpha=node.outputs["Alpha"])
    card.matrix_world = Matrix.Translation((0.9, 0.2, 0.3)) @ Matrix.Scale(0.4, 4)
    how = {"maps": ("HEIGHT",), "hit": "OUTERMOST", "extrusion": 1.0, "max_distance": 2.0}
    left = slice(0, SIDE // 8)
    _, found = bake(low, high, card, **how, wrap="U")
    card.matrix_world = Matrix.Translation((-TILE, 0.0, 0.0)) @ card.matrix_world
    _, moved = bake(low, high, card, **how, method="CAST")
    for name in ("height", "normal"):
        assert np.abs(found[name] - moved[name])[4:-4, left].max() < 2e-3, name
    card.data.materials.clear()
    _, solid = bake(low, high, card, **how, method="CAST")
    assert np.abs(solid["height"] - moved["height"])[:, left].max() > 0.1


def test_live_wraps_around_as_a_bake():
    """Also after a change of the high mesh."""
    low, high = zoo.plane("lo"), relief(n=24)
    values = {
        "width": SIDE,
        "height": SIDE,
        "wrap": "UV",
        "margin": 4,
        "depth": 32,
        "storage": "MEMORY",
        "material": False,
    }
    session = live_session.Session(bpy.context, Job(low, [high]), Settings(image="map", **values), progress.Pace())
    session.run(bpy.context)
    for _ in range(2):
        _, found = bake(low, high, maps=(), wrap="UV", margin=4)
        assert np.array_equal(session.texels, found["normal"])
        high.data.vertices[0].co.z += 0.1
        high.data.update()
        bpy.context.view_layer.update()
        session.run(bpy.context)
    session.free()


def test_a_tube_is_closed_and_repeats_nothing():
    tube = zoo.sphere("lo", n=8)
    report, found = bake(tube, zoo.sphere("hi", n=64), maps=("AO",), wrap="U")
    assert report.repeats == {"u": [0.0, 0.0, 0.0]}
    _, without = bake(tube, bpy.data.objects["hi"], maps=("AO",), method="CAST")
    assert np.array_equal(found["ao"], without["ao"])


def test_a_high_mesh_shorter_than_the_tile_leaves_gaps():
    report, _ = bake(zoo.plane("lo"), stone((0.9, 0.0)), maps=(), wrap="UV")
    assert 0.8 < report.missed < 0.95


@pytest.mark.parametrize("wrap", ["U", "V", "UV"])
def test_texture_sets_repeat_as_the_whole_low_mesh(wrap):
    """Each set alone ends before a border of the map."""
    low, high = zoo.plane("lo", n=4), relief(n=24)
    _, expected = bake(low, high, maps=("AO",), wrap=wrap, margin=0, ao_distance=None)
    for name in "ab":
        scenes.material(name, low)
    for face in low.data.polygons:
        face.material_index = int(face.center.x > 0.0) ^ int(face.center.y > 0.0)
    values = FAR | {"ao_distance": None, "width": SIDE, "height": SIDE, "margin": 0, "depth": 32, "storage": "MEMORY"}
    settings = Settings(wrap=wrap, texture_sets=True, maps=("AO",), material=False, **values)
    reports = bake_all(bpy.context, [Job(low, [high])], settings)
    assert [report.repeats for report in reports] == [reports[0].repeats] * 2
    x, y = np.moveaxis(texel_uv(SIDE, SIDE) > 0.5, -1, 0)
    for number, name in enumerate("ab"):
        is_own = (x ^ y) == bool(number)
        for kind in ("normal", "ao"):
            found = pixels(bpy.data.images[f"lo_{name}_{kind}"])
            np.testing.assert_allclose(found[is_own], expected[kind][is_own], atol=2e-7, err_msg=f"{name} {kind}")


def bent(u, v):
    """No tile: both borders along V differ in more than a step."""
    return np.stack([u, v, 0.3 * u * v], axis=1)


@pytest.mark.parametrize(
    "low, settings, message",
    [
        (lambda: zoo.sheet("lo", bent, 4, 4), {"wrap": "U"}, "'lo' is no tile along U"),
        (lambda: zoo.disc("lo"), {"wrap": "U"}, "'lo' is no tile along U"),
        (lambda: moved_uvs((1.5, 1.0), (0.0, 0.0)), {"wrap": "U"}, "'lo' has UVs outside 0 to 1 along U"),
        (lambda: moved_uvs((0.5, 0.5), (0.0, 0.0)), {"wrap": "UV"}, "'lo' is no tile along U"),
        (lambda: moved_uvs((0.998, 1.0), (0.001, 0.0)), {"wrap": "U"}, "no tile along U.*from 0.001 to 0.999"),
        (lambda: moved_uvs((1.002, 1.0), (-0.001, 0.0)), {"wrap": "U"}, "outside 0 to 1 along U.*from -0.001 to 1.001"),
        (lambda: zoo.plane("lo"), {"wrap": "UV", "udim": True, "storage": "PACK"}, "turn Wrap or UDIM Tiles off"),
        (lambda: zoo.plane("lo"), {"wrap": "UV", "method": "FLATTEN"}, "Flatten does not wrap around"),
        (lambda: zoo.plane("lo"), {"wrap": "W"}, "Wrap"),
    ],
    ids=["bent", "disc", "outside", "half", "ends before", "ends beyond", "udim", "flatten", "word"],
)
def test_what_is_no_tile_is_refused(low, settings, message):
    with pytest.raises(BakeError, match=message):
        bake(low(), relief(n=8), maps=(), **settings)
    assert "map" not in bpy.data.images


def moved_uvs(scale, offset, name="lo"):
    low = zoo.plane(name, n=2)
    scenes.move_uvs(low, scale, offset)
    return low


def test_a_low_mesh_that_is_turned_and_scaled_repeats_as_it_lies():
    low, high = zoo.plane("lo"), relief()
    _, expected = bake(low, high, maps=("HEIGHT", "AO"), wrap="UV")
    matrix = Matrix.Translation((30.0, -7.0, 2.0)) @ Matrix.Rotation(0.8, 4, (1.0, 0.4, -0.2))
    low.matrix_world = high.matrix_world = matrix
    _, found = bake(low, high, maps=("HEIGHT", "AO"), wrap="UV")
    assert np.abs(found["height"] - expected["height"]).max() < 1e-4
    assert abs((found["ao"] - expected["ao"]).mean()) < 2e-3
