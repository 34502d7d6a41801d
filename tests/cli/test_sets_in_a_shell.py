# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests --set: sets that a .blend keeps are baked in a shell as in the window, with what the command line says over it."""

import json
import shutil
import subprocess
import sys
from pathlib import Path

import bpy
import numpy as np
import pytest

import addon
from addon.cli import command, set_options
from addon.core import progress
from addon.core.progress import Pace
from addon.jobs import bake_jobs
from addon.jobs import sets as set_jobs
from addon.ui import results, sets
from scripts.imprint import ROOT
from tests.support import reports, zoo

pytestmark = pytest.mark.usefixtures("gpu_context")

NAMES = ("crate", "lid", "bolt")


@pytest.fixture
def registered():
    """The add-on, for what a window does; a shell does not have it."""
    addon.register()
    yield
    if hasattr(bpy.types.Scene, "imprint"):
        addon.unregister()


def parts(one, lows):
    for low in lows:
        one.parts.add().object = low


def own(one, **values):
    for name, value in values.items():
        one.make_own(name)
        setattr(one.own, name, value)


@pytest.fixture
def props(tmp_path, monkeypatch, registered):
    """The working folder, with props.blend: three parts in the sets Crate, Atlas, Wooden and Packed, and their files as the
    window bakes them, by name. The high object of the bolt belongs to it by hand, and the lid has a size of its own."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(set_options, "read", addon.scene_sets)
    lows = []
    for number, name in enumerate(NAMES):
        low, high = zoo.plane(f"{name}_low"), zoo.terrain("sculpt" if name == "bolt" else f"{name}_high", n=8 + number)
        low.location.x = high.location.x = 3.0 * number
        points = low.data.uv_layers[0].data
        for point in points:
            point.uv = point.uv[0] / 3 + number / 3, point.uv[1]
        low.data.materials.append(bpy.data.materials.new("Wood") if not lows else lows[0].data.materials[0])
        lows.append(low)
    pair = lows[2].imprint
    pair.highs.add().object = bpy.data.objects["sculpt"]
    lows[1].imprint_size = "256"
    scene = bpy.context.scene
    scene.imprint.width = scene.imprint.height = 24
    scene.imprint.storage, scene.imprint.output = "FILE", "//maps/{low}.png"
    for name, textures in (("Crate", "PART"), ("Atlas", "ONE"), ("Wooden", "MATERIAL"), ("Packed", "PART")):
        one = scene.imprint_sets.add()
        one.name, one.textures = name, textures
        parts(one, lows)
    own(scene.imprint_sets[1], output="//maps/T_{name}.png", width=48, samples="4")
    own(scene.imprint_sets[2], output="//maps/{material}.png", method="CAST")
    own(scene.imprint_sets[3], storage="PACK")
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "props.blend"))
    return tmp_path


def in_window(*names):
    """The files of sets as the window bakes them."""
    for one in bpy.context.scene.imprint_sets:
        if one.name in names:
            progress.finish(set_jobs.work(bpy.context, sets.resolve(bpy.context, one), Pace()))
    return contents()


def contents(folder="maps", ending="png"):
    return {path.name: path.read_bytes() for path in sorted(Path(folder).glob(f"*.{ending}"))}


def run(*words, code=0):
    addon.unregister()
    try:
        assert command.run(list(words)) == code
        assert not hasattr(bpy.types.Scene, "imprint")
    finally:
        addon.register()


def test_files_are_those_of_the_window(props):
    names = ("Crate", "Atlas", "Wooden")
    bpy.data.materials["Wood"].imprint_size = "512"
    bpy.ops.wm.save_mainfile()
    before = in_window(*names)
    assert len(before["Wood.png"]) > 10 * len(before["T_Atlas.png"])
    assert [*before] == ["T_Atlas.png", "Wood.png", "bolt_low.png", "crate_low.png", "lid_low.png"]
    shutil.rmtree("maps")
    run("props.blend", *(word for name in names for word in ("--set", name)))
    assert contents() == before


@pytest.mark.parametrize("name", ["Crate", "Atlas"])
@pytest.mark.parametrize("is_own", [True, False])
def test_meshes_are_those_of_the_window(props, name, is_own):
    scene = bpy.context.scene
    (scene.imprint_sets[name].own if is_own else scene.imprint).export = "//meshes/{low}.glb"
    scene.imprint.bakes, scene.imprint.active_set = "SETS", scene.imprint_sets.find(name)
    bpy.ops.wm.save_mainfile()
    results.remember(window_reports(name))
    for low in LOWS:
        bpy.context.view_layer.objects.active = bpy.data.objects[low]
        assert bpy.ops.imprint.export() == {"FINISHED"}
    before = contents("meshes", "glb")
    assert [*before] == ["bolt_low.glb", "crate_low.glb", "lid_low.glb"]
    shutil.rmtree("meshes")
    run("props.blend", "--set", name)
    assert contents("meshes", "glb") == before
    shutil.rmtree("meshes")
    run("props.blend", "--set", name, "--export", "other/{low}.glb", "--force")
    assert [*contents("other", "glb")] == [*before]
    assert not (props / "meshes").exists()


def test_a_star_takes_the_sets_that_are_on(props):
    bpy.context.scene.imprint_sets["Packed"].is_on = bpy.context.scene.imprint_sets["Wooden"].is_on = False
    bpy.ops.wm.save_mainfile()
    run("props.blend", "--set", "*", "--report", "r.json")
    assert {each["name"] for each in reports.bakes(props / "r.json")} == {"set 1 (Crate)", "set 2 (Atlas)"}


def test_options_override_what_the_set_has(props):
    run("props.blend", "--set", "Packed", "--output", "out/{low}.png", "--size", "16", "--report", "r.json")
    baked = reports.bakes(props / "r.json")[0]["reports"]
    assert [(each["low"], each["size"], each["high"]) for each in baked] == [
        ("crate_low", [16, 16], ["crate_high"]),
        ("lid_low", [256, 256], ["lid_high"]),
        ("bolt_low", [16, 16], ["sculpt"]),
    ]
    run("props.blend", "--set", "Atlas", "--samples", "1", "--report", "r.json", "--force")
    settings = reports.bakes(props / "r.json")[0]["reports"][0]["settings"]
    assert (settings["samples"], settings["width"], settings["height"]) == (1, 48, 24)


def test_a_usual_value_overrides_as_well(props):
    run("props.blend", "--set", "Crate", "--size", "2048", "--list", "--json")
    run("props.blend", "--set", "Wooden", "--method", "auto", "--report", "r.json", "--force")
    assert reports.bakes(props / "r.json")[0]["reports"][0]["settings"]["method"] == "AUTO"


def test_parts_that_are_off_keep_their_texels(props):
    before = in_window("Atlas")
    bpy.data.objects["lid_low"].imprint_is_baked = False
    bpy.data.objects["crate_high"].scale.z = bpy.data.objects["lid_high"].scale.z = 3.0
    bpy.ops.wm.save_mainfile()
    run("props.blend", "--set", "Atlas", "--report", "r.json", "--force")
    assert [each["low"] for each in reports.bakes(props / "r.json")[0]["reports"]] == ["crate_low", "bolt_low"]
    (props / "old.png").write_bytes(before["T_Atlas.png"])
    a, b = pixels_of("old.png"), pixels_of("maps/T_Atlas.png")
    assert np.array_equal(a[:, 18:30], b[:, 18:30])
    assert not np.array_equal(a[:, :14], b[:, :14])


def test_a_job_file_can_name_sets(props):
    (props / "j.json").write_text(
        json.dumps(
            {"defaults": {"file": "props.blend"}, "bake": [{"set": ["Crate", "Atlas"], "size": 16}, {"set": "Wooden"}]}
        )
    )
    run("--jobs", "j.json", "--report", "r.json")
    assert [(each["name"], each["reports"][0]["size"]) for each in reports.bakes(props / "r.json")] == [
        ("set 1 (Crate)", [16, 16]),
        ("set 2 (Atlas)", [16, 16]),
        ("set 3 (Wooden)", [24, 24]),
    ]


def test_the_keys_of_a_set_are_a_job_file(props):
    before = in_window("Crate", "Atlas", "Wooden")
    shutil.rmtree("maps")
    keys = [one.keys(str(props / "props.blend")) for one in addon.scene_sets() if one.output]
    (props / "j.json").write_text(json.dumps({"bake": keys}))
    run("--jobs", "j.json")
    assert contents() == before


def test_a_folder_of_files_has_each_set_of_this_name(props, capsys):
    (props / "all").mkdir()
    for name in ("a", "b", "c"):
        if name == "c":
            bpy.context.scene.imprint_sets.remove(0)
        bpy.ops.wm.save_as_mainfile(filepath=str(props / "all" / f"{name}.blend"), copy=True)
    run("all", "--set", "Crate", "--output", "out/{low}.png", code=1)  # all would write the same files
    run("all", "--set", "Crate", code=1)
    assert "would both be" in capsys.readouterr().err
    (props / "all" / "nested").mkdir()
    (props / "all" / "a.blend").rename(props / "all" / "nested" / "a.blend")
    (props / "all" / "b.blend").unlink()
    run("all", "--set", "Crate", code=1)
    assert "No .blend in 'all' has a set 'Crate'." in capsys.readouterr().err
    run("all/nested", "--set", "Crate")
    assert [*contents("all/nested/maps")] == ["bolt_low.png", "crate_low.png", "lid_low.png"]


WRONG = {
    "typo": (["--set", "Crat"], 1, "'props.blend' has no set 'Crat', did you mean 'Crate'?"),
    "unknown": (["--set", "zzz"], 1, "'props.blend' has no set 'zzz': it has 'Crate', 'Atlas', 'Wooden', 'Packed'."),
    "no output": (
        ["--set", "Packed"],
        2,
        "the set 'Packed' has no file for its maps: give --output, or store them in a file",
    ),
    "with low": (["--set", "Crate", "--low", "a"], 2, "--set says what to bake: leave out --low. See --help."),
    "one image": (["--set", "Atlas", "--output", "{low}.png"], 2, "leave {low} and {name} out of --output"),
    "each part": (["--set", "Crate", "--output", "a.png"], 2, "put {low} into --output"),
    "depth": (["--set", "Crate", "--depth", "32"], 2, "A .png file stores 8 or 16 bits per channel, not 32"),
    "untrusted": (["--set", "Crate", "--untrusted"], 2, "--set reads the scene before it is baked"),
    "floater": (["--set", "Crate", "--floater", "sculp"], 1, "'sculpt'"),
    "scene": (["--set", "Crate", "--scene", "nowhere"], 1, "has no sets"),
    "same file": (
        ["--set", "Crate", "--set", "Wooden", "--output", "maps/x_{low}.png"],
        2,
        "leave {low} and {name} out",
    ),
}


@pytest.mark.parametrize("name", WRONG)
def test_what_is_wrong_is_one_sentence_and_writes_nothing(props, capsys, name):
    words, code, said = WRONG[name]
    run("props.blend", *words, code=code)
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == 1, lines
    assert said in lines[0]
    assert not (props / "maps").exists()


def test_sets_of_two_scenes_are_told_apart(props, capsys):
    bpy.ops.scene.new(type="LINK_COPY")
    bpy.ops.wm.save_mainfile()
    run("props.blend", "--set", "Crate", code=1)
    assert (
        "has a set 'Crate' in the scenes 'Scene' and 'Scene.001': choose one with --scene." in capsys.readouterr().err
    )
    run("props.blend", "--set", "Crate", "--scene", "Scene.001")
    assert len(contents()) == 3


def test_a_file_without_sets(props, capsys):
    bpy.context.scene.imprint_sets.clear()
    bpy.ops.wm.save_mainfile()
    run("props.blend", "--set", "Crate", code=1)
    assert "'props.blend' has no sets: add one in the panel, or name objects with --low." in capsys.readouterr().err
    run("props.blend", "--list")
    assert "'props.blend' has no sets." in capsys.readouterr().err


def test_list_names_the_sets_of_a_file(props, capsys):
    run("props.blend", "--list")
    lines = [line.split("\t") for line in capsys.readouterr().out.splitlines()]
    assert [line[:2] for line in lines] == [[name, "3 parts"] for name in ("Crate", "Atlas", "Wooden", "Packed")]
    assert lines[3][2] == "in the .blend"
    run("props.blend", "--list", "--json")
    listed = json.loads(capsys.readouterr().out)["sets"]
    assert [one["name"] for one in listed] == ["Crate", "Atlas", "Wooden", "Packed"]
    assert listed[0]["parts"][1] == {"low": "lid_low", "high": ["lid_high"], "size": 256}
    assert not (props / "maps").exists()


def test_list_lists_the_bakes_of_sets(props, capsys):
    run("props.blend", "--set", "Crate", "--set", "Atlas", "--list")
    lines = [line.split("\t")[2:] for line in capsys.readouterr().out.splitlines()]
    assert lines == [
        ["set 1 (Crate)", str(props / "maps" / "{low}.png")],
        ["set 2 (Atlas)", str(props / "maps" / "T_Atlas.png")],
    ]


def test_resume_knows_a_set(props):
    run("props.blend", "--set", "Crate", "--resume", "--report", "r.json")
    assert [each["state"] for each in reports.bakes(props / "r.json")] == ["done"]
    run("props.blend", "--set", "Crate", "--resume", "--report", "r.json")
    assert [each["state"] for each in reports.bakes(props / "r.json")] == ["resumed"]
    run("props.blend", "--set", "Crate", "--resume", "--report", "r.json", "--size", "16")
    assert [each["state"] for each in reports.bakes(props / "r.json")] == ["done"]


def test_parts_that_cannot_be_baked_are_told(props, capsys):
    bpy.data.objects["lid_low"].data.uv_layers.remove(bpy.data.objects["lid_low"].data.uv_layers[0])
    bpy.ops.wm.save_mainfile()
    run("props.blend", "--set", "Crate")
    assert [*contents()] == ["bolt_low.png", "crate_low.png"]
    assert "lid_low: " in capsys.readouterr().err


def test_the_script_reads_sets_in_a_process_of_its_own(props):
    words = [sys.executable, str(ROOT / "scripts" / "bake.py"), "props.blend", "--set", "Crate", "--set", "Atlas"]
    done = subprocess.run(words, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert len(contents()) == 4


# --changed


def changed(*words, name="Crate"):
    """The low objects that --changed bakes, the state of the bake, and the low objects in its report."""
    baked = []
    work = bake_jobs.work

    def noted(context, jobs, settings, pace, **more):
        only = more.get("only")
        baked.extend(job.low.name for job in jobs if only is None or job.low_ref.uid in only)
        return work(context, jobs, settings, pace, **more)

    bake_jobs.work = noted
    try:
        run("props.blend", "--set", name, "--changed", "--report", "r.json", *words)
    finally:
        bake_jobs.work = work
    entry = reports.bakes(Path("r.json"))[0]
    return baked, entry["state"], sorted(each["low"] for each in entry["reports"])


LOWS = ["bolt_low", "crate_low", "lid_low"]


def edit(name="lid_high"):
    bpy.ops.wm.open_mainfile(filepath="props.blend")
    bpy.data.objects[name].data.vertices[3].co.z += 0.5
    bpy.ops.wm.save_mainfile()


def test_changed_bakes_the_parts_that_have_changed(props):
    assert changed() == (["crate_low", "lid_low", "bolt_low"], "done", LOWS)
    first = contents()
    assert changed() == ([], "resumed", LOWS)
    edit()
    assert changed() == (["lid_low"], "done", LOWS)
    second = contents()
    assert [name for name in first if first[name] != second[name]] == ["lid_low.png"]
    edit("sculpt")
    assert changed() == (["bolt_low"], "done", LOWS)
    second = contents()
    run("props.blend", "--set", "Crate", "--force")
    assert contents() == second
    assert changed() == ([], "resumed", LOWS)


def test_changed_knows_a_file_that_was_saved_without_a_change(props):
    changed()
    bpy.ops.wm.open_mainfile(filepath="props.blend")
    bpy.data.objects.new("nothing", None)
    bpy.ops.wm.save_mainfile()
    assert changed() == ([], "resumed", LOWS)
    before = (props / "maps" / "lid_low.png").stat().st_mtime_ns
    assert changed("--workers", "0") == ([], "resumed", LOWS)
    assert (props / "maps" / "lid_low.png").stat().st_mtime_ns == before


@pytest.mark.parametrize("what", ["deleted", "painted"])
def test_changed_bakes_parts_whose_file_is_another_one(props, what):
    changed()
    before, path = contents(), props / "maps" / "crate_low.png"
    path.unlink() if what == "deleted" else path.write_bytes(path.read_bytes() + b"x")
    assert changed() == (["crate_low"], "done", LOWS)
    assert contents() == before


def test_changed_bakes_all_for_another_setting(props):
    changed()
    assert changed("--samples", "4") == (["crate_low", "lid_low", "bolt_low"], "done", LOWS)
    assert changed("--samples", "4") == ([], "resumed", LOWS)


def test_changed_keeps_the_texels_of_the_others_in_one_image(props):
    assert changed(name="Atlas")[0] == ["crate_low", "lid_low", "bolt_low"]
    edit()
    assert changed(name="Atlas") == (["lid_low"], "done", LOWS)
    after = pixels_of("maps/T_Atlas.png")
    run("props.blend", "--set", "Atlas", "--force")
    np.testing.assert_array_equal(pixels_of("maps/T_Atlas.png"), after)


def pixels_of(path):
    image = bpy.data.images.load(str(Path(path).absolute()))
    texels = np.reshape(image.pixels, (24, 48, 4))
    bpy.data.images.remove(image)
    return texels


def test_changed_knows_what_the_window_has_baked(props):
    results.remember(window_reports("Crate"))
    bpy.ops.wm.save_mainfile()
    assert changed() == ([], "resumed", [])
    edit("crate_high")
    assert changed() == (["crate_low"], "done", ["crate_low"])
    assert changed() == ([], "resumed", ["crate_low"])
    assert changed("--output", "out/{low}.png") == (["crate_low", "lid_low", "bolt_low"], "done", LOWS)


def test_changed_writes_meshes_that_the_window_has_not(props):
    bpy.context.scene.imprint_sets["Crate"].own.export = "//meshes/{low}.glb"
    results.remember(window_reports("Crate"))
    bpy.ops.wm.save_mainfile()
    for state in ("done", "resumed"):
        assert changed()[1:] == (state, LOWS)
        assert len(contents("meshes", "glb")) == len(LOWS)


def window_reports(name):
    one = bpy.context.scene.imprint_sets[name]
    return progress.finish(set_jobs.work(bpy.context, sets.resolve(bpy.context, one), Pace()))


def test_changed_with_a_scene_to_save_bakes_all_or_nothing(props):
    assert changed("--save-blend", "out.blend")[0] == ["crate_low", "lid_low", "bolt_low"]
    edit()
    assert changed("--save-blend", "out.blend")[0] == ["crate_low", "lid_low", "bolt_low"]


def test_changed_is_for_pairs_by_name_too(props):
    words = ["props.blend", "--pairs", "--output", "p/{low}.png", "--size", "16", "--changed", "--report", "r.json"]
    for expected in ("done", "resumed"):
        run(*words)
        assert [each["state"] for each in reports.bakes(props / "r.json")] == [expected]
    before = (props / "p" / "crate_low.png").stat().st_mtime_ns
    edit()
    run(*words)
    assert (props / "p" / "crate_low.png").stat().st_mtime_ns == before


def test_a_set_whose_parts_are_all_off(props, capsys):
    for name in LOWS:
        bpy.data.objects[name].imprint_is_baked = False
    bpy.ops.wm.save_mainfile()
    run("props.blend", "--set", "Crate", code=1)
    assert "All parts are switched off: switch on those to bake." in capsys.readouterr().err
