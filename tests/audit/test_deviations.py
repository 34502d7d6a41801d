# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests of how far a low mesh with its map deviates from its high mesh, as reports have it."""

import bpy
import numpy as np
import pytest
from mathutils import Matrix, Vector

from addon.audit.deviations import AngleCounts
from addon.core.progress import Pace
from addon.engine import bands
from addon.jobs import Job, Wants, bake_jobs, live_session
from addon.passes import target
from addon.ui import view_scene, view_shading
from addon.ui.view_shading import Mode
from tests.engine.test_stacked_uvs import asymmetric, bump, half, mirrored
from tests.support import angles, maps, raster, scenes, zoo

pytestmark = pytest.mark.usefixtures("gpu_context")


SIZE = (128, 96)
EXACT = 0.1
"""Degrees at the 99th percentile of a map in floats with one sample: it holds the very normals that are compared."""
OF_8_BITS = (0.1, 0.6)
"""Between these are the degrees that 8 bits cost at the 99th percentile."""


def settings(**values):
    return scenes.settings(**{"width": SIZE[0], "height": SIZE[1]} | values)


def measured(lows, highs, chosen, *, share_image=False):
    """The figures of each bake."""
    bpy.context.view_layer.update()
    jobs = [Job(low, [high]) for low, high in zip(lows, highs, strict=True)]
    wants = Wants(measured=True)
    reports = bake_jobs.bake_all(bpy.context, jobs, chosen, wants=wants, share_image=share_image)
    return [report.deviation for report in reports]


def terrains():
    return [zoo.terrain("low", n=9, height=0.3)], [zoo.terrain("high", n=96, height=0.3)]


@pytest.mark.parametrize("values", [{}, {"space": "OBJECT"}, {"space": "WORLD"}, {"method": "CAST"}], ids=str)
def test_an_exact_map_does_not_deviate(values):
    (found,) = measured(*terrains(), settings(**values))
    assert found["percentile_99"] < EXACT
    assert found["median"] <= found["percentile_95"] <= found["percentile_99"] <= found["maximum"] + 1e-3
    assert found["texels"] > 0.8 * SIZE[0] * SIZE[1]


def test_what_8_bits_cost_is_measured():
    (found,) = measured(*terrains(), settings(depth=8))
    assert OF_8_BITS[0] < found["percentile_99"] < OF_8_BITS[1]


def test_the_figures_are_those_of_the_view():
    lows, highs = terrains()
    chosen = settings(depth=8, samples=16, width=16, height=16)
    (found,) = measured(lows, highs, chosen)
    session = live_session.Session(bpy.context, Job(lows[0], highs), chosen, Pace())
    session.run(bpy.context)
    shading = view_shading.Shading(session)
    shading.update(is_measured=True)
    assert found["percentile_99"] == pytest.approx(shading.deviations.percentile_99, rel=0.02)
    assert found["percentile_99"] > 2.0 * OF_8_BITS[1]  # a texel averages what the truth has at its center


def test_bands_of_a_map_are_measured_alike(monkeypatch):
    (whole,) = measured(*terrains(), settings(depth=8))
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    monkeypatch.setattr(bands, "BAND_TEXELS", SIZE[0] * 20)
    (found,) = measured(*terrains(), settings(depth=8))
    assert found == pytest.approx(whole, abs=0.002)


def test_a_shared_map_is_measured_for_each_low_mesh():
    lows, highs = terrains()
    low, high = zoo.plane("a"), zoo.plane("b", slope=0.4)
    for mesh in (lows[0].data, highs[0].data):
        shrink(mesh, 0.0)
    for mesh in (low.data, high.data):
        shrink(mesh, 0.5)
    found = measured([*lows, low], [*highs, high], settings(depth=8), share_image=True)
    assert len(found) == 2
    assert all(each["percentile_99"] < OF_8_BITS[1] for each in found)
    assert all(0.3 < each["texels"] / (SIZE[0] * SIZE[1]) < 0.55 for each in found)


def test_texels_that_show_another_place_are_left_out():
    """The high mesh's UVs are mirrored, so that only those near the middle show their own place."""
    lows, highs = terrains()
    (whole,) = measured(lows, highs, settings())
    change(highs[0].data, lambda uv: uv * (-1.0, 1.0) + (1.0, 0.0))
    (found,) = measured(lows, highs, settings())
    assert 0 < found["texels"] < 0.2 * whole["texels"]


@pytest.mark.parametrize(
    ("size", "rows", "axis", "udim"),
    [
        ((256, 32), None, 0, False),
        ((32, 256), None, 1, True),
        ((256, 32), 20, 1, True),
        ((32, 256), 20, 0, False),
        ((32, 256), 20, 1, False),
    ],
)
def test_half_a_map_that_shows_another_place_is_left_out_of_any_tile_and_shape(size, rows, axis, udim, monkeypatch):
    """On the right or upper half, the high mesh's UVs are mirrored along the other axis: but for the middle and the borders,
    where they meet."""
    (low,), (high,) = terrains()
    factor, offset = ((1.0, -1.0), (0.0, 1.0)) if axis == 0 else ((-1.0, 1.0), (1.0, 0.0))
    change(high.data, lambda uv: np.where(uv[:, axis, None] > 0.5, uv * factor + offset, uv))
    if udim:
        change(low.data, lambda uv: uv + 1.0)
        change(high.data, lambda uv: uv + 1.0)
    if rows:
        monkeypatch.setattr(bands, "BAND_TEXELS", size[0] * rows)
    values = {"udim": True, "storage": "PACK"} if udim else {}
    (found,) = measured([low], [high], settings(width=size[0], height=size[1], **values))
    assert 0.5 < found["texels"] / (size[0] * size[1]) < 0.6
    assert found["percentile_99"] < EXACT


def test_what_16_bits_cost_is_measured_and_not_rounded_to_nothing(tmp_path):
    """Rounding turns each of two components by up to half a step of 2 / 65535: 0.0007 degrees, root mean square."""
    found = []
    for name, depth in (("a.png", 16), ("b.exr", 32), ("c.exr", 16)):
        bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
        chosen = settings(depth=depth, storage="FILE", output=str(tmp_path / name))
        found.append(measured(*terrains(), chosen)[0])
    of_16, of_32, of_half = found
    assert of_32["median"] < 1e-4
    assert 0.0004 < of_16["median"] < 0.001
    assert of_16["percentile_99"] < 0.0025
    assert 0.005 < of_half["median"] < 0.05  # half floats have 11 bits


def test_dithering_costs_more_than_rounding():
    found = []
    for dither in (False, True):
        bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
        found.append(measured(*terrains(), settings(depth=8, dither=dither))[0]["percentile_99"])
    assert found[1] > 1.3 * found[0]


def test_percentiles_are_as_exact_for_small_angles_as_for_large_ones():
    """Against numpy, with seed 7: a third each of about 0.0001, 0.01 and 10 degrees, and one of 0."""
    angles = np.abs(np.random.default_rng(7).normal(size=(3, 9999)) * [[1e-4], [1e-2], [10.0]]).astype(np.float32)
    counts = AngleCounts()
    counts.add(angles[:2].ravel())
    counts.add(angles[2], weight=1)
    found = counts.results()
    for name, share in (("median", 0.5), ("percentile_95", 0.95), ("percentile_99", 0.99)):
        assert found[name] == pytest.approx(np.quantile(angles, share, method="inverted_cdf"), rel=5e-4)
    assert (found["maximum"], found["texels"]) == (pytest.approx(float(angles.max())), angles.size)
    zeros = AngleCounts()
    zeros.add(np.zeros(10, np.float32), weight=3)
    assert zeros.results() == dict.fromkeys(("median", "percentile_95", "percentile_99", "maximum"), 0.0) | {
        "texels": 30
    }


def test_nothing_is_measured_unless_it_is_asked_for():
    (low,), highs = terrains()
    assert bake_jobs.bake_pair(bpy.context, low, highs, settings()).deviation == {}


def shrink(mesh, start):
    """Put the UVs into half of the map."""
    change(mesh, lambda uv: uv * (0.5, 1.0) + (start, 0.0))


def change(mesh, function):
    """Change the UVs by a function from and to (N, 2)."""
    uvs = mesh.uv_layers.active.uv
    values = np.empty(2 * len(uvs), np.float32)
    uvs.foreach_get("vector", values)
    uvs.foreach_set("vector", np.float32(function(values.reshape(-1, 2))).ravel())


@pytest.mark.parametrize(("hit", "degrees"), [("OWN", 0.0), ("OUTERMOST", np.degrees(np.arctan(0.2)))])
def test_the_truth_is_the_layer_that_belongs_to_a_texel_whatever_hit_the_settings_choose(hit, degrees):
    """A tilted plate below a level one: the rays of both start above both."""
    lows, highs = (
        [zoo.plane("low", 2), zoo.plane("low above", 2)],
        [zoo.plane("high", 4, slope=0.2), zoo.plane("high above", 4)],
    )
    for obj, height, move in zip([*lows, *highs], (0.0, 1.0) * 2, (0.0, 0.5) * 2, strict=True):
        shrink(obj.data, move)
        obj.data.transform(Matrix.Translation((0.0, 0.0, height)))
    for one, other in (lows, highs):
        with bpy.context.temp_override(active_object=one, selected_editable_objects=[one, other]):
            bpy.ops.object.join()
    chosen = settings(method="CAST", hit=hit, extrusion=2.0, max_distance=3.0)
    (found,) = measured(lows[:1], highs[:1], chosen)
    assert found["median"] < EXACT
    assert found["percentile_99"] == pytest.approx(degrees, abs=EXACT)
    session = live_session.Session(bpy.context, Job(lows[0], highs[:1]), chosen, Pace())
    session.run(bpy.context)
    shading = view_shading.Shading(session)
    shading.update(is_measured=True)
    assert shading.deviations.percentile_99 == pytest.approx(degrees, abs=EXACT)


@pytest.mark.slow
@pytest.mark.shared
def test_wrong_layers_of_the_outermost_hit_are_found_on_a_collar(shared_assets):
    """39 percent of its texels show the outside of the collar in place of the inside."""
    bpy.ops.wm.open_mainfile(filepath=str(shared_assets / "layers" / "collar.blend"))
    low, high = (bpy.data.objects[name] for name in ("lo", "hi"))
    for hit, least, most in (("OWN", 0.0, EXACT), ("OUTERMOST", 90.0, 180.0)):
        (found,) = measured([low], [high], settings(method="CAST", hit=hit, width=256, height=256))
        assert least <= found["percentile_95"] <= most


# Hidden parts


PARTS_SIZE = 96
NEAR = 0.1
"""Degrees, between percentiles of angles: those of the report, and of two maps that were baked alone."""
RAYS = {"method": "CAST", "extrusion": 0.1, "max_distance": 0.2}


def baked(low, *highs, **values):
    """The report of a bake that measures deviations."""
    bpy.context.view_layer.update()
    (report,) = bake_jobs.bake_all(bpy.context, [Job(low, highs)], chosen(**values), wants=Wants(measured=True))
    return report


def chosen(**values):
    size = {"width": PARTS_SIZE, "height": PARTS_SIZE}
    return scenes.settings(**{"method": "AUTO", "image": "map"} | size | values)


def between_halves(high):
    """The degrees (SIZE, SIZE) between the maps of both halves, each baked alone."""
    alone = [
        maps.bake(half(f"half {side}", side), high, image=f"{side}", size=(PARTS_SIZE, PARTS_SIZE), **RAYS)
        for side in (1, -1)
    ]
    return angles.degrees(*map(angles.decode, alone))


def same_figures(found, degrees):
    """Whether a report has the percentiles of `degrees`."""
    truth = {"median": 50, "percentile_95": 95, "percentile_99": 99, "maximum": 100}
    degrees = np.abs(degrees)
    for name, share in truth.items():
        assert abs(found[name] - np.percentile(degrees, share, method="inverted_cdf")) < NEAR, name
    assert found["texels"] == degrees.size


@pytest.mark.parametrize("stacked", ["FIRST", "LAST"])
def test_both_halves_of_a_mirrored_low_mesh_count_at_their_own_places(stacked):
    """One half shows its own detail exactly, the other one what is between them."""
    high = asymmetric()
    low = mirrored()
    low.modifiers[0].use_mirror_merge = False  # so that the normals are those of a half alone
    report = baked(low, high, stacked=stacked, **RAYS)
    between = between_halves(high)
    assert np.percentile(between, 95) > 5.0
    same_figures(report.deviation, np.concatenate([between, np.zeros_like(between)]))
    assert report.checks["overlap"]["hidden"] == 2 * 4 * 4
    assert report.checks["overlap"]["differing"] == pytest.approx(np.mean(between > 2.0), abs=0.01)


def test_the_folded_side_of_an_island_counts_too():
    """Merged in the middle, both halves are one island."""
    high = asymmetric()
    found = baked(mirrored(), high, **RAYS).deviation
    between = between_halves(high)
    assert found["texels"] == 2 * PARTS_SIZE * PARTS_SIZE
    assert found["percentile_95"] == pytest.approx(np.percentile(np.concatenate([between, 0 * between]), 95), rel=0.1)


def test_bands_change_nothing(monkeypatch):
    high, low = asymmetric(), mirrored()
    whole = baked(low, high, **RAYS).deviation
    monkeypatch.setattr(bands, "BAND_TEXELS", PARTS_SIZE * 20)
    assert baked(low, high, **RAYS).deviation == pytest.approx(whole, abs=0.01)


@pytest.mark.parametrize("offset", [1.0, -2.0])
def test_a_mirrored_half_that_was_moved_by_whole_tiles_shows_the_map_as_well(offset):
    high, low = asymmetric(), mirrored()
    stacked = baked(low, high, **RAYS).deviation
    low.modifiers[0].offset_u = offset
    assert baked(low, high, **RAYS).deviation == pytest.approx(stacked, abs=NEAR)


def test_each_of_many_plates_on_one_place_counts():
    """Plates of slopes 0 to 0.4 on one square: the map has the slope 0."""
    slopes = 0.1 * np.arange(5)
    low, highs = plates(slopes)
    found = baked(low, *highs, method="CAST", extrusion=1.0, max_distance=2.0).deviation
    same_figures(found, np.repeat(np.degrees(np.arctan(slopes)), PARTS_SIZE * PARTS_SIZE))


@pytest.mark.parametrize(("stacked", "aside"), [("FIRST", 0.0), ("LAST", 0.0), ("FIRST", 5.0)])
def test_halves_of_one_high_mesh_with_the_same_uvs_count_by_flatten(stacked, aside):
    """One half of the high mesh has a bump, which is baked alone for the truth."""
    low, smooth, bumped = half("low", 1), half("smooth", 1, n=32), half("bumped", 1, n=32)
    bump(bumped)
    alone = [maps.bake(low, high, image=high.name, size=(PARTS_SIZE, PARTS_SIZE)) for high in (smooth, bumped)]
    between = angles.degrees(*map(angles.decode, alone))
    copy = half("copy", -1, n=32)
    with bpy.context.temp_override(active_object=bumped, selected_editable_objects=[bumped, copy]):
        bpy.ops.object.join()
    low.modifiers.new("Mirror", "MIRROR").use_mirror_merge = False
    bumped.location.x = aside
    report = baked(low, bumped, method="FLATTEN", stacked=stacked)
    assert np.percentile(between, 95) > 5.0
    same_figures(report.deviation, np.concatenate([between, np.zeros_like(between)]))


@pytest.mark.parametrize(("method", "slopes"), [("AUTO", (0.02, 0.0)), ("FLATTEN", (0.02, 0.0, 0.01))])
def test_plates_of_high_meshes_with_the_same_uvs_count_by_flatten(method, slopes):
    low, highs = plates(slopes)
    report = baked(low, *highs, method=method)
    assert report.method == "FLATTEN"
    same_figures(
        report.deviation, np.repeat(np.degrees(np.arctan(slopes) - np.arctan(slopes[0])), PARTS_SIZE * PARTS_SIZE)
    )


def plates(slopes, axis=0):
    """Plates in a row along an axis with the same UVs in one low mesh, and high meshes of these slopes at their places."""
    uv, moves = zoo.grid_uv(2, 2), 3.0 * np.outer(np.arange(len(slopes)), np.eye(3)[axis])
    points = [np.column_stack([2 * uv - 1, np.zeros(len(uv))]) + move for move in moves]
    faces = np.concatenate([zoo.grid_faces(2, 2, number * len(uv)) for number in range(len(slopes))])
    low = zoo.build("low", np.concatenate(points), faces, np.tile(uv, (len(slopes), 1))[faces])
    highs = [zoo.plane(f"high {number}", slope=slope) for number, slope in enumerate(slopes)]
    for high, move in zip(highs, moves, strict=True):
        high.location = move
    return low, highs


@pytest.mark.parametrize("offset", [0.0, 1.0])
def test_the_view_has_the_same_figures_and_shows_each_half_at_its_own_place(offset):
    low, high = mirrored(), asymmetric()
    low.modifiers[0].offset_u = offset
    report = baked(low, high, **RAYS)
    session = live_session.Session(bpy.context, Job(low, [high]), chosen(**RAYS), Pace())
    session.run(bpy.context)
    shading = view_shading.Shading(session)
    shading.update(is_measured=True)
    assert shading.deviations.percentile_99 == pytest.approx(report.deviation["percentile_99"], rel=0.05)
    drawn = seen_from_above(shading)[..., :3]
    # Where the copy is, x below 0, colors are those of degrees; the modeled half is exact, and has the color of 0.
    exact = drawn[48, 72]
    assert np.abs(drawn[20:76, 52:76] - exact).max() < 0.02
    assert np.abs(drawn[20:76, 20:44] - exact).max() > 0.2


def seen_from_above(shading):
    """The deviations of the square -1 to 1, (SIZE, SIZE, 4) float32 with row 0 at the lowest y."""
    into = target.Target(PARTS_SIZE, PARTS_SIZE, ("RGBA32F", "DEPTH_COMPONENT32F"))
    view = raster.look_at(np.array((0.0, 0.0, 5.0)), np.zeros(3), up=(0.0, 1.0, 0.0))
    eye = view_scene.Eye(view, raster.parallel(2.0, 0.1, 10.0, 1.0), np.array((0.0, 0.0, 1.0, 0.0)))
    with target.drawing(into):
        into.framebuffer.clear(depth=1.0)
        shading.draw(Mode.DEVIATION, eye)
    pixels = np.empty((PARTS_SIZE, PARTS_SIZE, 4), np.float32)
    into.read(pixels)
    return pixels


@pytest.mark.parametrize(("slope", "share"), [(0.030, 0.0), (0.040, 1.0)])
def test_plates_differ_from_2_degrees_on(slope, share):
    low, highs = plates((0.0, slope))
    report = baked(low, *highs, method="CAST", extrusion=1.0, max_distance=2.0)
    assert report.checks["overlap"]["differing"] == share
    assert sum("8 triangles of 'low' show the detail of other parts" in text for text in report.warnings) == share
    assert any("Shared UVs: 8 triangles show the detail of other parts" in line for line in report.summary())


def test_parts_of_a_texture_set_count_at_their_own_places():
    """Plates above each other have two materials, in turns: each set has a plate of its own, and a copy that shows it. All rays
    start above all plates."""
    slopes = np.array([0.1, 0.2, 0.15, 0.4])
    low, highs = plates(slopes, axis=2)
    for number in range(2):
        low.data.materials.append(bpy.data.materials.new(f"paint {number}"))
    low.data.polygons.foreach_set("material_index", np.arange(16) // 4 % 2)
    bpy.context.view_layer.update()
    settings = chosen(method="CAST", extrusion=12.0, max_distance=13.0, texture_sets=True, image="{material}")
    reports = bake_jobs.bake_all(bpy.context, [Job(low, highs)], settings, wants=Wants(measured=True))
    assert [report.material for report in reports] == ["paint 0", "paint 1"]
    for report, own in zip(reports, (slopes[::2], slopes[1::2]), strict=True):
        degrees = np.degrees(np.arctan(own) - np.arctan(own[0]))
        same_figures(report.deviation, np.repeat(degrees, PARTS_SIZE * PARTS_SIZE))


def test_only_the_hidden_side_of_a_part_counts_as_such():
    """A plate whose UVs lie half on those of another one is exact on the other half."""
    slopes = np.array([0.1, 0.3])
    low, highs = plates(slopes)
    for index, corner in enumerate(low.data.uv_layers.active.uv):
        corner.vector.x = 0.5 * corner.vector.x + 0.25 * (index >= 16)
    found = baked(low, *highs, method="CAST", extrusion=1.0, max_distance=2.0).deviation
    degrees = np.degrees(np.arctan(0.3) - np.arctan(0.1))
    same_figures(found, np.repeat([0.0, 0.0, 0.0, degrees], PARTS_SIZE * PARTS_SIZE // 4))


def test_parts_on_any_udim_tile_count_at_their_own_places():
    slopes = np.array([0.1, 0.2, 0.3])
    low, highs = plates(slopes)
    uvs = low.data.uv_layers.active.uv
    for index, corner in enumerate(uvs):
        corner.vector += Vector((2.0, 1.0) if index < 16 or index >= 32 else (0.0, 0.0))
    report = baked(low, *highs, method="CAST", extrusion=1.0, max_distance=2.0, udim=True, storage="PACK")
    assert report.tiles == [1001, 1013]
    degrees = np.degrees(np.arctan([0.1, 0.2, 0.3]) - np.arctan([0.1, 0.2, 0.1]))
    same_figures(report.deviation, np.repeat(degrees, PARTS_SIZE * PARTS_SIZE))


@pytest.mark.slow
def test_parts_count_at_their_own_places_where_flatten_leaves_texels_to_rays():
    """A strip of the high mesh has UVs that lie elsewhere, so that Auto casts rays there."""
    low, bumped, copy = half("low", 1), half("bumped", 1, n=40), half("copy", -1, n=40)
    bump(bumped)
    alone = [maps.bake(low, high, image=high.name, size=(PARTS_SIZE, PARTS_SIZE), **RAYS) for high in (bumped,)]
    low.modifiers.new("Mirror", "MIRROR").use_mirror_merge = False
    smooth = maps.bake(half("other", -1), copy, image="copy", size=(PARTS_SIZE, PARTS_SIZE), **RAYS)
    with bpy.context.temp_override(active_object=bumped, selected_editable_objects=[bumped, copy]):
        bpy.ops.object.join()
    move_some_uvs(bumped)
    report = baked(low, bumped)
    assert report.method == "FLATTEN"
    assert 0.01 < report.rays < 0.2
    between = angles.degrees(*map(angles.decode, (alone[0], smooth)))
    assert report.deviation["texels"] == pytest.approx(2 * PARTS_SIZE * PARTS_SIZE, rel=0.01)
    assert report.deviation["percentile_95"] == pytest.approx(np.percentile([between, 0 * between], 95), abs=0.5)


def move_some_uvs(obj):
    """Put the UVs of a strip of faces outside the tile."""
    uvs = obj.data.uv_layers.active.uv
    values = np.empty(2 * len(uvs), np.float32)
    uvs.foreach_get("vector", values)
    values = values.reshape(-1, 4, 2)
    values[values[..., 1].mean(axis=1) > 0.975] += 3.0
    uvs.foreach_set("vector", values.ravel())
