# SPDX-License-Identifier: GPL-3.0-or-later
"""Auto with several high objects: each must share the low mesh's UVs for Flatten."""

import bpy
import numpy as np
import pytest

from addon.core.settings import Settings
from addon.engine import uv_agreement
from addon.jobs import bake_pair
from tests.support import zoo
from tests.support.maps import bake as bake_texels

pytestmark = pytest.mark.usefixtures("gpu_context")


def bake(low, *highs, method="AUTO", **settings):
    values = {"width": 64, "height": 64, "storage": "MEMORY", "material": False, **settings}
    return bake_pair(bpy.context, low, highs, Settings(method=method, **values))


def patch(name, box, uv, *, height=0.05, n=4):
    """A bump over a box (x0, y0, x1, y1) of the plane, with UVs that fill the box `uv`."""

    def surface(u, v):
        x, y = (first + (last - first) * part for first, last, part in zip(box[:2], box[2:], (u, v), strict=True))
        return np.stack([x, y, height * np.sin(np.pi * u) * np.sin(np.pi * v)], axis=1)

    obj = zoo.sheet(name, surface, n, n)
    layer = obj.data.uv_layers[0].uv
    values = np.empty((len(layer), 2), np.float32)
    layer.foreach_get("vector", values.reshape(-1))
    layer.foreach_set("vector", (values * np.subtract(uv[2:], uv[:2]) + uv[:2]).astype(np.float32).ravel())
    return obj


def shared(box):
    """The UVs of the plane -1..1 in this box."""
    return tuple((np.array(box) + 1) / 2)


BOX = 0.2, 0.2, 0.25, 0.25
CORNERS = {
    "in a corner": (0.0, 0.0, 0.1, 0.1),
    "small in a corner": (0.0, 0.0, 0.01, 0.01),
    "all over": (0.0, 0.0, 1.0, 1.0),
    "in its place, four times as large": (0.58, 0.58, 0.68, 0.68),
    "beside the map": (1.5, 0.5, 1.6, 0.6),
    "in its place, rotated": (0.625, 0.625, 0.6, 0.6),
    "without area": (0.5, 0.5, 0.5, 0.5),
}


@pytest.mark.parametrize("uv", CORNERS.values(), ids=CORNERS)
@pytest.mark.parametrize("is_first", [False, True])
def test_a_bolt_with_different_uvs_is_cast(uv, is_first):
    low, terrain, bolt = zoo.plane("lo"), zoo.terrain("hi", height=0.02), patch("bolt", BOX, uv)
    report = bake(low, *((bolt, terrain) if is_first else (terrain, bolt)))
    assert report.method == "CAST"
    assert "'bolt'" in report.why
    assert not any("'bolt'" in warning for warning in report.warnings)  # it is printed where it is


@pytest.mark.parametrize("box", [BOX, (0.5, -0.9, 0.51, -0.89), (-1.0, -1.0, -0.99, 1.0)], ids=["bolt", "tiny", "rim"])
def test_a_bolt_that_shares_the_layout_is_flattened(box):
    low, terrain, bolt = zoo.plane("lo"), zoo.terrain("hi", height=0.02), patch("bolt", box, shared(box))
    report = bake(low, terrain, bolt)
    assert (report.method, "agree" in report.why) == ("FLATTEN", True)


@pytest.mark.parametrize(
    ("box", "method"), [(BOX, "CAST"), ((0.2, 0.2, 0.201, 0.201), "FLATTEN")], ids=["bolt", "sliver"]
)
def test_a_part_without_area_in_uv_space_is_cast_unless_it_is_a_sliver(box, method):
    low, high, bolt = zoo.plane("lo"), zoo.terrain("hi", height=0.02), patch("bolt", box, CORNERS["without area"])
    with bpy.context.temp_override(active_object=high, object=high, selected_editable_objects=[high, bolt]):
        bpy.ops.object.join()
    report = bake(low, high)
    assert report.method == method, report.why
    assert ("of the surface of 'hi' has no area in UV space" in report.why) == (method == "CAST")


def test_meshes_moved_aside_together_are_flattened():
    low, terrain, bolt = zoo.plane("lo"), zoo.terrain("hi", height=0.02), patch("bolt", BOX, shared(BOX))
    terrain.location = bolt.location = (3.0, 1.0, 0.0)
    assert bake(low, terrain, bolt).method == "FLATTEN"


def test_mirrored_halves_on_the_same_uvs_are_flattened():
    low = zoo.mirrored("lo")
    halves = [patch(f"hi {side}", (0, -1, side, 1), (0, 0, 1, 1), height=0.1, n=8) for side in (1, -1)]
    assert bake(low, *halves).method == "FLATTEN"


def test_tiles_that_are_not_baked_do_not_count():
    low, highs = (
        zoo.plane("lo"),
        [patch("left", (-1, -1, 0, 1), (0, 0, 1, 1)), patch("right", (0, -1, 1, 1), (1, 0, 2, 1))],
    )
    layer = low.data.uv_layers[0].uv
    layer.foreach_set("vector", np.array([(0, 0), (2, 0), (2, 1), (0, 1)], np.float32).ravel())
    assert bake(low, *highs, udim=True, tiles=(1002,), storage="PACK").method == "FLATTEN"


# With Flatten set


def differs(report):
    return [warning for warning in report.warnings if "--method auto" in warning]


@pytest.mark.parametrize("uv", [CORNERS["in a corner"], CORNERS["beside the map"]], ids=["in a corner", "beside"])
def test_flatten_reports_a_high_object_with_different_uvs(uv):
    low, terrain, bolt = zoo.plane("lo"), zoo.terrain("hi", height=0.02), patch("bolt", BOX, uv)
    (warning,) = differs(bake(low, terrain, bolt, method="FLATTEN"))
    assert "'bolt'" in warning
    assert not differs(bake(low, terrain, patch("good", BOX, shared(BOX)), method="FLATTEN"))


def test_flatten_reports_its_only_high_object():
    low, high = zoo.plane("lo"), patch("hi", (-1, -1, 1, 1), (1, 0, 0, 1))  # upside down
    (warning,) = differs(bake(low, high, method="FLATTEN"))
    assert "'hi'" in warning
    assert not differs(bake(low, zoo.terrain("good"), method="FLATTEN"))


def test_many_high_objects_are_probed_once_on_few_texels(monkeypatch):
    low, texels = zoo.plane("lo"), []
    side = 6
    corners = [(x / side, y / side) for x in range(side) for y in range(side)]
    boxes = [tuple(2 * np.array([x, y, x + 1 / side, y + 1 / side]) - 1) for x, y in corners]
    highs = [patch(f"hi {number}", box, shared(box)) for number, box in enumerate(boxes)]
    draw = uv_agreement.separation.draw_points

    def counted(meshes, size, uv_to_clip):
        texels.append(size[0] * size[1])
        return draw(meshes, size, uv_to_clip)

    monkeypatch.setattr(uv_agreement.separation, "draw_points", counted)
    assert bake(low, *highs).method == "FLATTEN"
    assert sum(texels) <= 6 * uv_agreement.PROBE_SIZE**2
    assert len(texels) <= len(highs) + 4
    shifted = patch("shifted", boxes[7], shared(boxes[8]))
    report = bake(low, *highs[:7], shifted, *highs[8:])
    assert (report.method, "'shifted'" in report.why) == ("CAST", True)


# Parts that share UVs, with high faces in another order


def winged(name, *, is_reversed=False, aside=0.0, size=0.1):
    """A plane with two sloping wings that share 1.3 % of the texels, the left one mirrored. is_reversed: the faces' order.
    aside: how far the wings are moved along the plane's sides. size: of the wings in UV space."""
    sections = (-1, 0, 0), (1, 0, 0), (1, 0, aside), (2, -1, aside), (-2, -1, aside), (-1, 0, aside)
    points = [(x, y + move, z) for x, z, move in sections for y in (-1, 1)]
    faces = np.array([0, 2, 3, 1]) + [[0], [4], [8]]
    plane, wing = (
        np.array([(u, v), (u + w, v), (u + w, v + w), (u, v + w)]) for u, v, w in ((0, 0, 0.875), (0.9, 0.9, size))
    )
    order = slice(None, None, -1 if is_reversed else 1)
    return zoo.build(name, points, faces[order], np.stack([plane, wing, wing[[1, 0, 3, 2]]])[order], smooth=False)


def crossed(report):
    return [warning for warning in report.warnings if warning.startswith("Parts of 'lo' share UVs")]


def test_flatten_reports_high_faces_of_stacked_parts_in_another_order():
    low = winged("lo")
    report = bake(low, winged("hi", is_reversed=True), method="FLATTEN", width=256, height=256)
    (warning,) = crossed(report)
    assert f"on {100 / (0.1**-2 * 0.875**2 + 1):.1f}% of the texels" in warning
    assert not crossed(bake(low, winged("same"), method="FLATTEN", width=256, height=256))


def test_auto_casts_rays_where_the_high_normals_are_those_of_another_part():
    low, high = winged("lo"), winged("hi", is_reversed=True)
    report = bake(low, high, width=256, height=256)
    assert report.method == "FLATTEN"
    assert report.rays > 0.01
    assert not crossed(report)
    auto, cast, flat = (bake_texels(low, high, method=method) for method in ("AUTO", "CAST", "FLATTEN"))
    np.testing.assert_allclose(auto, cast, atol=1e-6)
    assert np.abs(flat - cast).max() > 0.1


def test_a_few_crossed_texels_are_enough_for_rays():
    """0.33 % of the texels, which is less than may be uncovered."""
    assert bake(winged("lo", size=0.05), winged("hi", size=0.05, is_reversed=True), width=256, height=256).rays > 0.001


def test_only_tangents_of_another_part_are_reported():
    low, high = winged("lo"), winged("hi", is_reversed=True)
    assert not crossed(bake(low, high, space="OBJECT", width=256, height=256))
    assert not crossed(bake(low, high, method="CAST", width=256, height=256))


def test_cast_depends_on_no_order():
    maps = [
        bake_texels(winged("lo"), winged("hi", is_reversed=is_reversed), method="CAST") for is_reversed in (False, True)
    ]
    np.testing.assert_allclose(*maps, atol=1e-6)


def test_part_ids_that_are_close_to_no_part_are_not_crossed():
    report = bake(winged("lo"), winged("hi", is_reversed=True, aside=1.0), method="FLATTEN", width=256, height=256)
    assert report.checks["far"]["count"]
    assert not crossed(report)


def test_a_limit_of_distances_hides_no_crossed_parts():
    low, high = winged("lo"), winged("hi", is_reversed=True)
    assert crossed(bake(low, high, method="FLATTEN", limit=100.0, width=256, height=256))
