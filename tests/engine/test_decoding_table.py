# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests that the manual says what the numbers of thickness and curvature maps mean, as reports have it."""

import numpy as np
import pytest

from addon.core.map_types import BY_NAME
from addon.core.settings import Settings
from addon.engine.ray_maps import meanings
from addon.mesh.local_space import LocalSpace
from tests.support.manual import encodings


def test_the_table_of_encodings_has_the_scales_of_reports():
    lengths = {"distance_unit": "SCENE", "curvature_radius": 0.5, "thickness_distance": 0.25}
    settings = Settings(maps=("CURVATURE", "CONVEXITY", "CAVITY", "THICKNESS"), **lengths)
    scales = {
        "8 / (3 radii)": 16.0 / 3.0,
        "4 / (3 radii)": 8.0 / 3.0,
        "-4 / (3 radii)": -8.0 / 3.0,
        "The thickness distance": 0.25,
    }
    found = meanings(settings, LocalSpace(np.zeros(3), 1.0))
    assert len(found) == len(settings.map.maps)
    for name, how in found.items():
        midlevel, scale, _ = encodings()[BY_NAME[name].label]
        assert (float(midlevel), scales[scale]) == pytest.approx((how["midlevel"], how["scale"]))
