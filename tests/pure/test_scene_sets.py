# SPDX-License-Identifier: GPL-3.0-or-later
"""The keys of job files that sets of a scene make, read back: the same settings and parts."""

import json
import random
from dataclasses import replace

import pytest

from addon.cli import arguments, job_file
from addon.cli.arguments import WrongUsage
from addon.core.declarations import kinds
from addon.core.declarations.all_settings import DECLARED
from addon.core.errors import BakeError
from addon.core.naming import Suffixes
from addon.core.scene_sets import JobSet, Part, SceneSet, keys_of
from addon.core.settings import PART_OF, Settings

USUAL = Settings(width=64, height=32, storage="FILE", output="/maps/{low}.png", depth=16)


def read(keys):
    """The options of a job file with these keys, which went through JSON."""
    return job_file.of_keys(json.loads(json.dumps(keys)), {})


def test_usual_settings_make_few_keys():
    assert keys_of(USUAL) == {"size": "64x32", "output": "/maps/{low}.png", "depth": 16}


def another(chance, name):
    """Another value of a setting."""
    setting = DECLARED[name]
    match setting:
        case kinds.Switch():
            return not setting.default
        case kinds.Flags():
            return tuple(value for value in setting.values if chance.random() < 0.5)
        case kinds.Choice():
            return chance.choice(setting.values)
        case kinds.Color():
            return (0.25, 0.5, 1.0)
        case kinds.Tiles():
            return (1001, 1012)
        case kinds.WholeNumber():
            return None if setting.none_word and chance.random() < 0.5 else setting.least + 1
        case kinds.Distance() | kinds.Amount():
            return 0.125
        case kinds.FilePath():
            return "/maps/T_{low}.exr"
    return "Some Name, with = and ünï"


@pytest.mark.parametrize("seed", range(60))
def test_any_settings_are_the_same_when_they_are_read(seed):
    chance = random.Random(seed)
    names = [name for name in PART_OF if name not in {"storage", "low_suffix", "width", "height"}]
    values = {name: another(chance, name) for name in names if chance.random() < (0.2 if seed else 1.0)}
    settings = Settings(**USUAL.flat() | values)
    if settings.sampling.tiles or "<UDIM>" in settings.storing.output:
        settings = (
            settings.sampled(udim=True)
            if hasattr(settings, "sampled")
            else Settings(**settings.flat() | {"udim": True})
        )
    assert arguments.settings(read(keys_of(settings))) == settings


def test_each_setting_alone_is_the_same_when_it_is_read():
    chance = random.Random(7)
    for name in PART_OF:
        if name not in {"storage", "low_suffix", "width", "height", "tiles"}:
            settings = Settings(**USUAL.flat() | {name: another(chance, name)})
            assert arguments.settings(read(keys_of(settings))) == settings, name


def test_a_zero_is_kept():
    """In the window, too, which reads a job file by itself."""
    tried = []
    for name in PART_OF:
        if isinstance(DECLARED[name], kinds.WholeNumber | kinds.Distance) and name not in {"width", "height"}:
            settings = Settings(**USUAL.flat() | {name: 0})
            keys = keys_of(settings)
            if keys != keys_of(USUAL) and not _is_refused(settings):
                tried.append(name)
                assert JobSet.of_keys(keys).settings == settings, name
                assert arguments.settings(read(keys)) == settings, name
    assert {"margin", "mips", "extrusion"} <= {*tried}


def _is_refused(settings):
    try:
        settings.check()
    except BakeError:
        return True
    return False


def test_another_suffix_is_kept():
    options = read(keys_of(USUAL.stored(low_suffix="_game")))
    assert options.suffixes == Suffixes("_game")
    assert arguments.settings(options).storing.low_suffix == "_game"


PARTS = (
    Part("crate_low", ("crate_high",)),
    Part('a, b = "c"', ("x=y", "z,w"), "cage", 512, 0.25),
    Part("itself", sizes=(("Wood", 512), ("Iron", 64)), is_on=False),
)


def test_parts_are_the_same_when_they_are_read():
    one = SceneSet("Props", "Scene", PARTS, USUAL, output="/maps/{low}.png")
    options = read(one.keys("/a/props.blend"))
    assert tuple(options.part) == PARTS
    assert options.low == ["crate_low", 'a, b = "c"', "itself"]
    assert (options.file, options.scene, options.name) == (["/a/props.blend"], "Scene", "Props")


@pytest.mark.parametrize(
    ("by_material", "output"),
    [(False, "/maps/T_Props_N.png"), (True, "/maps/T_{material}_N.png")],
    ids=["one", "material"],
)
def test_one_image_for_all_is_called_as_the_set(by_material, output):
    settings = USUAL.mapped(texture_sets=by_material)
    one = SceneSet("Props", "Scene", PARTS, settings, output="/maps/T_{name}_N.png", share_image=True)
    assert one.keys("a.blend")["output"] == output


def test_a_part_in_a_shell():
    options = arguments.parse(["a.blend", "--part", "lo = hi, bolts", "--part", "b=c", "--output", "{low}.png"])
    assert options.part == [Part("lo", ("hi", "bolts")), Part("b", ("c",))]
    assert options.low == ["lo", "b"]
    assert list(arguments.mistakes(options)) == []


WRONG_PARTS = {
    "lo": "not a low object with its high ones",
    "lo=": "not a low object with its high ones",
    "=hi": "not a low object with its high ones",
    '{"low": "a", "hihg": ["b"]}': "part has no key 'hihg', did you mean 'high'?",
    '{"low": "a", "size": "big"}': "is not a part",
    '{"low": "a", "size": -1}': "is not a part",
    '{"low": "a", "on": 1}': "is not a part",
    '{"low": 3}': "is not a part",
    '{"low": "a", "sizes": 3}': "is not a part",
    '{"low": "a", "sizes": {"Wood": "big"}}': "is not a part",
    '{"low": "a", "sizes": {"Wood": -1}}': "is not a part",
    '{"high": ["b"]}': "is not a part",
    '{"low": "a", "high": 3}': "is not a part",
    '{"low": "a"': "is not a table",
}


@pytest.mark.parametrize("text", WRONG_PARTS)
def test_a_wrong_part_is_one_sentence(text):
    with pytest.raises(WrongUsage) as error:
        arguments.parse(["a.blend", "--part", text, "--output", "m.png"])
    assert WRONG_PARTS[text] in str(error.value)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--part", "a=b", "--high", "c"], "leave out --high"),
        (["--part", "a=b", "--cage", "c"], "leave out --cage"),
        (["--part", "a=b", "--part", "a=c"], "--part names 'a' twice"),
        (["--set", "A", "--low", "a"], "--set says what to bake: leave out --low"),
        (["--set", "A", "--pairs", "--frames", "1-2"], "--set says what to bake: leave out --pairs, --frames"),
        (["--set", "A", "b.obj"], "--set is for .blend files, and 'b.obj' is none"),
    ],
)
def test_options_that_contradict_sets_and_parts(words, said):
    options = arguments.parse(["a.blend", *words, "--output", "{low}.png"])
    assert any(said in each for each in arguments.mistakes(options)), list(arguments.mistakes(options))


def test_a_set_needs_no_output_in_a_call():
    options = arguments.parse(["a.blend", "--set", "A"])
    assert list(arguments.mistakes(options)) == []


@pytest.mark.parametrize("command", ["lod", "asset"])
def test_sets_are_for_bakes(command):
    reader = {"lod": arguments.read_lod, "asset": arguments.read_asset}[command]
    with pytest.raises(WrongUsage, match="--set"):
        reader(["a.blend", "--set", "A", "--output", "{low}.png"], "imprint")


def test_a_table_may_have_one_high_as_text():
    assert Part.of_text('{"low": "a", "high": "b"}') == Part("a", ("b",))
    with pytest.raises(BakeError):
        Part.of_text('{"low": "a", "high": [1]}')
    assert replace(Part("a"), is_on=False).table == {"low": "a", "on": False}
