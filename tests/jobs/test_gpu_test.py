# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests the test of the GPU: its answers are right, what is wrong is found, and it leaves nothing behind."""

import getpass
import json
import platform
from dataclasses import replace
from pathlib import Path

import bpy
import numpy as np
import pytest

from addon.core.declarations import bases
from addon.core.errors import NoGpu
from addon.core.gpu_report import Verdict
from addon.core.map_types import WRITTEN
from addon.core.progress import Pace, finish
from addon.jobs import gpu_pairs, gpu_test
from addon.jobs.gpu_pairs import PAIRS
from addon.passes import hemisphere, shader, target
from scripts.dev import gpu_inputs
from tests.support import drivers, fast_math
from tests.support.lying_drivers import WHOLE_LIES, changed_shaders, lying
from tests.support.snapshot import difference, snapshot

pytestmark = pytest.mark.usefixtures("gpu_context")

BY_NAME = {pair.name: pair for pair in PAIRS}
LARGEST = 500_000
"""Bytes of the meshes and answers in the zip."""


def verdicts(pair, maps):
    """The verdicts on maps, by name."""
    answers = gpu_pairs.answers_of(pair)
    return {name: gpu_pairs.compare(pair, name, answer, maps[name]) for name, answer in answers.items()}


@pytest.mark.parametrize("pair", PAIRS, ids=BY_NAME)
def test_this_driver_is_right(pair):
    found = verdicts(pair, finish(pair.bake()))
    assert {name.partition(" ")[0] for name in found} == set(pair.limits)
    right = (Verdict.EQUAL, Verdict.WITHIN) if drivers.on_hardware() else (Verdict.EQUAL,)
    assert [each.text for each in found.values() if each.verdict not in right] == []


@pytest.mark.parametrize("pair", PAIRS, ids=BY_NAME)
def test_slices_of_a_window_give_the_same_maps(pair):
    at_once, in_slices = finish(pair.bake()), finish(pair.bake(Pace(0.001, has_picture=False)))
    for name, (texels, states) in at_once.items():
        assert np.array_equal(texels, in_slices[name][0])
        assert np.array_equal(states, in_slices[name][1])


def test_the_meshes_are_those_that_the_answers_are_computed_of():
    with np.load(gpu_pairs.ANSWERS) as stored:
        made = gpu_inputs.arrays()
        assert {key for key in stored if key.startswith(("meshes/", "images/"))} == set(made)
        for key, values in made.items():
            np.testing.assert_allclose(stored[key], values, atol=1e-6, err_msg=key)


def test_the_answers_are_small():
    assert gpu_pairs.ANSWERS.stat().st_size < LARGEST


# What is wrong


NORMALS = BY_NAME["Cast, Cycles"]


@pytest.fixture(scope="module")
def baked():
    """Two pairs, and their maps."""
    return {name: finish(BY_NAME[name].bake()) for name in ("Cast, Cycles", "Rays from hits", "Materials")}


def changed(maps, name, change):
    """The maps with one that is changed in place. change: takes texels and states."""
    texels, states = (values.copy() for values in maps[name])
    change(texels, states)
    return maps | {name: (texels, states)}


def at_first(value):
    def change(texels, states):
        place = tuple(np.argwhere(states == WRITTEN)[100])
        texels[place][:3] = value(texels[place][:3])

    return change


def turned(normal):
    """A normal that leans 0.1 degrees further, as stored."""
    vector = 2.0 * normal - 1.0
    vector /= np.linalg.norm(vector)
    aside = np.cross(vector, (0.0, 0.0, 1.0) if abs(vector[2]) < 0.9 else (1.0, 0.0, 0.0))
    return 0.5 + 0.5 * (vector + np.tan(np.radians(0.1)) * aside / np.linalg.norm(aside))


@pytest.mark.parametrize(
    ("pair", "name", "change", "text"),
    [
        ("Cast, Cycles", "NORMAL", at_first(turned), "1 of 2,304 texels differ, by at most 0.09"),
        ("Cast, Cycles", "NORMAL", at_first(lambda _: np.nan), "by at most inf degrees"),
        ("Materials", "BASE_COLOR", at_first(lambda color: color + 1e-3), "by at most 0.001"),
    ],
)
def test_one_texel_is_enough(baked, pair, name, change, text):
    found = verdicts(BY_NAME[pair], changed(baked[pair], name, change))[name]
    assert found.verdict is Verdict.WRONG
    assert text in found.text


def test_a_texel_that_is_not_covered_is_wrong(baked):
    def uncovered(_texels, states):
        states[tuple(np.argwhere(states == WRITTEN)[100])] = 0

    found = verdicts(NORMALS, changed(baked[NORMALS.name], "NORMAL", uncovered))["NORMAL"]
    assert found.verdict is Verdict.WRONG
    assert "1 are covered here and not there" in found.note


def test_a_few_single_rays_may_miss(baked):
    pair = BY_NAME["Rays from hits"]

    def missed(count, rays):
        def change(texels, states):
            places = tuple(np.argwhere(states == WRITTEN)[100 : 100 + count].T)
            texels[places[0], places[1], :3] -= rays / gpu_pairs.RAYS

        return change

    share = int(pair.limits["AO"].share * np.count_nonzero(baked[pair.name]["AO"][1] == WRITTEN))
    for count, rays, verdict in (
        (1, 1, Verdict.WITHIN),
        (share, 1, Verdict.WITHIN),
        (share + 1, 1, Verdict.WRONG),
        (1, 6, Verdict.WRONG),
    ):
        maps = changed(baked[pair.name], "AO", missed(count, rays))
        assert verdicts(pair, maps)["AO"].verdict is verdict


@pytest.mark.parametrize("method", ["Flatten", "Cast"])
def test_no_basis_passes_for_another(method):
    for pair in (BY_NAME[f"{method}, {basis.label}"] for basis in bases.BASES):
        for basis in bases.BASES:
            if basis.name == pair.settings["basis"]:
                continue
            other = replace(pair, settings={**pair.settings, "basis": basis.name})
            assert verdicts(pair, finish(other.bake()))["NORMAL"].verdict is Verdict.WRONG


@pytest.mark.parametrize(
    ("name", "wrong", "settings"),
    [
        ("Own hits under a roof", {"NORMAL"}, {"hit": "OUTERMOST"}),
        ("Adaptive samples", {"NORMAL"}, {"samples": 4}),
        ("Rays from hits", {"AO", "BENT_NORMAL", "THICKNESS", "CURVATURE"}, {"rays": 8}),
        ("Margin across seams", {"BASE_COLOR"}, {"margin_type": "EXTEND"}),
        ("Margin of the nearest", {"BASE_COLOR"}, {"margin": 5}),
        ("Own normal and bump maps", {"NORMAL"}, {"detail_maps": False}),
        ("UDIM tiles", {"NORMAL 1002", "NORMAL 1011"}, {"green": "-Y"}),
    ],
)
def test_another_bake_is_wrong(name, wrong, settings):
    pair = BY_NAME[name]
    make = pair.make
    if "detail_maps" in settings:  # without objects, nobody reads this setting
        settings, make = {}, lambda meshes, run: pair.make(replace(meshes, materials=[]), run)
    other = replace(pair, make=make, settings={**pair.settings, **settings})
    found = verdicts(pair, finish(other.bake()))
    assert {each for each, test in found.items() if test.verdict is Verdict.WRONG} == wrong


# The whole


@pytest.mark.slow
def test_the_whole_test_names_nobody_and_changes_nothing():
    before, steps = snapshot(), []
    report = gpu_test.test(steps.append)
    assert difference(before, snapshot()) == {}
    assert report.wrong == []
    assert {each.name for each in report.times} == {
        "First use",
        "Upload",
        "Read-back",
        "Own hits",
        "Occlusion",
        "Margin",
    }
    assert all(each.value > 0.0 for each in report.times if each.name != "First use")
    shares = [step.done for step in steps]
    assert shares == sorted(shares)
    assert len(shares) > 50
    texts = report.text, report.row, json.dumps(report.to_dict())
    secrets = getpass.getuser(), platform.node(), str(Path.home()), str(Path(__file__).parents[2])
    assert [(secret, text) for secret in secrets for text in texts if len(secret) > 4 and secret in text] == []
    assert all("/home/" not in text and "\\Users\\" not in text for text in texts)
    assert len(target.common) == 0
    assert report.machine["reads"] == ("images" if shader.reads_images() else "samplers")
    assert len(report.text) < 8000, "an issue holds 65,536 characters; people read fewer"


@pytest.mark.slow
def test_what_fails_does_not_end_the_test(monkeypatch):
    """A program that does not compile, for which Blender raises Exception, and one whose result changes from run to run."""
    load, added = shader.load, [0.0]

    def refused(program):
        if program is hemisphere.ADD_THICKNESS:
            raise Exception("Shader Compile Error, see console for more details")
        return load(program)

    refused.cache_info, refused.cache_clear = load.cache_info, load.cache_clear
    monkeypatch.setattr(shader, "load", refused)
    mean = hemisphere.bent_normals

    def restless(into, sums, *arguments, **options):
        mean(into, sums, *arguments, **options)
        added[0] += 1.0

    monkeypatch.setattr(hemisphere, "bent_normals", restless)
    report = gpu_test.test()
    assert [(each.name, each.note) for each in report.wrong] == [
        ("Rays from hits", "Shader Compile Error, see console for more details")
    ]


@pytest.mark.slow
@pytest.mark.parametrize(("lie", "wrong"), WHOLE_LIES.values(), ids=WHOLE_LIES)
def test_a_driver_that_lies_is_caught(lie, wrong):
    with lying(lie):
        report = gpu_test.test()
    assert wrong <= {each.name for each in report.wrong}


@pytest.mark.slow
def test_a_compiler_with_fast_math_is_right():
    """As Metal's: it folds comparisons with NaN, which no map depends on."""
    with lying(changed_shaders(fast_math.turned)):
        report = gpu_test.test()
    assert report.wrong == []


@pytest.mark.slow
def test_samplers_give_the_same_maps(monkeypatch):
    """Hardware reads tables by samplers, software drivers by images."""
    monkeypatch.setattr(shader, "reads_images", lambda: False)
    report = gpu_test.test()
    assert report.machine["reads"] == "samplers"
    assert report.wrong == []
    assert {each.verdict for each in report.maps} == {Verdict.EQUAL}


def test_rays_are_measured(monkeypatch):
    monkeypatch.setattr(gpu_test, "SIDES", (128,))
    found = finish(gpu_test.MEASURES["Rays"]())
    assert [each.name for each in found] == ["Own hits", "Occlusion"]
    assert all(each.value > 0.0 for each in found)


def test_a_measurement_that_fails_is_wrong(monkeypatch):
    def refused():
        yield gpu_test.STEP
        raise RuntimeError("no memory")

    monkeypatch.setattr(gpu_test, "MEASURES", {"Upload": refused})
    monkeypatch.setattr(gpu_test, "DRIVER_CHECKS", ())
    monkeypatch.setattr(gpu_test, "PAIRS", ())
    report = gpu_test.test()
    assert [(each.name, each.note) for each in report.wrong] == [("Times: upload", "no memory")]


def test_maps_that_change_from_bake_to_bake_are_wrong():
    pair, count = BY_NAME["Own hits under a roof"], [0]

    def restless(meshes, run):
        maps = yield from pair.make(meshes, run)
        count[0] += 1
        maps["NORMAL"][0][20, 10, 0] += 1e-6 * count[0]
        return maps

    (found,), _ = finish(gpu_test._baked(replace(pair, make=restless), None))
    assert found.verdict is Verdict.WRONG
    assert "1 texels are others when it is baked again" in found.text


def test_errors_of_the_test_itself_are_not_hidden():
    def broken(_meshes, _run):
        yield from ()
        raise KeyError("a mistake")

    with pytest.raises(KeyError):
        finish(gpu_test._baked(replace(NORMALS, make=broken), None))


def test_a_test_that_is_stopped_frees_its_memory():
    steps = gpu_test.work(Pace(0.06, has_picture=False))
    for _ in range(30):
        next(steps)
    assert len(target.common) == 0
    pool = target._in_use.get()
    steps.close()
    assert target._in_use.get() is pool is target.common


def test_without_a_gpu_there_is_one_sentence(monkeypatch):
    def none():
        raise SystemError("GPU functions are not available in background mode")

    monkeypatch.setattr(gpu_test.older_blender, "start_gpu", none)
    with pytest.raises(NoGpu, match="has no GPU to draw on here"):
        gpu_test.test()


def test_nothing_is_read_of_the_open_file():
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    before = snapshot()
    finish(PAIRS[0].bake())
    assert difference(before, snapshot()) == {}
