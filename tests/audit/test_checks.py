# SPDX-License-Identifier: GPL-3.0-or-later
"""What the audit counts and where it locates it, on meshes where every texel and every face is known."""

import json

import bpy
import numpy as np
import pytest

from addon.audit import mip_gaps, severity, tally
from addon.core.errors import BakeError
from addon.core.report import Report
from addon.core.settings import Settings
from addon.engine import coverage, separation
from addon.jobs import Job, bake_all, fixes, masks
from tests.support import maps, random_cases, zoo
from tests.support.snapshot import difference, snapshot

pytestmark = pytest.mark.usefixtures("gpu_context")


RAYS = {"method": "CAST", "extrusion": 1.0, "max_distance": 2.0}


def bake(low, *highs, cage=None, size=(64, 64), **settings):
    """The report of a bake, written to a file and read back."""
    values = {"method": "FLATTEN", "margin": 0, "storage": "MEMORY", "material": False, **settings}
    job = Job(low, highs, cage)
    report = bake_all(bpy.context, [job], Settings(width=size[0], height=size[1], **values))[0]
    values = json.loads(json.dumps(report.to_dict()))
    return Report(**values)


def warnings_of(report):
    """The warnings, except that the map of planes is flat."""
    return [warning for warning in report.warnings if not warning.startswith("The map is flat")]


def faces(report, kind):
    return masks.find(bpy.context, report, kind).tolist()


def mask(report, kind):
    """The mask (H, W) bool. It must be only black and white."""
    texels = maps.pixels(masks.draw_mask(bpy.context, report, kind))
    assert set(np.unique(texels[..., :3])) <= {0.0, 1.0}
    assert (texels[..., 3] == 1.0).all()
    return texels[..., 0] == 1.0


def tiles(name, *boxes, height=0.0, flip=(), **options):
    """Quads in the plane z = height, each over a box (u0, v0, u1, v1) of UV space and of x and y.

    flip: those whose UVs are mirrored, along u within their boxes.
    """
    corners = np.array([[(a, b), (c, b), (c, d), (a, d)] for a, b, c, d in boxes], float)
    heights = np.broadcast_to(np.reshape(height, (-1, 1)), corners.shape[:2])
    points = np.concatenate([corners, heights[..., None]], axis=2).reshape(-1, 3)
    uv = corners.copy()
    for number in flip:
        uv[number] = uv[number][[1, 0, 3, 2]]
    return zoo.build(name, points, np.arange(len(points)).reshape(-1, 4), uv, **options)


def part(check, *names):
    """Some of the values of a check."""
    return {name: check[name] for name in names}


def counted(count, of):
    """A check of texels."""
    return {"count": count, "of": of, "share": count / of}


TEXELS = ("count", "of", "share")


QUARTERS = [(i / 2, j / 2, i / 2 + 0.5, j / 2 + 0.5) for j in range(2) for i in range(2)]
"""As the faces of a plane of 2 x 2 quads, in the square 0..1."""


def test_nothing_is_wrong_with_two_planes():
    report = bake(zoo.plane("lo", 3), zoo.plane("hi", 5))
    assert {kind: check["count"] for kind, check in report.checks.items()} == dict.fromkeys(masks.KINDS, 0) | {
        "polygons": 9
    }
    for kind in ("overlap", "uncovered", "far"):
        assert report.checks[kind]["of"] == 64 * 64
        assert not mask(report, kind).any()
    assert warnings_of(report) == []
    assert [kind for kind in masks.KINDS if faces(report, kind)] == ["polygons"]


# Texels that several triangles share


def test_shared_texels():
    low = tiles("lo", (0, 0, 0.5, 1), (0.25, 0, 0.75, 1), (0.25, 0, 0.375, 1), (0.875, 0, 1, 1))
    report = bake(low, zoo.plane("hi"))
    assert part(report.checks["overlap"], *TEXELS) == counted(16 * 64, (48 + 8) * 64)
    assert report.overlap == 16 / 56
    assert any("belong to two or more of its triangles" in warning for warning in report.warnings)
    expected = np.zeros((64, 64), bool)
    expected[:, 16:32] = True
    np.testing.assert_array_equal(mask(report, "overlap"), expected)
    assert faces(report, "overlap") == [0, 1, 2]


def test_faces_of_all_overlapping_layers_are_found():
    report = bake(tiles("lo", *[(0, 0, 0.5, 0.5)] * 30, (0.5, 0.5, 1, 1)), zoo.plane("hi"))
    assert faces(report, "overlap") == list(range(30))


# Triangles and their UVs


def test_mirrored_islands():
    boxes = [(0, 0, 0.2, 1), (0.25, 0, 0.5, 1), (0.5, 0, 0.75, 1), (0.8, 0, 1, 1)]
    report = bake(tiles("lo", *boxes, flip=(1, 3)), zoo.plane("hi"))
    assert part(report.checks["mirrored"], "count", "of", "islands") == {"count": 4, "of": 8, "islands": 2}
    assert report.mirrored == 4
    assert faces(report, "mirrored") == [1, 3]


@pytest.mark.parametrize(("udim", "outside"), [(False, [1, 2, 3, 4]), (True, [2, 3, 4])], ids=["one tile", "udim"])
def test_triangles_outside_the_tiles(udim, outside):
    boxes = [(0, 0, 1, 1), (1.25, 0, 1.5, 1), (-0.5, 0, -0.25, 1), (9.5, 0, 10.5, 1), (0, 99.5, 0.5, 100.5)]
    storage = {"udim": True, "storage": "PACK", "tiles": (1001,)} if udim else {}
    report = bake(tiles("lo", *boxes), zoo.plane("hi"), **storage)
    assert part(report.checks["outside"], "count", "of") == {"count": 2 * len(outside), "of": 10}
    assert faces(report, "outside") == outside
    assert any(("UDIM tiles" if udim else "UV tile 0 to 1") in warning for warning in report.warnings)


def test_triangles_without_area():
    low = tiles("lo", *QUARTERS)
    uv = np.stack([np.array([(a, b), (c, b), (c, d), (a, d)]) for a, b, c, d in QUARTERS])
    uv[2] = uv[2, 0]
    low.data.uv_layers[0].uv.foreach_set("vector", uv.astype(np.float32).ravel())
    report = bake(low, zoo.plane("hi"))
    assert part(report.checks["no_area"], "count", "of") == {"count": 2, "of": 8}
    assert faces(report, "no_area") == [2]


# Texels without a high triangle


@pytest.mark.parametrize("settings", [{}, {"space": "OBJECT"}, {"samples": 4}, {"margin": 16}, RAYS], ids=str)
def test_uncovered_texels(settings):
    low, high = tiles("lo", *QUARTERS), tiles("hi", *QUARTERS[1:], height=0.01)
    report = bake(low, high, **settings)
    assert part(report.checks["uncovered"], *TEXELS) == counted(32 * 32, 64 * 64)
    expected = np.zeros((64, 64), bool)
    expected[:32, :32] = True
    np.testing.assert_array_equal(mask(report, "uncovered"), expected)
    assert faces(report, "uncovered") == [0]
    words = "hit nothing" if settings == RAYS else "have no high triangle"
    assert any(words in warning and "25.00%" in warning for warning in report.warnings)


def test_a_few_uncovered_texels_are_counted_and_raise_no_warning():
    report = bake(tiles("lo", (0, 0, 1, 1)), tiles("hi", (0, 0, 0.995, 1)), size=(256, 256))
    assert report.checks["uncovered"]["count"] == 256
    assert warnings_of(report) == []


# Distances


def stairs(height=0.5):
    """A low mesh, and a high mesh that is `height` above its third face."""
    return tiles("lo", *QUARTERS), tiles("hi", *QUARTERS, height=[0.0, 0.0, height, 0.0])


@pytest.mark.parametrize("settings", [{}, RAYS], ids=str)
def test_far_texels(settings):
    low, high = stairs()
    low.scale = high.scale = (10.0, 10.0, 1.5)
    report = bake(low, high, **settings)
    check = report.checks["far"]
    assert (check["count"], check["of"], check["share"]) == (32 * 32, 64 * 64, 0.25)
    assert check["maximum"] == pytest.approx(0.75, rel=1e-5)
    assert check["percentile_99"] == pytest.approx(0.75, rel=1e-5)
    assert check["limit"] == pytest.approx(0.05 * np.hypot(10, 10) / 2)
    assert check["offset"] == pytest.approx(0.0, abs=1e-5)
    expected = np.zeros((64, 64), bool)
    expected[32:, :32] = True
    np.testing.assert_array_equal(mask(report, "far"), expected)
    assert faces(report, "far") == [2]
    assert warnings_of(report) == []


@pytest.mark.parametrize(("limit", "count"), [(0.49, 32 * 32), (0.51, 0)])
def test_the_limit_is_in_scene_units(limit, count):
    report = bake(*stairs(), limit=limit)
    assert report.checks["far"]["count"] == count
    assert report.checks["far"]["limit"] == limit
    assert bool(warnings_of(report)) == bool(count)
    assert faces(report, "far") == [2] * bool(count)


@pytest.mark.parametrize(("system", "scale", "shown"), [("METRIC", 0.01, "1 mm"), ("NONE", 1.0, "0.1")])
def test_far_texels_raise_a_warning_beyond_a_limit_that_was_set(system, scale, shown):
    units = bpy.context.scene.unit_settings
    units.system, units.scale_length = system, scale
    low, high = tiles("lo", *QUARTERS), tiles("hi", *QUARTERS, height=[0.0, 0.5, 0.5, 0.0])
    assert warnings_of(bake(low, high, **RAYS)) == []
    (warning,) = warnings_of(bake(low, high, limit=0.1, **RAYS))
    assert f"On 50.00% of the texels of 'lo', the high surface is farther away than {shown}," in warning


def test_the_99th_percentile_is_not_the_maximum():
    """A slope: distances are spread evenly from 0 to 2, minus the median, which counts as an offset."""
    report = bake(zoo.plane("lo"), zoo.plane("hi", slope=1.0), limit=5.0)
    check = report.checks["far"]
    assert check["maximum"] == pytest.approx(1 - 1 / 64, rel=1e-4)
    assert check["percentile_99"] == pytest.approx(0.99, abs=1 / 64)


@pytest.mark.parametrize("height", [0.0, 0.2])
def test_a_cage_does_not_count_as_distance(height):
    low, high = stairs()
    cage = tiles("cage", *QUARTERS, height=[0.7, 0.8, 0.9, 1.0])
    report = bake(low, high, cage=cage, **RAYS, limit=0.4 + height)
    assert report.checks["far"]["maximum"] == pytest.approx(0.5, abs=1e-5)
    assert report.checks["far"]["count"] == (0 if height else 32 * 32)
    assert report.cage == "cage"
    assert faces(report, "far") == ([] if height else [2])


def test_meshes_side_by_side():
    low, high = stairs()
    high.location = (3.0, 0.0, 4.0)
    report = bake(low, high)
    assert report.checks["far"]["offset"] == pytest.approx(5.0, rel=1e-5)
    assert report.checks["far"]["maximum"] == pytest.approx(0.5, rel=1e-4)
    assert faces(report, "far") == [2]
    assert any("5 apart as a whole" in line for line in report.summary())
    high.location = (0.0, 0.0, 0.0)
    assert not any("apart as a whole" in line for line in bake(low, high).summary())


def test_only_some_triangles_of_a_large_high_mesh_are_probed(monkeypatch):
    low, high = zoo.plane("lo"), zoo.plane("hi", 16)
    high.data.vertices[140].co.z = 0.5
    monkeypatch.setattr(separation, "TRIANGLES", 100)
    report = bake(low, high)
    check = report.checks["far"]
    assert 64 * 64 / 8 < check["of"] < 64 * 64 / 4  # every sixth triangle
    assert check["maximum"] <= 0.5
    monkeypatch.undo()
    assert bake(low, high).checks["far"]["of"] == 64 * 64


def test_several_high_meshes_overlap_as_on_the_map():
    low, ground, lid = zoo.plane("lo"), zoo.plane("hi"), tiles("lid", (0, 0, 1, 0.25), height=0.4)
    lid.scale, lid.location = (2, 2, 1), (-1, -1, 0)
    assert bake(low, ground, lid).checks["far"]["count"] == 64 * 16
    assert bake(low, lid, ground).checks["far"]["count"] == 0


# Faces


def polygons(name, *groups):
    """One object of faces, each a list of (x, y, z), with UVs from above."""
    points = [point for group in groups for point in group]
    starts = np.cumsum([0, *map(len, groups)])
    data = bpy.data.meshes.new(name)
    data.from_pydata(points, [], [range(a, b) for a, b in zip(starts, starts[1:], strict=False)])
    uv = np.array(points, np.float32)[[loop.vertex_index for loop in data.loops], :2]
    data.uv_layers.new(name=zoo.LAYER).uv.foreach_set("vector", uv.ravel())
    obj = bpy.data.objects.new(name, data)
    bpy.context.scene.collection.objects.link(obj)
    return obj


def mixed(name="lo"):
    """A triangle, a flat quad, a bent one, a flat n-gon and a bent one."""
    pentagon = np.array([(0, 0, 0), (0.2, 0, 0), (0.3, 0.2, 0), (0.1, 0.4, 0), (-0.1, 0.2, 0)]) + (0.5, 0.5, 0)
    square = np.array([(0, 0, 0), (0.3, 0, 0), (0.3, 0.3, 0), (0, 0.3, 0)])
    bent_square, bent_pentagon = square.copy(), pentagon + (0, 0, 1)
    bent_square[2, 2], bent_pentagon[2, 2] = 0.1, 1.1
    return polygons(name, square[:3], square + (0, 0.4, 0), bent_square + (0.4, 0, 0), pentagon, bent_pentagon)


def test_faces_of_more_than_three_corners():
    report = bake(mixed(), zoo.plane("hi"))
    assert part(report.checks["polygons"], "count", "of") == {"count": 4, "of": 5}
    assert part(report.checks["uneven"], "count", "of") == {"count": 2, "of": 5}
    assert faces(report, "polygons") == [1, 2, 3, 4]
    assert faces(report, "uneven") == [2, 4]


def triangles_of(polygons):
    return {tuple(sorted(polygon.vertices)) for polygon in polygons}


@random_cases.seeds(3, fast=2)
@pytest.mark.parametrize("noise", [0.01, 0.1])
def test_the_modifier_makes_the_triangles_that_blender_draws(seed, noise):
    rng = np.random.default_rng(seed)
    low, gon = zoo.plane("lo", 6), zoo.disc("gon", 9)
    for obj in (low, gon):
        points = np.array([vertex.co for vertex in obj.data.vertices])
        points += rng.normal(0.0, noise, points.shape)
        obj.data.vertices.foreach_set("co", points.astype(np.float32).ravel())
        obj.data.update()
        obj.data.calc_loop_triangles()
        drawn = triangles_of(obj.data.loop_triangles)
        report = bake(obj, zoo.plane("hi"), space="OBJECT")
        assert report.checks["uneven"]["count"] > 0
        _, folded = fixes.add_triangulate(bpy.context, report)
        assert (folded > 0) == (noise == 0.1 and obj == low)
        cut = triangles_of(obj.evaluated_get(bpy.context.evaluated_depsgraph_get()).data.polygons)
        assert len(drawn - cut) == 2 * folded
        after = bake(obj, zoo.plane("hi"), space="OBJECT")
        assert [after.checks[kind]["count"] for kind in ("polygons", "uneven")] == [0, 0]


def test_normals_stay_when_faces_are_triangulated():
    low = zoo.terrain("lo", 2)
    low.data.vertices[4].co.z = 0.7
    low.data.normals_split_custom_set(np.tile((0.6, 0.0, 0.8), (16, 1)))
    fixes.add_triangulate(bpy.context, bake(low, zoo.plane("hi")))
    evaluated = low.evaluated_get(bpy.context.evaluated_depsgraph_get()).data
    normals = np.array([corner.vector for corner in evaluated.corner_normals])
    np.testing.assert_allclose(normals, np.tile((0.6, 0.0, 0.8), (24, 1)), atol=1e-3)


# Shared images, tiles and large maps


def test_each_bake_into_a_shared_image_has_its_own_checks():
    for name, box in (("a", (0, 0, 0.5, 1)), ("b", (0.5, 0, 1, 1))):
        tiles(f"{name}_low", box)
        tiles(f"{name}_high", (*box[:3], 0.5))
    objects = bpy.data.objects
    jobs = [Job(objects[f"{name}_low"], [objects[f"{name}_high"]]) for name in "ab"]
    settings = Settings(method="FLATTEN", width=64, height=64, margin=0, storage="MEMORY", image="atlas")
    reports = bake_all(bpy.context, jobs, settings, share_image=True)
    for report, columns in zip(reports, (slice(0, 32), slice(32, 64)), strict=True):
        assert part(report.checks["uncovered"], *TEXELS) == counted(32 * 32, 32 * 64)
        expected = np.zeros((64, 64), bool)
        expected[32:, columns] = True
        np.testing.assert_array_equal(mask(report, "uncovered"), expected)
    assert bpy.data.images["atlas_uncovered"]


def test_udim_tiles():
    low = tiles("lo", (0, 0, 1, 1), (1, 0, 2, 1))
    report = bake(low, tiles("hi", (0, 0, 1, 1), (1, 0, 1.5, 1)), udim=True, storage="PACK", size=(32, 32))
    assert part(report.checks["uncovered"], *TEXELS) == counted(16 * 32, 2 * 32 * 32)
    assert faces(report, "uncovered") == [1]
    image = masks.draw_mask(bpy.context, report, "uncovered")
    assert image.source == "TILED"
    assert [tile.number for tile in image.tiles] == [1001, 1002]


def test_large_maps_are_checked_in_bands(monkeypatch):
    low, high = stairs()
    report = bake(low, high, size=(48, 80))
    whole = {kind: (mask(report, kind), faces(report, kind)) for kind in ("overlap", "far")}
    monkeypatch.setattr(masks, "TEXELS", 48 * 7)
    for kind, (texels, found) in whole.items():
        np.testing.assert_array_equal(mask(report, kind), texels)
        assert faces(report, kind) == found


def test_a_map_larger_than_the_probe_is_sampled_on_every_second_texel():
    report = bake(
        tiles("lo", (0, 0, 0.5, 1), (0.25, 0, 0.5, 1)), zoo.plane("hi"), size=(2 * coverage.SAMPLES_A_SIDE, 16)
    )
    assert part(report.checks["overlap"], *TEXELS) == counted(
        coverage.SAMPLES_A_SIDE // 4 * 16, coverage.SAMPLES_A_SIDE // 2 * 16
    )
    assert mask(report, "overlap").sum() == coverage.SAMPLES_A_SIDE // 2 * 16


# Objects as they are now


def test_faces_are_found_through_modifiers():
    low, high = zoo.plane("lo", 2), tiles("hi", (0, 0, 0.5, 1))
    rounded = low.modifiers.new("Cut", "SUBSURF")
    rounded.subdivision_type, rounded.levels, rounded.render_levels = "SIMPLE", 1, 2
    low.modifiers.new("Triangles", "TRIANGULATE")
    report = bake(low, high)
    before, attributes = snapshot(), low.data.attributes.keys()
    assert faces(report, "uncovered") == [1, 3]
    assert difference(before, snapshot()) == {}
    assert low.data.attributes.keys() == attributes


def test_modifiers_that_make_new_faces():
    low, other = zoo.plane("lo", 2), zoo.plane("other", 3)
    tree = bpy.data.node_groups.new("Swap", "GeometryNodeTree")
    tree.interface.new_socket("Geometry", in_out="OUTPUT", socket_type="NodeSocketGeometry")
    info, out = tree.nodes.new("GeometryNodeObjectInfo"), tree.nodes.new("NodeGroupOutput")
    info.inputs["Object"].default_value = other
    tree.links.new(info.outputs["Geometry"], out.inputs[0])
    low.modifiers.new("Swap", "NODES").node_group = tree
    report = bake(low, tiles("hi", (0, 0, 0.5, 1)))
    before = snapshot()
    with pytest.raises(BakeError, match="modifiers of 'lo' make new faces"):
        faces(report, "uncovered")
    assert difference(before, snapshot()) == {}


def test_a_surface_and_its_own_base_mesh():
    low = zoo.plane("lo", 2)
    lift = low.modifiers.new("Lift", "DISPLACE")
    low.vertex_groups.new(name="one").add([8], 1.0, "REPLACE")
    lift.vertex_group, lift.strength, lift.mid_level = "one", 0.8, 0.0
    report = bake(low, low, method="AUTO")
    assert report.checks["far"]["count"] > 0
    assert faces(report, "far") == [3]
    low.data.vertices[4].co.z = 0.7
    again = bake(low, low, method="AUTO")
    assert again.checks["uneven"]["count"] == 4
    assert not any("add a Triangulate" in warning for warning in again.warnings)
    with pytest.raises(BakeError, match="without modifiers: triangulate that mesh instead"):
        fixes.add_triangulate(bpy.context, report)


def test_checks_use_the_objects_as_they_are_now():
    low, high = stairs()
    report = bake(low, high)
    high.data.vertices.foreach_set("co", np.zeros(48))
    high.data.transform(np.eye(4))
    low.data.polygons[0].select = True
    for vertex, source in zip(high.data.vertices, low.data.vertices, strict=True):
        vertex.co = source.co
    assert faces(report, "far") == []
    high.name = "renamed"
    with pytest.raises(BakeError, match="no object called 'hi'"):
        faces(report, "far")


def test_checks_use_the_method_of_the_bake():
    """Auto would now cast rays, and none of them would miss."""
    low, high = zoo.plane("lo", 2), zoo.plane("hi", 2)
    report = bake(low, high, method="AUTO")
    assert report.method == "FLATTEN"
    uv = np.ravel([corner.vector for corner in high.data.uv_layers[0].uv])
    high.data.uv_layers[0].uv.foreach_set("vector", uv / 2)
    assert faces(report, "uncovered") == [1, 2, 3]
    assert mask(report, "uncovered").mean() == 0.75


@pytest.mark.parametrize("kind", masks.KINDS)
def test_checks_change_nothing(kind):
    low, high = stairs()
    report = bake(low, high)
    bpy.context.view_layer.objects.active = low
    bpy.ops.object.mode_set(mode="EDIT")
    before = snapshot()
    faces(report, kind)
    assert difference(before, snapshot()) == {}


def test_no_mask_remains_when_the_image_cannot_store_it():
    report = bake(*stairs())
    bpy.data.images.new("lo_normal_far", 4, 4, tiled=True)
    bpy.data.images["lo_normal_far"].source = "SEQUENCE"
    before = snapshot()
    with pytest.raises(BakeError, match="'lo_normal_far' is not a still image"):
        mask(report, "far")
    assert difference(before, snapshot()) == {}


def test_points_that_overflow_do_not_count_for_the_offset():
    texels = np.zeros((1, 2, 3, 4), np.float32)
    texels[..., 3] = 1.0
    texels[0, 0, :, 0] = np.inf, -np.inf, np.nan
    texels[0, 1, :, 0] = 2.0, 3.0, 4.0
    assert separation.offset(texels, "FLATTEN").tolist() == [3.0, 0.0, 0.0]
    assert separation.offset(texels[:, :1], "FLATTEN").tolist() == [0.0, 0.0, 0.0]


def test_a_single_texel_with_detail_between_the_compared_ones_is_found():
    normals = np.zeros((16, 16, 4), np.float32)
    normals[..., 2:] = 1.0
    flat, one = tally.Tally(), tally.Tally()
    flat.add_raw(normals, Settings().map)
    normals[1, 1, :3] = (0.6, 0.0, 0.8)
    one.add_raw(normals, Settings().map)
    assert (flat.leaning, one.leaning) == (0, 1)


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


def test_part_ids_moved_by_whole_tiles_raise_no_warning():
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
    low = masks.of_low(report)
    return [tuple(low.data.edges[number].vertices) for number in masks.find(bpy.context, report, "hard_edges")]


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
