# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests how the command line and job files are read, and the messages about mistakes in them."""

import json
import os
import random
import re
from pathlib import Path

import pytest

from addon.cli import arguments, job_file
from addon.cli.arguments import WrongUsage
from addon.cli.job_file import KEYS
from addon.cli.options import RunOptions
from addon.core import file_formats, map_types
from addon.core.declarations.all_settings import DECLARED
from addon.core.naming import Suffixes
from addon.core.settings import PART_OF, Settings
from tests.support import random_cases

LOW = ["--low", "lo", "--output", "m.png"]


def settings(*more, low=LOW):
    return arguments.settings(arguments.parse([*low, *more]))


# The command line


def test_the_defaults_are_those_of_settings(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    expected = Settings(width=2048, height=2048, storage="FILE", output=str(tmp_path / "m.png"))
    assert settings() == expected


SAID = {
    "method": ("--method cast", "CAST"),
    "space": ("--space WORLD", "WORLD"),
    "basis": ("--basis mikktspace", "MIKKTSPACE"),
    "targets": ("--targets three,unreal", ("unreal", "three")),
    "uv_layer": ("--uv Layout", "Layout"),
    "width": ("--size 64x32", 64),
    "height": ("--size 64x32", 32),
    "samples": ("--samples 16", 16),
    "adaptive": ("--no-adaptive", False),
    "extrusion": ("--extrusion 0.5", 0.5),
    "max_distance": ("--max-distance 1.5", 1.5),
    "directions": ("--directions split", "SPLIT"),
    "offset_group": ("--offset-group far", "far"),
    "straight_group": ("--straight-group=turned", "turned"),
    "hit": ("--hit nearest", "NEAREST"),
    "facing_only": ("--facing-only", True),
    "cut_outs": ("--no-cut-outs", False),
    "missed": ("--missed 1,0,1", (1.0, 0.0, 1.0)),
    "mask": ("--mask", True),
    "normal": ("--no-normal", False),
    "rays": ("--rays 64", 64),
    "distance_unit": ("--distance-unit scene", "SCENE"),
    "ao_distance": ("--ao-distance 0.3", 0.3),
    "ao_fade": ("--ao-fade smooth", "SMOOTH"),
    "occluders": ("--occluders all", "ALL"),
    "floor": ("--floor", True),
    "two_sided": ("--two-sided", True),
    "bias_angle": ("--bias-angle 8", 8),
    "thickness_distance": ("--thickness-distance 0.2", 0.2),
    "curvature_radius": ("--curvature-radius 0.05", 0.05),
    "attribute": ("--attribute Col", "Col"),
    "appearance": ("--appearance", True),
    "exact_materials": ("--exact-materials off", "OFF"),
    "tangent_displacement": ("--tangent-displacement", True),
    "gradient_axis": ("--gradient-axis x", "X"),
    "id_by": ("--id-by face-set", "FACE_SET"),
    "detail_maps": ("--no-detail-maps", False),
    "pack": ("--pack hdrp", "HDRP"),
    "pack_red": ("--pack-red cavity", "CAVITY"),
    "pack_green": ("--pack-green zero", "ZERO"),
    "pack_blue": ("--pack-blue smoothness", "SMOOTHNESS"),
    "pack_alpha": ("--pack-alpha alpha", "ALPHA"),
    "texture_sets": ("--texture-sets", True),
    "vertex_domain": ("--vertex-domain point", "POINT"),
    "connect_maps": ("--connect-maps", True),
    "maps": ("--maps object_id,height", ("HEIGHT", "OBJECT_ID")),
    "red": ("--red -y", "-Y"),
    "green": ("--green -Z", "-Z"),
    "blue": ("--blue=-x", "-X"),
    "margin": ("--margin unlimited", None),
    "wrap": ("--wrap uv", "UV"),
    "margin_type": ("--margin-type adjacent-faces", "ADJACENT_FACES"),
    "mips": ("--mips 5", 5),
    "udim": ("--udim", True),
    "tiles": ("--tiles 1001,1003", (1001, 1003)),
    "limit": ("--limit 0.25", 0.25),
    "depth": ("--depth 8", 8),
    "dither": ("--dither", True),
    "value_range": ("--value-range 0.25", 0.25),
    "stacked": ("--stacked last", "LAST"),
    "modifiers": ("--modifiers viewport", "VIEWPORT"),
    "rest_pose": ("--rest-pose", True),
    "keep_faces": ("--keep-faces", True),
    "edge_radius": ("--edge-radius 0.02", 0.02),
    "smooth_high": ("--smooth-high 3", 3),
    "image": ("--image Map", "Map"),
    "output": ("--output /n.exr", os.path.abspath("/n.exr")),  # on Windows, with the drive
    "alpha": ("--no-alpha", False),
    "mip_files": ("--mip-files", True),
    "format": ("--format auto", "AUTO"),
    "most_degrees": ("--most-degrees 0.5", 0.5),
    "most_steps": ("--most-steps 3", 3.0),
    "compression": ("--compression bc6h", "BC6H"),
    "quality": ("--quality 90", 90),
    "lossy_normals": ("--lossy-normals", True),
    "export_webp": ("--export a.glb --export-webp", True),
    "export_ktx2": ("--export a.glb --export-ktx2", True),
    "material": ("--no-material", False),
    "single_user": ("--single-user", True),
    "one_material": ("--one-material", True),
}


def test_every_setting_has_an_option():
    assert set(SAID) | {"storage", "low_suffix"} == set(PART_OF)  # --suffixes has the ending of low objects


def test_the_ending_of_low_objects_is_that_of_pairs_by_name():
    options = arguments.parse(["a.blend", "--pairs", "--suffixes", ".lp,.hp,.cg", "--output", "{name}_n.png"])
    assert arguments.settings(options).storing.low_suffix == ".lp"


@pytest.mark.parametrize("name", SAID)
def test_each_option_sets_its_setting(name):
    words, value = SAID[name]
    assert settings().flat()[name] != value
    assert settings(*words.split()).flat()[name] == value


def test_maps_may_be_written_without_dashes_and_with_the_normal_map():
    assert settings("--maps", "normal,basecolor,ao").map.maps == ("AO", "BASE_COLOR")


@pytest.mark.parametrize("channel", ["red", "green", "blue"])
@pytest.mark.parametrize("axis", DECLARED["red"].values)
@pytest.mark.parametrize("joint", [" ", "="])
def test_axes_whose_names_look_like_options(channel, axis, joint):
    assert settings(*f"--{channel}{joint}{axis.lower()}".split()).flat()[channel] == axis


def test_every_map_has_a_word():
    words = ",".join(name.lower().replace("_", "-") for name in map_types.NAMES)
    assert settings("--maps", words).map.maps == map_types.NAMES


@pytest.mark.parametrize("words", ["--tiles 1002", "--udim", "--output m.<UDIM>.png"])
def test_options_that_enable_tiles(words):
    assert settings(*words.split()).sampling.udim


@pytest.mark.parametrize("slashes", ["//", "///", "////"])
@pytest.mark.parametrize("option", ["output", "report", "save-blend", "low-file", "jobs", "pairs", "file"])
@pytest.mark.parametrize("system", ["posix", "nt"])
def test_two_slashes_become_one(monkeypatch, system, option, slashes):
    """A shell's $ROOT/map.png may have two. Blender would read them as the folder of the open file.

    On Windows they start the name of a server, and are kept.
    """
    monkeypatch.setattr(os, "name", system)
    words = [f"{slashes}x/y.png"] if option == "file" else [f"--{option}", f"{slashes}x/y.png"]
    found = vars(arguments.parse(words))[option.replace("-", "_")]
    expected = "/x/y.png" if system == "posix" else f"{slashes}x/y.png"
    assert found in (expected, [expected])


@pytest.mark.parametrize("ending", file_formats.BY_ENDING)
def test_the_default_depth_is_16_or_the_highest_below_that(ending):
    found = settings("--output", f"m{ending.upper()}")
    found.check()
    assert found.storing.depth == (16 if 16 in file_formats.BY_ENDING[ending].depths else 8)


WRONG = {
    "nothing": ("--output m.png", "one of --low"),
    "two ways": ("--low a --pairs --output m.png", "exclude each other"),
    "two other ways": ("--low a --low-file a.obj --output m.png", "exclude each other"),
    "no output": ("--low a", "--output is required"),
    "pairs and names": ("--pairs --high a --output m.png", "by itself"),
    "pairs and files": ("--pairs --high-file a.obj --output m.png", "by itself"),
    "files and names": ("--low-file a.obj --high a --output m.png", "go together"),
    "names and files": ("--low a --high-file a.obj --output m.png", "go together"),
    "files and a scene": ("x.blend --low-file a.obj --output m.png", "go together"),
    "a folder and a scene": ("x.blend --pairs folder --output {low}.png", "name no others"),
    "a folder and one map": ("--pairs folder --output m.png", "put {low} into --output"),
    "a folder and one scene": ("--pairs folder --output {low}.png --save-blend s.blend", "--save-blend"),
    "a wrong ending": ("--low a --output m.gif", "does not end in one of .png"),
    "a scene with a wrong ending": ("--low a --output m.png --save-blend s.txt", "does not end in .blend"),
    "no size": ("--low a --output m.png --size 0", "Width: 0 is outside 16 to 16384"),
    "a tile in a folder's name": ("--low a --output <UDIM>/m.png", "in a folder's name"),
    "no such map": ("--low a --output m.png --maps heigth", "'heigth' is not one of position, height"),
    "a misspelled map": (
        "--low a --output m.png --maps ao,curvture",
        "subsurface, attribute, part-id, gradient, normal, did you mean 'curvature'?",
    ),
    "misspelled maps": (
        "--low a --output m.png --maps hight,ao,curvture",
        "'hight', 'curvture' are not among position, height",
    ),
    "two suggestions": ("--low a --output m.png --maps hight,ao,curvture", ", did you mean 'height' and 'curvature'?"),
    "a misspelled word": ("--low a --output m.png --space tangnet", "tangent, object, world, did you mean 'tangent'?"),
    "no such axis": ("--low a --output m.png --red x", "'x' is not one of +x, -x"),
    "no such margin": ("--low a --output m.png --margin-type wide", "not one of extend, adjacent-faces"),
    "a margin in words": ("--low a --output m.png --margin wide", "unlimited"),
    "no tiles": ("--low a --output m.png --tiles x", "not a list of UDIM tiles"),
    "a part of one bake": (
        "--low a --output m.png --shard 1/2",
        "--shard is for many bakes: use --jobs or --pairs DIR",
    ),
    "done and not done": ("--low a --output m.png --resume --force", "--force does all bakes: leave out --resume"),
    "some of one bake": ("--low a --output m.png --only a", "--only is for many bakes"),
    "a part that is not there": ("--low a --output m.png --shard 3/2", "'3/2' is not a part K/N"),
    "part 0": ("--low a --output m.png --shard 0/2", "'0/2' is not a part K/N"),
    "a list and a check": ("--low a --output m.png --list --check", "leave out --check"),
    "JSON of nothing": ("--low a --output m.png --json", "--json is for --list"),
    "several mistakes": ("--size 0", "one of --low, --low-file and --pairs is required; --output is required"),
    "an abbreviation": ("--low a --outp m.png", "--outp"),
}


@pytest.mark.parametrize("case", WRONG)
def test_messages_about_wrong_usage(case):
    words, expected = WRONG[case]
    with pytest.raises(WrongUsage) as refused:
        arguments.check(arguments.parse(words.split()))
    assert expected in str(refused.value)
    assert "\n" not in str(refused.value)


def test_pairs_may_be_followed_by_the_file(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "rocks.blend").touch()
    (tmp_path / "folder").mkdir()
    for words in (["rocks.blend", "--pairs"], ["--pairs", "rocks.blend"]):
        found = arguments.parse([*words, "--output", "m.png"])
        assert (found.file, found.pairs) == (["rocks.blend"], True)
    for words in (["folder", "--pairs"], ["--pairs", "folder"]):
        found = arguments.parse([*words, "--output", "m.png"])
        assert (found.file, found.pairs) == ([], "folder")


# Job files

TOML = """
[defaults]
size = 512
space = "object"
samples = 4
green = "-y"
tiles = [1001, 1002]

[[bake]]
file = "rock.blend"
low = "-rock low"
high = ["rock_high", "moss"]
cage = "rock_cage"
output = "maps/rock.png"
missed = [1, 0, 1]
mask = true

[[bake]]
file = ["a.obj", "b.glb"]
pairs = true
suffixes = ["_lp", "_hp", "_cg"]
output = "/elsewhere/{low}.exr"
depth = 32
margin = "unlimited"
samples = 1

[[bake]]
low-file = "a_low.obj"
high_file = "a_high.fbx"
size = "64x32"
extrusion = 0.125
no-material = true
facing-only = false
output = "a.png"
"""


@pytest.fixture
def write(tmp_path, monkeypatch):
    """A function that writes a job file and returns its name."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "jobs").mkdir()

    def file(content, name="jobs/jobs.toml"):
        text = content if isinstance(content, str) else json.dumps(content)
        (tmp_path / name).write_text(text, encoding="utf-8")
        return name

    return file


def test_a_job_file_is_read(write, tmp_path):
    here = tmp_path / "jobs"
    rock, scene, files = job_file.read(write(TOML))
    assert (rock.file, rock.low, rock.high, rock.cage) == (
        [str(here / "rock.blend")],
        ["-rock low"],
        ["rock_high", "moss"],
        "rock_cage",
    )
    assert rock.output == str(here / "maps" / "rock.png")
    assert (rock.size, rock.space, rock.samples, rock.green) == ((512, 512), "OBJECT", 4, "-Y")
    assert (rock.missed, rock.mask, rock.tiles) == ((1.0, 0.0, 1.0), True, (1001, 1002))
    assert scene.file == [str(here / "a.obj"), str(here / "b.glb")]
    assert (scene.pairs, scene.suffixes, scene.output) == (
        True,
        Suffixes("_lp", "_hp", "_cg"),
        str(here / "/elsewhere/{low}.exr"),
    )
    assert (scene.depth, scene.margin, scene.samples) == (32, None, 1)
    assert (files.low_file, files.high_file) == (str(here / "a_low.obj"), [str(here / "a_high.fbx")])
    assert (files.size, files.extrusion, files.material, files.facing_only) == ((64, 32), 0.125, False, False)


def test_json_gives_the_same_as_toml(write):
    import tomllib

    assert job_file.read(write(tomllib.loads(TOML), "jobs/jobs.json")) == job_file.read(write(TOML))


def test_a_byte_order_mark_is_ignored(write):
    assert len(job_file.read(write("\ufeff" + TOML))) == 3


def test_a_set_overrides_the_defaults(write):
    text = "[defaults]\nmask = true\nhigh = ['a', 'b']\nfile = 'x.blend'\nlow = 'l'\noutput = 'm.png'\n[[bake]]\n"
    (default,) = job_file.read(write(text))
    (changed,) = job_file.read(write(text + "mask = false\nhigh = 'c'\n"))
    assert (default.mask, default.high) == (True, ["a", "b"])
    assert (changed.mask, changed.high) == (False, ["c"])


def test_options_on_the_command_line_are_passed_to_all_sets():
    words = "--size 32 --jobs j.toml --green -x --report r.json --mask"
    known, more = arguments.split_jobs(words.split())
    assert (known.jobs, known.report) == ("j.toml", "r.json")
    assert more == ["--size", "32", "--green=-x", "--mask"]


def test_options_on_the_command_line_override_all_sets(write):
    found = job_file.read(write(TOML), ["--size", "32", "--green=+y"])
    assert {options.size for options in found} == {(32, 32)}
    assert {options.green for options in found} == {"+Y"}


def test_options_of_the_run_are_not_passed_to_the_sets():
    words = "--list --json --shard 2/3 --only a* --only b --jobs j.toml --mask"
    known, more = arguments.split_jobs(words.split())
    assert (known.list, known.json, known.shard, known.only) == (True, True, (2, 3), ("a*", "b"))
    assert more == ["--mask"]
    with pytest.raises(WrongUsage, match="--json is for --list"):
        arguments.split_jobs(["--jobs", "j.toml", "--json"])


@pytest.mark.parametrize("words", ["--low x", "x.blend", "--pairs", "--low-file x.obj", "--high x"])
def test_only_the_job_file_may_name_objects(words):
    with pytest.raises(WrongUsage, match="names what to bake"):
        arguments.split_jobs(["--jobs", "j.toml", *words.split()])


SET = "[[bake]]\nfile='a.blend'\nlow='a'\noutput='{n}.png'\n"
FIRST = SET.format(n=1)
FAULTS = {
    "a misspelled key": (
        FIRST + SET.format(n=2) + "sampels = 4",
        "set 2: unknown key 'sampels', did you mean 'samples'?",
    ),
    "a misspelled default": (
        "[defaults]\nmaxdistance = 4\n" + FIRST,
        "defaults: unknown key 'maxdistance', did you mean 'max-distance'?",
    ),
    "several misspelt keys": (
        FIRST + "sise = 64\nsamples = 4\nmargim = 3\nmask = 7",
        "set 1: unknown key 'sise', did you mean 'size'?; unknown key 'margim', did you mean 'margin'?; mask: true or false",
    ),
    "a misspelt table": ("[default]\nsize = 4\n" + FIRST, ": unknown key 'default', did you mean 'defaults'?"),
    "misspelt sets": ("[[bakes]]\nlow='a'", ": unknown key 'bakes', did you mean 'bake'?"),
    "a word for an option": (FIRST + "jobs = 'x.toml'", "set 1: unknown key 'jobs'"),
    "an option of the run": (FIRST + "workers = 4", "set 1: unknown key 'workers': it works only on the command line"),
    "an option of asset": (
        FIRST + "own-textures = true",
        "set 1: unknown key 'own-textures': it is for the command asset, which no job file calls",
    ),
    "an option of lod": (
        FIRST + "triangles = '50%'",
        "set 1: unknown key 'triangles': it is for the command asset, which no job file calls",
    ),
    "a key before the sets": ("max_distance = 4\n" + FIRST, ": 'max_distance' belongs into 'defaults' or a set"),
    "slashes of Windows": ('[[bake]]\nfile="maps\\a.blend"', "Unescaped '\\' in a string"),
    "how slashes of Windows are written": ('[[bake]]\nfile="maps\\w.blend"', r"Write paths with /, or with \\"),
    "no choice": (FIRST + "samples = 3", "set 1: samples: invalid choice: 3"),
    "a fraction": (FIRST + "samples = 4.0", "set 1: samples: '4.0' is not a whole number"),
    "a word for a number": (FIRST + "extrusion = 'far'", "set 1: extrusion: 'far' is not a number"),
    "a number for a name": (FIRST.replace("'a'\n", "5\n", 1), "set 1: low: text, or a list of it is expected, not 5"),
    "a number for a path": ("[[bake]]\nfile=7", "set 1: file: text, or a list of it is expected, not 7"),
    "a list for a name": (FIRST + "cage = ['a']", 'set 1: cage: text is expected, not ["a"]'),
    "numbers among names": (FIRST + "high = ['a', 1]", "set 1: high: text, or a list of it is expected"),
    "text for a switch": (FIRST + "mask = 'yes'", 'set 1: mask: true or false is expected, not "yes"'),
    "a number for a switch": (FIRST + "mask = 1", "set 1: mask: true or false is expected, not 1"),
    "a switch for a number": (FIRST + "size = true", "set 1: size: a number or text is expected, not true"),
    "a switch for a name": (
        FIRST.replace("'a'\n", "true\n", 1),
        "set 1: low: text, or a list of it is expected, not true",
    ),
    "a table for a number": (FIRST + "size = {x = 1}", "set 1: size: a number or text is expected"),
    "a day for a number": (FIRST + "size = 2026-01-01", "set 1: size: a number or text is expected"),
    "no such word": (FIRST + "space = 'tangnet'", "set 1: space: 'tangnet' is not one of tangent, object, world"),
    "no output": ("[[bake]]\nfile='a.blend'\nlow='a'", "set 1: output is required"),
    "no low": ("[[bake]]\nfile='a.blend'\noutput='m.png'", "set 1: one of low, low-file and pairs is required"),
    "no file": ("[[bake]]\nlow='a'\noutput='m.png'", "set 1: file, low-file or a folder for pairs is missing"),
    "no size": (FIRST + "size = 0", "set 1: Width: 0 is outside 16 to 16384"),
    "no format": (FIRST.replace("png", "gif"), "{1.gif} does not end in"),
    "an empty path": (FIRST.replace("1.png", ""), "set 1: output: a path is empty"),
    "no sets": ("[defaults]\nsize = 4", ": 'bake' must be a list of sets"),
    "a set alone": ("[bake]\nlow = 'a'", "and not empty: in TOML each starts with [[bake]]"),
    "defaults in a list": ("[[defaults]]\nsize = 4\n" + FIRST, ": 'defaults' must be a table"),
    "a report of a folder": (
        "[[bake]]\npairs='x'\noutput='{low}.png'\nreport='r.json'",
        "set 1: report: the pairs of a folder",
    ),
    "a scene with a wrong ending": (FIRST + "save-blend='s.txt'", "set 1: {s.txt} does not end in .blend"),
    "standard output": (FIRST + "report='-'", "set 1: report: '-', standard output, works only on the command line"),
    "a long value": (FIRST + "size = [" + "[1]," * 999 + "]", "set 1: size: a number or text is expected"),
    "no TOML": ("[[bake]\nlow = 3", "'jobs/jobs.toml' is not valid TOML: "),
}


@pytest.mark.parametrize("case", FAULTS)
def test_a_mistake_gives_one_line_with_its_place(write, tmp_path, case):
    text, expected = FAULTS[case]
    name = write(text)
    with pytest.raises(WrongUsage) as refused:
        job_file.read(name)
    message = str(refused.value)
    expected = re.sub(r"\{(\w\.\w+)\}", lambda found: repr(str(tmp_path / "jobs" / found[1])), expected)
    assert expected in message
    assert name in message
    assert "\n" not in message
    assert len(message) < 500


def test_a_key_that_json_has_twice_is_a_mistake(write):
    """TOML has no such files. The first of both would be lost without a word."""
    name = write('{"bake": [{"file": "a.blend", "low": "a", "output": "1.png", "low": "b"}]}', "jobs/jobs.json")
    with pytest.raises(WrongUsage, match="'low' is given twice"):
        job_file.read(name)


@pytest.mark.parametrize("name", ["u.toml", "u.json"])
def test_a_file_that_is_not_utf_8_is_named(tmp_path, monkeypatch, name):
    """As an editor on Windows may save it."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / name).write_text(FIRST, encoding="utf-16")
    with pytest.raises(WrongUsage, match=f"^'{name}' is not UTF-8"):
        job_file.read(name)


def test_an_empty_list_and_false_take_back_the_defaults(write):
    defaults = "[defaults]\nmaps = ['ao']\nstrict = ['missed<1%']\nhigh = ['b']\nmask = true\n"
    taken_back = "maps = []\nstrict = []\nhigh = []\nmask = false\n"
    first, second = job_file.read(write(defaults + FIRST + SET.format(n=2) + taken_back))
    usual = arguments.parse([])
    for name in ("maps", "strict", "high", "mask"):
        assert getattr(first, name) != getattr(second, name) == getattr(usual, name)


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        ("--workers -1", "'-1' is not a number of processes from 0 to 256"),
        ("--workers 100000000", "'100000000' is not a number of processes from 0 to 256"),
        ("--timeout 1e-9", "'1e-9' is not a number of seconds from 0.1 to 31,536,000"),
        ("--timeout 1e300", "'1e300' is not a number of seconds from 0.1 to 31,536,000"),
        ("--timeout nan", "'nan' is not a number of seconds from 0.1 to 31,536,000"),
        ("--workers two", "'two' is not a whole number"),
        ("--max-memory 4", "'4' is less than Blender itself takes"),
        ("--max-memory 63M", "'63M' is less than Blender itself takes"),
        ("--max-memory 4 GB", "'4 GB' is not a size"),
    ],
)
def test_limits_that_no_bake_can_keep_are_refused(words, expected):
    """Fewer than no processes would do nothing for ever."""
    option, _, value = words.partition(" ")
    with pytest.raises(WrongUsage, match=re.escape(expected)):
        arguments.split_jobs(["--jobs", "j.toml", option, value])
    arguments.split_jobs(["--jobs", "j.toml", "--workers", "0"])
    arguments.split_jobs(["--jobs", "j.toml", "--max-memory", "64M"])


def test_a_job_file_in_the_place_of_a_scene_needs_jobs():
    with pytest.raises(WrongUsage, match="put --jobs before it"):
        arguments.check(arguments.parse(["props.TOML"]))


def test_mistakes_in_all_sets_are_reported_together(write):
    with pytest.raises(WrongUsage) as refused:
        job_file.read(write(FIRST + "sise = 4\n" + SET.format(n=2) + SET.format(n=3) + "mask = 3\n"))
    first, second = str(refused.value).splitlines()
    assert "set 1: unknown key 'sise', did you mean 'size'?" in first
    assert "set 3: mask" in second


def test_an_unknown_table_hides_no_other_mistake(write):
    with pytest.raises(WrongUsage) as refused:
        job_file.read(write("defaults = 3\n[default]\nsize = 4\n" + FIRST + "sise = 4\n"))
    unknown, wrong, first = str(refused.value).splitlines()
    assert unknown.endswith(": unknown key 'default', did you mean 'defaults'?")
    assert wrong.endswith(": 'defaults' must be a table")
    assert "set 1: unknown key 'sise'" in first


def test_all_mistakes_of_a_set_are_reported(write):
    text = (
        "[defaults]\nmask = 7\nspace = 'camera'\n"
        "[[bake]]\nlow='a'\nsamplse = 4\nsize = 'big'\nsamples = 3\n"
        "[[bake]]\nfile='a.blend'\nlow='a'\noutput='m.png'\nOUTPUT = 'm.png'\nsize = 0\n"
        "[[bake]]\nfile='b.blend'\nlow=3\n"
    )
    with pytest.raises(WrongUsage) as refused:
        job_file.read(write(text))
    defaults, first, second, third = str(refused.value).splitlines()
    assert "defaults: mask: true or false is expected, not 7; space: 'camera' is not one of" in defaults
    for words in (
        "set 1: unknown key 'samplse'",
        "size: 'big'",
        "samples: invalid choice: 3",
        "file, low-file",
        "output is r",
    ):
        assert words in first
    assert "set 2: unknown key 'OUTPUT'" in second
    assert "Width: 0 is outside" in second
    assert third.endswith("set 3: low: text, or a list of it is expected, not 3; output is required")


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("jobs/jobs.json", "[1]", "a table with 'bake'"),
        ("jobs/jobs.json", "{'bake': []}", "is not valid JSON"),
        ("jobs/jobs.json", {"bake": [{"low": None}]}, "set 1: low: text, or a list of it is expected, not null"),
        ("jobs/jobs.json", {"bake": [{"low": "a\0"}]}, "set 1: low: 'a\\x00' contains a NUL character"),
        ("jobs/jobs.json", "[" * 100_000, "nested too deeply"),
        ("jobs/jobs.toml", "a = " + "[" * 100_000, "nested too deeply"),
        (
            "jobs/jobs.json",
            '{"bake": [{"low": ' + "[" * 900 + "]" * 900 + "}]}",
            "set 1: low: text, or a list of it is expected",
        ),
        ("jobs/jobs.json", {"bake": [{"low": "a\udcff"}]}, "is not UTF-8"),
        ("jobs/jobs.txt", TOML, "does not end in .toml or .json"),
    ],
)
def test_other_mistakes_in_job_files(write, name, content, message):
    with pytest.raises(WrongUsage) as refused:
        job_file.read(write(content, name))
    assert message in str(refused.value)


def test_a_missing_job_file(tmp_path):
    with pytest.raises(WrongUsage, match="cannot be read: No such file"):
        job_file.read(str(tmp_path / "none.toml"))


DERIVED = {
    "nothing": ({}, set()),
    "a job file": ({"jobs": "j.toml"}, {"may_have_many", "has_table", "has_workers"}),
    "a folder": ({"folder": "d"}, {"may_have_many", "has_table", "has_workers"}),
    "a folder in this process": ({"folder": "d", "workers": 0}, {"may_have_many", "has_table"}),
    "records": ({"resume": True}, {"has_records", "has_table"}),
    "records of all": ({"force": True}, {"has_records", "has_table"}),
    "a page": ({"sheet": "s.html"}, {"has_pictures", "has_table"}),
    "pictures": ({"pictures": "p"}, {"has_pictures", "has_hashes", "has_table"}),
    "a report": ({"report": "-"}, {"has_hashes"}),
    "a limit": ({"timeout": 9.0}, {"needs_worker", "has_workers", "has_table"}),
    "a log": ({"log": "l"}, {"needs_worker", "has_workers", "has_table"}),
    "untrusted files": ({"untrusted": True}, {"needs_worker", "has_workers", "has_table", "has_hashes"}),
}


@pytest.mark.parametrize(("given", "expected"), DERIVED.values(), ids=DERIVED)
def test_what_follows_from_the_options_of_a_run(given, expected):
    found = RunOptions(**given)
    names = set().union(*(names for _, names in DERIVED.values()))
    assert {name for name in names if getattr(found, name)} == expected


@pytest.mark.parametrize(("given", "has_files"), [({"folder": "d"}, False), ({"jobs": "j"}, False), ({}, True)])
def test_untrusted_files_are_named(given, has_files):
    assert list(RunOptions(untrusted=True, **given).mistakes(has_files=has_files)) == []
    assert "needs FILE" in next(RunOptions(untrusted=True).mistakes(has_files=False))


# Job file reading


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


@random_cases.seeds(6, fast=1)
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
