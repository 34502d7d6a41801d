# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests the hints about low and high meshes whose units, axes or places differ."""

import numpy as np
import pytest

from addon.core.preflight import placement_hint, rounding_hint

SIDES = np.array([4.0, 3.0, 1.0])


def box(sides=SIDES, center=(0.0, 0.0, 0.0)):
    return np.array([np.array(center) - sides / 2.0, np.array(center) + sides / 2.0])


@pytest.mark.parametrize(("factor", "words"), [(100.0, "100 times as large"), (0.001, "1000 times as small")])
def test_other_units_are_named(factor, words):
    assert words in placement_hint(box(), box(SIDES * factor * 1.02))


def test_feet_are_named():
    assert "3.281 times as large" in placement_hint(box(), box(SIDES / 0.3048))


def test_other_axes_are_named():
    assert "turned by 90 degrees about X" in placement_hint(box(), box(SIDES[[0, 2, 1]]))


def test_other_offsets_are_named():
    text = placement_hint(box(), box(center=(512_345.0, 5_412_345.0, 300.0)))
    assert "(0, 0, 0)" in text
    assert "(512345, 5.41234e+06, 300)" in text


def test_meshes_that_fit_give_no_hint():
    assert placement_hint(box(), box(SIDES * 1.04)) == ""
    assert placement_hint(box(), box(SIDES * np.array([100.0, 100.0, 2.0]))) == ""  # a large scan, and a part of it
    assert placement_hint(box(), box(center=(20.0, 0.0, 0.0))) == ""  # moved aside
    flat = np.array([4.0, 3.0, 0.0])
    assert placement_hint(box(flat), box(flat + [0.0, 0.0, 0.02])) == ""
    assert "100 times" in placement_hint(box(flat), box(flat * 100.0))


def test_boxes_without_a_size_give_no_hint():
    assert placement_hint(box(SIDES * 0.0), box()) == ""
    assert placement_hint(box(), box(SIDES * np.nan)) == ""
    assert placement_hint(box(SIDES * np.inf), box()) == ""


def test_rounded_coordinates_are_named():
    far = box(center=(512_345.0, 5_412_345.0, 300.0))
    assert rounding_hint(far, np.zeros(3)).startswith(
        "lies 5.41e+06 from its origin, where single precision rounds coordinates to 0.5."
    )
    assert "to 0.5." in rounding_hint(box(), np.array([0.0, 5_412_345.5, 0.0]))


def test_coordinates_that_are_not_rounded_give_no_sentence():
    assert rounding_hint(box(), np.zeros(3)) == ""
    assert rounding_hint(box(), np.array([512_345.0, -5_412_345.0, 312.0])) == ""  # whole numbers are exact
    assert rounding_hint(box(SIDES * 1e6), np.array([1e6 / 3.0, 0.0, 0.0])) == ""
    assert rounding_hint(box(center=(100.0, 0.0, 0.0)), np.zeros(3)) == ""
    assert rounding_hint(box(SIDES * 0.0), np.zeros(3)) == ""
    assert rounding_hint(box(SIDES * np.inf), np.zeros(3)) == ""
