# SPDX-License-Identifier: GPL-3.0-or-later
"""What the audit counts and where it locates it, on meshes where every texel and every face is known."""

import json

import bpy
import numpy as np
import pytest

from addon.audit import tally
from addon.core.errors import BakeError
from addon.core.report import Report
from addon.core.settings import Settings
from addon.engine import separation
from addon.jobs import Job, bake_all, checks
from tests.support import maps, zoo
from tests.support.snapshot import difference, snapshot

pytestmark = pytest.mark.usefixtures("gpu_context")

RAYS = {"method": "CAST", "extrusion": 1.0, "max_distance": 2.0}


def bake(low, *highs, cage=None, size=(64, 64), **settings):
    """The report of a bake, written to a file and read back."""
    values = {"method": "FLATTEN", "margin": 0, "storage": "MEMORY", "material": False, **settings}
    job = Job(low, highs, cage)
    report = bake_all(bpy.context, [job], Settings(width=size[0], height=size[1], **values))[0]
    values = json.loads(json.dumps(report.to_dict()))
    del values["readers"]  # the earlier name of a key
    return Report(**values)


def warnings_of(report):
    """The warnings, except that the map of planes is flat."""
    return [warning for warning in report.warnings if not warning.startswith("The map is flat")]


def faces(report, kind):
    return checks.find(bpy.context, report, kind).tolist()


def mask(report, kind):
    """The mask (H, W) bool. It must be only black and white."""
    texels = maps.pixels(checks.draw_mask(bpy.context, report, kind))
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
    assert {kind: check["count"] for kind, check in report.checks.items()} == dict.fromkeys(checks.KINDS, 0) | {
        "polygons": 9
    }
    for kind in ("overlap", "uncovered", "far"):
        assert report.checks[kind]["of"] == 64 * 64
        assert not mask(report, kind).any()
    assert warnings_of(report) == []
    assert [kind for kind in checks.KINDS if faces(report, kind)] == ["polygons"]


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


def test_auto_probes_once(monkeypatch):
    """The measurement that chose the method also gives the distances."""
    low, high = zoo.terrain("lo", 8), zoo.terrain("hi", 32)
    size = separation.PROBE_SIZE, separation.PROBE_SIZE
    expected = bake(low, high, method="FLATTEN", size=size).checks["far"]
    monkeypatch.setattr(separation, "full_probe", None)
    found = bake(low, high, method="AUTO", size=size).checks["far"]
    assert found == expected
    assert 0.0 < found["percentile_99"] < found["maximum"] < 0.2


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


@pytest.mark.parametrize("seed", range(3))
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
        _, folded = checks.add_triangulate(bpy.context, report)
        assert (folded > 0) == (noise == 0.1 and obj == low)
        cut = triangles_of(obj.evaluated_get(bpy.context.evaluated_depsgraph_get()).data.polygons)
        assert len(drawn - cut) == 2 * folded
        after = bake(obj, zoo.plane("hi"), space="OBJECT")
        assert [after.checks[kind]["count"] for kind in ("polygons", "uneven")] == [0, 0]


def test_normals_stay_when_faces_are_triangulated():
    low = zoo.terrain("lo", 2)
    low.data.vertices[4].co.z = 0.7
    low.data.normals_split_custom_set(np.tile((0.6, 0.0, 0.8), (16, 1)))
    checks.add_triangulate(bpy.context, bake(low, zoo.plane("hi")))
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
    image = checks.draw_mask(bpy.context, report, "uncovered")
    assert image.source == "TILED"
    assert [tile.number for tile in image.tiles] == [1001, 1002]


def test_large_maps_are_checked_in_bands(monkeypatch):
    low, high = stairs()
    report = bake(low, high, size=(48, 80))
    whole = {kind: (mask(report, kind), faces(report, kind)) for kind in ("overlap", "far")}
    monkeypatch.setattr(checks, "TEXELS", 48 * 7)
    for kind, (texels, found) in whole.items():
        np.testing.assert_array_equal(mask(report, kind), texels)
        assert faces(report, kind) == found


def test_a_map_larger_than_the_probe_is_sampled_on_every_second_texel():
    report = bake(tiles("lo", (0, 0, 0.5, 1), (0.25, 0, 0.5, 1)), zoo.plane("hi"), size=(2 * tally.SAMPLES_A_SIDE, 16))
    assert part(report.checks["overlap"], *TEXELS) == counted(
        tally.SAMPLES_A_SIDE // 4 * 16, tally.SAMPLES_A_SIDE // 2 * 16
    )
    assert mask(report, "overlap").sum() == tally.SAMPLES_A_SIDE // 2 * 16


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
    with pytest.raises(BakeError, match="triangulate the base mesh instead"):
        checks.add_triangulate(bpy.context, report)


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


@pytest.mark.parametrize("kind", checks.KINDS)
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
