# SPDX-License-Identifier: GPL-3.0-or-later
"""What programs show of a map, as the report says it, equals what their rules give in float64."""

import bpy
import numpy as np
import pytest

from addon.audit import deviations
from addon.core.declarations import targets
from addon.core.progress import Pace, finish
from addon.core.settings import Settings
from addon.engine import bands
from addon.jobs import Job, bake_jobs, bake_pair
from tests.support import angles, raster, scenes, zoo
from tests.support.maps import pixels
from tests.support.seen_frames import frames

pytestmark = pytest.mark.usefixtures("gpu_context")

SIZE = (96, 64)
CLOSE = 0.003
"""Degrees. Percentiles are rounded down to 0.001 degrees, and rasterizers round corners to 1/256 texel."""
BORDER = 0.02
"""Share of the texels: those whose center is at the border of a triangle, which one rasterizer may give to its neighbor."""
ALL = tuple(target.name for target in targets.TARGETS)


def terrains():
    return zoo.terrain("low", n=9, height=0.3), zoo.terrain("high", n=96, height=0.3)


def settings(**values):
    return scenes.settings(**{"targets": ALL, "width": SIZE[0], "height": SIZE[1], "basis": "CYCLES"} | values)


def expected(low, texels, chosen, target):
    """The angles (N,) between what the map means and what the program shows, in float64."""
    seen = frames(low, SIZE)
    axes = chosen.map.channels
    stored = texels[..., :3].astype(np.float64)
    meant = decode(stored, axes)
    if min(chosen.storing.depth, target.depth) == 8:
        stored = np.floor(stored * 255.0 + 0.5) / 255.0
    shown = decode(stored, ("+X", target.green, "+Z"))
    if target.rebuilds_z:
        shown[..., 2] = np.sqrt(np.maximum(0.0, 1.0 - shown[..., 0] ** 2 - shown[..., 1] ** 2))
    return angles.degrees(seen.decoded(meant, chosen.map.basis), seen.decoded(shown, target.basis.name))


def decode(stored, axes):
    return raster.decode(stored.reshape(-1, 3), axes).reshape(stored.shape)


@pytest.mark.parametrize(
    "values",
    [{}, {"basis": "NORMALIZED"}, {"basis": "MIKKTSPACE", "green": "-Y"}, {"red": "-Z", "blue": "+X"}],
    ids=str,
)
def test_each_program_is_off_by_what_its_rules_give(values):
    low, high = terrains()
    chosen = settings(**values)
    report = bake_pair(bpy.context, low, [high], chosen)
    texels = pixels(bpy.data.images[report.image])
    assert list(report.targets) == list(ALL)
    for name, found in report.targets.items():
        off = expected(low, texels, chosen, targets.BY_NAME[name])
        assert found["texels"] == pytest.approx(len(off), rel=BORDER)
        for key, percent in (("median", 50), ("percentile_95", 95)):
            below, above = np.percentile(off, [percent - 2, percent + 2])
            assert below - CLOSE <= found[key] <= above + CLOSE, (name, key)
        below, above = np.percentile(off, 97), off.max()
        assert below - CLOSE <= found["percentile_99"] <= above + CLOSE, name
        assert found["percentile_99"] <= found["maximum"] + CLOSE


def test_the_programs_that_the_map_is_made_for_are_exact():
    for basis in {target.basis.name for target in targets.TARGETS}:
        for green in (targets.UP, targets.DOWN):
            found = bake_pair(bpy.context, *pair_of(terrains()), settings(basis=basis, green=green)).targets
            for target in targets.TARGETS:
                is_made = (target.basis.name, target.green) == (basis, green) and target.depth > 8
                assert (found[target.name]["percentile_95"] < CLOSE) == is_made, (basis, green, target.name)


def pair_of(objects):
    low, high = objects
    return low, [high]


def assert_same(one, other):
    """The largest angles are those of single texels at the corners of triangles."""
    assert list(one) == list(other)
    for name, found in one.items():
        assert found["texels"] == other[name]["texels"]
        before = dict(other[name])
        assert found.pop("compressed", None) == pytest.approx(before.pop("compressed", None), abs=0.01)
        assert found == pytest.approx(before, abs=0.01)


def test_bands_and_tiles_and_an_atlas_count_the_same_texels(monkeypatch):
    low, high = terrains()
    whole = bake_pair(bpy.context, low, [high], settings()).targets
    monkeypatch.setattr(bands, "BAND_TEXELS", SIZE[0] * 10)
    assert_same(bake_pair(bpy.context, low, [high], settings()).targets, whole)
    tiled = bake_pair(bpy.context, low, [high], settings(udim=True, tiles=(1001,), storage="PACK")).targets
    assert_same(tiled, whole)
    (report,) = finish(
        bake_jobs.work(bpy.context, [Job(low, [high])], settings(image="atlas"), Pace(None), share_image=True)
    )
    assert_same(report.targets, whole)


def test_texels_with_a_z_of_0_or_less_are_a_warning_for_programs_that_make_z():
    low, high = zoo.plane("low"), zoo.plane("high")
    high.rotation_euler.x = 2.0
    report = bake_pair(bpy.context, low, [high], settings(targets=("unreal", "godot", "three"), keep_faces=True))
    rebuilt = {name: found["rebuilt"] for name, found in report.targets.items()}
    texels = SIZE[0] * SIZE[1]
    assert rebuilt == {"unreal": texels, "godot": texels, "three": 0}
    assert not any("z is made" in text for text in report.warnings)  # they name the cause
    assert deviations.engine_warnings(report.targets) == [
        f"Unreal Engine, Godot 4.4+: z is made of x and y there, and {texels:,} texels with a z of 0 or less come out wrong."
    ]
    away = 180.0 - 2.0 * np.degrees(2.0 - np.pi / 2.0)  # mirrored at the surface, by green as well in Unreal
    assert report.targets["godot"]["maximum"] == pytest.approx(180.0 - away, abs=0.01)


def test_the_summary_has_a_line_for_each_program():
    report = bake_pair(bpy.context, *pair_of(terrains()), settings(targets=("unreal", "cycles")))
    lines = [line for line in report.summary() if " is off by " in line]
    assert [line.split(" is off by ")[0] for line in lines] == ["Unreal Engine", "Blender Cycles"]
    assert [line.endswith("; it reads green as -Y") for line in lines] == [True, False]
    assert report.to_dict()["notes"] == ["Unreal Engine reads green as -Y, and this map has +Y: set green to -y."]


@pytest.mark.parametrize("values", [{"space": "OBJECT"}, {"normal": False, "maps": ("AO",)}, {"targets": ()}], ids=str)
def test_a_bake_without_a_tangent_space_map_has_no_targets(values):
    assert bake_pair(bpy.context, *pair_of(terrains()), settings(**values)).targets == {}


def test_programs_with_other_tangents_of_an_uneven_scale_are_named_and_not_measured():
    low, high = zoo.terrain("low", n=5, height=0.3), zoo.terrain("high", n=32, height=0.3)
    for obj in (low, high):
        obj.scale = (1.0, 2.0, 1.0)
    settings = Settings(
        method="FLATTEN",
        space="TANGENT",
        basis="NORMALIZED",
        width=64,
        height=64,
        targets=("three", "cycles", "babylon"),
    )
    report = bake_pair(bpy.context, low, [high], settings)
    assert set(report.targets) == {"three", "babylon"}
    (said,) = (warning for warning in report.warnings if "Apply the scale" in warning)
    assert said.startswith("Blender Cycles: of 'low', which is scaled more along one axis")
    low.scale = high.scale = (2.0, 2.0, 2.0)
    report = bake_pair(bpy.context, low, [high], settings)
    assert set(report.targets) == {"three", "cycles", "babylon"}
    assert not [warning for warning in report.warnings if "Apply the scale" in warning]
