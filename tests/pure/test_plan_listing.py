# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests what --list and --check say of the bakes of a job file, and which of them --shard and --only choose."""

import json
import os
import random
import struct
import subprocess
import sys
from argparse import Namespace

import pytest

from addon.cli import arguments, command, job_file, listing, plans
from addon.cli.arguments import WrongUsage
from addon.cli.plans import Plan
from addon.cli.run_report import FAILED, WRONG_USAGE
from scripts.imprint import ROOT
from tests.support import random_cases

BLOCK = "<4siQii"
SET = {"low-file": "a_low.obj", "high-file": "a_high.obj", "output": "maps/a.png", "size": 64}


@pytest.fixture
def here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for name in ("a_low.obj", "a_high.obj"):
        (tmp_path / name).write_text("v 0 0 0\n")
    return tmp_path


def blend(path, *names):
    """A .blend with objects of these names, as Blender 4.5 writes them."""
    blocks = [(b"OB", bytes(40) + b"OB" + name.encode() + bytes(66)) for name in names]
    content = b"".join(struct.pack(BLOCK, code, len(data), 0, 0, 1) + data for code, data in [*blocks, (b"ENDB", b"")])
    path.write_bytes(b"BLENDER-v405" + content)


def listed(capsys, sets, *words):
    """The exit code, and the lines on standard output and on standard error."""
    with open("jobs.json", "w", encoding="utf-8") as file:
        json.dump({"bake": sets}, file)
    options, more = arguments.split_jobs(["--jobs", "jobs.json", *words])
    code = listing.list_bakes(options, job_file.read("jobs.json", more))
    return code, *(text.splitlines() for text in capsys.readouterr())


def test_a_line_has_number_cost_name_and_files(capsys, here):
    code, out, err = listed(capsys, [SET, {**SET, "output": "b.png", "maps": "ao", "mask": True}], "--list")
    assert (code, err) == (0, [])
    first, second = (line.split("\t") for line in out)
    read = 2 * 2 * len("v 0 0 0\n")  # 2 for each byte of two files
    assert first == ["1", str(64 * 64 + read), "set 1 (a_low)", str(here / "maps" / "a.png")]
    files = ", ".join(str(here / name) for name in ("b.png", "b_missed.png", "b_ao.png"))
    assert second == ["2", str(2 * 64 * 64 + read), "set 2 (a_low)", files]


def test_json_has_the_same_as_the_lines(capsys, here):
    sets = [SET, {**SET, "output": "b.png", "low-file": "none.obj"}]
    code, out, _ = listed(capsys, sets, "--list", "--json", "--shard", "1/1")
    found = json.loads("\n".join(out))
    assert (code, found["imprint_list"], found["planned"], found["shard"]) == (FAILED, 1, 2, "1/1")
    first, second = found["bakes"]
    assert first == {
        "number": 1,
        "name": "set 1 (a_low)",
        "cost": 64 * 64 + 2 * 2 * len("v 0 0 0\n"),
        "inputs": [str(here / "a_low.obj"), str(here / "a_high.obj")],
        "outputs": [str(here / "maps" / "a.png")],
        "problems": [],
    }
    assert second["problems"] == [f"There is no file {str(here / 'none.obj')!r}."]


WRONG = {
    "a missing file": ({"high-file": "none.obj"}, "There is no file '", FAILED),
    "a folder for a file": ({"high-file": "."}, "There is no file '", FAILED),
    "no mesh": ({"high-file": "jobs.json"}, "is not a supported mesh file", FAILED),
    "a missing map to convert": ({"high-file": [], "convert": "old.<UDIM>.png"}, "There is no file '", FAILED),
    "a clash": ({"report": "a_low.obj"}, "would overwrite", WRONG_USAGE),
    "a folder for a map": ({"output": "folder.png"}, "is a folder: name a file", WRONG_USAGE),
    "a folder for a report": ({"report": "folder.png"}, "is a folder: name a file", WRONG_USAGE),
}


@pytest.mark.parametrize("case", WRONG)
def test_what_is_wrong_is_said_by_list_and_check(capsys, here, case):
    changed, expected, expected_code = WRONG[case]
    (here / "folder.png").mkdir()
    for word in ("--list", "--check"):
        code, out, err = listed(capsys, [{**SET, "output": "b.png"}, {**SET, **changed}], word)
        assert (code, len(out)) == (expected_code, 2 if word == "--list" else 0)
        assert len(err) == 1
        assert err[0].startswith("imprint: set 2 (a_low): ")
        assert expected in err[0]


def test_a_file_where_a_folder_is_needed_is_named(capsys, here):
    """The one of each bake."""
    (here / "maps").write_text("")
    code, _, err = listed(capsys, [SET, {**SET, "output": "maps/b.png"}], "--check")
    assert (code, len(err)) == (FAILED, 2)
    for line, name in zip(err, "ab", strict=True):
        assert f"{str(here / 'maps' / name)}.png' cannot be written" in line


def test_unknown_objects_of_a_blend_are_named(capsys, here):
    blend(here / "s.blend", "rock_low", "rock_high")
    right = {"file": "s.blend", "low": "rock_low", "high": ["rock_high"], "output": "r.png"}
    assert listed(capsys, [right], "--check") == (0, [], [])
    code, _, err = listed(capsys, [{**right, "high": ["rock_hihg", "rock_high"], "cage": "box"}], "--check")
    assert code == FAILED
    assert err == [
        "imprint: rock_low: There is no object called 'rock_hihg' in the file: did you mean 'rock_high' or 'rock_low'?",
        "imprint: rock_low: There is no object called 'box' in the file: it has 'rock_high', 'rock_low'.",
    ]


def test_pairs_of_a_blend_need_names_that_match(capsys, here):
    blend(here / "s.blend", "rock_low", "rock_high")
    pairs = {"file": "s.blend", "pairs": True, "output": "{low}.png"}
    assert listed(capsys, [pairs], "--check")[0] == 0
    code, _, err = listed(capsys, [{**pairs, "suffixes": "_a,_b,_c"}], "--check")
    assert (code, err) == (FAILED, ["imprint: s.blend: No object has a name that ends in '_a'."])


def test_a_file_that_is_no_blend_is_named(capsys, here):
    (here / "s.blend").write_bytes(b"BLENDER-v405 and so on")
    code, _, err = listed(capsys, [{"file": "s.blend", "low": "a", "output": "r.png"}], "--check")
    assert (code, len(err)) == (FAILED, 1)
    assert "is not a complete .blend file" in err[0]


def test_names_stay_on_their_line(capsys, here):
    blend(here / "s.blend", "a\n1\tb")
    _, out, _ = listed(capsys, [{"file": "s.blend", "low": "a\n1\tb", "output": "r.png"}], "--list")
    assert [line.split("\t")[2] for line in out] == ["a?1?b"]


# What a machine does of a run


def random_plans(rng):
    return [
        Plan(rng.choice("abc"), Namespace(cost=rng.randrange(rng.choice([1, 5, 1000]))), number=number)
        for number in range(1, rng.randrange(2, 60))
    ]


def cost(plan):
    return plan.options.cost


@random_cases.seeds(40, fast=2)
def test_parts_are_disjoint_and_complete(seed):
    rng = random.Random(seed)
    planned, count = random_plans(rng), rng.randrange(1, 20)
    parts = [plans.shard_part(planned, (number, count), cost) for number in range(1, count + 1)]
    assert sorted(plan.number for part in parts for plan in part) == [plan.number for plan in planned]
    assert all(part == sorted(part, key=lambda plan: plan.number) for part in parts)
    assert max(map(len, parts)) - min(map(len, parts)) <= 1
    # The parts cost the same, but for one bake of the costliest.
    sums = [sum(map(cost, part)) for part in parts]
    assert max(sums) - min(sums) <= max(map(cost, planned))


def test_equal_costs_go_by_number():
    planned = [Plan("", Namespace(cost=1), number=number) for number in range(1, 8)]
    assert [[plan.number for plan in plans.shard_part(planned, (k, 3), cost)] for k in (1, 2, 3)] == [
        [1, 4, 7],
        [2, 5],
        [3, 6],
    ]


def test_the_costliest_come_first_in_turns():
    planned = [Plan("", Namespace(cost=each), number=number) for number, each in enumerate([1, 9, 5, 8, 7, 2], 1)]
    assert [sorted(map(cost, plans.shard_part(planned, (k, 2), cost))) for k in (1, 2)] == [[2, 7, 9], [1, 5, 8]]


def test_a_chain_stays_together_and_counts_as_one():
    planned = [
        Plan("", Namespace(cost=each), number=number, chain=chain)
        for number, (each, chain) in enumerate([(6, 0), (2, 2), (3, 2), (2, 2), (1, 0)], 1)
    ]
    assert [[plan.number for plan in plans.shard_part(planned, (k, 2), cost)] for k in (1, 2)] == [[2, 3, 4, 5], [1]]


def set_of(file="s.blend", saved=None, origin=None):
    files = {"file": [file] if file else [], "low_file": None, "pairs": None, "save_blend": saved, "jobs": None}
    return Namespace(**files, low="low", origin=origin, name="")


def test_a_chain_reaches_from_the_first_set_of_a_scene_to_the_last_one_that_saves_it():
    sets = [set_of(), set_of(saved="x.blend"), set_of(), set_of(saved="y.blend"), set_of(), set_of("t.blend")]
    sets += [set_of("t.blend", "z.blend"), set_of("u.blend", "w.blend"), set_of("u.blend"), set_of("")]
    assert [plan.chain for plan in plans.plans_of(sets)[0]] == [1, 1, 1, 1, 0, 6, 6, 0, 0, 0]


def test_a_set_can_have_a_name(capsys, here):
    sets = [{**SET, "name": "crate"}, {**SET, "output": "b.png"}, {**SET, "output": "c.png", "name": "a\nb\u202e"}]
    _, out, err = listed(capsys, sets, "--list")
    assert [line.split("\t")[2] for line in out] == ["set 1 (crate)", "set 2 (a_low)", "set 3 (a?b?)"]
    assert err == []
    assert [line.split("\t")[0] for line in listed(capsys, sets, "--list", "--only", "*(crate)")[1]] == ["1"]


def test_pairs_of_a_folder_have_names_of_their_own(capsys, here):
    folder = {"pairs": ".", "output": "{low}.png", "name": "props"}
    assert listed(capsys, [folder, SET], "--list")[1][0].split("\t")[2] == "set 1 (a_low)"


def test_only_comes_before_the_parts_and_numbers_stay(capsys, here):
    sets = [{**SET, "output": f"{number}.png"} for number in range(1, 9)]
    words = ["--list", "--only", "set [1-5] *", "--only", "set 8 *", "--shard", "2/2"]
    assert [line.split("\t")[0] for line in listed(capsys, sets, *words)[1]] == ["2", "4", "8"]
    with pytest.raises(WrongUsage, match="name that matches 'rock'"):
        listed(capsys, sets, "--list", "--only", "set*", "--only", "rock")


def test_clashes_with_bakes_of_other_machines_are_found(capsys, here):
    code, out, err = listed(capsys, [SET, SET], "--list", "--shard", "2/2")
    assert (code, len(out), len(err)) == (2, 1, 1)
    assert "would both be" in err[0]


def test_files_do_not_move_bakes(capsys, here):
    """Other machines may see another version of them, or look for their part after a scene was saved over its file."""
    sets = [{**SET, "low-file": f"{number}_low.obj", "output": f"{number}.png"} for number in range(1, 9)]
    parts = set()
    for sizes in (range(1, 9), range(9, 1, -1)):
        for number, size in enumerate(sizes, 1):
            (here / f"{number}_low.obj").write_text("v 0 0 0\n" * 10 * size)
        parts.add(tuple(line.split("\t")[0] for line in listed(capsys, sets, "--list", "--shard", "1/3")[1]))
    assert parts == {("1", "4", "7")}


def test_large_files_are_divided_among_machines(capsys, here):
    """Scans beside small meshes, with maps of the same size. Holes take no place on the disk."""
    large = {1, 2, 5, 6}
    for number in range(1, 9):
        with open(f"{number}_low.obj", "wb") as file:
            file.truncate((1 << 28) + number if number in large else 100)
    sets = [{**SET, "low-file": f"{number}_low.obj", "output": f"{number}.png"} for number in range(1, 9)]
    parts = [
        {int(line.split("\t")[0]) for line in listed(capsys, sets, "--list", "--shard", f"{k}/4")[1]}
        for k in range(1, 5)
    ]
    assert [len(part & large) for part in parts] == [1] * 4
    assert sorted(number for part in parts for number in part) == list(range(1, 9))


def test_a_scene_that_is_saved_over_its_file_moves_no_bake(capsys, here):
    def part():
        return [line.split("\t")[0] for line in listed(capsys, sets, "--list", "--shard", "1/2")[1]]

    sets = []
    for number in range(4):
        blend(here / f"{number}.blend", "low", "high")
        own = {"file": f"{number}.blend", "low": "low", "high": "high", "output": f"{number}.png", "size": 64}
        sets.append({**own, "save-blend": f"{number}.blend"})
    before = part()
    with open("3.blend", "ab") as file:
        file.truncate(1 << 28)
    assert part() == before


def test_the_process_prints_tabs(here):
    """What a program reads, and not what a function returns. A name has none that could be taken for one."""
    with open("jobs.json", "w", encoding="utf-8") as file:
        json.dump({"bake": [{**SET, "name": "a\tb\x1b[1m"}]}, file)
    words = [sys.executable, str(ROOT / "scripts/bake.py"), "--", "--jobs", "jobs.json", "--list"]
    done = subprocess.run(words, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    (line,) = done.stdout.splitlines()
    number, _, name, path = line.split("\t")
    assert (number, name, path) == ("1", "a?b?[1m", str(here / "maps/a.png"))


def test_texels_samples_maps_tiles_and_frames_cost():
    def of(*words):
        return plans.cost(
            arguments.parse(["s.blend", "--low", "a", "--output", "m_<UDIM>_#.png", "--size", "64", *words])
        )

    one = of()
    assert one == 64 * 64
    for words in (["--samples", "4"], ["--tiles", "1001,1002,1003,1011"], ["--maps", "ao,height,position"]):
        assert of(*words) == 4 * one
    assert of("--frames", "3-6") == 4 * one


@pytest.mark.slow
@pytest.mark.parametrize("words", [["--list"], ["--list", "--json", "--shard", "2/3"]])
def test_each_process_lists_the_same(here, words):
    sets = [{**SET, "output": f"{number}.png", "size": 16 << number % 3, "maps": "ao"} for number in range(50)]
    (here / "jobs.json").write_text(json.dumps({"bake": sets}))
    program = (
        "import sys; from addon.cli import listing; from addon.cli import arguments, job_file\n"
        "options, more = arguments.split_jobs(sys.argv[1:])\n"
        "listing.list_bakes(options, job_file.read(options.jobs, more))"
    )
    found = {
        subprocess.run(
            [sys.executable, "-c", program, "--jobs", "jobs.json", *words],
            env={**os.environ, "PYTHONHASHSEED": seed, "PYTHONPATH": str(ROOT)},
            capture_output=True,
            check=True,
        ).stdout
        for seed in ("0", "1", "2")
    }
    assert len(found) == 1
    assert len(found.pop()) > 1000


def test_an_output_that_is_a_hard_link_to_a_mesh_is_refused(capsys, here):
    os.link(here / "a_high.obj", here / "linked.png")
    code, _, (problem,) = listed(capsys, [{**SET, "output": "linked.png"}], "--check")
    assert (code, "would overwrite the high mesh's file" in problem) == (2, True)


BESIDE = {
    "the record": ("a.png.imprint.json", ["--resume"]),
    "the claim": ("a.png.imprint.json.lock", ["--force"]),
    "the record of another bake": ("b.png.imprint.json", ["--resume"]),
    "the report": ("sub/../r.json", ["--report", "r.json"]),
    "the report in progress": ("r.json.lines", ["--report", "r.json"]),
    "the page": ("S.HTML", ["--sheet", "s.html"]),
}


@pytest.mark.parametrize(("name", "words"), BESIDE.values(), ids=BESIDE)
def test_a_bake_of_what_the_run_writes_fails_alone(capsys, here, name, words):
    """An image of a .mtl may have any name: it must not decide what becomes of other bakes."""
    (here / "a_high.obj").write_text("mtllib a.mtl\nv 0 0 0\n")
    (here / "a.mtl").write_text(f"newmtl a\nmap_Kd {name}\n")
    values = {**SET, "output": "a.png"}
    other = {"low-file": "a_low.obj", "high-file": "a_low.obj", "output": "b.png"}
    code, _, (problem,) = listed(capsys, [values, other], "--check", *words)
    assert (code, problem.startswith("imprint: set 1 (a_low): ")) == (1, True)
    assert "would overwrite what 'a_high.obj' refers to" in problem
    assert listed(capsys, [values], "--check")[0] == 0


def test_a_check_looks_for_the_ends_of_files(capsys, here):
    (here / "cut.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2")
    (here / "root.usda").write_text("#usda 1.0\n(subLayers = [@part.usda@])\n")
    sets = [{**SET, "high-file": name, "output": f"{name}.png"} for name in ("cut.obj", "root.usda")]
    assert listed(capsys, sets, "--list")[0] == 0
    code, _, problems = listed(capsys, sets, "--check")
    assert code == FAILED
    cut, root, part = (str(here / name) for name in ("cut.obj", "root.usda", "part.usda"))
    assert [each.partition(": ")[2].partition(": ")[2] for each in problems] == [
        f"{cut!r} ends too early.",
        f"{root!r} refers to {part!r}, which cannot be found.",
    ]


@pytest.mark.slow
def test_the_script_lists_without_blender(here):
    (here / "jobs.json").write_text(json.dumps({"bake": [SET]}))
    (here / "bpy.py").write_text("raise SystemExit(99)")
    command = [sys.executable, str(ROOT / "scripts" / "bake.py"), "--", "--jobs", "jobs.json"]
    for words, code in ((["--list"], 0), (["--check"], 0), (["--list", "--only", "none"], 2), (["--workers", "0"], 99)):
        done = subprocess.run([*command, *words], env={**os.environ, "PYTHONPATH": str(here)}, check=False)
        assert done.returncode == code, words


def refused(sets, *words, capsys):
    """The lines of a call that is wrong."""
    with open("jobs.json", "w", encoding="utf-8") as file:
        json.dump({"bake": sets}, file)
    assert command.run(["--jobs", "jobs.json", *words]) == WRONG_USAGE
    return capsys.readouterr().err.splitlines()


def test_equal_mistakes_are_told_once(capsys, here):
    sets = [{**SET, "output": f"{number}.png", "size": "x" if number != 200 else 64} for number in range(380)]
    (line,) = refused(sets, capsys=capsys)
    assert line.startswith("imprint: jobs.json, sets 1-200, 202-380: size: 'x' is neither")
    sets = [{**SET, "output": f"{number}.png", "high-file": "none.obj"} for number in range(380)]
    code, _, (line,) = listed(capsys, sets, "--check")
    assert (code, line) == (1, f"imprint: set 1 (a_low) and 379 more: There is no file {str(here / 'none.obj')!r}.")


@pytest.mark.parametrize("word", ["--list", "--check"])
def test_a_wrong_placeholder_hides_no_other_mistake(capsys, here, word):
    wrong = {**SET, "output": "{lo}.png", "depth": 32, "udim": True, "strict": "foo<1"}
    lines = refused([SET, wrong, {**SET, "output": "b.png", "low-file": "none.obj"}], word, capsys=capsys)
    of_set, of_file = lines
    for text in ("Unknown placeholder {lo}", "stores 8 or 16 bits per channel, not 32", "'foo' is not a metric"):
        assert text in of_set
    assert of_file == f"imprint: set 3 (none): There is no file {str(here / 'none.obj')!r}."


@pytest.mark.parametrize("words", [["--report", "r.json"], ["--sheet", "s.html"]])
def test_a_list_writes_no_report_and_says_so(capsys, here, words):
    (line,) = refused([SET], "--list", *words, capsys=capsys)
    assert line.startswith(f"imprint: {words[0]} is of bakes, and --list does none: leave it out")
    assert sorted(path.name for path in here.iterdir()) == ["a_high.obj", "a_low.obj", "jobs.json"]


CONVERT = {"file": "s.blend", "low": "lo", "convert": "map.png", "output": "new.png"}


@pytest.mark.parametrize(("key", "value"), [("size", 512), ("method", "cast"), ("max-distance", 1), ("samples", 4)])
def test_what_a_conversion_ignores_is_refused(capsys, here, key, value):
    words = [word for name, text in CONVERT.items() for word in ([f"--{name}", text] if name != "file" else [text])]
    assert command.run([*words, f"--{key}", str(value)]) == WRONG_USAGE
    assert f"--convert converts one normal map: leave out --{key}" in capsys.readouterr().err
    # Of a job file, other sets may need it.
    (here / "defaults.json").write_text(json.dumps({"defaults": {key: value}, "bake": [CONVERT]}))
    assert len(job_file.read("defaults.json")) == len(job_file.read("defaults.json", [f"--{key}", str(value)])) == 1


@pytest.mark.parametrize(
    ("word", "value"), [("--method", "cast"), ("--hit", "outermost"), ("--extrusion", "1"), ("--directions", "smooth")]
)
def test_what_levels_of_detail_ignore_is_refused(capsys, here, word, value):
    words = ["lod", "--low-file", "a_low.obj", "--output", "{low}.png", word, value]
    assert command.run(words) == WRONG_USAGE
    assert f"{word} is not for lod" in capsys.readouterr().err
