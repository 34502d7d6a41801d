# SPDX-License-Identifier: GPL-3.0-or-later
"""Live draws only the parts of a map that changed. The map is that of a new bake, to the bit."""

import bpy
import numpy as np
import pytest

from addon.core import progress
from addon.core.settings import Settings
from addon.engine import live_redraw
from addon.engine.live_redraw import KeptMap
from addon.jobs import Job
from addon.jobs.live_session import Session
from addon.passes import high_in_uv
from addon.scene import mesh_reader
from tests.support import cut_scenes, random_cases, scenes, zoo

pytestmark = pytest.mark.usefixtures("gpu_context")

SIZE = 128
SETTINGS = {"method": "FLATTEN", "width": SIZE, "height": SIZE, "storage": "MEMORY", "modifiers": "VIEWPORT"}


@pytest.fixture
def drawn(monkeypatch):
    """For each map by Flatten since the start, whether only parts of it were drawn."""
    found = []
    redraw = KeptMap.redraw

    def noted(self, *arguments):
        found.append(redraw(self, *arguments))
        return found[-1]

    monkeypatch.setattr(KeptMap, "redraw", noted)
    return found


def pair(**options):
    return zoo.terrain("lo", n=8), zoo.terrain("hi", n=48, height=0.15, **options)


def begin(low, *highs, **settings):
    session = Session(bpy.context, Job(low, list(highs)), Settings(**SETTINGS | settings), progress.Pace())
    session.run(bpy.context)
    return session


def fresh(session):
    """The texels of a new session."""
    new = Session(bpy.context, session.job, session.settings, progress.Pace())
    new.run(bpy.context)
    texels = new.texels
    new.free()
    return texels


def stroke(obj, seed, radius=0.2, height=0.05):
    """Raise and lower the vertices in a circle."""
    rng = np.random.default_rng(seed)
    points = mesh_reader.points(obj.data)
    center = rng.uniform(-0.8, 0.8, 2)
    near = np.linalg.norm(points[:, :2] - center, axis=1) < radius
    points[near, 2] += rng.normal(0.0, height, near.sum()).astype(np.float32)
    put(obj, points)


def put(obj, points):
    obj.data.attributes["position"].data.foreach_set("vector", points.ravel())
    obj.data.update()
    bpy.context.view_layer.update()


def follow(session, *objects):
    session.run(bpy.context, {obj.session_uid for obj in objects})


CASES = {
    "tangent": {},
    "object": {"space": "OBJECT"},
    "world": {"space": "WORLD"},
    "four samples": {"samples": 4},
    "four samples, world": {"samples": 4, "space": "WORLD"},
    "no margin": {"margin": 0},
    "unlimited margin": {"margin": None},
    "adjacent faces": {"margin_type": "ADJACENT_FACES"},
    "not square": {"width": 192, "height": 96},
}


def test_rounded_edges_are_drawn_as_a_whole(drawn):
    """Normals around what has moved change with it."""
    low, high = pair(smooth=False)
    session = begin(low, high, edge_radius=0.05)
    for seed in range(2):
        stroke(high, seed)
        follow(session, high)
        assert np.array_equal(session.texels, fresh(session))
    assert not any(drawn)


@pytest.mark.parametrize("name", CASES)
def test_parts_equal_a_new_bake(drawn, name):
    low, high = pair()
    for obj in (low, high):  # an island in the middle, with a margin
        values = mesh_reader.uvs(obj.data, zoo.LAYER) * 0.7 + 0.15
        obj.data.uv_layers[0].uv.foreach_set("vector", values.ravel())
    session = begin(low, high, **CASES[name])
    for seed in range(6):
        before = session.texels
        stroke(high, seed)
        follow(session, high)
        assert not np.array_equal(session.texels, before)
        assert np.array_equal(session.texels, fresh(session))
    assert drawn[1:7:2] == [True] * 3  # new sessions draw whole maps
    session.free()


@pytest.mark.parametrize("method", ["FLATTEN", "CAST"])
def test_an_alpha_that_is_painted_is_read_with_the_next_stroke(method):
    """Although the card that shows it is as it was. Blender reports its material."""
    (low, card), body = scenes.planes("low", "card"), zoo.terrain("body", n=24, height=0.02)
    body.location.z = -0.15
    clear = np.zeros((8, 8))
    half = np.tile(np.repeat([0.0, 1.0], 4), (8, 1))
    material = cut_scenes.color_over(card, half)
    image = next(node.image for node in material.node_tree.nodes if node.type == "TEX_IMAGE")
    bpy.context.view_layer.update()
    session = begin(low, body, card, method=method, extrusion=0.1, max_distance=0.4)
    assert session.shows(material)
    found = []
    for number, alpha in enumerate((half, half.T, clear, 1.0 - clear, half)):
        pixels = np.full((8, 8, 4), 0.5, np.float32)
        pixels[..., 3] = alpha
        image.pixels.foreach_set(pixels.ravel())
        before = session.meshes.highs
        stroke(body, number, height=0.01)
        follow(session, body)
        found.append(session.texels)
        assert np.array_equal(found[-1], fresh(session)), number
        assert len(session._as_read.lacks) == (number == 2)
        assert (before[1] is session.meshes.highs[1]) == (number == 0)
    assert np.abs(found[2] - found[3]).max() > 0.01
    session.free()


def test_few_triangles_are_drawn(monkeypatch):
    low, high = pair()
    session = begin(low, high)
    counted, within = [], live_redraw.DrawnMesh.within
    monkeypatch.setattr(
        live_redraw.DrawnMesh,
        "within",
        lambda *arguments: (found := within(*arguments), counted.append(len(found.triangles)))[0],
    )
    stroke(high, 1)
    follow(session, high)
    assert 0 < sum(counted) < 0.2 * 2 * 48**2
    whole = []
    draw = high_in_uv.draw_normals
    monkeypatch.setattr(
        high_in_uv, "draw_normals", lambda into, meshes, clip: (whole.append(1), draw(into, meshes, clip))
    )
    follow(session, high)  # nothing has changed
    assert whole == []
    session.free()


def test_a_stroke_across_islands_and_mirrored_uvs(drawn):
    """Two halves of the mesh lie on the same texels, and the last triangle stays there."""
    low, high = pair()
    for obj in (low, high):
        values = mesh_reader.uvs(obj.data, zoo.LAYER)
        values[:, 0] = np.abs(2.0 * values[:, 0] - 1.0)
        obj.data.uv_layers[0].uv.foreach_set("vector", values.ravel())
    session = begin(low, high)
    for seed in range(6):
        stroke(high, seed, radius=0.3)
        follow(session, high)
        assert np.array_equal(session.texels, fresh(session))
    assert drawn[1] and drawn[3]
    session.free()


def test_of_two_objects_on_the_same_texels_the_later_one_stays(drawn):
    low, first = pair()
    second = zoo.plane("second", n=5)
    values = mesh_reader.uvs(second.data, zoo.LAYER) * 0.4 + 0.3
    second.data.uv_layers[0].uv.foreach_set("vector", values.ravel())
    session = begin(low, first, second)
    for seed in range(4):
        stroke(first, seed)
        follow(session, first)
        assert np.array_equal(session.texels, fresh(session))
    stroke(second, 9, height=0.3)
    follow(session, second)
    assert np.array_equal(session.texels, fresh(session))
    assert drawn[1] and drawn[3]
    session.free()


def test_texels_that_lose_their_normal_change_the_margin(drawn):
    """Opposite normals cancel out: Flatten writes no texel between them, and the margin fills it."""
    low, high = zoo.plane("lo"), zoo.plane("hi", n=16)
    session = begin(low, high, margin=4)
    points = mesh_reader.points(high.data)
    fold = points.copy()
    middle = np.linalg.norm(points[:, :2] - 0.1, axis=1) < 0.25
    fold[middle, 0] = 0.2 - fold[middle, 0]  # turned over
    for wanted in (fold, points):
        put(high, wanted)
        follow(session, high)
        assert np.array_equal(session.texels, fresh(session))
    assert drawn[1] and drawn[3]
    session.free()


def test_other_changes_draw_the_whole_map(drawn):
    low, high = pair()
    session = begin(low, high)
    stroke(high, 1)
    follow(session, high)
    assert drawn.pop()
    high.location.z = 0.1
    high.rotation_euler.x = 0.1
    bpy.context.view_layer.update()
    follow(session, high)
    assert not drawn.pop()
    stroke(low, 2, height=0.01)
    follow(session, low)
    assert not drawn.pop()
    high.data.uv_layers[0].uv[7].vector.x += 0.01
    high.data.update()
    bpy.context.view_layer.update()
    follow(session, high)
    assert not drawn.pop()
    stroke(high, 3, radius=5.0)
    follow(session, high)
    assert not drawn.pop()
    assert np.array_equal(session.texels, fresh(session))
    session.free()


def test_a_map_that_was_interrupted_is_drawn_whole(drawn):
    low, high = pair()
    session = begin(low, high, samples=4, adaptive=False)
    session.pace = progress.Pace(1e-9, has_picture=False)
    stroke(high, 1, radius=5.0)
    work = session.steps(bpy.context, {high.session_uid})
    for _ in range(4):
        next(work)
    work.close()
    stroke(high, 2)
    follow(session, high)
    assert drawn == [False, False, False]
    stroke(high, 3)
    follow(session, high)
    assert drawn[-1]
    assert np.array_equal(session.texels, fresh(session))
    session.free()


def test_texels_stay_when_the_memory_is_freed(drawn):
    low, high = pair()
    session = begin(low, high)
    stroke(high, 1)
    follow(session, high)
    expected = fresh(session)
    session.free()
    assert session.map is None
    assert np.array_equal(session.texels, expected)
    stroke(high, 2)
    follow(session, high)
    assert not drawn[-1]
    assert np.array_equal(session.texels, fresh(session))
    session.free()


@random_cases.seeds(4, fast=2)
def test_parts_contain_all_boxes_and_do_not_overlap(seed):
    rng = np.random.default_rng(seed)
    size = (200, 120)
    lowest = rng.uniform(-0.2, 1.1, (rng.integers(1, 60), 2))
    boxes = np.concatenate([lowest, lowest + rng.exponential(0.03, lowest.shape)], axis=1).astype(np.float32)
    covered = np.zeros((size[1], size[0]), int)
    found = live_redraw.parts_of(boxes, size)
    for part in found:
        covered[part.y.start : part.y.stop, part.x.start : part.x.stop] += 1
    assert covered.max() <= 1
    assert len(found) <= live_redraw.MOST_PARTS
    for u0, v0, u1, v1 in boxes:
        inside = covered[
            max(0, int(np.floor(v0 * size[1]))) : max(0, int(np.ceil(v1 * size[1]))),
            max(0, int(np.floor(u0 * size[0]))) : max(0, int(np.ceil(u1 * size[0]))),
        ]
        assert inside.all()


def test_parts_that_are_far_apart_are_not_joined():
    boxes = np.array([[0.1, 0.1, 0.12, 0.12], [0.8, 0.8, 0.82, 0.82]], np.float32)
    found = live_redraw.parts_of(boxes, (512, 512))
    assert len(found) == 2
    assert sum(len(part.x) * len(part.y) for part in found) < 5000
    assert live_redraw.parts_of(boxes + 2.0, (512, 512)) == []
