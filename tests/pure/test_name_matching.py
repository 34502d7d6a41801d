# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests which object names form pairs."""

import pytest

from addon.core import naming
from addon.core.errors import BakeError
from addon.core.naming import Pair, Suffixes, match


def test_the_suffixes_of_the_manual():
    names = ["rock_low", "rock_high", "rock_high_2", "rock_cage", "Camera", "tree_low", "tree_high"]
    assert match(names, Suffixes()) == (
        [Pair("rock", "rock_low", ["rock_high", "rock_high_2"], "rock_cage"), Pair("tree", "tree_low", ["tree_high"])],
        [],
    )


@pytest.mark.parametrize("high", ["ROCK_HIGH", "Rock_High.001", "rock_high_bolts.012", "rock_HIGH_a_b"])
def test_other_case_copies_and_extra_words_match(high):
    pairs, problems = match(["rock_low.003", high], Suffixes())
    assert [(pair.low, pair.highs) for pair in pairs] == [("rock_low.003", [high])]
    assert problems == []


@pytest.mark.parametrize(
    "name", ["rock", "low", "_low", "rocklow", "rock_lower", "rock_highest", "rock_lop", "hi", "x_hill"]
)
def test_other_names_are_ignored(name):
    assert match([name], Suffixes()) == ([], [])


@pytest.mark.parametrize(("bare", "low"), [("rock", "rock_low"), ("Rock", "rock_LP"), ("rock.001", "rock.001_low")])
def test_a_bare_name_is_the_high_object_of_a_low_one_that_has_none(bare, low):
    assert naming.low_name_of("rock.001", Suffixes()) == "rock.001_low"
    pairs, problems = match([bare, low], Suffixes())
    assert [(pair.low, pair.highs) for pair in pairs] == [(low, [bare])] and problems == []
    pairs, _ = match([bare, low, f"{bare}_high"], Suffixes())
    assert pairs[0].highs == [f"{bare}_high"]


@pytest.mark.parametrize("names", [["rock", "rock_low_1"], ["rock_cage", "rock_low"], ["rock", "rock_cage"]])
def test_a_bare_name_is_no_high_object_of_a_numbered_one(names):
    pairs, problems = match(names, Suffixes())
    assert pairs == [] and len(problems) == 1


WORDS = [
    ("rock_LP", "rock_HP"),
    ("rock_lo", "rock_hi"),
    ("rock-lowpoly", "rock-highpoly"),
    ("rock_low_poly", "rock_high_poly"),
    ("Rock.Low", "Rock.High"),
    ("rock low", "Rock_HiGH_bolts"),
    ("rock_low_01", "rock_high_01"),
    ("rock_low1", "rock_high_001"),
    ("rock_LP_7.001", "rock_hp_07_bolts.012"),
    ("01_low", "01_high"),
    ("rock_01_lo", "rock_01_hi"),
    ("rock_low", "rock_high_01"),
    ("rock_high_low", "rock_high_high"),
]


@pytest.mark.parametrize(("low", "high"), WORDS)
def test_common_suffixes_and_numbers_match(low, high):
    pairs, problems = match([high, low], Suffixes())
    assert [(pair.low, pair.highs) for pair in pairs] == [(low, [high])]
    assert problems == []


def test_numbers_distinguish_pairs():
    names = [f"rock_{role}_{number:02}" for role in ("low", "high", "cage") for number in (1, 2, 10)]
    pairs, problems = match([*names, "rock_high_02_moss", "rock_low", "rock_high", "rock_high_3"], Suffixes())
    assert problems == []
    assert [(pair.low, pair.highs, pair.cage) for pair in pairs] == [
        ("rock_low", ["rock_high", "rock_high_3"], ""),
        ("rock_low_01", ["rock_high_01"], "rock_cage_01"),
        ("rock_low_02", ["rock_high_02", "rock_high_02_moss"], "rock_cage_02"),
        ("rock_low_10", ["rock_high_10"], "rock_cage_10"),
    ]
    assert len({pair.name for pair in pairs}) == 4


def test_a_number_without_a_partner_is_reported():
    pairs, problems = match(["rock_low_01", "rock_high_02"], Suffixes())
    assert pairs == []
    assert problems == [
        "'rock_high_02' has no low object: none is called 'rock_low'.",
        "'rock_low_01' has no high object: none is called 'rock_high_1'.",
    ]


@pytest.mark.parametrize("order", [1, -1])
def test_blenders_numbers_distinguish_copies_of_a_pair(order):
    names = ["pipe_low", "pipe_high", "pipe_low.001", "pipe_high.001", "pipe_cage.001", "pipe_high_bolts.001"]
    pairs, problems = match(names[::order], Suffixes())
    assert problems == []
    assert pairs == [
        Pair("pipe", "pipe_low", ["pipe_high"]),
        Pair("pipe.001", "pipe_low.001", ["pipe_high.001", "pipe_high_bolts.001"], "pipe_cage.001"),
    ]


def test_a_copy_goes_to_the_low_object_without_a_number_if_none_has_its_own():
    pairs, problems = match(["pipe_low", "pipe_low.001", "pipe_high.001", "pipe_high.002"], Suffixes())
    assert problems == []
    assert [(pair.low, pair.highs) for pair in pairs] == [
        ("pipe_low", ["pipe_high.002"]),
        ("pipe_low.001", ["pipe_high.001"]),
    ]


def test_blenders_numbers_and_own_numbers_distinguish_together():
    names = [f"a_{role}_{number}{copy}" for role in ("low", "high") for number in (1, 2) for copy in ("", ".001")]
    pairs, problems = match(names, Suffixes())
    assert problems == []
    assert [(pair.low, pair.highs) for pair in pairs] == [
        (f"a_low_{number}{copy}", [f"a_high_{number}{copy}"]) for number in (1, 2) for copy in ("", ".001")
    ]
    assert len({pair.name for pair in pairs}) == 4


def test_a_copy_without_a_high_object_is_reported_by_the_name_that_is_missing():
    pairs, problems = match(["pipe_low_2", "pipe_low_2.001", "pipe_high_2"], Suffixes())
    assert [(pair.low, pair.highs) for pair in pairs] == [("pipe_low_2", ["pipe_high_2"])]
    assert problems == ["'pipe_low_2.001' has no high object: none is called 'pipe_high_2.001'."]


def test_chosen_suffixes_take_precedence():
    pairs, _ = match(["a_hi", "a_low", "a_top"], Suffixes("_hi", "_top", "_cage"))
    assert pairs == [Pair("a", "a_hi", ["a_top"])]
    assert match(["a_lo", "a_hp"], Suffixes("_low", "_sculpt", "_cage"))[0] == []
    pairs, _ = match(["a_lp", "a_hi"], Suffixes("_LP", "_high", "_cage"))  # the default words of the others still match
    assert pairs == [Pair("a", "a_lp", ["a_hi"])]


def test_patterns_are_compiled_once(monkeypatch):
    names = [f"rock{number}_low" for number in range(100)]
    expected = match(names, Suffixes())
    monkeypatch.setattr(naming.re, "compile", None)
    assert match(names, Suffixes()) == expected


def test_other_suffixes():
    pairs, _ = match(["a.lp", "a.hp", "b_low"], Suffixes(".lp", ".hp", ".cg"))
    assert pairs == [Pair("a", "a.lp", ["a.hp"])]


def test_names_with_special_characters_of_regular_expressions():
    pairs, _ = match(["a(+)[low", "a(+)[high"], Suffixes("[low", "[high", "[cage"))
    assert pairs == [Pair("a(+)", "a(+)[low", ["a(+)[high"])]


def test_unmatched_names_are_reported():
    pairs, problems = match(["a_low", "b_high", "c_cage", "d_low", "D_LOW.001", "d_high"], Suffixes())
    assert pairs == [Pair("d", "d_low", ["d_high"])]
    assert len(problems) == 4
    for word, problem in zip(["a_low", "b_high", "c_cage", "D_LOW.001"], problems, strict=True):
        assert word in problem


@pytest.mark.parametrize("suffixes", [Suffixes("", "_high", "_cage"), Suffixes("_x", "_X", "_cage")])
def test_suffixes_must_differ(suffixes):
    with pytest.raises(BakeError):
        match([], suffixes)
