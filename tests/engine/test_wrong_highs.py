# SPDX-License-Identifier: GPL-3.0-or-later
"""High meshes that are wrong in all ways at once: a bake ends in maps of finite numbers, or in a sentence."""

import bpy
import numpy as np
import pytest

from addon.core.errors import BakeError
from tests.support import maps, random_cases, wrong_highs, zoo

pytestmark = pytest.mark.usefixtures("gpu_context")

outcomes = random_cases.counted(enough=40, mended=0.3, sentences=0.02)


@random_cases.seeds(300, fast=2)
def test_any_high_mesh_ends_in_finite_maps_or_a_sentence(seed, outcomes):
    rng = np.random.default_rng(seed)
    low = zoo.plane("lo") if rng.random() < 0.7 else zoo.sphere("lo", n=8)
    high = wrong_highs.made(rng)
    options = {"smooth_high": int(rng.integers(0, 3)), "keep_faces": bool(rng.random() < 0.1)}
    wanted = ("AO", "THICKNESS", "HEIGHT") if rng.random() < 0.5 else ()
    method = str(rng.choice(["CAST", "AUTO"]))
    try:
        with np.errstate(invalid="raise", divide="raise"):
            report, found = maps.bake_all_maps(low, high, maps=wanted, size=16, method=method, rays=16, **options)
    except BakeError as error:
        assert str(error).endswith(".")
        outcomes["sentences"] += 1
        return
    outcomes["mended" if report.mended else "as read"] += 1
    found["normal"] = maps.pixels(bpy.data.images["map"])
    for name, texels in found.items():
        assert np.isfinite(texels).all(), name
    values = [value for value in report.mended.values() if isinstance(value, float)]
    assert np.isfinite(values).all()
