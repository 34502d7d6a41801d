# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests the command line: exit codes, one line on stderr, and no files if something fails."""

import json
import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import bpy
import numpy as np
import pytest

from addon.cli import arguments, command, run_report
from addon.core import versions
from addon.core.errors import BakeError
from addon.export import engine_files
from addon.jobs import bake_jobs
from addon.scene import mesh_reader
from scripts.imprint import ROOT
from tests.support import maps, reports, zoo

pytestmark = pytest.mark.usefixtures("gpu_context")

ROUNDING_16 = 1e-5
"""Half a step of 16-bit integers, and the error of single precision."""


@pytest.fixture
def scene(tmp_path, monkeypatch):
    """The working folder, with scene/file.blend: a low and a high object, and a texture with a relative path."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "scene").mkdir()
    zoo.plane("lo")
    zoo.plane("hi", slope=1.0)
    texture = bpy.data.images.new("texture", 4, 4)
    texture.filepath_raw, texture.file_format = str(tmp_path / "scene" / "texture.png"), "PNG"
    texture.save()
    texture.source, texture.filepath, texture.use_fake_user = "FILE", "//texture.png", True
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "scene" / "file.blend"))
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    return tmp_path


def files(folder):
    return sorted(str(path.relative_to(folder)) for path in folder.rglob("*"))


BAKE = ["scene/file.blend", "--low", "lo", "--high", "hi", "--method", "flatten", "--limit", "9", "--size", "16"]
MISSPELLED = ["loo" if word == "lo" else word for word in BAKE]


@pytest.fixture
def fails(scene, capsys):
    """A function that runs a command that must fail with a code and write nothing. It returns the last line on stderr."""

    def run(code, *arguments):
        before = files(scene)
        assert command.run(list(arguments)) == code
        assert files(scene) == before
        captured = capsys.readouterr()
        assert all(line.startswith("Error: ") for line in captured.out.splitlines())  # Blender's own
        lines = captured.err.splitlines()
        assert "Traceback" not in captured.err
        assert lines[-1].startswith("imprint: ")
        assert len(lines) == 1, captured.err
        return lines[-1]

    return run


# Parsing


def test_the_command_in_the_readme_is_parsed():
    line = (
        "FILE.blend --low lo --high hi --high hi2 --space object --uv Layout --method flatten --size 4096x1024 --green +y "
        "--margin 8 --depth 32 --output MAP.exr --save-blend OUT.blend --report REPORT.json"
    )
    options = arguments.parse(line.split())
    assert (options.file, options.low, options.high) == (["FILE.blend"], ["lo"], ["hi", "hi2"])
    assert (options.space, options.uv_layer, options.method, options.size) == (
        "OBJECT",
        "Layout",
        "FLATTEN",
        (4096, 1024),
    )
    assert (options.green, options.margin, options.depth) == ("+Y", 8, 32)
    assert (options.output, options.save_blend, options.report) == ("MAP.exr", "OUT.blend", "REPORT.json")


@pytest.mark.parametrize(
    ("text", "size"),
    [
        ("2048", (2048, 2048)),
        ("4096x1024", (4096, 1024)),
        ("64X32", (64, 32)),
        ("2k", (2048, 2048)),
        ("4Kx1024", (4096, 1024)),
    ],
)
def test_sizes(text, size):
    assert arguments.parse(["--low", "lo", "--output", "m.png", "--size", text]).size == size


WRONG = {
    "a limit that is too large for a float": [*BAKE, "--output", "m.png", "--limit", "1e39"],
    "no low object": ["scene/file.blend", "--output", "m.png"],
    "no output": BAKE,
    "unknown option": [*BAKE, "--output", "m.png", "--quality", "high"],
    "unknown space": [*BAKE, "--output", "m.png", "--space", "camera"],
    "unknown method": [*BAKE, "--output", "m.png", "--method", "guess"],
    "size in words": [*BAKE, "--output", "m.png", "--size", "big"],
    "three sizes": [*BAKE, "--output", "m.png", "--size", "16x16x16"],
    "half a size": [*BAKE, "--output", "m.png", "--size", "16x"],
    "green": [*BAKE, "--output", "m.png", "--green", "y"],
    "green without a value": [*BAKE, "--output", "m.png", "--green"],
    "depth": [*BAKE, "--output", "m.png", "--depth", "24"],
    "margin": [*BAKE, "--output", "m.png", "--margin", "wide"],
    "a name that is not UTF-8": ["scene/file.blend", "--low", "\udcff", "--high", "hi", "--output", "m.png"],
    "map and report in one file": [*BAKE, "--output", "m.png", "--report", "./m.png"],
    "map and scene in one file": [*BAKE, "--output", "m.png", "--save-blend", "scene/../m.png"],
    "report over the scene": [*BAKE, "--output", "m.png", "--report", "scene/file.blend"],
}


@pytest.mark.parametrize("case", WRONG)
def test_wrong_usage(fails, case):
    line = fails(run_report.WRONG_USAGE, *WRONG[case])
    assert "usage:" not in line


@pytest.mark.parametrize(
    ("words", "code"),
    [
        (["--low", "low", "--high", "hi"], run_report.FAILED),
        (["--low", "lo", "--high", "high"], run_report.FAILED),
        (["--low", "lo", "--high", "hi", "--save-blend", "m.png"], run_report.WRONG_USAGE),
        (["--low", "lo", "--high", "hi", "--report", "scene/file.blend"], run_report.WRONG_USAGE),
    ],
)
def test_a_check_ends_with_the_code_of_the_bake(fails, words, code):
    given = [BAKE[0], *words, "--output", "m.png"]
    assert fails(code, *given, "--check") == fails(code, *given)


@pytest.mark.parametrize("words", [[], ["lod"], ["farm"], ["report"], ["--jobs", "none.toml"]])
def test_all_commands_say_their_version(capsys, words):
    assert command.run([*words, "--version"]) == run_report.DONE
    line = f"Imprint {versions.imprint()}, code {versions.code()[:12]}, Blender {versions.blender()}\n"
    assert capsys.readouterr() == (line, "")


# Failures

CANNOT = {
    "no such file": (["nothing.blend", *BAKE[1:], "--output", "m.png"], "no file"),
    "a folder for a file": (["scene", *BAKE[1:], "--output", "m.png"], "no file"),
    "no scene file": (["scene/texture.png", *BAKE[1:], "--output", "m.png"], "is not a complete .blend file"),
    "a broken scene file": (["broken.blend", *BAKE[1:], "--output", "m.png"], "is not a complete .blend file"),
    "low object misspelled": ([*MISSPELLED, "--output", "m.png"], "did you mean 'lo'?"),
    "high object misspelled": ([*BAKE, "--high", "hii", "--output", "m.png"], "did you mean 'hi'?"),
    "no similar name": (
        ["Suzanne" if word == "lo" else word for word in BAKE] + ["--output", "m.png"],
        "it has 'hi', 'lo'.",
    ),
    "a scene twice": (["scene/file.blend", *BAKE, "--output", "m.png"], "Cannot load from the current blend file"),
    "no such UV map": ([*BAKE, "--uv", "Lightmap", "--output", "m.png"], "'lo' has no UV layer 'Lightmap'"),
    "file for a folder": ([*BAKE, "--output", "broken.blend/m.png"], "Not a directory"),
}


INVALID = {
    "size 0": ([*BAKE, "--size", "0", "--output", "m.png"], "Width: 0 is outside"),
    "huge size": ([*BAKE, "--size", "9" * 30, "--output", "m.png"], "16384"),
    "size of 5000 digits": (
        [*BAKE, "--size", "9" * 5000, "--output", "m.png"],
        "is neither a number of texels nor",
    ),
    "frames of 5000 digits": (
        [*BAKE, "--frames", f"1-{'9' * 5000}", "--output", "m.png"],
        "not a range of frames",
    ),
    "tiles of 5000 digits": ([*BAKE, "--tiles", "1" * 5000, "--output", "m.png"], "not a list of UDIM tiles"),
    "option misspelled": ([*BAKE, "--outptu", "m.png"], "--outptu m.png, did you mean '--output'?"),
    "jobs misspelled": (["--job", "j.json"], "did you mean '--jobs'? See --help."),
    "an option that is only in the panel": (
        [*BAKE, "--preset", "unreal", "--output", "m.png"],
        "unrecognized arguments: --preset unreal. See --help.",
    ),
    "folder for a map": ([*BAKE, "--output", "scene/"], "'scene/' is a folder: name a file. See --help."),
    "unknown option without a similar one": ([*BAKE, "--qqq", "--output", "m.png"], "unrecognized arguments: --qqq"),
    "negative margin": ([*BAKE, "--margin", "-1", "--output", "m.png"], "-1"),
    "format": ([*BAKE, "--output", "m.bmp"], "one of .png, .exr"),
    "format and depth": ([*BAKE, "--output", "m.png", "--depth", "32"], "8 or 16 bits"),
    "folder for a report": ([*BAKE, "--output", "m.png", "--report", "scene"], "is a folder"),
    "size 0, before the file is opened": (
        ["none.blend", *BAKE[1:-1], "0", "--output", "m.png"],
        "Width: 0 is outside",
    ),
    "the ending of a scene": ([*BAKE, "--output", "m.png", "--save-blend", "s.txt"], "does not end in .blend"),
}


@pytest.mark.parametrize("case", INVALID)
def test_invalid_values_are_wrong_usage(fails, case):
    arguments, words = INVALID[case]
    assert words in fails(run_report.WRONG_USAGE, *arguments)


@pytest.mark.parametrize("case", CANNOT)
def test_a_bake_that_is_not_possible_gives_one_line(scene, fails, case):
    (scene / "broken.blend").write_bytes((scene / "scene" / "file.blend").read_bytes()[:2000])
    arguments, words = CANNOT[case]
    assert words in fails(run_report.FAILED, *arguments)


def test_a_bake_that_fails_at_its_end_replaces_nothing(scene, fails, monkeypatch):
    def fail(*_, **__):
        raise BakeError("The bake went wrong.")

    (scene / "m.png").write_bytes(b"an old picture")
    (scene / "s.blend").write_bytes(b"an old scene")
    monkeypatch.setattr(bake_jobs, "work", fail)
    line = fails(run_report.FAILED, *BAKE, "--output", "m.png", "--save-blend", "s.blend")
    assert line == "imprint: The bake went wrong."
    assert (scene / "m.png").read_bytes() == b"an old picture"
    assert (scene / "s.blend").read_bytes() == b"an old scene"


LIMIT = 20_000
"""The most bytes of a file in the test: more than a small map, less than any .blend."""


@pytest.mark.skipif(os.name == "nt", reason="Windows has no such limit")
@pytest.mark.parametrize("end", ["scene", "report"])
@pytest.mark.parametrize("more", [[], ["--frames", "1-2"], ["--mask", "--maps", "height"]])
def test_a_scene_or_report_that_cannot_be_saved_undoes_the_bake(scene, monkeypatch, capsys, end, more):
    import resource

    def fail(*_, **__):
        raise OSError(28, "No space left on device")

    (scene / "m.png").write_bytes(b"an old picture")
    (scene / "s.blend").write_bytes(b"an old scene")
    before = {path: path.read_bytes() for path in scene.rglob("*") if path.is_file()}
    if end == "report":
        monkeypatch.setattr(Path, "write_text", fail)
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    try:
        resource.setrlimit(resource.RLIMIT_FSIZE, (LIMIT if end == "scene" else soft, hard))
        code = command.run([*BAKE, *more, "--output", "m.png", "--report", "new/r.json", "--save-blend", "s.blend"])
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    assert code == run_report.FAILED
    (line,) = capsys.readouterr().err.splitlines()
    assert ("s.blend' could not be written: Blender could not write all" if end == "scene" else "r.json") in line
    after = {path: path.read_bytes() for path in scene.rglob("*") if path.is_file()}
    if end == "scene":
        assert json.loads(after.pop(scene / "new" / "r.json"))["bakes"][0]["error"] == line.removeprefix("imprint: ")
    else:
        assert not (scene / "new").exists()
    assert after == before


def test_missing_folders_are_made(scene):
    """They are removed again if the bake fails: see above, and tests/pure/test_atomic_file.py."""
    words = [*BAKE, "--output", "a/b/m.png", "--report", "r/r.json", "--save-blend", "s/s.blend"]
    assert command.run(words) == run_report.DONE
    assert {"a/b/m.png", "r/r.json", "s/s.blend"} <= set(files(scene))


def test_the_report_can_be_the_only_text_on_standard_output(scene, capsys):
    assert command.run([*BAKE, "--output", "m.png", "--report", "-"]) == run_report.DONE
    captured = capsys.readouterr()
    assert json.loads(captured.out[captured.out.index("{") :])["bakes"][0]["files"][0]["path"] == str(scene / "m.png")
    assert "16 x 16: lo_normal" in captured.err
    assert f"Wrote {scene / 'm.png'}\n" in captured.err
    assert not (scene / "-").exists()
    (scene / "jobs.json").write_text(json.dumps({"bake": [{"file": BAKE[0], "low": "no", "output": "n.png"}]}))
    capsys.readouterr()
    assert command.run(["--jobs", "jobs.json", "--report", "-"]) == run_report.FAILED
    captured = capsys.readouterr()
    (found,) = json.loads(captured.out[captured.out.index("{\n") :])["bakes"]
    assert found["state"] == "failed"
    assert "0 done, 1 failed" in captured.err


FAILED_BAKE = {"name": "no", "state": "failed", "cause": "input", "files": [], "reports": []}


@pytest.mark.parametrize("earlier", [None, '{"version": 1}'])
def test_a_single_bake_that_fails_writes_its_report(scene, capsys, earlier):
    if earlier:
        (scene / "r.json").write_text(earlier)
    words = [BAKE[0], "--low", "no", "--output", "m.png", "--report"]
    assert command.run([*words, "r.json"]) == run_report.FAILED
    report = reports.bake(scene / "r.json")
    (line,) = capsys.readouterr().err.splitlines()
    assert line == f"imprint: {report['error']}"
    assert {key: report[key] for key in FAILED_BAKE} == FAILED_BAKE
    assert report["seconds"] >= 0.0
    assert command.run([*words, "-"]) == run_report.FAILED
    out = capsys.readouterr().out
    assert json.loads(out[out.index("{") :])["bakes"][0]["error"] == report["error"]


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (["--report", "m2.png"], "The report would overwrite 'm2.png', which is not JSON: choose another path for it."),
        (
            ["--report", "m2.png", "--force"],
            "The report of all bakes would overwrite 'm2.png', which is not JSON: choose another path for it.",
        ),
        (
            ["--sheet", "m2.html"],
            "The page of results would overwrite 'm2.html', which is not HTML: choose another path for it.",
        ),
        (
            ["--report", "scene/texture.png", "--sheet", "scene/texture.html"],
            "The report of all bakes would overwrite 'scene/texture.png', which is not JSON: choose another path for it.",
        ),
        (["--report", "scene/file.blend"], None),
    ],
)
def test_a_report_or_a_page_replaces_no_other_files(scene, fails, words, sentence):
    for name in ("m2.png", "m2.html"):
        (scene / name).write_bytes((scene / "scene" / "texture.png").read_bytes())
    (line,) = [fails(run_report.WRONG_USAGE, *BAKE, "--output", "m.png", *words)]
    assert sentence is None or line == f"imprint: {sentence}"
    assert (scene / words[1]).read_bytes()[:4] in (b"\x89PNG", b"BLEN", b"(\xb5/\xfd")


@pytest.mark.parametrize("start", ["", "\ufeff \n{", "[]", "\0" * 2000])
def test_a_report_replaces_what_may_be_one(scene, start):
    (scene / "r.json").write_text(start, encoding="utf-8")
    (scene / "s.html").write_text("<!doctype HTML>")
    words = ["--low", "lo", "--high", "no", "--output", "m.png", "--report", "r.json", "--sheet", "s.html"]
    assert command.run([BAKE[0], *words]) == run_report.FAILED
    assert reports.bake(scene / "r.json")["state"] == "failed"


def test_merged_reports_and_their_page_replace_no_other_files(scene, capsys):
    (scene / "r.json").write_text(json.dumps(reports.of_three()))
    for option in ("--merge", "--sheet"):
        path = scene / "a.html"
        path.write_text("text")
        assert command.run(["report", option, str(path), "r.json"]) == run_report.WRONG_USAGE
        assert "choose another path for it" in capsys.readouterr().err
        assert path.read_text() == "text"


def test_a_path_that_becomes_a_folder_during_the_bake_is_a_failure(scene, capsys, monkeypatch):
    """Exit code 2 is only for wrong calls, which are found before the bake."""
    work = bake_jobs.work

    def late(*arguments, **options):
        (scene / "m.png").mkdir()
        return work(*arguments, **options)

    monkeypatch.setattr(bake_jobs, "work", late)
    assert command.run([*BAKE, "--output", "m.png", "--report", "r.json"]) == run_report.FAILED
    (line,) = capsys.readouterr().err.splitlines()
    assert "m.png" in line
    assert reports.bake(scene / "r.json")["error"] in line


def test_a_sequence_has_a_summary_of_one_line(scene, capsys):
    assert command.run([*BAKE, "--frames", "1-3", "--output", "m.#.png"]) == run_report.DONE
    first, second = capsys.readouterr().out.splitlines()[-2:]
    assert first.startswith("3 frames of 'lo', ")
    assert second == f"Wrote 3 maps from {scene / 'm.1.png'} to {scene / 'm.3.png'}"


@pytest.mark.skipif(sys.platform != "linux", reason="on other systems all names are UTF-8")
def test_a_folder_whose_name_is_not_utf_8(scene, fails, monkeypatch):
    strange = scene / "\udcff"
    strange.mkdir()
    monkeypatch.chdir(strange)
    words = [str(scene / BAKE[0]), *BAKE[1:]]
    assert "is not UTF-8" in fails(run_report.WRONG_USAGE, *words, "--output", "m.png")
    assert "is not UTF-8" in fails(
        run_report.WRONG_USAGE, *words, "--output", str(scene / "m.png"), "--report", "r.json"
    )
    assert "is not UTF-8" in fails(run_report.WRONG_USAGE, "--pairs", ".", "--output", str(scene / "{low}.png"))


@pytest.mark.skipif(os.name == "nt", reason="links and pipes of POSIX")
@pytest.mark.parametrize("option", ["--output", "--report", "--save-blend"])
def test_a_link_is_kept_and_a_pipe_is_refused(scene, capsys, option):
    names = {"--output": "m.png", "--report": "r.json", "--save-blend": "s.blend"}
    words = [*BAKE, *(word for item in names.items() for word in item)]
    (scene / "store").mkdir()
    link = scene / names[option]
    link.symlink_to("store/it")
    assert command.run(words) == run_report.DONE
    assert link.is_symlink()
    assert (scene / "store" / "it").stat().st_size > 0
    link.unlink()
    os.mkfifo(link)
    others = [scene / name for name in names.values() if name != link.name]
    for path in others:
        path.unlink()
    assert command.run(words) == run_report.WRONG_USAGE
    assert "is a pipe" in capsys.readouterr().err
    assert link.is_fifo()
    assert not any(path.exists() for path in others)


# Baking


def test_the_map_is_written(scene, capsys):
    before = files(scene)
    assert command.run([*BAKE, "--output", "m.png", "--margin", "0"]) == run_report.DONE
    assert files(scene) == sorted([*before, "m.png"])
    captured = capsys.readouterr()
    assert captured.err == ""
    assert "16 x 16" in captured.out
    image = bpy.data.images.load(str(scene / "m.png"))
    image.colorspace_settings.name, image.alpha_mode = "Non-Color", "CHANNEL_PACKED"
    expected = maps.bake(bpy.data.objects["lo"], bpy.data.objects["hi"], size=(16, 16))
    np.testing.assert_allclose(maps.pixels(image), expected, rtol=0, atol=ROUNDING_16)


@pytest.mark.parametrize(
    ("arguments", "is_up"), [([], True), (["--green", "+y"], True), (["--green", "-y"], False), (["--green=-y"], False)]
)
def test_green_points_up_or_down(scene, arguments, is_up):
    bpy.ops.wm.open_mainfile(filepath=str(scene / "scene" / "file.blend"))
    bpy.data.objects["hi"].rotation_euler.z = np.pi / 2  # so that it rises along y, and its normal points to -y
    assert command.run([*BAKE[1:], "--output", "m.exr", *arguments]) == run_report.DONE
    green = maps.pixels(bpy.data.images["lo_normal"])[8, 8, 1]
    assert (green < 0.2) == is_up
    assert (green > 0.8) != is_up


@pytest.mark.parametrize(
    ("arguments", "written"),
    [
        (["--maps", "height,object-id", "--mask", "--output", "m.png"], ["m", "m_height", "m_missed", "m_object_id"]),
        (["--output", "m.<UDIM>.png"], ["m.1001"]),
        (["--udim", "--output", "m.png"], ["m.1001"]),
        (["--tiles", "1001", "--mask", "--output", "{low}.<UDIM>.png"], ["lo.1001", "lo_missed.1001"]),
    ],
)
def test_other_maps_and_tiles_are_written_beside_the_map(scene, arguments, written):
    before = files(scene)
    assert command.run([*BAKE, *arguments]) == run_report.DONE
    assert sorted(set(files(scene)) - set(before)) == [f"{name}.png" for name in written]


def test_a_format_with_only_8_bits_needs_no_depth(scene):
    assert command.run([*BAKE, "--output", "m.tga"]) == run_report.DONE
    assert read(scene / "m.tga").shape == (16, 16, 4)
    assert bpy.data.images["lo_normal"].depth == 32


def test_tiles_that_the_mesh_does_not_cover(fails):
    assert "1001, not on 1002" in fails(run_report.FAILED, *BAKE, "--tiles", "1002", "--output", "m.png")


def test_the_open_file_is_the_default(scene):
    bpy.ops.wm.open_mainfile(filepath=str(scene / "scene" / "file.blend"))
    assert command.run([*BAKE[1:], "--output", "m.png"]) == run_report.DONE


def test_the_report(scene):
    assert command.run([*BAKE, "--output", "m.png", "--report", "r.json"]) == run_report.DONE
    report = reports.one(scene / "r.json")
    assert report["method"] == "FLATTEN"
    assert report["space"] == "TANGENT"
    assert report["size"] == [16, 16]
    assert (report["low"], report["high"], report["uv_layer"]) == ("lo", ["hi"], zoo.LAYER)
    assert report["triangles"] == {"high": 2, "low": 2}
    assert report["coverage"] == 1.0
    assert report["output"] == [str(scene / "m.png")]
    assert report["image"] == "lo_normal"
    assert report["backend"]
    assert report["renderer"]
    assert report["warnings"] == []
    seconds = report["seconds"]
    assert {"extract", "upload", "draw", "read", "image", "total"} <= seconds.keys()
    assert all(value >= 0 for value in seconds.values())
    assert seconds["total"] >= sum(value for stage, value in seconds.items() if stage != "total") * 0.999


def test_warnings_are_printed_and_the_bake_does_not_fail(scene, capsys):
    bpy.ops.wm.open_mainfile(filepath=str(scene / "scene" / "file.blend"))
    bpy.data.objects["hi"].data.uv_layers[0].uv[0].vector = (-1, 0)
    assert command.run([*BAKE[1:], "--output", "m.png", "--report", "r.json"]) == run_report.DONE
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("imprint: warning: 'hi': 2 of its triangles reach outside")
    assert reports.one(scene / "r.json")["warnings"] == [line.removeprefix("imprint: warning: ")]


def shown(path):
    """Open a scene. Returns the image that its low object shows, by following the links from the output."""
    bpy.ops.wm.open_mainfile(filepath=str(path))
    low = bpy.data.objects["lo"]
    assert low.mode == "OBJECT"
    normal = low.active_material.node_tree.nodes["Principled BSDF"].inputs["Normal"]
    normal_map = normal.links[0].from_node
    assert normal_map.bl_idname == "ShaderNodeNormalMap"
    return normal_map.inputs["Color"].links[0].from_node.image


@pytest.mark.parametrize(
    ("output", "blend", "filepath"),
    [
        ("m.png", "s.blend", "//m.png"),  # beside each other, in another folder than the opened scene
        ("scene/m.png", "scene/s.blend", "//m.png"),
        ("out/maps/m.png", "out/s.blend", "//maps/m.png"),
        ("outer/m.png", "out/s.blend", None),  # in different folders: the path is absolute
        ("m.png", "out/s.blend", None),
        ("out/m.png", "other/../out/s.blend", "//m.png"),  # the folder is the same
    ],
)
def test_the_saved_scene_shows_the_map(scene, output, blend, filepath):
    (scene / "other").mkdir()
    for path in (scene / output, scene / blend):
        path.parent.mkdir(parents=True, exist_ok=True)
    before = files(scene)
    assert command.run([*BAKE, "--output", output, "--save-blend", blend]) == run_report.DONE
    output, blend = os.path.normpath(output), os.path.normpath(blend)
    assert files(scene) == sorted({*before, output, blend})
    image = shown(scene / blend)
    assert image.filepath == (filepath or str(scene / output))
    assert image.colorspace_settings.is_data
    assert maps.pixels(image).shape == (16, 16, 4)
    assert bpy.data.images["texture"].size[:] == (4, 4)  # relative paths still lead to their files
    if filepath:
        home = (scene / blend).parent
        for path in (scene / output, scene / blend):
            to = scene / "moved" / path.relative_to(home)
            to.parent.mkdir(parents=True, exist_ok=True)
            path.rename(to)
        assert maps.pixels(shown(scene / "moved" / (scene / blend).name)).shape == (16, 16, 4)


def test_maps_beside_the_saved_scene_may_lie_behind_a_link(scene):
    (scene / "out").mkdir()
    (scene / "link").symlink_to("out", target_is_directory=True)
    assert command.run([*BAKE, "--output", "link/m.png", "--save-blend", "link/s.blend"]) == run_report.DONE
    image = shown(scene / "out/s.blend")
    assert image.filepath.startswith("//")
    assert maps.pixels(image).shape == (16, 16, 4)


def test_the_saved_scene_shows_the_other_maps_too(scene):
    more = ("--no-normal", "--maps", "height", "--connect-maps", "--no-material")
    assert command.run([*BAKE, *more, "--output", "m.png", "--save-blend", "s.blend"]) == run_report.DONE
    bpy.ops.wm.open_mainfile(filepath=str(scene / "s.blend"))
    outputs = [material.node_tree.nodes["Material Output"] for material in bpy.data.materials]
    (node,) = (link.from_node for output in outputs for link in output.inputs["Displacement"].links)
    image = node.inputs["Height"].links[0].from_node.image
    assert image.filepath == "//m_height.png"
    assert maps.pixels(image).shape == (16, 16, 4)


def test_the_scene_may_replace_its_own_file(scene):
    assert command.run([*BAKE, "--output", "m.png", "--save-blend", "scene/file.blend"]) == run_report.DONE
    assert tuple(shown(scene / "scene" / "file.blend").size) == (16, 16)


def test_no_material_leaves_the_material_unchanged(scene):
    assert command.run([*BAKE, "--output", "m.png", "--save-blend", "s.blend", "--no-material"]) == run_report.DONE
    bpy.ops.wm.open_mainfile(filepath=str(scene / "s.blend"))
    assert bpy.data.objects["lo"].active_material is None


def script(*arguments):
    """Run scripts/bake.py in a separate process, as users do."""
    program = [sys.executable, str(ROOT / "scripts" / "bake.py"), "--", *arguments]
    return subprocess.run(program, capture_output=True, text=True, errors="replace", check=False)


@pytest.mark.parametrize(
    ("arguments", "code"),
    [([*MISSPELLED, "--output", "m.png"], 1), (BAKE, 2)],
)
def test_the_scripts_exit_codes(scene, arguments, code):
    done = script(*arguments)
    assert done.returncode == code, done.stderr
    assert not (scene / "m.png").exists()
    messages = [line for line in done.stderr.splitlines() if line.startswith("imprint: ")]
    assert len(messages) == 1
    assert "Traceback" not in done.stderr


# Rays and pairs


@pytest.fixture
def rocks(tmp_path, monkeypatch):
    """rocks.blend: two pairs side by side, one with a cage, with UVs in the halves of an atlas; and a high object alone."""
    monkeypatch.chdir(tmp_path)
    for number, (name, slope) in enumerate([("a", 0.0), ("b", 0.3)]):
        low, high = zoo.plane(f"{name}_low"), zoo.plane(f"{name.upper()}_High.001", slope=slope)
        high.data.uv_layers.remove(high.data.uv_layers[0])
        uv = np.array([(0.1, 0.1), (0.4, 0.1), (0.4, 0.9), (0.1, 0.9)]) + (0.5 * number, 0.0)
        low.data.uv_layers[0].uv.foreach_set("vector", uv.astype(np.float32).ravel())
        for obj in (low, high):
            obj.location.x = number * 1.5  # they overlap in space
    zoo.plane("a_cage").location.z = 0.4
    zoo.plane("c_high")
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "rocks.blend"))
    return tmp_path


PAIRS = ["rocks.blend", "--pairs", "--size", "32", "--depth", "16", "--margin", "2"]


def read(path):
    image = bpy.data.images.load(str(path))
    image.colorspace_settings.is_data = True
    return maps.pixels(image)


def test_pairs_may_share_an_atlas(rocks, capsys):
    arguments = [*PAIRS, "--output", "atlas.png", "--report", "r.json", "--save-blend", "out.blend"]
    assert command.run(arguments) == run_report.DONE
    captured = capsys.readouterr()
    assert "'c_high' has no low object" in captured.err
    report = reports.bake(rocks / "r.json")
    assert [(pair["low"], pair["method"], pair["missed"]) for pair in report["reports"]] == [
        ("a_low", "CAST", 0.0),
        ("b_low", "CAST", 0.0),
    ]
    assert len(report["problems"]) == 1
    texels = read(rocks / "atlas.png")
    # Neighbors overlap in space, but rays from each low mesh hit only its own high mesh.
    assert np.allclose(texels[8:24, 4:12, :3], (0.5, 0.5, 1.0), atol=ROUNDING_16)
    lean = np.array((-0.3, 0.0, 1.0)) / np.hypot(0.3, 1.0)
    assert np.allclose(texels[8:24, 20:28, :3], lean * 0.5 + 0.5, atol=1e-3)
    assert (texels[0, :, 3] == 0.0).all()
    bpy.ops.wm.open_mainfile(filepath=str(rocks / "out.blend"))
    images = {
        node.image
        for low in ("a_low", "b_low")
        for node in bpy.data.objects[low].data.materials[0].node_tree.nodes
        if node.type == "TEX_IMAGE"
    }
    assert [image.filepath for image in images] == ["//atlas.png"]


def uvs(name, layer):
    return mesh_reader.uvs(bpy.data.objects[name].data, layer)


def test_uv_maps_of_pairs_are_packed_once(rocks, capsys):
    stacked = [*PAIRS, "--pack-uvs", "--output", "atlas.png", "--save-blend", "rocks.blend"]
    bpy.ops.wm.open_mainfile(filepath=str(rocks / "rocks.blend"))
    bpy.data.objects["b_low"].data.uv_layers[0].uv.foreach_set("vector", uvs("a_low", zoo.LAYER).ravel())
    bpy.ops.wm.save_as_mainfile(filepath=str(rocks / "rocks.blend"))
    assert command.run(stacked) == run_report.DONE
    assert "'a_low', 'b_low' have the UV map 'Atlas'" in capsys.readouterr().out
    first = read(rocks / "atlas.png")
    bpy.ops.wm.open_mainfile(filepath=str(rocks / "rocks.blend"))
    lows = [bpy.data.objects[name] for name in ("a_low", "b_low")]
    assert [low.data.uv_layers.active.name for low in lows] == ["Atlas"] * 2
    a, b = (uvs(low.name, "Atlas") for low in lows)
    assert (a.max(axis=0) < b.min(axis=0)).any() or (b.max(axis=0) < a.min(axis=0)).any()
    a, b = a * 0.5, b * 0.5  # a place that packing would not choose
    for low, uv in zip(lows, (a, b), strict=True):
        low.data.uv_layers["Atlas"].uv.foreach_set("vector", uv.ravel())
        low.data.uv_layers.active = low.data.uv_layers[zoo.LAYER]
    bpy.ops.wm.save_as_mainfile(filepath=str(rocks / "rocks.blend"))
    assert command.run(stacked) == run_report.DONE
    assert np.array_equal(uvs("a_low", "Atlas"), a)
    assert np.array_equal(uvs("b_low", "Atlas"), b)
    second = read(rocks / "atlas.png")[..., 3] > 0.0
    assert (first[..., 3] > 0.0).sum() > 2 * second.sum()  # baked there


@pytest.mark.parametrize("words", [["--pairs", "--output", "{low}.png"], ["--low", "a_low", "--output", "a.png"]])
def test_uv_maps_are_packed_for_a_map_that_pairs_share(rocks, capsys, words):
    assert command.run(["rocks.blend", "--pack-uvs", *words]) == run_report.WRONG_USAGE
    assert "--pack-uvs is for low objects that share one map" in capsys.readouterr().err


def test_pairs_may_have_their_own_maps(rocks):
    assert command.run([*PAIRS, "--output", "{low}_n.png"]) == run_report.DONE
    assert files(rocks) == ["a_low_n.png", "b_low_n.png", "rocks.blend"]


def test_a_pair_that_fails_makes_all_fail(rocks, capsys):
    bpy.ops.wm.open_mainfile(filepath=str(rocks / "rocks.blend"))
    bpy.data.objects["B_High.001"].location.z = 1000.0
    bpy.ops.wm.save_as_mainfile(filepath=str(rocks / "rocks.blend"))
    (rocks / "b_low.png").write_bytes(b"of yesterday")
    before = files(rocks)
    assert command.run([*PAIRS, "--output", "{low}.png", "--report", "r.json"]) == run_report.FAILED
    assert capsys.readouterr().err.splitlines()[-1].startswith("imprint: 'b_low' and 'B_High.001' do not overlap")
    assert files(rocks) == sorted([*before, "r.json"])
    assert (rocks / "b_low.png").read_bytes() == b"of yesterday"


def test_suffixes_without_pairs(rocks, capsys):
    arguments = ["rocks.blend", "--pairs", "--suffixes", ".lp,.hp,.cg", "--output", "m.png"]
    assert command.run(arguments) == run_report.FAILED
    assert capsys.readouterr().err == "imprint: No object has a name that ends in '.lp'.\n"
    assert files(rocks) == ["rocks.blend"]


@pytest.mark.parametrize(
    "arguments",
    [
        ["--pairs", "--high", "x"],
        ["--pairs", "--low", "x"],
        ["--pairs", "--cage", "x"],
        ["--pairs", "--suffixes", "a,b"],
        ["--low", "x", "--missed", "red"],
        ["--low", "x", "--extrusion", "far"],
        [],
    ],
)
def test_wrong_usage_of_rays(arguments, capsys):
    assert command.run([*arguments, "--output", "m.png"]) == run_report.WRONG_USAGE
    assert "Traceback" not in capsys.readouterr().err


def test_distances_cage_and_mask(scene, fails):
    cast = ["scene/file.blend", "--low", "lo", "--high", "hi", "--method", "cast", "--size", "16", "--depth", "8"]
    assert "not a distance" in fails(run_report.WRONG_USAGE, *cast, "--extrusion=-1", "--output", "n.png")
    assert "no object called 'cag'" in fails(run_report.FAILED, *cast, "--cage", "cag", "--output", "n.png")
    # The high plane rises from -1 to 1 over the low one: rays of 0.5 reach its middle half.
    numbers = ["--extrusion", "0.5", "--max-distance", "1", "--missed", "1,0,1"]
    assert command.run([*cast, *numbers, "--mask", "--output", "m.png", "--report", "r.json"]) == run_report.DONE
    report = reports.one(scene / "r.json")
    assert report["distances"] == {"extrusion": 0.5, "max_distance": 1.0}
    assert report["missed"] == pytest.approx(0.5, abs=0.01)
    texels, mask = read(scene / "m.png"), read(scene / "m_missed.png")
    holes = texels[..., 3] == 0.0
    assert np.array_equal(mask[..., 0] == 1.0, holes & (texels[..., 1] == 0.0))
    assert mask[..., 0].mean() == pytest.approx(report["missed"])


def test_the_last_line_lists_the_written_files(scene, capsys):
    assert command.run([*BAKE, "--output", "m.png", "--mask", "--report", "r.json"]) == run_report.DONE
    assert (
        capsys.readouterr()
        .out.rstrip()
        .endswith(f"Wrote {scene / 'm.png'}, {scene / 'm_missed.png'}, {scene / 'r.json'}")
    )


def test_a_call_without_a_file(fails):
    words = ["--low", "lo", "--high", "hi", "--output", "m.png"]
    assert (
        fails(run_report.FAILED, *words)
        == "imprint: There is no scene to bake: give a FILE, or mesh files with --low-file and --high-file."
    )


# Files for engines


def test_a_file_for_an_engine_is_written_read_back_and_reported(scene, capsys):
    assert command.run([*BAKE, "--output", "{low}.png", "--export", "out/{low}.glb", "--report", "report.json"]) == 0
    assert (scene / "out" / "lo.glb").read_bytes()[:4] == b"glTF"
    found = reports.one(scene / "report.json")["export"]
    assert found["files"] == [str(scene / "out" / "lo.glb")]
    assert found["degrees"][found["basis"]]["percentile_99"] < 0.35
    assert found["has_tangents"]
    out = capsys.readouterr().out
    assert "lo.glb: 2 triangles, read back; normals, read as" in out
    assert f"Wrote {scene / 'lo.png'}, {scene / 'out' / 'lo.glb'}, {scene / 'report.json'}" in out


@pytest.mark.parametrize(
    ("more", "reason"),
    [
        (["--export", "lo.obj"], "'lo.obj' does not end in .glb"),
        (["--export", "lo.glb", "--space", "object"], "--export needs a normal map in tangent space"),
        (["--export", "lo.glb", "--frames", "1-2"], "--export is for one map, --frames for many"),
    ],
)
def test_exports_that_cannot_be_are_refused_before_the_bake(fails, more, reason):
    assert reason in fails(2, *BAKE, "--output", "map.png", *more)


def test_an_export_that_fails_takes_the_maps_along(fails, monkeypatch):
    broken = replace(engine_files.FORMATS[".glb"], read=_unreadable)
    monkeypatch.setattr(engine_files, "FORMATS", {**engine_files.FORMATS, ".glb": broken})
    assert "is broken" in fails(1, *BAKE, "--output", "map.png", "--export", "lo.glb")


def _unreadable(_path, _one):
    raise BakeError("The file is broken.")
