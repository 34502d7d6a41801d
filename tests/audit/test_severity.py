# SPDX-License-Identifier: GPL-3.0-or-later
"""How the audit rates its results: only checks that harm the map raise a warning."""

import bpy
import numpy as np
import pytest

from addon.audit import mip_gaps, severity
from addon.core.settings import Settings
from addon.jobs import Job, bake_all, checks
from tests.audit.test_checks import QUARTERS, bake, faces, mask, part, tiles
from tests.support import zoo

pytestmark = pytest.mark.usefixtures("gpu_context")


def severities(report):
    """The severity of each check that is not GOOD."""
    return {kind: check["severity"] for kind, check in report.checks.items() if check["severity"] != "GOOD"}


# Overlapping UVs, and parts moved by whole tiles


def halves(name="lo", *, move=(0.0, 0.0), **options):
    """Two mirrored halves side by side with the same UVs, those of the second one moved."""
    low = zoo.mirrored(name, 4, **options)
    uv = np.array([corner.vector for corner in low.data.uv_layers[0].uv])
    uv[len(uv) // 2 :] += move
    low.data.uv_layers[0].uv.foreach_set("vector", uv.astype(np.float32).ravel())
    return low


def test_stacked_mirrored_halves_are_good_practice_in_tangent_space():
    report = bake(halves(), halves("hi", slope=0.02))
    assert part(report.checks["overlap"], "share", "stacked", "severity") == {
        "share": 1.0,
        "stacked": 64 * 64,
        "severity": "LOOK",
    }
    assert report.checks["mirrored"]["severity"] == "LOOK"
    assert report.warnings == []


@pytest.mark.parametrize("space", ["OBJECT", "WORLD"])
def test_stacked_mirrored_halves_are_wrong_in_object_and_world_space(space):
    report = bake(halves(), halves("hi"), space=space)
    assert report.checks["overlap"]["severity"] == "WRONG"
    assert any("overlapping UVs" in warning for warning in report.warnings)


def test_halves_that_overlap_in_part_are_wrong():
    report = bake(halves(move=(0.125, 0.0)), halves("hi", move=(0.125, 0.0)), udim=True, storage="PACK", tiles=(1001,))
    assert part(report.checks["overlap"], "count", "stacked") == {"count": 56 * 64, "stacked": 0}
    assert report.checks["overlap"]["severity"] == "WRONG"


def test_only_shared_texels_that_are_not_stacked_count():
    stacked, crossing = (0, 0, 0.5, 0.5), (0.5, 0.5, 1, 1)
    report = bake(tiles("lo", stacked, stacked, crossing, (0.75, 0.5, 1, 0.75)), zoo.plane("hi"))
    assert part(report.checks["overlap"], "count", "stacked") == {"count": 32 * 32 + 16 * 16, "stacked": 32 * 32}
    assert report.checks["overlap"]["severity"] == "WRONG"


@pytest.mark.parametrize("move", [(1.0, 0.0), (0.0, -2.0)])
def test_a_half_moved_by_whole_tiles_is_good_practice(move):
    report = bake(halves(move=move), halves("hi", move=move, slope=0.02))
    assert part(report.checks["outside"], "count", "moved", "severity") == {
        "count": 32,
        "moved": 32,
        "severity": "LOOK",
    }
    assert report.warnings == []
    assert faces(report, "outside") == list(range(16, 32))


@pytest.mark.parametrize("move", [(1.5, 0.0), (0.5, 0.0)])
def test_a_half_that_crosses_the_border_is_wrong(move):
    report = bake(halves(move=move), halves("hi"))
    assert part(report.checks["outside"], "moved", "severity") == {"moved": 0, "severity": "WRONG"}
    assert any("reach outside the UV tile" in warning for warning in report.warnings)


def test_only_harmful_faces_outside_the_tile_are_selected():
    report = bake(tiles("lo", (0, 0, 1, 1), (1, 0, 2, 1), (1.5, 0, 1.75, 1)), zoo.plane("hi"))
    assert part(report.checks["outside"], "count", "moved") == {"count": 4, "moved": 2}
    assert faces(report, "outside") == [2]


def test_high_parts_moved_by_whole_tiles_raise_no_warning():
    assert bake(tiles("lo", (0, 0, 1, 1)), tiles("hi", (0, 0, 1, 1), (1, 0, 2, 1)), space="OBJECT").warnings == []
    report = bake(tiles("lo2", (0, 0, 1, 1)), tiles("hi2", (0.5, 0, 1.5, 1), (0, 0, 1, 1)), space="OBJECT")
    (warning,) = report.warnings
    assert "'hi2': 2 of its triangles reach outside" in warning


# Gaps between islands


def islands(gap, size=64, border=8):
    """Two islands on a map of `size` texels, `gap` texels apart and `border` texels from its border."""
    middle, rim = (size - gap) / 2 / size, border / size
    return tiles("lo", (rim, rim, middle, 1 - rim), (middle + gap / size, rim, 1 - rim, 1 - rim))


@pytest.mark.parametrize(
    ("mips", "gap", "is_close"), [(3, 8, False), (3, 6, True), (2, 6, False), (2, 2, True), (4, 8, True)]
)
def test_islands_closer_than_a_texel_of_the_mip_level(mips, gap, is_close):
    report = bake(islands(gap), zoo.plane("hi"), mips=mips)
    need = 2**mips
    # On each side, the texels are close up to where a texel of the mip level reaches past the gap.
    wide, first = max(0, need - gap), (64 - gap) // 2
    expected = np.zeros((64, 64), bool)
    expected[8:56, first - wide : first] = expected[8:56, first + gap : first + gap + wide] = True
    check = report.checks["gaps"]
    assert part(check, "count", "border", "needed") == {"count": expected.sum(), "border": 0, "needed": need}
    np.testing.assert_array_equal(mask(report, "gaps"), expected)
    assert faces(report, "gaps") == ([0, 1] if is_close else [])
    assert check["severity"] == ("WRONG" if is_close else "GOOD")
    assert any("of another UV island" in warning for warning in report.warnings) == is_close


@pytest.mark.parametrize(("border", "is_close"), [(4, False), (3, True), (0, True)])
def test_islands_closer_to_the_border_than_half_a_texel_of_the_mip_level(border, is_close):
    low = tiles("lo", (border / 64, 0.25, 0.75, 0.75))
    report = bake(low, zoo.plane("hi"))
    assert report.checks["gaps"]["border"] == report.checks["gaps"]["count"] == (4 - border) * 32 * is_close
    assert mask(report, "gaps")[:, :4].any() == is_close
    in_udim = bake(low, zoo.plane("hi"), udim=True, storage="PACK")
    assert in_udim.checks["gaps"]["count"] == 0


@pytest.mark.parametrize("wide", [128, 512])
def test_gaps_on_a_map_that_is_not_square(wide):
    """Along u and along v alike, also where only every second texel along u is looked at."""
    boxes = [(0.25, 2 / 64, 0.5, 0.5), (0.5 + 6 / wide, 2 / 64, 0.75, 0.5)]
    swapped = [tuple(np.array(box)[[1, 0, 3, 2]]) for box in boxes]
    report = bake(tiles("lo", *boxes), zoo.plane("hi"), size=(wide, 64))
    turned = bake(tiles("turned", *swapped), zoo.plane("hi2"), size=(64, wide))
    expected = np.zeros((64, wide), bool)
    rows, half = slice(2, 32), wide // 2
    expected[rows, half - 2 : half] = expected[rows, half + 6 : half + 8] = True
    expected[2:4, wide // 4 : half] = expected[2:4, half + 6 : wide * 3 // 4] = True
    np.testing.assert_array_equal(mask(report, "gaps"), expected)
    np.testing.assert_array_equal(mask(turned, "gaps"), expected.T)
    assert report.checks["gaps"] == turned.checks["gaps"]
    step = max(1, wide // mip_gaps.QUICK)
    assert report.checks["gaps"]["count"] == expected[:, ::step].sum()


def test_gaps_on_each_tile():
    close = np.array([(0.125, 0.125, 0.5, 0.5), (0.5 + 2 / 64, 0.125, 0.875, 0.5)])
    boxes = (0.25, 0.25, 0.75, 0.75), *(close + 1)
    plain = bake(tiles("plain", *close), zoo.plane("hi")).checks["gaps"]
    report = bake(tiles("lo", *boxes), tiles("hi2", *boxes), udim=True, storage="PACK")
    assert report.tiles == [1001, 1012]
    assert part(report.checks["gaps"], "count", "of") == {"count": plain["count"], "of": plain["of"] + 32 * 32}
    assert plain["count"] > 0


@pytest.mark.parametrize("box", [(0, 0, 1, 1), (0, 0.25, 1, 0.75), (0.25, 0, 0.75, 1)])
def test_an_island_that_continues_past_the_border_is_close_to_itself(box):
    report = bake(tiles("lo", box), zoo.plane("hi"))
    assert report.checks["gaps"]["count"] == 0


def test_stacked_islands_are_not_close_but_their_neighbors_are():
    first, second = (8 / 64, 8 / 64, 30 / 64, 30 / 64), (16 / 64, 16 / 64, 40 / 64, 40 / 64)
    report = bake(tiles("lo", first, second, first), zoo.plane("hi"))
    assert report.checks["overlap"]["count"] > 0
    assert report.checks["gaps"]["count"] == 0
    near = (44 / 64, 16 / 64, 56 / 64, 40 / 64)
    report = bake(tiles("lo2", first, second, first, near), zoo.plane("hi2"))
    assert report.checks["gaps"]["count"] == 2 * 4 * 24
    assert faces(report, "gaps") == [1, 3]


def test_pieces_of_one_island_split_by_a_file_are_not_close():
    assert bake(tiles("lo", *QUARTERS), zoo.plane("hi")).checks["gaps"]["count"] == 0


@pytest.mark.parametrize("size", [(1024, 64), (64, 2048), (4096, 2048)])
def test_two_texels_on_each_gap_of_a_large_map_are_checked(size):
    for mips in (1, 3):
        sparse = mip_gaps.grid(Settings(width=size[0], height=size[1], mips=mips).sampling)
        assert max(sparse.steps) <= 2 ** (mips - 1)


# Normals that point into the surface


def tents(slope):
    """A plane, and a high mesh whose third quarter has normals that lean `slope` degrees away from it."""
    normals = np.tile((0.0, 0.0, 1.0), (4, 4, 1))
    normals[2] = np.sin(np.radians(slope)), 0.0, np.cos(np.radians(slope))
    return tiles("lo", *QUARTERS), tiles("hi", *QUARTERS, normals=normals)


CHANNELS = {"as usual": {}, "turned over": {"red": "-Z", "green": "+X", "blue": "-Y"}}


@pytest.mark.parametrize("channels", CHANNELS)
@pytest.mark.parametrize(("slope", "is_lost"), [(85, False), (95, True), (180, True)])
def test_texels_whose_z_is_lost(channels, slope, is_lost):
    report = bake(*tents(slope), **CHANNELS[channels])
    assert part(report.checks["backwards"], "count", "of") == {"count": 32 * 32 * is_lost, "of": 64 * 64}
    assert report.checks["backwards"]["severity"] == ("WRONG" if is_lost else "GOOD")
    assert any("engines that rebuild z" in warning for warning in report.warnings) == is_lost
    expected = np.zeros((64, 64), bool)
    expected[32:, :32] = is_lost
    np.testing.assert_array_equal(mask(report, "backwards"), expected)
    assert faces(report, "backwards") == [2] * is_lost


@pytest.mark.parametrize(
    "settings", [{"margin": 8}, {"samples": 4}, {"method": "CAST", "extrusion": 1.0, "max_distance": 2.0}]
)
def test_the_margin_does_not_count_and_rays_do(settings):
    assert bake(*tents(120), **settings).checks["backwards"]["count"] == 32 * 32


def test_texels_of_the_margin_do_not_count_as_lost():
    low = tiles("lo", QUARTERS[2])
    high = tiles("hi", QUARTERS[2], normals=np.tile((1.0, 0.0, -0.1), (1, 4, 1)))
    assert bake(low, high, margin=8).checks["backwards"]["count"] == 32 * 32


def test_lost_z_is_counted_in_a_shared_image_too():
    low, high = tents(120)
    jobs = [Job(low, [high])]
    settings = Settings(
        method="FLATTEN", width=64, height=64, margin=4, storage="MEMORY", material=False, image="atlas"
    )
    (report,) = bake_all(bpy.context, jobs, settings, share_image=True)
    assert report.checks["backwards"]["count"] == 32 * 32


def test_other_spaces_lose_nothing():
    assert bake(*tents(120), space="OBJECT").checks["backwards"]["count"] == 0


# Low normals and edges


def roof(name="lo", **options):
    """Two quads that meet at a right angle along the middle of the plane, flat shaded, in one island."""
    points = [(-1, -1, 0), (0, -1, 1), (1, -1, 0), (-1, 1, 0), (0, 1, 1), (1, 1, 0)]
    grid = zoo.grid_faces(2, 1)
    return zoo.build(name, points, grid, zoo.grid_uv(2, 1)[grid], **options)


def edges(report):
    """The ends of the hard edges of the low object."""
    low = checks.of_low(report)
    return [tuple(low.data.edges[number].vertices) for number in checks.find(bpy.context, report, "hard_edges")]


def test_hard_edges_without_a_seam():
    report = bake(roof(smooth=False), roof("hi"))
    assert report.checks["hard_edges"] == {"count": 1, "severity": "WRONG"}
    assert [tuple(sorted(ends)) for ends in edges(report)] == [(1, 4)]
    assert any("1 hard edges without a UV seam" in warning for warning in report.warnings)
    assert bake(roof("smooth"), roof("other")).checks["hard_edges"]["count"] == 0


def test_sharp_edges_of_a_smooth_mesh():
    low = roof()
    low.data.attributes.new("sharp_edge", "BOOLEAN", "EDGE")
    sharp = next(edge.index for edge in low.data.edges if set(edge.vertices) == {1, 4})
    low.data.attributes["sharp_edge"].data[sharp].value = True
    low.data.update()
    report = bake(low, roof("hi"))
    assert [tuple(sorted(ends)) for ends in edges(report)] == [(1, 4)]


def test_hard_edges_are_harmless_in_object_and_world_space():
    report = bake(roof(smooth=False), roof("hi"), space="OBJECT")
    assert report.checks["hard_edges"] == {"count": 1, "severity": "GOOD"}
    assert report.warnings == []


def test_hard_edges_at_seams_are_good():
    assert bake(zoo.cube("lo"), zoo.cube("hi")).checks["hard_edges"]["count"] == 0


@pytest.mark.parametrize("modifier", ["TRIANGULATE", "ARRAY"])
def test_edges_made_by_modifiers_map_back_to_edges_of_the_object(modifier):
    low = roof(smooth=False)
    low.modifiers.new("Some", modifier)
    report = bake(low, roof("hi"))
    assert report.checks["hard_edges"]["count"] >= 1
    assert [tuple(sorted(ends)) for ends in edges(report)] == [(1, 4)]


def test_normals_behind_their_triangles():
    normals = np.tile((0.0, 0.0, 1.0), (4, 4, 1))
    normals[1, 2] = (0.8, 0.0, -0.6)
    low = tiles("lo", *QUARTERS, normals=normals)
    report = bake(low, high := tiles("hi", *QUARTERS))
    assert part(report.checks["behind"], "of", "severity") == {"of": 8, "severity": "WRONG"}
    assert 1 <= report.checks["behind"]["count"] <= 2
    assert faces(report, "behind") == [1]
    assert any("shading normals that point behind them" in warning for warning in report.warnings)
    assert bake(low, high, space="OBJECT").checks["behind"]["severity"] == "GOOD"


# What the numbers mean


MEANINGS = [
    ("overlap", {"count": 0, "of": 100, "stacked": 0}, {}, "GOOD"),
    ("overlap", {"count": 100, "of": 100, "stacked": 100}, {}, "LOOK"),
    ("overlap", {"count": 100, "of": 100, "stacked": 99}, {}, "WRONG"),
    ("overlap", {"count": 1, "of": 10_000, "stacked": 0}, {}, "LOOK"),
    ("overlap", {"count": 100, "of": 100, "stacked": 100}, {"space": "WORLD"}, "WRONG"),
    ("uncovered", {"count": 1, "of": 200, "share": 0.005}, {"method": "CAST"}, "WRONG"),
    ("uncovered", {"count": 1, "of": 200, "share": 0.005}, {"method": "FLATTEN"}, "LOOK"),
    ("uncovered", {"count": 3, "of": 200, "share": 0.015}, {"method": "FLATTEN"}, "WRONG"),
    ("far", {"count": 1, "of": 100, "share": 0.01}, {}, "LOOK"),
    ("far", {"count": 1, "of": 100, "share": 0.01}, {"limit": 1.0}, "WRONG"),
    ("far", {"count": 30, "of": 100, "share": 0.3}, {}, "LOOK"),
    ("unsure", {"count": 1, "of": 200}, {"method": "CAST"}, "LOOK"),
    ("unsure", {"count": 3, "of": 200}, {"method": "CAST"}, "WRONG"),
    ("gaps", {"count": 1, "of": 100}, {}, "LOOK"),
    ("gaps", {"count": 3, "of": 100}, {}, "WRONG"),
    ("backwards", {"count": 1, "of": 2000}, {}, "LOOK"),
    ("backwards", {"count": 3, "of": 2000}, {}, "WRONG"),
    ("mirrored", {"count": 8, "of": 8, "islands": 1}, {}, "LOOK"),
    ("outside", {"count": 8, "of": 16, "moved": 7, "cut_off": 0.0009}, {}, "LOOK"),
    ("outside", {"count": 8, "of": 16, "moved": 7, "cut_off": 0.002}, {}, "WRONG"),
    ("no_area", {"count": 1, "of": 16}, {}, "WRONG"),
    ("behind", {"count": 30, "of": 200, "backwards": 0.0009}, {}, "LOOK"),
    ("behind", {"count": 3, "of": 200, "backwards": 0.002}, {}, "WRONG"),
    ("hard_edges", {"count": 1}, {}, "WRONG"),
    ("hard_edges", {"count": 1}, {"space": "OBJECT"}, "GOOD"),
    ("polygons", {"count": 16, "of": 16}, {}, "LOOK"),
    ("uneven", {"count": 16, "of": 16, "is_own_base": False}, {}, "LOOK"),
]


@pytest.mark.parametrize(("kind", "check", "settings", "expected"), MEANINGS)
def test_what_a_number_means(kind, check, settings, expected):
    assert severity.rate(kind, check, Settings(**{"method": "FLATTEN"} | settings)) == expected


def test_each_kind_has_a_meaning():
    assert {kind for kind, *_ in MEANINGS} == set(checks.KINDS)
