# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests that names of objects become file names that are valid on every system."""

import pytest

from addon.core import naming


@pytest.mark.parametrize(
    ("name", "written"),
    [
        *((name, name) for name in ("Möbel", "岩", "صخرة", "rock.001", "a b  c", "it's", ".hidden", "a#1", "con2")),
        *(("a/b", "a_b"), ("C:\\x", "C__x"), ('say "so"', "say _so_"), ("<UDIM>", "_UDIM_"), ("tab\there", "tab_here")),
        *(("..", "__"), ("ends. .", "ends___"), ("CON", "CON_"), ("nul.png", "nul_.png"), ("com1", "com1_")),
        *(("\udcff", "_"), ("100%", "100_")),
    ],
)
def test_only_characters_that_file_systems_refuse_are_replaced(name, written):
    assert naming.file_name(name) == written
    assert naming.fill("a/{low}/{low}.png", name) == f"a/{written}/{written}.png"
