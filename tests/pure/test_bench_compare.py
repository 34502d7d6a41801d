# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests the comparison of two runs of the benchmark on invented figures."""

import copy

import pytest

from scripts.bench.contenders.names import CAST, CYCLES, FLATTEN, PRESENT
from scripts.bench.report.compare import ASSUMED_SPREAD, NoRun, compare, read

MACHINE = {"processor": "abacus", "cores": 2, "renderer": "chalk", "backend": "BOARD", "blender": "5.2.3"}


def run(**parts):
    about = {"versions": [PRESENT, f"{PRESENT} v0.1.0"], "peers": {"open3d": "0.20"}, "repeats": 3, "seconds": 1.0}
    return {"quick": False, "machine": dict(MACHINE), **about} | parts


def row(**seconds):
    """Rounds of Flatten, Cast and Cycles."""
    names = {"flatten": FLATTEN, "cast": CAST, "cycles": CYCLES}
    times = {names[key]: {"seconds": rounds} for key, rounds in seconds.items()}
    return {"pair": "king", "size": 1024, "samples": 1, "times": times}


def of_flatten(old, new):
    return compare(run(pairs=[row(flatten=old)]), run(pairs=[row(flatten=new)]))


@pytest.mark.parametrize(
    ("old", "new", "slower", "faster"),
    [
        ([1.0, 1.1, 1.2], [1.21, 1.3, 1.4], True, False),  # all rounds are slower
        ([1.0, 1.1, 1.2], [1.19, 1.3, 1.4], False, False),  # they overlap
        ([1.0, 1.1, 1.2], [1.2, 1.3, 1.4], False, False),  # they touch
        ([1.0, 1.1, 1.2], [0.8, 0.9, 0.99], False, True),
        ([1.0, 1.1, 1.2], [0.8, 0.9, 1.0], False, False),
        ([1.0, 1.1, 9.0], [2.0, 2.1, 2.2], False, False),  # a wide spread hides it
        ([1.0], [1.0 + 1.9 * ASSUMED_SPREAD], False, False),  # one round has a spread that is assumed
        ([1.0], [1.0 + 2.5 * ASSUMED_SPREAD], True, False),
        ([1.0], [1.0 - 2.5 * ASSUMED_SPREAD], False, True),
    ],
)
def test_a_change_counts_if_it_is_more_than_the_spread(old, new, slower, faster):
    found = of_flatten(old, new)
    (change,) = found.changes
    assert (change.is_slower, change.is_faster, found.has_slower) == (slower, faster, slower)
    assert ("beyond the spread" in str(change)) == (slower or faster)


def test_the_ratio_is_that_of_the_medians():
    (change,) = of_flatten([1.0, 2.0, 9.0], [3.0, 3.0, 30.0]).changes
    assert change.ratio == 1.5
    assert "2 s (1 to 9), now 3 s (3 to 30), 1.50 times slower, within the spread" in str(change)
    (change,) = of_flatten([0.3, 0.3, 0.3], [0.1, 0.1, 0.1]).changes
    assert "300 ms (300 to 300), now 100 ms (100 to 100), 3.00 times faster, beyond the spread" in str(change)


def test_the_slowest_comes_first_and_figures_that_only_one_has_are_named():
    old = run(pairs=[row(flatten=[1.0] * 3, cast=[1.0] * 3)], live=[])
    new = run(pairs=[row(flatten=[2.0] * 3, cast=[3.0] * 3), row(flatten=[1.0] * 3) | {"samples": 16}])
    found = compare(old, new)
    assert [change.name for change in found.changes] == [f"pairs, king, 1024: {CAST}", f"pairs, king, 1024: {FLATTEN}"]
    assert found.only_new == [f"pairs, king, 1024, 16 samples: {FLATTEN}"]
    assert compare(new, old).only_old == found.only_new
    lines = found.lines()
    assert lines[0].startswith("2 of 2 figures are slower")
    assert lines.index("Only in the new run:") == len(lines) - 2
    assert CAST in lines[lines.index("Slower:") + 1]


def test_other_bakers_show_the_machine_and_are_not_judged():
    old = run(pairs=[row(flatten=[1.0] * 3, cycles=[1.0] * 3)])
    new = run(pairs=[row(flatten=[1.0] * 3, cycles=[4.0] * 3)])
    found = compare(old, new)
    assert not found.has_slower
    assert found.others == [4.0]
    assert any("4.00 (4.00 to 4.00) times as long" in line for line in found.lines())


def test_an_older_version_in_a_run_is_not_judged():
    times = {PRESENT: {"seconds": [1.0] * 3}, "Imprint v0.2.0": {"seconds": [1.0] * 3}}
    old = run(start=[{"what": "a shell run", "times": times}])
    new = copy.deepcopy(old)
    new["start"][0]["times"]["Imprint v0.2.0"]["seconds"] = [9.0] * 3
    found = compare(old, new)
    assert [change.name for change in found.changes] == [f"start, a shell run: {PRESENT}"]
    assert not found.has_slower


@pytest.mark.parametrize(
    ("part", "rows", "name"),
    [
        ("occlusion", [{"pair": "king", "size": 256, "seconds": 1.0, "cycles_seconds": 2.0}], "occlusion, king, 256"),
        ("growth", {"texels": [{"amount": 4096, "seconds": {FLATTEN: [1.0] * 3}}]}, "growth by texels, 4,096"),
        (
            "live",
            [{"triangles": 8, "size": 16, "update_ms": [9.0] * 3, "image_ms": [1.0] * 3}],
            "live, 8 triangles, 16",
        ),
        ("memory", [{"what": "a bake", "peak_bytes": {PRESENT: [5e9]}}], "memory, a bake, peak memory"),
    ],
)
def test_figures_of_all_parts_are_compared(part, rows, name):
    def doubled(value):
        if isinstance(value, dict):
            return {key: doubled(inner) for key, inner in value.items()}
        if isinstance(value, list):
            return [doubled(inner) for inner in value]
        return 2 * value if isinstance(value, float) else value

    found = compare(run(**{part: rows}), run(**{part: doubled(rows)}))
    assert found.changes
    assert all(change.name.startswith(name) and change.ratio == 2.0 and change.is_slower for change in found.changes)


def test_other_machines_are_named():
    new = run()
    new["machine"]["processor"] = "loom"
    new["quick"] = True
    lines = compare(run(), new).lines()
    assert "Note: processor was abacus and is loom." in lines
    assert "Note: only one of the runs is quick." in lines
    assert not any(line.startswith("Note") for line in compare(run(), run()).lines())


@pytest.mark.parametrize("text", ["{", "[]", "{}", '{"machine": 1, "quick": true}'])
def test_files_that_are_no_result_have_a_message(tmp_path, text):
    path = tmp_path / "other.json"
    path.write_text(text)
    with pytest.raises(NoRun, match=r"other\.json is no bench\.json"):
        read(path)
    with pytest.raises(NoRun, match="cannot be read: No such file"):
        read(tmp_path / "none.json")


def test_the_fastest_comes_first_among_the_faster():
    old = run(pairs=[row(flatten=[9.0] * 3, cast=[9.0] * 3)])
    new = run(pairs=[row(flatten=[8.0] * 3, cast=[1.0] * 3)])
    lines = compare(old, new).lines()
    assert CAST in lines[lines.index("Faster:") + 1]


def test_gaps_are_no_figures_and_live_is_in_milliseconds():
    live = [{"triangles": 8, "size": 16, "update_ms": [9.0, 8.0, 10.0], "image_ms": [1.0] * 3}]
    new = run(pairs=[row(flatten=[])], live=live)
    found = compare(run(pairs=[row(flatten=[1.0] * 3)], live=live), new)
    assert found.only_old == [f"pairs, king, 1024: {FLATTEN}"]
    assert ": 9 ms (8 to 10), now 9 ms (8 to 10)" in str(found.changes[0])
