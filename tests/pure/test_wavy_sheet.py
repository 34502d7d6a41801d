# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests what compares engines with a wavy sheet of known shape and colors, without engines."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from scripts.dev.in_engines import drawing, wavy_sheet
from scripts.dev.in_engines.glb_file import Surface
from scripts.dev.in_engines.wavy_sheet import Case
from tests.support import angles

SIZE = 64
SQUARE = np.array([[(-1, -1, 0), (1, -1, 0), (1, 1, 0)], [(-1, -1, 0), (1, 1, 0), (-1, 1, 0)]], np.float64)


class Square:
    """A file of the square -1..1, one part for each of its two triangles. uv: of corners, v down."""

    def __init__(self, *, w=1.0, tangent=(1.0, 0.0, 0.0), uv=None):
        self.tangents = np.tile((*tangent, w), (2, 3, 1))
        self.uv = np.stack([SQUARE[..., 0] + 1.0, 1.0 - SQUARE[..., 1]], axis=-1) / 2.0 if uv is None else uv
        parts = [{"attributes": {"TANGENT": part}, "indices": 2} for part in range(2)]
        self.document = {"meshes": [{"primitives": parts}]}

    def surface(self):
        return Surface(SQUARE, np.tile((0.0, 0.0, 1.0), (2, 3, 1)), self.tangents, self.uv)

    def accessor(self, index):
        return np.arange(3)[:, None] if index == 2 else self.tangents[index]


def seen():
    """The square from before: what is drawn, and x and y of the pixels on it."""
    (drawn,) = drawing.look_around(SQUARE, [wavy_sheet.TOWARDS], SIZE).drawn
    points = np.einsum("...cx,...c->...x", SQUARE[drawn.triangle], drawn.weights)
    return drawn, points[..., 0], points[..., 1]


def pictures(case, *, turned=0.0, color=0.0, surface=(0.0, 0.0, 0.0)):
    """What an engine without a fault shows, but for normals turned by degrees, and differences."""
    drawn, x, y = seen()
    normals = wavy_sheet.normals(x, y)
    across = np.cross(normals, (0.0, 1.0, 0.0))
    across /= np.linalg.norm(across, axis=-1, keepdims=True)
    normals = np.cos(np.radians(turned)) * normals + np.sin(np.radians(turned)) * across
    there = drawn.there[..., None].astype(np.float64)
    sides = [
        wavy_sheet.values(case, x.ravel(), (name,)).reshape(*x.shape, -1) for name in ("color", "roughness", "metallic")
    ]
    found = {
        "normal": normals * 0.5 + 0.5,
        "color": sides[0] + color,
        "surface": np.concatenate([np.full_like(sides[1], 0.7), *sides[1:]], axis=-1) + surface,
    }
    return drawn, {name: np.concatenate([pixels, there], axis=-1).astype(np.float32) for name, pixels in found.items()}


def figures(case, **faults):
    drawn, found = pictures(case, **faults)
    return wavy_sheet.figures(case, drawn, found, [one.ravel().tolist() for one in case.glb.tangents])


def test_the_normals_are_at_right_angles_to_the_surface():
    x, y = np.random.default_rng(1).uniform(-1.0, 1.0, (2, 100))
    step = 1e-6
    along_x = (wavy_sheet.height(x + step, y) - wavy_sheet.height(x - step, y)) / (2.0 * step)
    along_y = (wavy_sheet.height(x, y + step) - wavy_sheet.height(x, y - step)) / (2.0 * step)
    wanted = np.stack([-along_x, -along_y, np.ones(100)], axis=-1)
    wanted /= np.linalg.norm(wanted, axis=-1, keepdims=True)
    assert angles.degrees(wavy_sheet.normals(x, y), wanted).max() < 1e-5


def test_a_fault_of_each_kind_is_measured():
    case = Case("a", glb=Square(), surfaces=[np.full((4, 4, 4), 0.7)] * 2)
    right = figures(case)
    assert right["tangents"]
    assert right["pixels"] == np.count_nonzero(seen()[0].there)
    assert max(right["normal"], right["color"], right["surface"]) < 1e-4
    assert figures(case, turned=2.0)["normal"] == pytest.approx(2.0, abs=1e-3)
    assert figures(case, color=0.1)["color"] == pytest.approx(0.1, abs=1e-3)
    for channel in np.eye(3):
        assert figures(case, surface=0.2 * channel)["surface"] == pytest.approx(0.2, abs=1e-3)
    assert "surface" not in figures(replace(case, surfaces=[]))
    assert figures(replace(case, glb=Square(w=-1.0)))["tangents"] is False


@pytest.mark.parametrize(("share", "is_found"), [(0.005, False), (0.03, True)])
def test_one_pixel_in_a_hundred_may_be_off(share, is_found):
    case = Case("a", glb=Square())
    drawn, found = pictures(case)
    _, x, _ = seen()
    for name, where in (("color", drawn.there & (np.abs(x) > wavy_sheet.AWAY)), ("normal", drawn.there)):
        rows, columns = np.nonzero(where)
        count = int(share * len(rows))
        assert count
        found[name][rows[:count], columns[:count], :3] = (1.0, 0.5, 0.5)
    measured = wavy_sheet.figures(case, drawn, found, [])
    assert (measured["color"] > 0.1, measured["normal"] > 10.0) == (is_found, is_found)


def test_colors_are_not_compared_where_they_change():
    case = Case("a", glb=Square())
    drawn, found = pictures(case)
    found["color"][np.abs(seen()[1]) < wavy_sheet.AWAY] = 0.0
    assert wavy_sheet.figures(case, drawn, found, [])["color"] < 1e-4


def test_occlusion_is_that_of_the_file_with_v_up():
    upward = np.zeros((SIZE, SIZE, 4))
    upward[..., 0] = (np.arange(SIZE)[:, None] + 0.5) / SIZE
    case = Case("a", glb=Square(), surfaces=[upward] * 2)
    drawn, found = pictures(case)
    found["surface"][..., 0] = (seen()[2] + 1.0) / 2.0
    assert wavy_sheet.figures(case, drawn, found, [])["surface"] < 0.5 / SIZE
    found["surface"][..., 0] = (1.0 - seen()[2]) / 2.0
    assert wavy_sheet.figures(case, drawn, found, [])["surface"] > 0.9


def test_a_case_without_sides_has_the_values_of_the_right_one():
    x = np.array([-0.5, 0.5])
    left, right = wavy_sheet.SIDES
    assert wavy_sheet.values(Case("a"), x, ("color",)).tolist() == [list(left.color), list(right.color)]
    one = wavy_sheet.values(Case("a", has_sides=False), x, ("roughness", "metallic"))
    assert one.tolist() == [[right.roughness, right.metallic]] * 2


@pytest.mark.parametrize(
    ("square", "follows"),
    [
        (Square(), True),
        (Square(tangent=(0.8, 0.6, 0.0)), True),
        (Square(tangent=(0.6, 0.8, 0.0)), False),
        (Square(w=-1.0), False),
        (Square(uv=Square().uv * (-1.0, 1.0)), False),
        (Square(uv=Square().uv * (-1.0, 1.0), tangent=(-1.0, 0.0, 0.0), w=-1.0), True),
        (Square(uv=Square().uv[..., ::-1]), False),
    ],
)
def test_tangents_follow_the_uvs(square, follows):
    assert wavy_sheet.follow_their_uv(square.surface()) == follows


def test_a_surface_without_tangents_follows_nothing():
    assert not wavy_sheet.follow_their_uv(replace(Square().surface(), tangent=None))


def test_tangents_are_loaded_in_any_order():
    square = Square()
    square.tangents[1, 2] = (0.0, 1.0, 0.0, -1.0)
    parts = [one.ravel().tolist() for one in square.tangents]
    assert wavy_sheet.are_loaded(square, parts)
    assert wavy_sheet.are_loaded(square, parts[::-1])
    assert not wavy_sheet.are_loaded(square, parts[:1])
    assert not wavy_sheet.are_loaded(square, [[*parts[0], 0.0, 0.0, 1.0, 1.0], parts[1]])
    assert not wavy_sheet.are_loaded(square, [parts[0], None])
    assert not wavy_sheet.are_loaded(square, [parts[0], parts[0]])
    assert not wavy_sheet.are_loaded(square, [parts[0], [*parts[1][:-1], 1.0]])
    del square.document["meshes"][0]["primitives"][0]["attributes"]["TANGENT"]
    assert not wavy_sheet.are_loaded(square, parts)


def test_texels_are_looked_up_between_their_centers_in_the_image_of_the_part():
    slope = np.zeros((4, 4, 4))
    slope[..., 0] = np.arange(4) / 4.0 + 0.125
    case = Case("a", glb=Square(), surfaces=[slope, 1.0 - slope])
    uv = np.array([(0.3, 0.5), (0.625, 0.7), (0.3, 0.5)])
    found = wavy_sheet.looked_up(case, np.array([0, 0, 1]), uv)
    np.testing.assert_allclose(found, [0.3, 0.625, 0.7])


def test_each_fault_is_named():
    row = {"case": "N-gons", "label": "three.js", "tangents": True, "normal": 0.3, "color": 0.003}
    assert wavy_sheet.failures([row, row | {"surface": 0.01}]) == []
    for change, text in (
        ({"tangents": False}, "N-gons in three.js: the tangents"),
        ({"normal": 1.01}, "off by 1.01 degrees"),
        ({"color": 0.011}, "color is off by 0.011"),
        ({"surface": 0.02}, "surface is off by 0.020"),
    ):
        (said,) = wavy_sheet.failures([row | change])
        assert text in said


def test_all_models_are_drawn_in_the_engine(monkeypatch):
    square = Square()
    square.copy, square.content, cameras = (lambda: square), (lambda: b"glb"), []
    square.set_cameras = lambda *given: cameras.append(given)
    case = Case("a", glb=square)

    def render(_modules, engine, models, *, views, size, keep):
        assert (engine, views, size) == ("three", 1, SIZE)
        assert [(model.name, model.content, model.outputs) for model in models] == [("a", b"glb", ("normal", "color"))]
        for name, pixels in pictures(case)[1].items():
            keep("a", 0, name, pixels)
        return {"a": [one.ravel().tolist() for one in square.tangents]}

    monkeypatch.setattr(wavy_sheet, "chromium", SimpleNamespace(**{**vars(wavy_sheet.chromium), "render": render}))
    (found,) = wavy_sheet.run([case], None, "three", SIZE)
    assert (found["case"], found["tangents"], found["normal"] < 1e-3) == ("a", True, True)
    assert cameras[0][1] == drawing.ANGLE
