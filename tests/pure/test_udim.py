# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests the arithmetic of UDIM tiles."""

import numpy as np
import pytest

from addon.core import udim
from addon.core.errors import BakeError
from addon.engine.bands import Band

SIZE = 64, 48


def shown(uv, uv_to_clip):
    return np.asarray(uv) * uv_to_clip[:2] + uv_to_clip[2:]


def test_number_and_place_are_inverse_functions():
    assert [udim.place(tile) for tile in (1001, 1010, 1011, 2000)] == [(0, 0), (9, 0), (0, 1), (9, 99)]
    assert [udim.number(*udim.place(tile)) for tile in udim.TILES] == list(udim.TILES)


@pytest.mark.parametrize("tile", [1001, 1010, 1034])
def test_a_tile_fills_clip_space(tile):
    lowest = np.array(udim.place(tile))
    assert shown([lowest, lowest + 0.5, lowest + 1], udim.uv_to_clip(tile)).tolist() == [[-1, -1], [0, 0], [1, 1]]


@pytest.mark.parametrize("tile", [1001, 1034])
def test_a_part_of_a_tile_fills_clip_space(tile):
    lowest = np.array(udim.place(tile))
    start, count = np.array((8, 12)), np.array((16, 24))
    corners = [lowest + start / SIZE, lowest + (start + count) / SIZE]
    np.testing.assert_allclose(shown(corners, udim.uv_to_clip(tile, SIZE, (8, 12), (16, 24))), [[-1, -1], [1, 1]])


def test_a_band_shows_its_rows_and_its_halo():
    band = Band(12, 24, SIZE, 4, tile=1012)
    corners = [(1.0, 1.0 + 8 / SIZE[1]), (2.0, 1.0 + 28 / SIZE[1])]
    np.testing.assert_allclose(shown(corners, band.uv_to_clip), [[-1, -1], [1, 1]])


def test_lists_of_tiles_are_read():
    assert udim.parse("1001, 1003 1001") == (1001, 1003)
    assert udim.parse("") == ()
    for text in ("-1", "1001.5", "all", "9" * 5000):
        with pytest.raises(BakeError, match="is not a list of UDIM tiles"):
            udim.parse(text)


def test_numbers_that_are_not_tiles_are_refused():
    udim.check(())
    udim.check((1001, 2000))
    for tile in (1000, 2001):
        with pytest.raises(BakeError, match=f"{tile} is not a UDIM tile"):
            udim.check((1001, tile))
