# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests of how far a low mesh with its map deviates from its high mesh, as reports have it."""

import bpy
import numpy as np
import pytest
from mathutils import Matrix

from addon.audit.deviations import AngleCounts
from addon.core.progress import Pace
from addon.core.settings import Settings
from addon.engine import bands
from addon.jobs import Job, bake_jobs, live_session
from addon.ui import view_shading
from tests.support import zoo

pytestmark = pytest.mark.usefixtures("gpu_context")

SIZE = (128, 96)
EXACT = 0.1
"""Degrees at the 99th percentile of a map in floats with one sample: it holds the very normals that are compared."""
OF_8_BITS = (0.1, 0.6)
"""Between these are the degrees that 8 bits cost at the 99th percentile."""


def settings(**values):
    usual = {"method": "FLATTEN", "margin": 0, "depth": 32, "storage": "MEMORY", "material": False}
    return Settings(**{**usual, "width": SIZE[0], "height": SIZE[1], **values})


def measured(lows, highs, chosen, *, share_image=False):
    """The figures of each bake."""
    bpy.context.view_layer.update()
    jobs = [Job(low, [high]) for low, high in zip(lows, highs, strict=True)]
    for job in jobs:
        job.is_measured = True
    return [report.deviation for report in bake_jobs.bake_all(bpy.context, jobs, chosen, share_image=share_image)]


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
