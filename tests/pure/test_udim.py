# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests the arithmetic of UDIM tiles."""

from contextlib import nullcontext
from pathlib import Path

import numpy as np
import pytest

from addon.core import udim
from addon.core.errors import BakeError, WrongPlace
from addon.core.file_structure import found_files
from addon.output.path_clashes import Places

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


NAMES = ["1000", "1001", "1010", "1999", "2000", "2001", "0999", "3000", "10010"]


def test_a_path_with_a_token_stands_for_the_files_of_all_tiles_and_of_no_other_number(tmp_path):
    for number in NAMES:
        (tmp_path / f"rock_{number}.png").touch()
    found = udim.files(str(tmp_path / "rock_<UDIM>.png"))
    assert list(found) == [1001, 1010, 1999, 2000]
    assert found[2000] == str(tmp_path / "rock_2000.png")


def test_a_path_with_columns_and_rows_stands_for_the_same_tiles(tmp_path):
    for place in ("u1_v1", "u10_v1", "u1_v2", "u10_v100", "u0_v1", "u11_v1", "u1_v101", "u01_v1"):
        (tmp_path / f"rock_{place}.png").touch()
    path = str(tmp_path / "rock_<UVTILE>.png")
    assert list(udim.files(path)) == [1001, 1010, 1011, 2000]
    assert [udim.fill_all(path, tile) for tile in udim.files(path)] == list(udim.files(path).values())


def test_both_numbers_in_a_name_are_of_one_tile():
    tiled = "rock_<UDIM>_<UVTILE>_<UDIM>.png"
    assert udim.tile_of("rock_1012_u2_v2_1012.png", tiled) == 1012
    assert udim.tile_of("rock_1012_u1_v2_1012.png", tiled) == 0
    assert udim.tile_of("rock_1012_u2_v2_1013.png", tiled) == 0


def test_letters_count_only_where_they_should():
    assert udim.tile_of("ROCK_1001.PNG", "rock_<UDIM>.png") == 0
    assert udim.tile_of("ROCK_1001.PNG", "rock_<UDIM>.png", any_case=True) == 1001
    assert udim.spelled("rock_<UDIM>.png", "ROCK_1001.PNG") == "ROCK_<UDIM>.PNG"


@pytest.mark.parametrize("number", NAMES)
def test_a_number_is_a_tile_wherever_it_is_asked(number, tmp_path):
    """All readers of names agree: a search for files, images of importers, and paths that may clash."""
    is_tile = len(number) == 4 and int(number) in udim.TILES
    (tmp_path / f"rock_{number}.png").write_bytes(b"x")
    path = str(tmp_path / "rock_<UDIM>.png")
    assert bool(udim.files(path)) is is_tile
    assert bool(udim.tiled_name(f"rock_{number}")) is is_tile
    assert bool(found_files.existing_tiles(Path(path))) is is_tile
    assert (found_files.find_file("rock_<UDIM>.png", [tmp_path]) is not None) is is_tile
    places = Places()
    places.read(str(tmp_path / f"rock_{number}.png"), "a texture")
    with pytest.raises(WrongPlace) if is_tile else nullcontext():
        places.write(path, "the map")
