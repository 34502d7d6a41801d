# SPDX-License-Identifier: GPL-3.0-or-later
"""Which names belong together."""

import pytest

from addon.bake.errors import BakeError
from addon.bake.pairs import Pair, Suffixes, match


def test_the_naming_of_the_readme():
    names = ["rock_low", "rock_high", "rock_high_2", "rock_cage", "Camera", "tree_low", "tree_high"]
    assert match(names, Suffixes()) == (
        [Pair("rock", "rock_low", ["rock_high", "rock_high_2"], "rock_cage"), Pair("tree", "tree_low", ["tree_high"])],
        [],
    )


@pytest.mark.parametrize("high", ["ROCK_HIGH", "Rock_High.001", "rock_high_bolts.012", "rock_HIGH_a_b"])
def test_case_copies_and_more_words_are_tolerated(high):
    pairs, problems = match(["rock_low.003", high], Suffixes())
    assert [(pair.low, pair.highs) for pair in pairs] == [("rock_low.003", [high])]
    assert problems == []


@pytest.mark.parametrize("name", ["rock", "low", "_low", "rocklow", "rock_lower", "rock_low_2", "rock_highest"])
def test_other_names_are_nobody_s_business(name):
    assert match([name], Suffixes()) == ([], [])


def test_other_suffixes():
    pairs, _ = match(["a.lp", "a.hp", "b_low"], Suffixes(".lp", ".hp", ".cg"))
    assert pairs == [Pair("a", "a.lp", ["a.hp"])]


def test_names_with_what_regular_expressions_read():
    pairs, _ = match(["a(+)[low", "a(+)[high"], Suffixes("[low", "[high", "[cage"))
    assert pairs == [Pair("a(+)", "a(+)[low", ["a(+)[high"])]


def test_what_is_left_over_is_said():
    pairs, problems = match(["a_low", "b_high", "c_cage", "d_low", "D_LOW.001", "d_high"], Suffixes())
    assert [pair.name for pair in pairs] == ["D"]
    assert len(problems) == 4
    for word, problem in zip(["D_LOW.001", "a_low", "b_high", "c_cage"], problems, strict=True):
        assert word in problem


@pytest.mark.parametrize("suffixes", [Suffixes("", "_high", "_cage"), Suffixes("_x", "_X", "_cage")])
def test_suffixes_must_differ(suffixes):
    with pytest.raises(BakeError):
        match([], suffixes)
