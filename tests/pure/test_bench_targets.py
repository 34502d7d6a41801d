# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests the targets of the benchmark and the sections about older versions on invented figures."""

import numpy as np
import pytest

from scripts.bench.contenders.names import CAST, CYCLES, FLATTEN, MULTIRES, OUTERMOST, PEERS, PRESENT
from scripts.bench.report import run_sections
from scripts.bench.report.angles_of_maps import difference_of
from scripts.bench.report.statistics_of_rounds import older_name
from scripts.bench.report.targets import judge
from scripts.bench.report.verdicts import at_most

OLDER = f"{PRESENT} v0.1.0"


def timed(*seconds, gap=""):
    return {"first": 1.0, "seconds": list(seconds), "stages": {}, "gap": gap}


def versions(present, older, **row):
    """A row of both versions. The rounds of the older one are all the same."""
    times = {PRESENT: timed(*present), OLDER: timed(*[older] * len(present))}
    sizes = dict.fromkeys(times, 1000)
    return {"what": "PNG, 16 bits", "pair": "kepler", "size": 2048, "times": times, "bytes": sizes} | row


def only(result, words):
    (found,) = (verdict for verdict in judge(result) if words in verdict.target)
    return found


def test_nothing_is_measured_in_an_empty_run():
    found = judge({})
    assert len(found) > 15
    assert {verdict.outcome for verdict in found} == {"not measured"}


@pytest.mark.parametrize(
    ("present", "outcome"), [([1.0, 0.9, 1.0], "holds"), ([1.1] * 3, "missed"), ([1.1, 1.0, 1.0], "open")]
)
@pytest.mark.parametrize(
    ("words", "part", "row", "times"),
    [
        ("Storing a PNG", "storing", {}, 4.0),
        ("run from the shell", "start", {}, 2.0),
        ("200 small bakes", "batches", {"sets": 200}, 2.0),
        ("Bakes at most a tenth", "bakes", {}, 1 / 1.1),
        ("10 million triangles", "memory", {"triangles": 10**7, "size": 512, "method": CAST}, 2.0),
    ],
)
def test_targets_against_the_older_version(words, part, row, times, *, present, outcome):
    assert only({part: [versions(present, times, **row)]}, words).outcome == outcome


@pytest.mark.parametrize(
    ("words", "part", "row"),
    [
        ("Storing a PNG", "storing", {"size": 1024}),
        ("Storing a PNG", "storing", {"what": "PNG, 8 bits"}),
        ("200 small bakes", "batches", {"sets": 20}),
        ("10 million triangles", "memory", {"triangles": 10**6, "size": 512, "method": CAST}),
        ("10 million triangles", "memory", {"triangles": 10**7, "size": 1024, "method": CAST}),
        ("10 million triangles", "memory", {"triangles": 10**7, "size": 512, "method": FLATTEN}),
        ("run from the shell", "start", {"times": {PRESENT: timed(1.0)}}),
    ],
)
def test_other_rows_do_not_count_for_those_targets(words, part, row):
    assert only({part: [versions([9.0], 1.0, **row)]}, words).outcome == "not measured"


def race(size, samples=1, is_terrain=False, **seconds):
    names = {"flatten": FLATTEN, "cast": CAST, "outermost": OUTERMOST, "cycles": CYCLES, "multires": MULTIRES}
    names["open3d"] = PEERS["open3d"]
    times = {names[key]: timed(value) for key, value in seconds.items()}
    return {"pair": "king", "size": size, "samples": samples, "is_terrain": is_terrain, "times": times, "angles": {}}


@pytest.mark.parametrize(
    ("words", "row", "slower"),
    [
        ("outermost hits 3 times", race(1024, outermost=1.0, cycles=3.0), {"outermost": 1.1, "cycles": 3.0}),
        ("outermost hits 6 times", race(2048, outermost=1.0, cycles=6.0), {"outermost": 1.1, "cycles": 6.0}),
        ("own hits 2 times", race(1024, cast=1.0, cycles=2.0), {"cast": 1.1, "cycles": 2.0}),
        ("own hits 4 times", race(2048, cast=1.0, cycles=4.0), {"cast": 1.1, "cycles": 4.0}),
        ("16 samples no slower", race(1024, 16, cast=1.0, cycles=1.0), {"cast": 1.1, "cycles": 1.0}),
        ("16 samples 3 times", race(2048, 16, True, cast=1.0, cycles=3.0), {"cast": 1.1, "cycles": 3.0}),
        ("Flatten 10 times", race(2048, 1, True, flatten=1.0, cycles=10.0), {"flatten": 1.1, "cycles": 10.0}),
        ("faster than Open3D", race(1024, cast=1.0, open3d=1.0), {"cast": 1.1, "open3d": 1.0}),
    ],
)
def test_targets_against_other_bakers(words, row, slower):
    assert only({"pairs": [row]}, words).outcome == "holds"
    missed = race(row["size"], row["samples"], row["is_terrain"], **slower)
    assert only({"pairs": [row, missed]}, words).outcome == "missed"
    assert only({"pairs": [row | {"size": 512, "samples": 4}]}, words).outcome == "not measured"


def test_the_multires_target_takes_all_sizes():
    rows = [race(size, flatten=1.0, multires=1.0) for size in (512, 1024)]
    assert only({"closed_forms": rows}, "multires").outcome == "holds"
    found = only({"closed_forms": [*rows, race(2048, flatten=1.2, multires=1.0)]}, "multires")
    assert (found.outcome, "2 of 3 hold" in found.figures) == ("missed", True)


@pytest.mark.parametrize(("triangles", "most"), [(100_352, 40.0), (1_000_000, 100.0)])
def test_live_targets(triangles, most):
    def outcome(*update):
        rows = [{"triangles": triangles, "size": 1024, "update_ms": list(update), "image_ms": [1.0]}]
        return {verdict.outcome for verdict in judge({"live": rows}) if verdict.target.startswith("Live")}

    assert outcome(most, most - 1.0) == {"holds", "not measured"}
    assert outcome(most, most + 1.0) == {"open", "not measured"}
    assert outcome(most + 1.0, most + 1.0) == {"missed", "not measured"}


def test_the_figures_of_a_missed_limit_are_those_that_miss_it():
    found = at_most("few", 2.0, [("a", [1.0]), ("b", [3.0, 4.0, 5.0]), ("c", [])], "s")
    assert (found.outcome, found.figures) == ("missed", "b 4 s (3 to 5)")
    assert at_most("few", 2.0, [("a", [1.0])], "s").figures == "a 1 s (1 to 1)"


@pytest.mark.parametrize(("size", "outcome"), [(1100, "holds"), (1101, "missed")])
def test_files_may_be_a_tenth_larger(size, outcome):
    row = versions([1.0], 1.0)
    other = row | {"what": "TIFF", "bytes": {PRESENT: size, OLDER: 1000}}
    found = only({"storing": [row, other]}, "10 % larger")
    assert found.outcome == outcome
    for gap in ({"times": {PRESENT: timed(1.0)}}, {"bytes": {PRESENT: 1, OLDER: 0}}, {"bytes": {PRESENT: 0, OLDER: 1}}):
        assert only({"storing": [row | gap]}, "10 % larger").outcome == "not measured"


def sampled(samples, *seconds, **row):
    return {
        "what": "Flatten",
        "pair": "kepler",
        "size": 2048,
        "samples": samples,
        "times": {PRESENT: timed(*seconds)},
    } | row


@pytest.mark.parametrize(("degrees", "outcome"), [(0.02, "holds"), (0.021, "missed")])
def test_adaptive_samples_must_be_near_all_samples(degrees, outcome):
    rows = [sampled(16, 1.0, angles={"percentile_99": value}) for value in (0.0, degrees)]
    assert only({"samples": [sampled(1, 1.0), *rows]}, "Adaptive").outcome == outcome


def test_the_angle_between_two_maps():
    turned = np.radians(30.0)
    wanted, found = np.zeros((2, 4, 10, 10))
    wanted[:, :8] = np.array([0.5, 0.5, 1.0, 1.0])[:, None, None]
    found[:, :8] = wanted[:, :8]
    found[:3, :8, :1] = (np.array([np.sin(turned), 0.0, np.cos(turned)]) * 0.5 + 0.5)[:, None, None]
    found[3, 9] = 1.0  # ten texels that only one covers
    angle = difference_of(found.transpose(1, 2, 0), wanted.transpose(1, 2, 0))
    assert angle == pytest.approx({"percentile_99": 30.0, "percentile_99_9": 30.0, "maximum": 30.0, "unlike": 0.1})
    found[:3, :8] = wanted[:3, :8]
    found[0, 3, 3] = 0.6
    angle = difference_of(found.transpose(1, 2, 0), wanted.transpose(1, 2, 0))
    assert angle["percentile_99"] < angle["percentile_99_9"] < angle["maximum"]
    assert angle["maximum"] == pytest.approx(np.degrees(np.arctan(0.2)))


def test_the_older_version_is_found_by_its_name():
    assert older_name(versions([1.0], 1.0)) == OLDER
    assert older_name({"times": {PRESENT: timed(), FLATTEN: timed()}}) is None


def test_sections_have_gaps_for_what_was_not_measured():
    both, alone = versions([0.25, 0.25], 1.0), {"times": {PRESENT: timed(gap="no disk")}}
    names = PRESENT, OLDER
    more = {
        "whole": dict.fromkeys(names, [1.0]),
        "bytes": dict.fromkeys(names, 12_345),
        "samples": 16,
        "stopped_early": 0.25,
        "angles": {"percentile_99": 0.01, "percentile_99_9": 0.02, "maximum": 3.0, "unlike": 0.0},
        "startup": {PRESENT: {"bpy": 0.5}, OLDER: {}},
        "bake": dict.fromkeys(names, {"draw": 0.25}),
        "sets": 10,
        "peak_bytes": {PRESENT: [2e9], OLDER: []},
        "held_bytes": {PRESENT: 1e9, OLDER: None},
    }
    sections = run_sections.storing, run_sections.start, run_sections.batches, run_sections.memory
    sections += run_sections.samples, run_sections.very_large, run_sections.bakes
    text = "\n".join(line for section in sections for line in section([both | more, both | more | alone]))
    assert "None" not in text
    assert "| 250 (250 to 250) | 1,000 (1,000 to 1,000) | 12,345 | 4.00 (4.00 to 4.00) |" in text
    assert "| Imprint | startup | bpy | 500 |" in text
    assert "| 0.25 (0.25 to 0.25) | 2,400 | 4.00 (4.00 to 4.00) |" in text
    assert "| 2.00 | 1.00 | 1.0 | 0.25 (0.25 to 0.25) |" in text
    assert "no disk" in text
    assert "| 16 | Imprint | 250 (250 to 250) | 25.0% | 0.0100 | 0.0200 | 3.0000 | 0.0000% |" in text
    for table in text.split("\n\n"):
        assert len({line.count("|") for line in table.splitlines() if line.startswith("|")}) <= 1
