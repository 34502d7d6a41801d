# SPDX-License-Identifier: GPL-3.0-or-later
"""A look at the high meshes before a bake says what the bake then does."""

import bpy
import numpy as np
import pytest

from addon.core.settings import Settings
from addon.jobs import Job, pair_checks
from tests.support import scenes, spoiled, zoo
from tests.support.snapshot import difference, snapshot

pytestmark = pytest.mark.usefixtures("gpu_context")


def look(low, *highs, **settings):
    values = {"method": "CAST", "storage": "MEMORY", "material": False, **settings}
    return pair_checks.look_at_high(bpy.context, Job(low, highs), Settings(**values))


def test_a_clean_mesh():
    low, high = zoo.plane("lo"), zoo.plane("hi", 8)
    high.location.z = 0.1
    bpy.context.view_layer.update()
    found = look(low, high)
    assert (found.triangles, found.parts, found.closed) == (128, 1, 0)
    assert found.mended == {}
    assert found.noise == pytest.approx(0.0, abs=1e-3)
    assert found.distances == pytest.approx((0.1, 0.1, np.sqrt(8.0)), rel=1e-4)
    lines = found.lines()
    assert lines[:2] == ["128 triangles in 1 connected parts, 0 of them closed", "No face will be turned over"]
    assert lines[2].startswith("Parts that are not closed have holes or borders")
    assert "0.1 (median, 3.5% of its diagonal)" in lines[-1]


def test_a_spoiled_mesh_is_told_as_the_bake_mends_it_seed_4():
    low, soup = zoo.plane("lo"), spoiled.of_object(zoo.terrain("quads", 32))
    rng = np.random.default_rng(4)
    high = spoiled.build("hi", spoiled.joined(spoiled.flipped_in_regions(soup, rng, 0.2), soup.at(slice(1000, 1050))))
    before = snapshot()
    found = look(low, high)
    assert difference(before, snapshot()) == {}
    assert found.mended == scenes.bake(low, high, method="CAST").mended
    assert found.mended["twice"] == 50
    share = found.mended["turned"] / found.mended["of"]
    assert any(f"{share:.1%} of the faces, will be turned over" in line for line in found.lines())
    assert any("50 in the place of others will be left out" in line for line in found.lines())
    assert look(low, high, keep_faces=True).mended == {}


def test_noise_is_told_in_degrees_seed_5():
    low, soup = zoo.plane("lo"), spoiled.of_object(zoo.terrain("quads", 32))
    noisy = spoiled.build("hi", spoiled.noisy(soup, np.random.default_rng(5), 0.2))
    assert look(low, noisy).noise > 3.0 * look(low, spoiled.build("clean", soup)).noise > 0.0
