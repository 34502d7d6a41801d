# SPDX-License-Identifier: GPL-3.0-or-later
"""The points at which a file is compared with the bake, and what is found where a file differs from it."""

import numpy as np
import pytest

from addon.core.declarations import bases, targets
from addon.core.errors import BakeError
from addon.export import comparison
from addon.export.baked_low import FileMesh
from addon.export.comparison import Baked

UV = np.array([[[0, 0], [1, 0], [0, 1]], [[1, 0], [1, 1], [0, 1]]], np.float32)
POSITIONS = np.concatenate([UV, np.zeros((2, 3, 1), np.float32)], axis=-1)
NORMALS = np.tile(np.float32([0, 0, 1]), (2, 3, 1))
TANGENTS = np.tile(np.float32([1, 0, 0, 1]), (2, 3, 1))
PAGES = np.zeros(2, np.int32)


def texels(vector, size=8):
    """A map of one normal."""
    return np.tile(np.float32([*(np.array(vector) * 0.5 + 0.5), 1.0]), (size, size, 1))


def baked(vector=(0, 0, 1)):
    return Baked(POSITIONS, NORMALS, TANGENTS, UV, PAGES, bases.MIKKTSPACE, lambda _page: texels(vector))


def found(**other):
    values = {"positions": POSITIONS, "normals": NORMALS, "uv": UV, "tangents": TANGENTS, "materials": PAGES}
    return FileMesh(**{**values, **other}, pictures=[b""])


def test_points_are_centers_of_texels_in_their_triangles():
    triangles, weights, uv = comparison.points(UV, 16, 16)
    assert len(triangles) > 500
    assert set(triangles.tolist()) == {0, 1}
    np.testing.assert_allclose(np.einsum("nc,nck->nk", weights, UV[triangles]), uv, atol=1e-12)
    np.testing.assert_allclose(uv * 16 % 1.0, 0.5)
    assert weights.min() >= 0.0


def test_uvs_without_area_have_no_points():
    assert len(comparison.points(np.zeros((2, 3, 2), np.float32), 16, 16)[0]) == 0


@pytest.mark.parametrize(
    ("other", "stored", "angle"),
    [
        ({}, (0, 0, 1), 0.0),
        ({}, (np.sin(0.1), 0, np.cos(0.1)), np.degrees(0.1)),
        ({"tangents": TANGENTS * np.float32([-1, 1, 1, 1])}, (0, 0, 1), 0.0),
        ({"normals": np.tile(np.float32([0, np.sin(0.2), np.cos(0.2)]), (2, 3, 1))}, (0, 0, 1), np.degrees(0.2)),
    ],
)
def test_angles_of_what_differs(other, stored, angle):
    measured = comparison.measure(baked(), found(**other), lambda _page: texels(stored))
    assert measured.degrees["MIKKTSPACE"]["median"] == pytest.approx(angle, abs=1e-3)
    assert measured.degrees["MIKKTSPACE"]["maximum"] == pytest.approx(angle, abs=1e-3)


def test_a_turned_tangent_turns_what_leans():
    lean = (0.6, 0.0, 0.8)
    turned = found(tangents=TANGENTS * np.float32([-1, 1, 1, 1]))
    measured = comparison.measure(baked(lean), turned, lambda _page: texels(lean))
    assert measured.degrees["MIKKTSPACE"]["median"] == pytest.approx(2.0 * np.degrees(np.arcsin(0.6)), abs=1e-3)


@pytest.mark.parametrize(
    ("other", "reason"),
    [
        ({"positions": POSITIONS[:1]}, "1 triangles of 'low' where 2 were baked"),
        ({"positions": POSITIONS + 0.01}, "other triangles"),
        ({"uv": UV + 0.01}, "other UVs"),
        ({"materials": PAGES + 1}, "other materials"),
    ],
)
def test_another_surface_is_refused(other, reason):
    comparison.check_surface(baked(), found(), "low")
    with pytest.raises(BakeError, match=reason):
        comparison.check_surface(baked(), found(**other), "low")


@pytest.mark.parametrize(
    ("name", "channels", "read"),
    [
        ("three", (), (0.36, 0.48, -0.8)),
        ("unreal", (), (0.36, 0.48, 0.8)),
        ("directx", (), (0.36, 0.48, -0.8)),
        ("three", ("+X", "-Y", "+Z"), (0.36, -0.48, -0.8)),
        ("directx", ("+X", "-Y", "+Z"), (0.36, 0.48, -0.8)),
        ("unreal", ("+X", "+Y", "+Z"), (0.36, -0.48, 0.8)),
        ("three", ("+Z", "-Y", "-X"), (-0.8, -0.48, -0.36)),
    ],
)
def test_programs_read_their_green_and_make_their_z(name, channels, read):
    vector = np.array((0.36, 0.48, -0.8))
    measured = comparison.measure(
        baked(vector), found(), lambda _page: texels(vector), [targets.BY_NAME[name]], channels
    )
    angle = np.degrees(np.arccos(np.clip(vector @ read, -1.0, 1.0)))
    assert measured.targets.keys() == {name}
    assert measured.targets[name]["median"] == pytest.approx(angle, abs=1e-3)
    assert measured.degrees["MIKKTSPACE"]["median"] == pytest.approx(0.0, abs=1e-3)


def test_a_missing_normal_map_is_refused():
    with pytest.raises(BakeError, match="no normal map"):
        comparison.measure(baked(), found(), lambda _page: None)
