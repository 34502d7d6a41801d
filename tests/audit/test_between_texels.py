# SPDX-License-Identifier: GPL-3.0-or-later
"""What the map shows between the centers of its texels: too few texels and other layers are seen there."""

import bpy
import numpy as np
import pytest

from addon.audit import deviations
from addon.cli import limits
from addon.core.settings import Settings
from addon.jobs import Job, Wants, bake_all
from tests.support import scenes, zoo

pytestmark = pytest.mark.usefixtures("gpu_context")

SETTINGS = {"storage": "MEMORY", "depth": 16, "material": False, "method": "CAST"}
EXACT = 1e-6


def measured(low, high, size, **values):
    settings = Settings(width=size, height=size, **SETTINGS | values)
    return bake_all(bpy.context, [Job(low, [high])], settings, wants=Wants(measured=True))[0].to_dict()


@pytest.mark.parametrize("shape", [(3, 5), (4, 1)])
def test_linear_interpolation_repeats_the_map(shape):
    """At centers a texel counts alone, half way between two their mean, and beyond the last one the first."""
    dice = np.random.default_rng(3)
    texels = dice.random((*shape, 4)).astype(np.float32)
    rows, columns = ((np.arange(count) + 0.5) / count for count in shape)
    assert np.abs(deviations._between(texels, rows, columns) - texels).max() < EXACT
    half = deviations._between(texels, rows + 0.5 / shape[0], columns + 0.5 / shape[1])
    mean = (texels + np.roll(texels, -1, 0) + np.roll(texels, -1, 1) + np.roll(texels, -1, (0, 1))) / 4
    assert np.abs(half - mean).max() < EXACT


def test_too_few_texels_are_seen_between_them_alone():
    low, high = zoo.terrain("low", 2), zoo.terrain("high", 48)
    many, few = (measured(low, high, size) for size in (128, 16))
    assert few["deviation"]["percentile_99"] < 0.1
    assert many["between"]["percentile_95"] < few["between"]["percentile_95"] / 4
    assert many["between"]["wrong"] <= few["between"]["wrong"]
    assert many["between"]["left"] < 0.05 < few["between"]["left"] < 1.0
    limit = limits.parse(f"between.p95<{few['between']['percentile_95'] / 2:.4f}deg")
    assert limits.over(limit, [many]) == []
    assert len(limits.over(limit, [few])) == 1


def sheets(name, slope):
    """Two squares of side 2, one 0.5 above the other, side by side on the map. slope: of the upper one, around its middle."""
    x, y = np.array([-1, 1, 1, -1]), np.array([-1, -1, 1, 1])
    points = np.concatenate([np.c_[x, y, 0 * x], np.c_[x, y, 0.5 + slope * x]])
    uv = np.concatenate([np.c_[0.25 + 0.2 * x, 0.5 + 0.4 * y], np.c_[0.75 + 0.2 * x, 0.5 + 0.4 * y]])
    return zoo.build(name, points, [(0, 1, 2, 3), (4, 5, 6, 7)], uv)


def test_another_layer_is_wrong_at_texels_and_between_them():
    """Rays of the lower sheet that start far outside meet the upper one first, which is 24 degrees off."""
    low, high = sheets("low", 0.0), sheets("high", 0.45)
    right = measured(low, high, 64)
    wrong = measured(low, high, 64, extrusion=3.0, max_distance=6.0, hit="OUTERMOST")
    assert (right["deviation"]["wrong"], right["between"]["wrong"]) == (0.0, 0.0)
    assert wrong["deviation"]["wrong"] > 0.3 and wrong["between"]["wrong"] > 0.3


def test_it_is_measured_only_if_wanted():
    low, high = scenes.planes("low", "high", height=0.01)
    assert scenes.bake(low, high, method="CAST", size=16).between == {}


def test_of_little_detail_little_is_left():
    """8 bits lose less than what is seen, of a plane that has no detail."""
    low, high = scenes.planes("low", "high", height=0.01, slope=0.001)
    report = measured(low, high, 16, depth=8)
    assert report["between"]["percentile_95"] > 0.0
    assert report["between"]["left"] < 0.01
