# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests that job files are read as the command line's parser reads the same words.

The seed is in the test's name. For more of them: IMPRINT_RANDOM=0:200 pytest tests/pure/test_job_file_reading.py
"""

import json
import random
import re
from pathlib import Path

from addon.cli import arguments, job_file
from addon.cli.arguments import WrongUsage
from addon.cli.job_file import KEYS
from tests.support import random_cases

SETS = 250
"""In each job file."""
PATHS = (
    "a.png",
    "b_normal.exr",
    "x/../c.tif",
    "./d.tga",
    "/e.png",
    "//f.png",
    "g//h.png",
    "i/./j.png",
    "k/",
    ".",
    "é.png",
    "%.png",
)
MORE_PATHS = (
    "{low}.png",
    "{lo}.png",
    "<UDIM>.png",
    "<UDIM>/x.png",
    "m.<UDIM>.png",
    "%<UDIM>.png",
    "no.jpg",
    "..png",
    "png",
    "s.blend",
)
WORDS = (
    "",
    "a",
    "-a",
    "--low",
    "cast",
    "Object",
    "tangent",
    "ao,curvature",
    "heigth",
    "unreal,three",
    "hdrp",
    "+y",
    "-z",
    "x",
    "y",
)
NUMBERS = (0, 1, 4, 16, 64, 512, -1, 3, 1.0, 0.5, -0.0, 0.0, 1e19, float("inf"), float("nan"), True, False, 10**40)
TEXTS = (
    "64x32",
    "1001,1002",
    "1-48",
    "9-3",
    "1,0,1",
    "unlimited",
    "_a,_b,_c",
    "a\0b",
    "\ud800",
    "8",
    "1e3",
    " 7",
    "1_0",
)
LISTS = ([], [1, 0, 1], [1001, 1002], ["a", "b"], ["a", 1], [[1]], [True], [64, 32], ["_a", "_b", "_c"], {"a": 1}, None)
USUAL = (
    {"low": "a", "file": "s.blend"},
    {"low-file": "l.obj", "high-file": "h.obj"},
    {"pairs": "folder"},
    {"file": "s.blend", "pairs": True},
)


def random_value(rng, key):
    option = KEYS.get(key.replace("_", "-"))
    kind = rng.random()
    if option is not None and kind < 0.7:  # likely a right one
        if option.is_flag:
            return rng.random() < 0.7
        if option.is_path:
            return rng.choice(PATHS + MORE_PATHS)
        if option.items or option.is_text:
            return rng.choice([*(word for word, _ in option.items), *WORDS])
        return rng.choice([*(option.parsing.get("choices") or ()), *NUMBERS, *WORDS, *TEXTS])
    return rng.choice([*PATHS, *MORE_PATHS, *WORDS, *NUMBERS, *TEXTS, *LISTS])


def random_set(rng):
    values = dict(rng.choice(USUAL)) if rng.random() < 0.9 else {}
    if rng.random() < 0.9:
        values["output"] = rng.choice(PATHS[:7] + MORE_PATHS[:1]) if rng.random() < 0.8 else rng.choice(MORE_PATHS)
    for _ in range(rng.choice([0, 0, 1, 1, 2, 5])):
        key = rng.choice([*KEYS, *KEYS, "sampels"])
        values[key.replace("-", "_") if rng.random() < 0.3 else key] = random_value(rng, key)
    return values


def words_of(key, value, folder):
    """A key as words for the parser, or None if its value has a type that it never takes."""
    option = KEYS.get(key)
    if option is None:
        return None
    if isinstance(value, bool):
        return None if not option.may_be_flag else [f"--{key}"] * value
    parts = value if isinstance(value, list) else [value]
    takes = str if option.is_text else str | int | float
    if option.is_flag or not all(isinstance(part, takes) and not isinstance(part, bool) for part in parts):
        return None
    if isinstance(value, list) and option.is_text and not option.may_repeat:
        return None
    parts = list(map(str, parts)) if option.is_text or not parts else [",".join(map(str, parts))]
    if option.is_path:
        parts = [str(folder / part) if part else part for part in parts]
    return parts if key == "file" else [f"--{key}={part}" for part in parts]


def by_parser(values, folder, more):
    """The options of a set by the parser alone, and what is wrong: None for a value of a type that no word has."""
    words, faults = {}, {}
    for written, value in values.items():
        key = written.replace("_", "-")
        words[key] = words_of(key, value, folder)
        faults.pop(key, None)
        if words[key] is None:
            faults[key] = None
    for key in [key for key in words if key not in faults]:
        try:
            arguments.parse(words[key])
        except WrongUsage as fault:
            faults[key] = plain(str(fault))
    words = {key: found for key, found in words.items() if key not in faults}
    files = words.pop("file", [])
    options = arguments.parse([*files, *(word for key in words for word in words[key]), *more])
    return options, [*faults.values(), *map(plain, mistakes(options, faults))]


def mistakes(options, unread):
    has_file = options.file or options.low_file or arguments.is_folder(options)
    if not has_file and not {"file", "low-file", "pairs"}.intersection(unread):
        yield "file, low-file or a folder for pairs is missing"
    if options.report and arguments.is_folder(options):
        yield "report: the pairs of a folder have no report of their own, use --report on the command line"
    yield from arguments.mistakes(options, unread)


def plain(message):
    return re.sub(r"(?<!\S)--(?=\w)", "", message).removeprefix("argument ").rstrip(".")


def read(sets, more):
    """The options of all sets, or what is wrong with them by their numbers."""
    Path("jobs.json").write_text(json.dumps({"bake": sets}), encoding="utf-8")
    try:
        return job_file.read("jobs.json", more), {}
    except WrongUsage as error:
        found = re.findall(r"^jobs\.json, set (\d+): ((?:.|\n(?!jobs))*)$", str(error), re.MULTILINE)
        return [], {int(number): text for number, text in found}


@random_cases.seeds(12, fast=1)
def test_sets_are_read_as_the_parser_reads_them(seed, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "folder").mkdir()
    (tmp_path / "s.blend").touch()
    rng = random.Random(seed)
    sets = [random_set(rng) for _ in range(SETS)]
    more = rng.choice([[], ["--size", "32"], ["--size=64", "--samples", "4", "--mask", "--green=-y", "--maps", "ao"]])
    _, faults = read(sets, more)
    options, _ = read([values for number, values in enumerate(sets, 1) if number not in faults], more)
    assert min(len(options), len(faults)) > SETS / 10  # otherwise refusing all would pass
    for number, values in enumerate(sets, 1):
        wanted, wrong = by_parser(values, tmp_path, more)
        if None in wrong:
            assert number in faults
        elif wrong:
            assert faults[number] == "; ".join(wrong)
        else:
            assert repr(vars(options.pop(0))) == repr(vars(wanted))
    assert not options
