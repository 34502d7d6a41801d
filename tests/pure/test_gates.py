# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests of limits for figures, as --strict reads them. Needs no Blender."""

import pytest

from addon.cli import arguments, limits
from addon.cli.arguments import WrongUsage
from addon.core.errors import BakeError

REPORT = {
    "low": "rock",
    "missed": 0.002,
    "overlap": 0.0,
    "coverage": 0.75,
    "mirrored": 3,
    "checks": {"unsure": {"share": 0.01, "count": 7}, "hard_edges": {"count": 5, "of": 100}, "far": {"share": 0.0}},
    "deviation": {"median": 0.5, "percentile_95": 1.0, "percentile_99": 2.5, "maximum": 9.0},
    "targets": {"unity-built-in": {"percentile_99": 3.0}},
    "export": {"basis": "CYCLES", "degrees": {"CYCLES": {"maximum": 0.25}, "NORMALIZED": {"maximum": 20.0}}},
    "loss": {},
    "warnings": ["a", "b"],
    "seconds": {"total": 1.5},
}
WORDS = ["--low", "a", "--output", "b.png"]


def over(text, *reports):
    return limits.over(limits.parse(text), reports or [REPORT])


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("missed<0.1%", "missed is 0.2 %, and must be less than 0.1 %."),
        ("missed<0.001", "missed is 0.2 %, and must be less than 0.1 %."),
        ("coverage >= 80 %", "coverage is 75 %, and must be at least 80 %."),
        ("unsure<1%", "unsure is 1 %, and must be less than 1 %."),
        ("mirrored=0", "mirrored is 3, and must be exactly 0."),
        ("hard_edges<=4", "hard_edges is 5, and must be at most 4."),
        ("Deviation.P99<2deg", "deviation.p99 is 2.5 degrees, and must be less than 2 degrees."),
        ("deviation.max<.5", "deviation.max is 9 degrees, and must be less than 0.5 degrees."),
        (
            "targets.unity-built-in.p99<2deg",
            "targets.unity-built-in.p99 is 3 degrees, and must be less than 2 degrees.",
        ),
        ("targets.three.p99<2deg", "targets.three.p99 was not measured, and must be less than 2 degrees."),
        ("export.max<0.2deg", "export.max is 0.25 degrees, and must be less than 0.2 degrees."),
        ("warnings==0", "warnings is 2, and must be exactly 0."),
        ("seconds<1s", "seconds is 1.5 s, and must be less than 1 s."),
        ("coverage>0.75", "coverage is 75 %, and must be more than 75 %."),
    ],
)
def test_a_figure_over_its_limit_is_named_with_its_value_and_the_limit(text, sentence):
    assert over(text) == [sentence]


@pytest.mark.parametrize(
    "text",
    [
        "missed<0.3%",
        "overlap=0",
        "far<0.1%",
        "loss.max<0.1deg",
        "unsure<=1%",
        "mirrored>2",
        "coverage>=75%",
        "coverage<=1",
        "missed<100%",
        "",
    ],
)
def test_a_figure_within_its_limit_is_not_named(text):
    assert over(text) == []


def test_several_limits_and_reports():
    assert over("missed<0.1%, overlap=0,mirrored<1", REPORT, {**REPORT, "low": "moss", "mirrored": 0}) == [
        "rock: missed is 0.2 %, and must be less than 0.1 %.",
        "rock: mirrored is 3, and must be less than 1.",
        "moss: missed is 0.2 %, and must be less than 0.1 %.",
    ]


@pytest.mark.parametrize(
    ("text", "part"),
    [
        ("mised<1%", "'mised' is not a metric of a bake, did you mean 'missed'?"),
        ("deviation.p98<1", "did you mean 'deviation.p"),
        ("beauty>1", "choose one of missed, coverage"),
        ("missed<1deg", "'missed<1deg': missed takes %, or no unit, and not 'deg'"),
        ("deviation.p99<1%", "takes deg, or no unit"),
        ("mirrored<1%", "takes no unit"),
        ("missed~1", "is not a limit, such as missed<0.1%"),
        ("missed", "is not a limit"),
        ("missed<", "is not a limit"),
        ("missed<-1", "is not a limit"),
        ("missed<nan", "is not a limit"),
        ("missed<1e999", "is not a limit"),
        ("missed!=1", "is not a limit"),
        ("<1", "is not a limit"),
        ("missed<5", "'missed<5': missed is a share of texels, from 0 to 1: for percent, write missed<5%."),
        ("coverage>50", "write coverage>50%"),
        ("overlap<=1.01", "from 0 to 1"),
        ("missed<101%", "missed is a share of texels, which is 100 % at most."),
    ],
)
def test_a_limit_that_cannot_be_read_is_an_error_before_the_bake(text, part):
    with pytest.raises(BakeError) as error:
        limits.parse(text)
    assert part in str(error.value)
    with pytest.raises(WrongUsage, match="argument --strict: "):
        arguments.parse([*WORDS, "--strict", text])


@pytest.mark.parametrize(
    ("words", "mistake"),
    [
        (["--strict", "deviation.p99<1", "--no-normal", "--maps", "ao"], "deviation.p99 needs a normal map"),
        (["--strict", "targets.three.p99<1"], "targets.three.p99 needs --targets three"),
        (["--strict", "targets.three.p99<1", "--targets", "unreal"], "targets.three.p99 needs --targets three"),
        (["--strict", "export.p99<1"], "export.p99 needs --export"),
        (["--strict", "missed<1%", "--convert", "old.png"], "a conversion does not measure missed"),
    ],
)
def test_a_figure_that_will_not_be_measured_is_an_error_before_the_bake(words, mistake):
    assert [text for text in arguments.mistakes(arguments.parse([*WORDS, *words])) if mistake in text]


@pytest.mark.parametrize(
    "words",
    [
        ["--strict", "deviation.p99<1"],
        ["--strict", "targets.three.p99<1", "--targets", "unreal,three"],
        ["--strict", "export.p99<1", "--export", "a.glb"],
        ["--strict", "coverage>1%,loss.max<1,warnings=0", "--convert", "old.png"],
    ],
)
def test_a_figure_that_will_be_measured_is_no_mistake(words):
    assert list(arguments.mistakes(arguments.parse([*WORDS, *words]))) == []
