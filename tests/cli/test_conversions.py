# SPDX-License-Identifier: GPL-3.0-or-later
"""Converts maps from the command line and from job files."""

import bpy
import numpy as np
import pytest

from addon.cli import command
from tests.support import angles, maps, reports, zoo

pytestmark = pytest.mark.usefixtures("gpu_context")

SIZE = 64
EXACT_16 = 0.01
"""Degrees at the 99th percentile: the rounding of 16 bits, before and after."""


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """The working folder, with file.blend and maps of its pair: tangent.png for MikkTSpace, object.png for object space."""
    monkeypatch.chdir(tmp_path)
    zoo.terrain("lo", n=9, height=0.3), zoo.terrain("hi", n=64, height=0.3)
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "file.blend"))
    common = ["file.blend", "--low", "lo", "--high", "hi", "--method", "flatten", "--size", str(SIZE), "--depth", "16"]
    assert command.run([*common, "--basis", "mikktspace", "--output", "tangent.png"]) == 0
    assert command.run([*common, "--space", "object", "--output", "object.png"]) == 0
    return tmp_path


def off(folder, name, expected):
    """Degrees at the 99th percentile between two files."""
    found = []
    for path in (name, expected):
        image = bpy.data.images.load(str(folder / path))
        image.colorspace_settings.is_data = True
        image.alpha_mode = "CHANNEL_PACKED"
        found.append(maps.pixels(image))
    assert (found[0][..., 3] == found[1][..., 3]).all()
    kept = found[1][..., 3] > 0
    return np.percentile(angles.degrees(*(angles.decode(texels)[kept] for texels in found)), 99)


CONVERT = ["file.blend", "--low", "lo", "--convert"]


def test_a_file_is_converted_and_back_again(folder, capsys):
    to_object = [*CONVERT, "tangent.png", "--space", "object", "--output", "new.png", "--report", "report.json"]
    assert command.run([*to_object, "--depth", "16"]) == 0
    assert "Converted tangent.png from tangent space (MikkTSpace) to object space, 64 x 64" in capsys.readouterr().out
    assert off(folder, "new.png", "object.png") < EXACT_16
    report = reports.one(folder / "report.json")
    assert report["source_depth"] == 16
    assert 0.0 < report["source_loss"]["median"] < report["source_loss"]["maximum"] < 0.005
    back = [*CONVERT, "new.png", "--from-space", "object", "--basis", "mikktspace", "--output", "back.png"]
    assert command.run([*back, "--depth", "16"]) == 0
    assert off(folder, "back.png", "tangent.png") < EXACT_16


def test_green_is_flipped_on_both_sides(folder):
    to_directx = [*CONVERT, "tangent.png", "--basis", "mikktspace", "--green", "-y", "--output", "directx.png"]
    assert command.run([*to_directx, "--depth", "16"]) == 0
    back = [*CONVERT, "directx.png", "--from-green", "-y", "--space", "object", "--output", "new.png", "--depth", "16"]
    assert command.run(back) == 0
    assert off(folder, "directx.png", "tangent.png") > 1.0
    assert off(folder, "new.png", "object.png") < EXACT_16


def test_a_job_file_converts(folder):
    (folder / "jobs.toml").write_text(
        '[[bake]]\nfile = "file.blend"\nlow = "lo"\nconvert = "object.png"\nfrom-space = "object"\nbasis = "mikktspace"\n'
        'output = "new.png"\ndepth = 16\n'
    )
    assert command.run(["--jobs", "jobs.toml"]) == 0
    assert off(folder, "new.png", "tangent.png") < EXACT_16


WRONG = {
    "no file": (1, ["missing.png"], "'missing.png' does not exist."),
    "normals that point inwards": (1, ["tangent.png", "--from-blue", "-z"], "choose another From Space"),
    "the same file": (2, ["tangent.png", "--output", "tangent.png"], "the map to convert"),
    "KTX2": (2, ["old_<UDIM>.ktx2"], "Blender does not read KTX2: name the map's .dds or .png file"),
    "other maps": (2, ["tangent.png", "--maps", "height"], "--convert converts one normal map: leave out --maps"),
    "a mask": (2, ["tangent.png", "--mask"], "leave out --mask"),
    "several of them": (
        2,
        ["tangent.png", "--texture-sets", "--targets", "three", "--no-normal"],
        "leave out --no-normal, --texture-sets, --targets",
    ),
    "a packed image": (2, ["tangent.png", "--pack", "gltf"], "leave out --pack"),
    "an attribute": (2, ["tangent.png", "--vertex-domain", "corner"], "leave out --vertex-domain"),
    "a material": (2, ["tangent.png", "--connect-maps"], "leave out --connect-maps"),
    "pairs": (2, ["tangent.png", "--pairs"], "leave out --pairs"),
    "a cage": (2, ["tangent.png", "--cage", "hi"], "leave out --cage"),
    "frames": (2, ["tangent.png", "--frames", "1-2"], "leave out --frames"),
    "the same axis twice": (2, ["tangent.png", "--from-red", "+y"], "give each channel another axis"),
}


def test_the_files_of_other_meshes_are_not_read(folder, capsys):
    files = ["--low-file", "lo.obj", "--high-file", "hi.obj", "--cage-file", "cage.obj"]
    assert command.run([*files, "--convert", "tangent.png", "--output", "new.png"]) == 2
    assert "leave out --high-file, --cage-file" in capsys.readouterr().err.splitlines()[-1]


@pytest.mark.parametrize("name", WRONG)
def test_wrong_input_is_one_sentence_and_writes_nothing(folder, capsys, name):
    code, more, text = WRONG[name]
    before = {path: path.read_bytes() for path in folder.iterdir()}
    capsys.readouterr()
    assert command.run([*CONVERT, more[0], "--output", "new.png", *more[1:]]) == code
    assert text in capsys.readouterr().err.splitlines()[-1]
    assert {path: path.read_bytes() for path in folder.iterdir()} == before
