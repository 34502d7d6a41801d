# SPDX-License-Identifier: GPL-3.0-or-later
"""Sentences that know how much harm they tell of."""

import copy
import dataclasses
import json
import pickle

import pytest

from addon.core.errors import Fix
from addon.core.report import Report
from addon.core.sentences import LOOK, NOTE, WRONG, Sentence, by_harm, gist


def test_a_sentence_is_a_string_that_stays_rated():
    sentence = Sentence("Half of it is wrong.", WRONG, "overlap", 0.5)
    assert sentence == "Half of it is wrong." and json.loads(json.dumps(sentence)) == sentence
    for same in (copy.deepcopy(sentence), pickle.loads(pickle.dumps(sentence)), Sentence.of(sentence)):
        assert (same, same.harm, same.kind, same.share) == (sentence, WRONG, "overlap", 0.5)
    longer = Fix.UDIM.after(sentence)
    assert longer.endswith(f"; {Fix.UDIM.in_shell}.") and (longer.harm, longer.kind) == (WRONG, "overlap")
    assert Fix.UDIM.after("It may be.").harm == LOOK
    filled = Sentence("{low}: {share:.0%}", NOTE).filled(low="'a'", share=0.25)
    assert (filled, filled.harm, filled.share) == ("'a': 25%", NOTE, 0.25)


def test_the_worst_comes_first_and_the_larger_share_before_the_smaller():
    small, large = Sentence("small", WRONG, share=0.1), Sentence("large", WRONG, share=0.9)
    note, unrated = Sentence("note", NOTE, share=1.0), "unrated"
    assert by_harm([note, unrated, small, large, small]) == [large, small, unrated, note]
    assert by_harm([unrated])[0].harm == LOOK


def test_sentences_that_say_the_same_of_several_objects_have_one_gist():
    one, other = "'a' has 2 n-gons: exporters write none.", "'my b' has 1,250 n-gons: exporters write none."
    assert gist(one) == gist(other) != gist("'a' has 2 quads.")
    assert gist('"a" is 7.5% off') == gist("'b' is 12.25% off")


@pytest.fixture
def report():
    return Report("CAST", "TANGENT", (16, 16), "lo", ["hi"], warnings=[Sentence("first", WRONG, "overlap"), "second"])


def test_a_report_keeps_the_ratings(report):
    data = json.loads(json.dumps(report.to_dict()))
    assert data["warnings"] == ["first", "second"]
    assert data["ratings"] == {"first": ["WRONG", "overlap"], "second": ["LOOK", ""]}
    assert [(each.harm, each.kind) for each in Report(**data).warnings] == [(WRONG, "overlap"), (LOOK, "")]
    other = dataclasses.replace(report, warnings=["third"])
    assert other.ratings == {"third": ["LOOK", ""]}


def test_what_is_added_to_a_report_finds_its_place(report):
    more = report.with_warnings([Sentence("worst", WRONG, share=1.0), Sentence("note", NOTE)])
    assert more.warnings == ["worst", "first", "second", "note"]
