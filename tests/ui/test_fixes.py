# SPDX-License-Identifier: GPL-3.0-or-later
"""Each fix with a button makes the map better, by what it should show, or it is not offered."""

import bpy
import numpy as np
import pytest

from addon.core.errors import in_window
from addon.jobs import Job, bake_jobs, fixes, pair_checks
from addon.ui.bake_results import results
from tests.support import angles, maps, panel_layout, random_cases, scenes, zoo
from tests.support.panel import use

pytestmark = pytest.mark.usefixtures("registered", "gpu_context")

SIDE = 24
"""Texels of a map."""


def offered():
    """The kinds of the buttons in the main panel."""
    bpy.context.view_layer.update()
    return {*panel_layout.fixes(panel_layout.draw(width=3000))}


def press(kind):
    assert bpy.ops.imprint.fix(kind=kind) == {"FINISHED"}


def normals():
    """The unit normals of the map of the panel's low object, after a bake, and whether they are known."""
    assert bpy.ops.imprint.bake() == {"FINISHED"}
    texels = maps.pixels(bpy.data.images["lo_normal"])
    return angles.decode(texels), texels[..., 3] > 0.0


def error(truth):
    """Degrees between the map and `truth`, in the mean; 180 where one of the two has nothing."""
    (found, is_known), (wanted, is_wanted) = normals(), truth
    off = np.where(is_known & is_wanted, angles.degrees(found, wanted), 180.0)
    return float(off[is_known | is_wanted].mean())


# Flipped faces


def flip(obj):
    fixes.flip_mesh(obj.data)


def ball(name, radius, place, n=8):
    made = zoo.ball(name, n)
    made.scale, made.location = (radius,) * 3, place
    return made


def places(n):
    at = -1.0 + (np.arange(n) + 0.5) * 2.0 / n
    return [(x, y) for x in at.tolist() for y in at.tolist()]


def sunk_balls(n, radius, sink):
    parts = [ball(f"ball {number}", radius, (*place, sink)) for number, place in enumerate(places(n))]
    return zoo.plane("lo"), [zoo.plane("hi", 8), *parts]


def bricks(height=0.1):
    """Closed boxes, with the low plane through their middle."""
    parts = []
    for number, place in enumerate(places(3)):
        parts.append(zoo.cube(f"brick {number}"))
        parts[-1].scale, parts[-1].location = (0.3, 0.3, height), (*place, 0.0)
    return zoo.plane("lo"), parts


def leaves(n=6):
    """One-sided sheets, tilted to all sides, above a plate."""
    rng, parts = np.random.default_rng(5), [zoo.plane("hi", 4)]
    for number, place in enumerate(places(n)):
        parts.append(zoo.plane(f"leaf {number}"))
        parts[-1].scale, parts[-1].location = (0.12,) * 3, (*place, 0.08)
        parts[-1].rotation_euler = rng.uniform(-0.9, 0.9, 3)
    return zoo.plane("lo"), parts


def bowls():
    """Dents with a rim: spheres open at the top, whose inside is seen."""
    parts = [zoo.plane("hi", 4)]
    for number, place in enumerate(places(3)):
        parts.append(ball(f"bowl {number}", 0.2, (*place, 0.02)))
        flip(parts[-1])
    return zoo.plane("lo"), parts


def tilted():
    low, highs = sunk_balls(5, 0.1, 0.02)
    for obj in (low, *highs):
        obj.matrix_world = obj.matrix_world @ obj.matrix_world.Identity(4)
    parent = scenes.link(bpy.data.objects.new("all", None))
    for obj in (low, *highs):
        obj.parent = parent
    parent.rotation_euler, parent.scale = (2.0, 0.4, 1.0), (1.0, 2.0, -1.0)
    return low, highs


def ball_in_ball():
    """A shell with beads on it and below it."""
    rng = np.random.default_rng(3)
    ways = rng.normal(size=(40, 3))
    ways /= np.linalg.norm(ways, axis=1, keepdims=True)
    beads = [ball(f"bead {number}", 0.12, way * 0.97, 6) for number, way in enumerate(ways)]
    return zoo.sphere("lo", 6), [zoo.ball("hi", 16), *beads]


def behind_bricks():
    """From behind, where a flip would show the back of the wall."""
    low, parts = bricks()
    low.location.z = -0.4
    return low, parts


RIGHT = {
    "behind bricks": behind_bricks,
    "balls sunk by a half": lambda: sunk_balls(8, 0.06, 0.03),
    "many balls": lambda: sunk_balls(10, 0.07, 0.02),
    "large balls": lambda: sunk_balls(3, 0.3, 0.1),
    "balls below": lambda: sunk_balls(6, 0.08, -0.03),
    "bricks": bricks,
    "flat bricks": lambda: bricks(0.02),
    "leaves": leaves,
    "bowls": bowls,
    "turned and mirrored": tilted,
    "beads on a shell": ball_in_ball,
}


@pytest.mark.parametrize("name", RIGHT)
def test_a_right_low_mesh_is_not_called_flipped(name):
    low, highs = RIGHT[name]()
    use(low, *highs, size=SIDE, method="CAST", material=False, keep_faces=name == "bowls")
    assert "FLIPPED" not in offered()
    with pytest.raises(RuntimeError, match="point to the same sides"):
        bpy.ops.imprint.fix(kind="FLIPPED")
    bpy.ops.imprint.bake()
    assert not any("point to the other side" in text for text in results.of(bpy.context).warnings)


@pytest.mark.parametrize("name", ["leaves", "balls below"])
def test_a_low_mesh_that_is_flipped_is_named_and_the_button_gives_the_right_map(name):
    low, highs = RIGHT[name]()
    use(low, *highs, size=SIDE, method="CAST", material=False, keep_faces=True)
    truth = normals()
    flip(low)
    assert "FLIPPED" in offered()
    bpy.ops.imprint.bake()
    assert any("point to the other side" in text for text in results.of(bpy.context).warnings)
    wrong = error(truth)
    press("FLIPPED")
    assert "FLIPPED" not in offered()
    assert error(truth) < 0.01
    assert wrong > 10.0


@pytest.mark.parametrize("name", ["balls sunk by a half", "many balls", "beads on a shell"])
def test_a_bake_names_a_flipped_low_mesh_also_where_the_nearest_faces_do_not_show_it(name):
    low, highs = RIGHT[name]()
    use(low, *highs, size=SIDE, method="CAST", material=False, keep_faces=True)
    truth = normals()
    flip(low)
    wrong = error(truth)
    assert any("The faces of 'lo' point to the other side" in text for text in results.of(bpy.context).warnings)
    press("FLIPPED")
    assert error(truth) < 0.01
    assert wrong > 10.0


def corner_normals(obj):
    """The normals of the corners by face and vertex, and those of the faces."""
    data = obj.data
    corners = {
        (face.index, data.loops[corner].vertex_index): tuple(data.corner_normals[corner].vector)
        for face in data.polygons
        for corner in face.loop_indices
    }
    return np.array([corners[key] for key in sorted(corners)]), np.array([face.normal[:] for face in data.polygons])


@pytest.mark.parametrize("make", [zoo.ball, zoo.sphere, zoo.cube])
def test_a_flip_turns_all_normals(make):
    """Also those of a mesh that has normals of its own, as zoo.sphere."""
    obj = make("obj")
    before = corner_normals(obj)
    flip(obj)
    assert all(np.allclose(a, -b, atol=1e-3) for a, b in zip(corner_normals(obj), before, strict=True))


@random_cases.seeds(6, fast=2)
def test_random_parts_on_a_plate_flip_nothing(seed):
    """Parts of any size, sunk to any depth: the low mesh is right."""
    rng = np.random.default_rng(seed)
    parts = []
    for number in range(int(rng.integers(10, 60))):
        kind = (zoo.ball, zoo.cube, zoo.plane)[int(rng.integers(3))]
        parts.append(kind(f"part {number}"))
        parts[-1].scale = (float(rng.uniform(0.03, 0.3)),) * 3
        parts[-1].location = (*rng.uniform(-0.9, 0.9, 2), float(rng.uniform(-0.1, 0.1)))
        parts[-1].rotation_euler = rng.uniform(-1.0, 1.0, 3)
    low, high = zoo.plane("lo", int(rng.integers(1, 4))), zoo.plane("hi", 8)
    bpy.context.view_layer.update()
    assert not pair_checks.viewport_flipped(bpy.context, low, [high, *parts])
    settings = scenes.settings(method="CAST", size=16)
    (report,) = bake_jobs.bake_all(bpy.context, [Job(low, [high, *parts])], settings)
    assert not any("point to the other side" in text for text in report.warnings)


# What changes a setting, or the low object's UVs and shading


HEIGHT, WAVES = 0.05, 1


def terrain_truth(side=SIDE):
    """The closed form of the map of zoo.terrain on zoo.plane, all of it known."""
    uv = 2.0 * np.pi * WAVES * maps.texel_uv(side, side)
    slopes = (
        HEIGHT
        * np.pi
        * WAVES
        * np.stack([np.cos(uv[..., 0]) * np.sin(uv[..., 1]), np.sin(uv[..., 0]) * np.cos(uv[..., 1])], axis=-1)
    )
    normals_ = np.concatenate([-slopes, np.ones((side, side, 1))], axis=-1)
    return normals_ / np.linalg.norm(normals_, axis=-1, keepdims=True), np.ones((side, side), bool)


def waves(n=24):
    return zoo.terrain("hi", n, height=HEIGHT, waves=WAVES)


def moved_uvs():
    """A high mesh whose UVs fit the low one in a half of the map."""
    high = waves()
    scenes.move_uvs(high, (0.5, 1.0))
    return zoo.plane("lo"), high, {"method": "FLATTEN"}


def too_short_rays():
    high = waves()
    high.location.z = 0.1
    return zoo.plane("lo"), high, {"method": "CAST", "measure": False, "extrusion": 0.1, "max_distance": 0.15}


def no_uvs():
    low = zoo.plane("lo")
    low.data.uv_layers.remove(low.data.uv_layers[0])
    return low, waves(), {"method": "CAST"}


BETTER = {"CAST or AUTO": moved_uvs, "MEASURE": too_short_rays}


@pytest.mark.parametrize("case", BETTER)
def test_a_setting_that_a_warning_names_brings_the_map_nearer_to_the_truth(case):
    low, high, values = BETTER[case]()
    use(low, high, size=SIDE, material=False, **values)
    before = error(terrain_truth())
    kinds = {in_window(text)[1] for text in results.of(bpy.context).warnings} - {""}
    assert kinds & set(case.split(" or "))
    for kind in kinds:
        press(kind)
        assert error(terrain_truth()) < 1.0 < before


def test_unwrap_makes_a_bake_possible():
    low, high, values = no_uvs()
    use(low, high, size=SIDE, material=False, **values)
    assert "UNWRAP" in offered()
    with pytest.raises(RuntimeError, match="unwrap it first"):
        bpy.ops.imprint.bake()
    assert bpy.ops.imprint.unwrap() == {"FINISHED"}
    assert "UNWRAP" not in offered()
    _, is_known = normals()
    assert is_known.mean() > 0.5


@pytest.mark.parametrize("kind", ["POLYGONS", "LAYER", "HARD_EDGES", "MIRRORED"])
def test_what_makes_a_low_object_fit_for_engines_spoils_no_map(kind):
    """The shading error of the low object with its map, which its new triangles, normals or UVs would raise."""
    make = {
        "POLYGONS": lambda: zoo.terrain("lo", 4, waves=1),
        "LAYER": lambda: zoo.terrain("lo", 4, waves=1),
        "HARD_EDGES": lambda: zoo.terrain("lo", 4, waves=1, smooth=False),
        "MIRRORED": lambda: zoo.mirrored("lo"),
    }
    low = make[kind]()
    high = zoo.mirrored("hi", 16) if kind == "MIRRORED" else zoo.terrain("hi", 24, waves=1)
    use(low, high, size=SIDE, method="CAST", material=False, green="-Y", appearance=True)
    if kind == "LAYER":
        low.data.uv_layers.new(name="Second")
        low.data.uv_layers.active = low.data.uv_layers["Second"]
        bpy.context.scene.imprint.uv_layer = zoo.LAYER
    assert kind in offered()
    bpy.ops.imprint.bake()
    before = results.of(bpy.context)
    press(kind)
    assert kind not in offered()
    bpy.ops.imprint.bake()
    after = results.of(bpy.context)
    assert after.appearance["mean"] < before.appearance["mean"] + SAME_SHADING
    harm = {"HARD_EDGES": "hard_edges", "POLYGONS": "uneven", "MIRRORED": "overlap"}.get(kind)
    if harm:
        assert after.checks[harm]["count"] < max(1, before.checks[harm]["count"])


SAME_SHADING = 0.05
"""Degrees by which the shading error may change by the rounding of rays."""
