# SPDX-License-Identifier: GPL-3.0-or-later
"""The check for texels that may show the wrong layer, on layers where each texel's answer is known."""

import bpy  # noqa: F401 - Blender's gpu module comes with it
import numpy as np
import pytest

from addon.engine.unsure_texels import REASONS
from tests.audit.test_checks import RAYS, bake, faces, mask, part
from tests.support import zoo

pytestmark = pytest.mark.usefixtures("gpu_context")

SIZE = 64
HALF = SIZE * SIZE // 2
LEFT = np.arange(SIZE)[None, :] < SIZE // 2


def plates(name, *heights, up=True, begin=-1.0, end=1.0):
    """Squares -1..1 at these heights, side by side in UV space, each one face. begin, end: along x."""
    square = np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)], float)
    points = np.concatenate([np.column_stack([square, np.full(4, z)]) for z in heights])
    points[:, 0] = np.clip(points[:, 0], begin, end)
    cells = np.array([(square + 1) / 2 * (1 / len(heights), 1) + (i / len(heights), 0) for i in range(len(heights))])
    order = np.arange(4) if up else np.arange(4)[::-1]
    return zoo.build(name, points, np.arange(len(points)).reshape(-1, 4)[:, order], cells[:, order])


def shells(name, *radii, n=24):
    """Parts of spheres around the origin, facing outwards, side by side in UV space."""
    uv, quads = zoo.grid_uv(n, n), zoo.grid_faces(n, n)
    longitude, latitude = (uv[:, 0] - 0.5) * 2.0, (uv[:, 1] - 0.5) * 2.0
    unit = np.stack(
        [np.cos(longitude) * np.cos(latitude), np.sin(longitude) * np.cos(latitude), np.sin(latitude)], axis=1
    )
    points = np.concatenate([radius * unit for radius in radii])
    quads_uv = np.concatenate([(uv * (1 / len(radii), 1) + (i / len(radii), 0))[quads] for i in range(len(radii))])
    return zoo.build(name, points, np.concatenate([quads + i * len(uv) for i in range(len(radii))]), quads_uv)


def reasons(report):
    """The reasons that texels have, with the numbers of texels."""
    check = report.checks["unsure"]
    return {name: check[name] for name in REASONS if check[name]}


def test_each_low_layer_near_its_high_layer_is_sure():
    report = bake(plates("lo", 0.0, 0.3), plates("hi", 0.02, 0.28), **RAYS)
    assert part(report.checks["unsure"], "count", "of", "share", "not_owned", "severity") == {
        "count": 0,
        "of": SIZE * SIZE,
        "share": 0.0,
        "not_owned": 0,
        "severity": "GOOD",
    }
    assert reasons(report) == {}
    assert not any("layer" in warning for warning in report.warnings)
    assert not mask(report, "unsure").any()
    assert faces(report, "unsure") == []


def test_a_low_mesh_far_outside_its_layers_is_unsure():
    """Both high layers are closest to the lower low layer, and none to the upper one, which has two to choose from."""
    report = bake(plates("lo", 0.0, 0.3), plates("hi", -0.15, 0.05), **RAYS)
    assert reasons(report) == {"contested": HALF, "undecided": HALF}
    assert part(report.checks["unsure"], "count", "not_owned", "severity") == {
        "count": 2 * HALF,
        "not_owned": HALF,
        "severity": "WRONG",
    }
    assert any("differ in place or size" in warning for warning in report.warnings)
    assert mask(report, "unsure").all()
    assert faces(report, "unsure") == [0, 1]


@pytest.mark.parametrize("side", ["left", "right"])
def test_only_the_texels_below_the_second_layer_are_unsure(side):
    """The lower low layer owns two hits on one side, with a jump at the middle. The upper one owns the upper high layer."""
    low, high = plates("lo", 0.0, 0.3), plates("hi", -0.25, 0.31)
    other = plates("other", 0.05, **({"end": 0.0} if side == "left" else {"begin": 0.0}))
    report = bake(low, high, other, **RAYS)
    column, middle = np.arange(SIZE), SIZE // 4
    expected = column < middle + 1 if side == "left" else (column >= middle - 1) & (column < SIZE // 2)
    np.testing.assert_array_equal(mask(report, "unsure"), np.broadcast_to(expected, (SIZE, SIZE)))
    assert faces(report, "unsure") == [0]
    assert reasons(report)["contested"] == HALF // 2


def test_a_second_hit_that_is_much_farther_is_no_choice():
    """The upper low layer shows the nearest hit, 0.25 below it; the other is 0.47 or 0.53 below it."""
    for lower, expected in ((-0.17, HALF), (-0.23, 0)):
        report = bake(plates("lo", 0.0, 0.3), plates("hi", lower, 0.05), **RAYS)
        assert part(report.checks["unsure"], "not_owned", "undecided") == {"not_owned": HALF, "undecided": expected}


def test_hits_above_are_a_choice_as_well():
    """Both hits are closest to the third low layer, at -0.4; the texels of the one at -0.6 show the lower hit."""
    report = bake(plates("lo", -0.6, -0.4), plates("hi", -0.47, -0.4), **RAYS)
    assert part(report.checks["unsure"], "not_owned", "undecided") == {"not_owned": HALF, "undecided": HALF}


def test_what_stands_off_a_single_low_layer_is_sure():
    report = bake(plates("lo", 0.0), plates("hi", 0.0, 0.2), **RAYS)
    assert report.checks["unsure"]["count"] == 0


def test_a_layer_beyond_the_rays_does_not_count():
    low, high = plates("lo", 0.0, 0.3), plates("hi", -0.05, 0.12)
    near = {"method": "CAST", "extrusion": 0.25, "max_distance": 0.5}
    assert reasons(bake(low, high, **near)).get("contested", 0) == 0
    assert reasons(bake(low, high, **RAYS))["contested"] == HALF


def test_one_hit_that_is_not_owned_leaves_no_choice():
    report = bake(plates("lo", 0.0, 0.3), plates("hi", 0.05), **RAYS)
    assert part(report.checks["unsure"], "count", "not_owned") == {"count": 0, "not_owned": HALF}


@pytest.mark.parametrize(("height", "is_unsure"), [(0.02, True), (0.05, False), (0.28, True), (0.25, False)])
def test_one_hit_that_is_not_owned_is_unsure_where_another_part_of_the_low_mesh_is(height, is_unsure):
    """One of the two plates owns the only high layer. The other one shows it as well."""
    report = bake(plates("lo", 0.0, 0.3), plates("hi", height), **RAYS)
    expected = HALF if is_unsure else 0
    assert part(report.checks["unsure"], "count", "not_owned") == {"count": expected, "not_owned": HALF}


def test_hits_of_backs_alone_are_unsure():
    """Below another low layer too, where a front follows that belongs to it: a texel has one reason."""
    report = bake(plates("lo", 0.0), plates("hi", 0.05, up=False), keep_faces=True, **RAYS)
    assert reasons(report) == {"backs": SIZE * SIZE}
    assert mask(report, "unsure").all()
    assert faces(report, "unsure") == [0]


def test_backs_that_rays_pass_are_sure():
    low, high, front = plates("lo", 0.0), plates("hi", 0.05, up=False), plates("front", 0.02, end=0.5)
    report = bake(low, high, front, facing_only=True, **RAYS)
    assert reasons(report) == {}
    assert report.checks["unsure"]["of"] == SIZE * SIZE  # also where rays miss


def test_backs_are_no_second_hits():
    low, high, backs = plates("lo", 0.0, 0.3), plates("hi", 0.05), plates("backs", -0.05, 0.1, up=False)
    assert bake(low, high, backs, keep_faces=True, **RAYS).checks["unsure"]["count"] == 0


def test_hits_next_to_another_part_are_undecided_without_a_layer_on_the_ray():
    """Hits that lean toward a wall are closest to it, and the wall is no neighbor of the floor."""
    floor, wall = [(-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0)], [(1, -1, 0.1), (1, -1, 1), (1, 1, 1), (1, 1, 0.1)]
    cells = [[(0, 0), (0.5, 0), (0.5, 1), (0, 1)], [(0.5, 0), (1, 0), (1, 1), (0.5, 1)]]
    low = zoo.build("lo", floor + wall, [(0, 1, 2, 3), (4, 5, 6, 7)], cells, smooth=False)
    toward_wall = np.tile((-0.7, 0.0, 0.7), (2, 4, 1))
    points = [(x, y, z) for z in (0.4, 0.5) for x, y in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
    high = zoo.build("hi", points, [(0, 1, 2, 3), (4, 5, 6, 7)], cells, normals=toward_wall)
    report = bake(low, high, **RAYS)
    found = mask(report, "unsure")[:, : SIZE // 2]
    assert not found[:, : SIZE // 4].any()  # closer to the floor
    assert found[:, SIZE // 2 - 6 :].all()
    assert reasons(report)["undecided"] == found.sum()


def test_a_hit_that_is_not_owned_is_not_contested():
    """The upper low layer owns no hit: both are closer to the lower one, and the lower one owns one of them."""
    low, high = plates("lo", 0.0, 0.3), plates("hi", 0.02, 0.1)
    check = bake(low, high, **RAYS).checks["unsure"]
    assert part(check, "contested", "undecided") == {"contested": HALF, "undecided": HALF}


@pytest.mark.parametrize("end", [0.0, 2.0])
def test_jumps_count_only_where_another_low_layer_is_on_the_ray(end):
    low = zoo.build(
        "lo",
        [
            (-1, -1, 0),
            (1, -1, 0),
            (1, 1, 0),
            (-1, 1, 0),
            (end, -1, 0.3),
            (end + 1, -1, 0.3),
            (end + 1, 1, 0.3),
            (end, 1, 0.3),
        ],
        [(0, 1, 2, 3), (4, 5, 6, 7)],
        [[(0, 0), (0.5, 0), (0.5, 1), (0, 1)], [(0.5, 0), (1, 0), (1, 1), (0.5, 1)]],
    )
    high, bump = plates("hi", -0.1), plates("bump", 0.12, end=0.5)
    report = bake(low, high, bump, **RAYS)
    assert (report.checks["unsure"]["jumps"] > 0) == (end == 0.0)


def test_a_jump_between_single_hits_does_not_count():
    """Two plates side by side at two heights, below another low layer with a high layer of its own over one of them."""
    low, left = plates("lo", 0.0, 0.3), plates("left", 0.12, end=0.0)
    square = np.array([(0, -1, -0.1), (1, -1, -0.1), (1, 1, -0.1), (0, 1, -0.1)])
    right = zoo.build("right", square, [(0, 1, 2, 3)], [[(0.5, 0), (1, 0), (1, 1), (0.5, 1)]])
    check = bake(low, left, right, **RAYS).checks["unsure"]
    assert part(check, "contested", "undecided", "jumps") == {"contested": 0, "undecided": 0, "jumps": 0}


def test_what_stands_off_a_single_low_layer_is_sure_with_a_cage_too():
    low, cage = plates("lo", 0.0), plates("cage", 0.5)
    report = bake(low, plates("hi", 0.0, 0.2), cage=cage, method="CAST", max_distance=0.8)
    assert report.checks["unsure"]["count"] == 0


def test_neighbors_in_the_map_that_lie_far_away_are_no_jumps():
    """Two islands that touch in the map: the texels on both sides of the border are a whole plate away from each other."""
    low, high, other = plates("lo", 0.0, 0.3), plates("hi", -0.1), plates("other", 0.12)
    assert bake(low, high, other, **RAYS).checks["unsure"]["jumps"] == 0


@pytest.mark.parametrize(("height", "expected"), [(0.3, HALF), (0.6, 0)])
def test_low_layers_within_a_cage_count(height, expected):
    """Rays start 0.5 outside the lower low layer, which owns both hits."""
    low, cage = plates("lo", 0.0, height), plates("cage", 0.5, height + 0.5)
    report = bake(low, plates("hi", 0.12, -0.05), cage=cage, method="CAST", max_distance=0.7)
    assert report.checks["unsure"]["contested"] == expected


@pytest.mark.parametrize(("reach", "expected"), [(0.6, 0), (0.8, HALF)])
def test_rays_from_a_cage_end_where_they_do_in_a_bake(reach, expected):
    """Rays start 0.5 outside. The second low layer is 0.2 below the first one, which owns both hits."""
    low, cage = plates("lo", 0.0, -0.2), plates("cage", 0.5, 0.3)
    report = bake(low, plates("hi", 0.01, -0.05), cage=cage, method="CAST", max_distance=reach)
    assert report.checks["unsure"]["contested"] == expected


def test_jumps_between_layers_are_on_the_side_with_a_choice():
    """Texels of both low layers that show the small plate, next to texels that show the large one."""
    low, high, other = plates("lo", 0.0, 0.3), plates("hi", -0.1), plates("other", 0.12, end=0.0)
    report = bake(low, high, other, **RAYS)
    # In the sample, a texel is compared with its neighbor one texel to the right and one texel up: not in the last row.
    assert reasons(report)["jumps"] == 2 * (SIZE - 1)


def test_a_steep_surface_with_a_single_layer_has_no_jumps():
    report = bake(zoo.plane("lo", 2), zoo.terrain("hi", 64, height=0.4, waves=4), **RAYS)
    assert report.checks["unsure"]["count"] == 0


@pytest.mark.parametrize(("radii", "expected"), [((1.02, 1.18), set()), ((0.9, 1.08), {"contested", "undecided"})])
def test_a_shell_around_a_sphere(radii, expected):
    report = bake(shells("lo", 1.0, 1.3), shells("hi", *radii), method="CAST", extrusion=0.6, max_distance=1.2)
    inner = report.checks["unsure"]
    assert set(reasons(report)) == expected
    if expected:
        assert inner["contested"] == HALF
        assert inner["undecided"] >= 0.95 * HALF  # at the rim, rays of the outer shell pass the inner ones


@pytest.mark.parametrize("hit", ["OUTERMOST", "NEAREST"])
def test_with_another_rule_texels_are_unsure_where_their_own_hit_is_another(hit):
    """Outermost takes the upper high layer everywhere, nearest takes the right ones here."""
    report = bake(plates("lo", 0.0, 0.3), plates("hi", 0.02, 0.28), hit=hit, **RAYS)
    if hit == "NEAREST":
        assert report.checks["unsure"]["count"] == 0
        return
    assert reasons(report) == {"other_layer": HALF}
    np.testing.assert_array_equal(mask(report, "unsure"), np.broadcast_to(LEFT, (SIZE, SIZE)))
    assert any("belongs to another part of 'lo'" in warning for warning in report.warnings)


def test_flatten_is_sure():
    report = bake(plates("lo", 0.0, 0.3), plates("hi", -0.15, 0.05))
    assert part(report.checks["unsure"], "count", "of", "share") == {"count": 0, "of": 0, "share": 0.0}
    assert not mask(report, "unsure").any()
    assert faces(report, "unsure") == []


def test_the_sample_of_a_large_map_has_the_same_shares():
    report = bake(plates("lo", 0.0, 0.3), plates("hi", -0.15, 0.05), size=(512, 256), **RAYS)
    assert part(report.checks["unsure"], "of", "contested", "undecided") == {
        "of": 128 * 128,
        "contested": 128 * 64,
        "undecided": 128 * 64,
    }


def test_a_mirrored_low_object_is_as_sure():
    low, high = plates("lo", 0.0, 0.3, up=False), plates("hi", -0.15, 0.05)
    low.scale = (1.0, 1.0, 1.0)
    low.data.transform(np.diag((-1.0, 1.0, 1.0, 1.0)))
    low.scale[0] = -1.0
    low.data.update()
    sure = bake(low, high, **RAYS)
    assert reasons(sure)["contested"] == HALF


def test_udim_tiles_are_counted_together():
    low, high = plates("lo", 0.0, 0.3), plates("hi", -0.15, 0.05)
    corners = np.array([corner.vector for corner in low.data.uv_layers[0].uv], np.float32)
    corners[:, 0] *= 2.0
    low.data.uv_layers[0].uv.foreach_set("vector", corners.ravel())
    report = bake(low, high, udim=True, storage="PACK", **RAYS)
    assert part(report.checks["unsure"], "of", "contested", "undecided") == {
        "of": 2 * SIZE * SIZE,
        "contested": SIZE * SIZE,
        "undecided": SIZE * SIZE,
    }


def test_where_rays_hit_only_backs_the_normals_are_to_blame():
    parts = plates("hi", 0.02, end=0.0), plates("other", 0.02, begin=0.0, up=False)
    report = bake(plates("lo", 0.0), *parts, keep_faces=True, **RAYS)
    (warning,) = [warning for warning in report.warnings if "may be wrong" in warning]
    assert "only backs" in warning
    assert "Recalculate the normals" in warning
