# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests bakes of mesh files, folders of pairs and job files: a failure does not stop the others, and all are reported."""

import json
import logging
import os
import re
import signal
import subprocess
import sys
from contextlib import nullcontext

import bpy
import numpy as np
import pytest

from addon.cli import command, run_report, scene_files
from addon.core import file_formats
from addon.core.errors import BakeError
from addon.scene import importing
from scripts import imprint
from tests.support import angles, bombs, maps, reports, snapshot, zoo

pytestmark = [
    pytest.mark.usefixtures("gpu_context"),
    pytest.mark.filterwarnings("ignore:Setting the shape:DeprecationWarning"),  # Blender's exporter of FBX
]

SMALL = ["--size", "16", "--margin", "0", "--limit", "9"]
ROUNDING_16 = 1e-4
"""Half a step of 16-bit integers, and of the numbers in text files."""

EXPORTERS = {
    ".obj": lambda path: bpy.ops.wm.obj_export(filepath=path, export_selected_objects=True),
    ".ply": lambda path: bpy.ops.wm.ply_export(filepath=path, export_selected_objects=True),
    ".stl": lambda path: bpy.ops.wm.stl_export(filepath=path, export_selected_objects=True),
    ".gltf": lambda path: bpy.ops.export_scene.gltf(filepath=path, use_selection=True, export_format="GLTF_SEPARATE"),
    ".glb": lambda path: bpy.ops.export_scene.gltf(filepath=path, use_selection=True),
    ".fbx": lambda path: bpy.ops.export_scene.fbx(filepath=path, use_selection=True),
    **{
        ending: lambda path: bpy.ops.wm.usd_export(filepath=path, selected_objects_only=True)
        for ending in (".usd", ".usda", ".usdc", ".usdz")
    },
    ".blend": lambda path: bpy.data.libraries.write(path, set(bpy.context.selected_objects)),
}


def export(path, *objects):
    """Write objects to a file, in the format of its ending."""
    bpy.context.view_layer.update()
    for obj in bpy.context.view_layer.objects:
        obj.select_set(obj in objects)
    EXPORTERS[path.suffix](str(path))


def files(folder):
    return sorted(str(path.relative_to(folder)) for path in folder.rglob("*") if path.is_file())


def read(path):
    image = bpy.data.images.load(str(path))
    image.colorspace_settings.is_data = True
    return maps.pixels(image)


def leaning(slope):
    """The color of a plane that rises by `slope` along x, in the map of the plane z = 0."""
    return np.array((-slope, 0.0, 1.0)) / np.hypot(slope, 1.0) * 0.5 + 0.5


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """The working folder, empty."""
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture
def run(capsys, monkeypatch):
    """A function that runs a command. It returns the exit code and the text on both streams."""
    monkeypatch.setattr(logging, "raiseExceptions", False)  # the importer of glTF logs to the output of an earlier test

    def run(*words):
        capsys.readouterr()
        code = command.run([str(word) for word in words])
        captured = capsys.readouterr()
        assert "Traceback" not in captured.err
        return code, captured.out, captured.err

    return run


# Mesh files

SAME_PLACE = 0.05
"""Degrees between maps of the same surface from different files, whose numbers are rounded, to half floats at most."""


def test_all_endings_are_in_the_help_and_tested(capsys):
    assert command.run(["--help"]) == run_report.DONE
    text = capsys.readouterr().out.replace("\n", " ")
    assert all(ending in text for ending in file_formats.OPENED)
    assert set(EXPORTERS) == set(file_formats.OPENED)
    assert (".blend", *importing.IMPORTERS) == file_formats.OPENED


@pytest.fixture(scope="module")
def bumps(tmp_path_factory):
    """Files of every format with a low and a high surface without symmetry, rotated and moved."""
    folder = tmp_path_factory.mktemp("bumps")
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)

    def surface(height):
        def points(u, v):
            z = 0.3 * u * v + 0.1 * u * u + height * np.sin(9 * u) * np.sin(7 * v)
            return np.stack([2 * u - 1, 3 * v - 1, z], axis=1)

        return points

    low, high = zoo.sheet("a_low", surface(0.0), 4, 4), zoo.sheet("a_high", surface(0.05), 40, 40)
    for obj in (low, high):
        obj.location, obj.rotation_euler, obj.scale = (1, 2, 3), (0.3, 0.5, 0.7), (1.5, 1.5, 1.5)
    for obj in (low, high):
        for ending in EXPORTERS:
            export(folder / f"{obj.name}{ending}", obj)
    bpy.ops.wm.save_as_mainfile(filepath=str(folder / "scene.blend"))
    return folder


WITH_UVS = [ending for ending in EXPORTERS if ending != ".stl"]


def test_an_obj_with_faces_whose_points_are_missing_is_not_baked(tmp_path, capsys):
    low, high = (zoo.plane(name, 2) for name in ("low", "high"))
    for obj in (low, high):
        export(tmp_path / f"{obj.name}.obj", obj)
    path, low_path = tmp_path / "high.obj", tmp_path / "low.obj"
    words = ["--low-file", str(low_path), "--high-file", str(path), "--output", str(tmp_path / "m.png"), *SMALL]
    whole = path.read_text()
    lines = whole.splitlines(keepends=True)
    last = max(number for number, line in enumerate(lines) if line.startswith("v "))
    path.write_text("".join(lines[:last] + lines[last + 1 :]))
    assert command.run(words) == 1
    said = f"1 face of {str(path)!r} cannot be read, since points, UVs or normals are missing: export it again."
    assert said in capsys.readouterr().err
    path.write_text(whole)
    assert command.run(words) == 0


def test_a_usd_that_refers_to_a_file_that_is_missing_is_not_baked(tmp_path, capsys):
    """The importer leaves that part out."""
    usda = tmp_path / "high.usda"
    usda.write_text('#usda 1.0\ndef "a" (references = @none.usdc@</a>) {}\n')
    words = ["--low-file", str(usda), "--high-file", str(usda), "--output", str(tmp_path / "m.png")]
    assert command.run(words) == 1
    assert capsys.readouterr().err == f"imprint: {str(usda)!r} refers to 'none.usdc', which cannot be read.\n"


@pytest.mark.parametrize("is_missing", [False, True])
def test_an_import_that_fails_leaves_nothing(tmp_path, is_missing):
    path = tmp_path / "part.usda"
    export(path, zoo.plane("part"))
    text = path.read_text()
    before = snapshot.snapshot()
    layers = "subLayers = [@none.usdc@]\n" if is_missing else ""
    path.write_text(text.replace("(\n", f"(\n{layers}", 1))
    with pytest.raises(BakeError) if is_missing else nullcontext(), importing.scene_apart():
        importing.import_file(path, importing.PLAIN)
    assert bool(snapshot.difference(before, snapshot.snapshot())) != is_missing


SHADED = [ending for ending in WITH_UVS if ending != ".ply"]  # PLY files have only smooth normals


@pytest.mark.parametrize("number", range(len(WITH_UVS)), ids=WITH_UVS)
def test_files_of_all_formats_have_the_same_transform(bumps, folder, run, number):
    """The low surface from one format and the high surface from another, compared with their scene."""
    low, high = WITH_UVS[number], SHADED[(number + 3) % len(SHADED)]
    numbers = ["--size", "32", "--margin", "0", "--depth", "32", "--method", "cast", "--space", "world"]
    numbers += ["--extrusion", "0.3", "--max-distance", "0.6", "--output"]
    assert run(bumps / "scene.blend", "--low", "a_low", "--high", "a_high", *numbers, "scene.exr")[0] == run_report.DONE
    by_file = ["--low-file", bumps / f"a_low{low}", "--high-file", bumps / f"a_high{high}"]
    code, out, _ = run(*by_file, *numbers, "files.exr")
    assert code == run_report.DONE
    assert "a_low_normal" in out
    expected, found = read(folder / "scene.exr"), read(folder / "files.exr")
    assert (expected[..., 3] > 0).mean() > 0.99
    hits = (expected[..., 3] > 0) & (found[..., 3] > 0)
    assert np.count_nonzero(hits != (expected[..., 3] > 0)) <= 4  # at the rim, where rounding decides
    assert angles.degrees(angles.decode(expected), angles.decode(found))[hits].max() < SAME_PLACE


def test_a_mesh_file_is_a_scene_as_well(folder, run):
    low, high = zoo.plane("lo"), zoo.plane("hi", slope=0.3)
    export(folder / "both.glb", low, high)
    export(folder / "low.obj", low)
    export(folder / "high.ply", high)
    by_name = ["--low", "lo", "--high", "hi", *SMALL, "--output"]
    assert run("both.glb", *by_name, "{low}.png")[0] == run_report.DONE
    assert np.allclose(read(folder / "lo.png")[8, 8, :3], leaning(0.3), atol=ROUNDING_16)
    code, _, _ = run("low.obj", "high.ply", "--low", "lo", "--high", "high", *SMALL, "--output", "two.png")
    assert code == run_report.DONE
    assert np.allclose(read(folder / "two.png")[8, 8, :3], leaning(0.3), atol=ROUNDING_16)


def test_the_high_file_may_have_several_meshes_and_the_low_file_one(folder, run):
    low, high, more = zoo.plane("lo"), zoo.plane("hi", slope=0.3), zoo.plane("more", slope=0.3)
    more.location.z = -0.2
    export(folder / "rock.obj", low)
    export(folder / "two.glb", high, more)
    export(folder / "cage.obj", low)
    by_file = ["--high-file", "two.glb", "--cage-file", "cage.obj", *SMALL, "--output", "{low}.png"]
    code, out, _ = run("--low-file", "rock.obj", *by_file, "--report", "r.json", "--save-blend", "s.blend")
    assert code == run_report.DONE, out
    report = reports.one(folder / "r.json")
    assert (report["low"], len(report["high"])) == ("rock", 2)
    assert {"rock.png", "s.blend"} <= set(files(folder))
    code, _, err = run("--low-file", "two.glb", "--high-file", "rock.obj", *SMALL, "--output", "m.png")
    assert code == run_report.FAILED
    assert err.startswith(f"imprint: {str(folder / 'two.glb')!r} holds 2 meshes where one is wanted: ")


def test_the_low_mesh_gets_the_name_of_its_file_even_if_others_have_it(folder, run):
    plane, parent = zoo.plane("Plane"), bpy.data.objects.new("rock", None)
    bpy.context.scene.collection.objects.link(parent)
    plane.parent = parent
    export(folder / "rock.glb", plane, parent)
    parent.name = "other"
    export(folder / "high.glb", zoo.plane("rock", slope=0.2))
    by_file = ["--low-file", "rock.glb", "--high-file", "high.glb", *SMALL]
    assert run(*by_file, "--output", "{low}.png", "--report", "r.json")[0] == run_report.DONE
    report = reports.one(folder / "r.json")
    assert (report["low"], report["image"]) == ("rock", "rock_normal")
    assert report["high"][0].startswith("rock.")
    assert "rock.png" in files(folder)


def test_shapes_of_bones_are_not_baked(folder, run):
    """Blender's importer of glTF adds a mesh for them."""
    high = zoo.plane("hi", slope=0.2)
    export(folder / "low.obj", zoo.plane("lo"))
    armature = bpy.data.objects.new("Armature", bpy.data.armatures.new("Armature"))
    bpy.context.scene.collection.objects.link(armature)
    bpy.context.view_layer.objects.active = armature
    bpy.ops.object.mode_set(mode="EDIT")
    armature.data.edit_bones.new("Bone").tail.z = 1.0
    bpy.ops.object.mode_set(mode="OBJECT")
    high.parent = armature
    high.modifiers.new("Armature", "ARMATURE").object = armature
    high.vertex_groups.new(name="Bone").add(range(4), 1.0, "REPLACE")
    export(folder / "high.glb", high, armature)
    by_file = ["--low-file", "low.obj", "--high-file", "high.glb", *SMALL]
    assert run(*by_file, "--output", "m.png", "--report", "r.json")[0] == run_report.DONE
    assert reports.one(folder / "r.json")["high"] == ["hi"]
    assert np.allclose(read(folder / "m.png")[8, 8, :3], leaning(0.2), atol=ROUNDING_16)


BROKEN = {
    "empty.obj": b"",
    "words.obj": b"hello\n\0\xff",
    "empty.glb": b"",
    "words.gltf": b"hello",
    "wrong.gltf": b'{"asset": {"version": "2.0"}, "scenes": [{"nodes": [7]}], "scene": 0}',
    "old.gltf": b'{"asset": {"version": "1.0"}}',
    "empty.fbx": b"",
    "words.fbx": b"Kaydara FBX Binary  \0\x1a\0 and no more",
    "empty.usda": b"",
    "words.usdc": b"PXR-USDC and no more",
    "words.usdz": b"PK and no more",
    "packed.usdz": bombs.zip_of_zeros("a.usda", 1 << 16),
    "empty.ply": b"ply\nformat ascii 1.0\nelement vertex 0\nend_header\n",
    "words.ply": b"hello",
    "words.stl": b"solid hello",
    "words.blend": b"BLENDER17-01v0502 and no more",
    "empty.blend": b"",
    "words.txt": b"hello",
}


@pytest.mark.parametrize(
    ("name", "role"),
    [*((name, "high") for name in BROKEN), ("words.obj", "low"), ("words.gltf", "cage"), ("empty.glb", "low")],
)
def test_broken_files_give_one_sentence(folder, run, name, role):
    good = {"low": "low.obj", "high": "high.obj", "cage": "low.obj"}
    export(folder / "low.obj", zoo.plane("lo"))
    export(folder / "high.obj", zoo.plane("hi", slope=0.2))
    (folder / name).write_bytes(BROKEN[name])
    before = files(folder)
    words = [word for key, value in {**good, role: name}.items() for word in (f"--{key}-file", value)]
    code, _, err = run(*words, *SMALL, "--output", "m.png")
    assert code == run_report.FAILED
    (line,) = err.splitlines()
    assert line.startswith("imprint: ")
    assert str(folder / name) in line
    assert line.endswith(".")
    assert files(folder) == before


def test_a_missing_file_is_reported_before_others_are_read(folder, run, monkeypatch):
    export(folder / "low.obj", zoo.plane("lo"))
    monkeypatch.setattr(importing, "import_meshes", lambda name, _space: pytest.fail(f"{name} was read"))
    code, _, err = run("--low-file", "low.obj", "--high-file", "none.obj", *SMALL, "--output", "m.png")
    assert code == run_report.FAILED
    assert err == f"imprint: There is no file {str(folder / 'none.obj')!r}.\n"


@pytest.mark.shared
@pytest.mark.parametrize("role", ["low", "high"])
@pytest.mark.parametrize(
    "name",
    [
        "BoxBadNormals.glb",
        "BoxWithInfinites.glb",
        "MirroredCube_252.blend",
        "busted.STL",
        "chair_model.obj",
        "cycloidal.ply",
        "empty.obj",
        "fuze.obj",
        "groups.obj",
        "nancolor.obj",
    ],
)
def test_nasty_files_give_a_map_or_one_sentence(shared_assets, folder, run, name, role):
    other = "high" if role == "low" else "low"
    export(folder / "other.obj", zoo.sphere("other", 8))
    nasty = [f"--{role}-file", shared_assets / "nasty" / name, f"--{other}-file", "other.obj"]
    code, _, err = run(*nasty, *SMALL, "--output", "m.png")
    if code == run_report.FAILED:
        (line,) = err.splitlines()
        assert line.startswith("imprint: ")
        assert line.endswith(".")
    else:
        assert code == run_report.DONE
        assert np.isfinite(read(folder / "m.png")).all()
    assert ("m.png" in files(folder)) == (code == run_report.DONE)


@pytest.mark.slow
def test_importers_print_nothing(folder):
    """In a separate process, to see the output of C code as well."""
    export(folder / "low.obj", zoo.plane("lo"))
    export(folder / "high.glb", zoo.plane("hi", slope=0.2))
    done = script("--low-file", "low.obj", "--high-file", "high.glb", *SMALL, "--output", "m.png")
    assert done.returncode == run_report.DONE, done.stderr
    assert "Flatten" in done.stdout
    assert not re.search(r"\bimport\b", done.stdout + done.stderr, re.IGNORECASE)


def script(*words, **options):
    """Run scripts/bake.py in a separate process."""
    program = [sys.executable, str(imprint.ROOT / "scripts" / "bake.py"), "--", *map(str, words)]
    return subprocess.run(program, capture_output=True, text=True, errors="replace", check=False, **options)


# Folders of pairs


@pytest.fixture
def rocks(folder):
    """Files of three pairs, of which one cannot be baked, and two files without a pair."""
    (folder / "rocks").mkdir()
    low = zoo.plane("whatever")
    for name, slope in (("a", 0.2), ("b", 0.4)):
        export(folder / "rocks" / f"{name}_low.obj", low)
        export(folder / "rocks" / f"{name.upper()}_High_2.glb", zoo.plane("hi", slope=slope))
    export(folder / "rocks" / "c_low.obj", low)
    (folder / "rocks" / "c_high.stl").write_bytes(b"solid nothing")
    export(folder / "rocks" / "d_high.ply", low)
    (folder / "rocks" / "e_low.txt").write_text("no mesh")
    low.location.z = 0.5
    export(folder / "rocks" / "a_cage.fbx", low)
    return folder


def test_a_folder_of_pairs(rocks, run):
    code, out, err = run("--pairs", "rocks", *SMALL, "--output", "{name}_n.png", "--report", "r.json")
    assert code == run_report.FAILED
    warning, failure = err.splitlines()
    assert warning.startswith("imprint: warning: 'd_high' has no low object")
    assert failure == f"imprint: c_low: {str(rocks / 'rocks' / 'c_high.stl')!r} ends too early."
    assert np.allclose(read(rocks / "a_n.png")[8, 8, :3], leaning(0.2), atol=ROUNDING_16)
    assert np.allclose(read(rocks / "b_n.png")[8, 8, :3], leaning(0.4), atol=ROUNDING_16)
    assert [name for name in files(rocks) if not name.startswith("rocks")] == ["a_n.png", "b_n.png", "r.json"]
    a, b, c = reports.bakes(rocks / "r.json")
    states = [("a_low", "done"), ("b_low", "done"), ("c_low", "failed")]
    assert [(each["name"], each["state"]) for each in (a, b, c)] == states
    assert (a["error"], a["reports"][0]["low"], a["files"][0]["path"]) == ("", "a_low", str(rocks / "a_n.png"))
    assert (c["reports"], c["files"], c["cause"]) == ([], [], "input")
    assert c["error"] in failure
    assert min(each["seconds"] for each in (a, b)) > 0.0
    saved, lines = out.splitlines()[:2], out.splitlines()[2:]
    assert saved == [f"Saved: '{rocks / name}'" for name in ("a_n.png", "b_n.png")]
    assert [line.split()[0] for line in lines] == ["done", "done", "failed", "2", "Wrote"]
    assert str(rocks / "b_n.png") in lines[1]
    assert c["error"] not in lines[2]  # standard error has it
    assert lines[3].startswith("2 done, 1 failed, ")


def test_a_cage_in_a_folder_is_used(rocks, run):
    assert run("--pairs", "rocks", *SMALL, "--output", "{low}.png", "--method", "flatten")[0] == run_report.FAILED
    assert "a_low.png" not in files(rocks)  # Flatten does not use a cage
    assert "b_low.png" in files(rocks)


@pytest.mark.skipif(sys.platform != "linux", reason="on other systems all names are UTF-8")
def test_files_whose_names_are_not_utf_8_are_left_out_with_a_warning(rocks, run):
    for name in ("\udcff_low.obj", "\udcff_high.obj"):
        (rocks / "rocks" / name).write_bytes((rocks / "rocks" / "a_low.obj").read_bytes())
    _, _, err = run("--pairs", "rocks", *SMALL, "--output", "{low}.png", "--report", "r.json")
    assert err.count("is left out: its name is not UTF-8") == 2
    found = reports.bakes(rocks / "r.json")
    assert [(each["name"], each["state"]) for each in found] == [
        ("a_low", "done"),
        ("b_low", "done"),
        ("c_low", "failed"),
    ]


def test_two_files_with_the_same_name_are_refused(rocks, run):
    export(rocks / "rocks" / "b_low.ply", bpy.data.objects["whatever"])
    _, _, err = run("--pairs", "rocks", *SMALL, "--output", "{low}.png")
    assert "imprint: b_low: 'b_low.obj' and 'b_low.ply' share a name: remove one of them." in err.splitlines()
    assert {"a_low.png", "b_low.png"} & set(files(rocks)) == {"a_low.png"}


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--pairs", "none"], "The folder 'none' cannot be read: No such file or directory."),
        (["--pairs", "."], "No mesh file in '.' has a name that ends in '_low'."),
        (["--pairs", "rocks", "--suffixes", ".l,.h,.c"], "No mesh file in 'rocks' has a name that ends in '.l'."),
        (["--pairs", "rocks", "--suffixes", "_x,_x,_c"], "must all be different"),
    ],
)
def test_folders_without_pairs(rocks, run, words, message):
    code, _, err = run(*words, *SMALL, "--output", "{low}.png")
    assert code == run_report.FAILED
    (line,) = err.splitlines()
    assert line.startswith(f"imprint: {(rocks / words[1]).resolve().name}: ")
    assert message in line


# Job files


@pytest.fixture
def scenes(folder):
    """rock.blend and hero.blend with two pairs each, and the mesh files of a third pair, in folders beside the job file."""
    (folder / "in").mkdir()
    (folder / "maps").mkdir()
    for number, scene in enumerate(("rock", "hero")):
        bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
        for name in ("a", "b"):
            zoo.plane(f"{scene}_{name}_low")
            zoo.plane(f"{scene}_{name}_high", slope=0.2 + 0.2 * number)
        bpy.ops.wm.save_as_mainfile(filepath=str(folder / "in" / f"{scene}.blend"))
    export(folder / "in" / "c_low.obj", bpy.data.objects["hero_a_low"])
    export(folder / "in" / "c_high.glb", bpy.data.objects["hero_a_high"])
    return folder


JOBS = """
[defaults]
size = 16
margin = 0
limit = 9

[[bake]]
file = "in/rock.blend"
low = "rock_a_low"
high = "rock_a_high"
output = "maps/a.png"
report = "maps/a.json"

[[bake]]
file = "in/hero.blend"
pairs = true
output = "maps/{low}.png"

[[bake]]
file = "in/hero.blend"
low = "hero_a_lo"
high = ["hero_a_high"]
output = "maps/no.png"

[[bake]]
low-file = "in/c_low.obj"
high-file = "in/c_high.glb"
output = "maps/{low}.exr"
depth = 32

[[bake]]
pairs = "in"
output = "maps/{low}_again.png"
"""


def test_a_job_file(scenes, run, monkeypatch):
    (scenes / "jobs.toml").write_text(JOBS)
    (scenes / "elsewhere").mkdir()
    monkeypatch.chdir(scenes / "elsewhere")
    code, out, err = run("--jobs", "../jobs.toml", "--report", "r.json")
    assert code == run_report.FAILED
    (line,) = err.splitlines()
    assert line.startswith(
        "imprint: set 3 (hero_a_lo): There is no object called 'hero_a_lo' in the file: did you mean"
    )
    maps = ["a.json", "a.png", "c_low.exr", "c_low_again.png", "hero_a_low.png", "hero_b_low.png"]
    assert files(scenes / "maps") == maps
    assert np.allclose(read(scenes / "maps" / "a.png")[8, 8, :3], leaning(0.2), atol=ROUNDING_16)
    assert np.allclose(read(scenes / "maps" / "hero_b_low.png")[8, 8, :3], leaning(0.4), atol=ROUNDING_16)
    assert np.allclose(read(scenes / "maps" / "c_low.exr")[8, 8, :3], leaning(0.4), atol=ROUNDING_16)
    bakes = reports.bakes(scenes / "elsewhere" / "r.json")
    assert [each["name"] for each in bakes] == [
        "set 1 (rock_a_low)",
        "set 2 (hero.blend)",
        "set 3 (hero_a_lo)",
        "set 4 (c_low)",
        "set 5 (c_low)",
    ]
    assert [each["number"] for each in bakes] == [1, 2, 3, 4, 5]
    assert [each["state"] for each in bakes] == ["done", "done", "failed", "done", "done"]
    assert bakes[0]["reports"] == [reports.one(scenes / "maps" / "a.json")]
    assert [pair["low"] for pair in bakes[1]["reports"]] == ["hero_a_low", "hero_b_low"]
    assert len(bakes[1]["files"]) == 2
    assert "4 done, 1 failed" in out


def test_toml_and_json_bake_the_same(scenes, run):
    import tomllib

    (scenes / "jobs.toml").write_text(JOBS)
    (scenes / "jobs.json").write_text(json.dumps(tomllib.loads(JOBS)))
    found = []
    for name in ("jobs.toml", "jobs.json"):
        assert run("--jobs", name)[0] == run_report.FAILED
        found.append({path: (scenes / path).read_bytes() for path in files(scenes) if path.endswith((".png", ".exr"))})
        for path in found[-1]:
            (scenes / path).unlink()
    assert len(found[0]) == 5
    assert found[0] == found[1]


def test_options_on_the_command_line_apply_to_all_sets(scenes, run):
    (scenes / "jobs.toml").write_text(JOBS)
    run("--jobs", "jobs.toml", "--size", "32x16", "--green", "-y")
    assert {read(scenes / path).shape for path in files(scenes) if path.endswith(".png")} == {(16, 32, 4)}


FAULTY = {
    "jobs.toml": JOBS + "samlpes = 4\n",
    "none.toml": None,
    "jobs.json": "{",
}


@pytest.mark.parametrize("name", FAULTY)
def test_a_faulty_job_file_is_wrong_usage_and_nothing_is_baked(scenes, run, name, monkeypatch):
    if FAULTY[name] is not None:
        (scenes / name).write_text(FAULTY[name])
    before = files(scenes)
    code, out, err = run("--jobs", name)
    assert (code, out) == (run_report.WRONG_USAGE, "")
    assert files(scenes) == before
    line = err.splitlines()[-1]
    assert line.startswith("imprint: ")
    assert len(err.splitlines()) == 1
    assert name in line
    if name == "jobs.toml":
        assert line == "imprint: jobs.toml, set 5: unknown key 'samlpes', did you mean 'samples'?"


@pytest.fixture
def opened(monkeypatch):
    """The names of the opened scenes and imported files, in order."""
    result, open_blend, import_meshes = [], scene_files._open_blend, importing.import_meshes
    monkeypatch.setattr(
        scene_files, "_open_blend", lambda name: (result.append(os.path.basename(name)), open_blend(name))
    )
    monkeypatch.setattr(
        importing,
        "import_meshes",
        lambda name, *more: (result.append(os.path.basename(name)), import_meshes(name, *more))[1],
    )
    return result


def jobs(*sets):
    return json.dumps({"defaults": {"size": 16, "margin": 0, "limit": 9}, "bake": list(sets)})


def test_a_scene_is_opened_once_for_sets_that_follow_each_other(scenes, run, opened):
    a = {"file": "in/rock.blend", "low": "rock_a_low", "high": "rock_a_high", "output": "1.png"}
    b = {"file": "in/../in/rock.blend", "low": "rock_b_low", "high": "rock_b_high", "output": "2.png"}
    files_ = {"low-file": "in/c_low.obj", "high-file": "in/c_high.glb", "output": "3.png"}
    last = {**a, "output": "4.png"}
    (scenes / "jobs.json").write_text(jobs(a, b, files_, last))
    assert run("--jobs", "jobs.json")[0] == run_report.DONE
    assert opened == ["rock.blend", "c_low.obj", "c_high.glb", "rock.blend"]


def test_sets_do_not_see_the_changes_of_others(scenes, run):
    a = {"file": "in/rock.blend", "low": "rock_a_low", "high": "rock_a_high", "output": "1.png"}
    between = {"file": "in/hero.blend", "low": "hero_a_low", "high": "hero_a_high", "output": "2.png"}
    b = {**a, "low": "rock_b_low", "high": "rock_b_high", "output": "3.png", "save-blend": "saved.blend"}
    (scenes / "jobs.json").write_text(jobs(a, between, b))
    assert run("--jobs", "jobs.json")[0] == run_report.DONE
    bpy.ops.wm.open_mainfile(filepath=str(scenes / "saved.blend"))
    assert bpy.data.objects["rock_b_low"].active_material is not None
    assert bpy.data.objects["rock_a_low"].active_material is None
    (scenes / "jobs.json").write_text(jobs(a, b))
    assert run("--jobs", "jobs.json")[0] == run_report.DONE
    bpy.ops.wm.open_mainfile(filepath=str(scenes / "saved.blend"))
    assert bpy.data.objects["rock_a_low"].active_material is not None  # they share the open file


def test_a_set_bakes_as_if_it_were_alone_although_one_before_changed_its_high_mesh(scenes, run, opened):
    """The first map is in the material of the second one's high mesh, whose normal maps count."""
    a = {"file": "in/rock.blend", "low": "rock_a_low", "high": "rock_a_high", "output": "1.png"}
    other = {"file": "in/rock.blend", "low": "rock_b_low", "high": "rock_b_high", "output": "2.png"}
    b = {**a, "low": "rock_b_low", "high": "rock_a_low", "output": "3.png", "method": "flatten"}
    (scenes / "jobs.json").write_text(jobs(b))
    assert run("--jobs", "jobs.json")[0] == run_report.DONE
    alone = (scenes / "3.png").read_bytes()
    opened.clear()
    (scenes / "jobs.json").write_text(jobs(a, other, b))
    assert run("--jobs", "jobs.json")[0] == run_report.DONE
    assert (scenes / "3.png").read_bytes() == alone
    assert opened == ["rock.blend", "rock.blend"]
    (scenes / "jobs.json").write_text(jobs(a, {**b, "save-blend": "saved.blend"}))
    assert run("--jobs", "jobs.json")[0] == run_report.DONE
    assert (scenes / "3.png").read_bytes() != alone  # they are one scene


def test_a_scene_is_not_saved_without_the_maps_of_bakes_that_failed(scenes, run):
    a = {"file": "in/rock.blend", "low": "rock_a_low", "high": "rock_a_high", "output": "1.png"}
    wrong = {**a, "low": "no_such_low", "output": "2.png"}
    b = {**a, "low": "rock_b_low", "high": "rock_b_high", "output": "3.png", "save-blend": "saved.blend"}
    (scenes / "jobs.json").write_text(jobs(a, wrong, b))
    code, _, err = run("--jobs", "jobs.json")
    assert code == run_report.FAILED
    assert "set 3 (rock_b_low): An earlier bake of the same scene has failed" in err
    assert not {"saved.blend", "3.png"} & set(files(scenes))


def test_a_later_set_does_not_overwrite_a_map(scenes, run):
    a = {"file": "in/rock.blend", "low": "rock_a_low", "high": "rock_a_high", "output": "{low}.png"}
    b = {"file": "in/rock.blend", "pairs": True, "output": "in/../{low}.png"}
    (scenes / "jobs.json").write_text(jobs(a, b))
    code, _, err = run("--jobs", "jobs.json")
    assert code == run_report.FAILED
    (line,) = err.splitlines()
    assert line.startswith("imprint: set 2 (rock.blend): The normal map of 'rock_a_low' of set 2 (rock.blend) and ")
    assert "the normal map of set 1 (rock_a_low) would both be" in line
    assert "rock_b_low.png" not in files(scenes)


def test_clashes_of_sets_are_reported_before_the_first_bake(scenes, run):
    a = {"file": "in/rock.blend", "low": "rock_a_low", "high": "rock_a_high", "output": "{low}.png"}
    b = {**a, "low": "rock_b_low", "high": "rock_b_high", "report": "r.json"}
    (scenes / "jobs.json").write_text(jobs(a, b, {**a, "mask": True}, {**b, "output": "x.png"}))
    before = files(scenes)
    code, out, err = run("--jobs", "jobs.json")
    assert (code, out) == (run_report.WRONG_USAGE, "")
    third, fourth = err.splitlines()
    assert "set 3 (rock_a_low): The normal map of set 3 (rock_a_low) and the normal map of set 1 (rock_a_low)" in third
    assert "the report of set 2 (rock_b_low) would both be" in fourth
    assert files(scenes) == before


@pytest.mark.parametrize(
    ("fault", "message"),
    [
        ({"file": "none.blend"}, "There is no file"),
        ({"file": "jobs.json"}, "is not a complete .blend file"),
        ({"output": "jobs.json/m.png"}, "Not a directory"),
        ({"cage": "none"}, "There is no object called 'none'"),
    ],
)
def test_a_set_that_fails_does_not_stop_others(scenes, run, fault, message):
    good = {"file": "in/rock.blend", "low": "rock_a_low", "high": "rock_a_high", "output": "{low}.png"}
    (scenes / "jobs.json").write_text(jobs({**good, "output": "bad.png", **fault}, good))
    code, out, err = run("--jobs", "jobs.json")
    assert code == run_report.FAILED
    (line,) = err.splitlines()
    assert line.startswith("imprint: set 1 (rock_a_low): ")
    assert message in line
    assert "rock_a_low.png" in files(scenes)
    assert "bad.png" not in files(scenes)
    assert "1 done, 1 failed" in out


def test_a_report_that_cannot_be_written_is_reported_before_the_bakes(scenes, run):
    (scenes / "jobs.toml").write_text(JOBS)
    before = files(scenes)
    code, _, err = run("--jobs", "jobs.toml", "--report", "jobs.toml/r.json")
    assert code == run_report.FAILED
    assert "Not a directory" in err
    assert files(scenes) == before


# Progress, and Ctrl-C

posix = pytest.mark.skipif(os.name == "nt", reason="Windows has no pseudo-terminals")


def on_terminal(*words, stop_at=None):
    """Run scripts/bake.py with its errors on a terminal. Returns the exit code and both texts.

    stop_at: a text on the terminal at which Ctrl-C is pressed.
    """
    import threading

    master, slave = os.openpty()
    program = [sys.executable, str(imprint.ROOT / "scripts" / "bake.py"), "--", *words]
    with subprocess.Popen(program, stdout=subprocess.PIPE, stderr=slave) as process:
        os.close(slave)
        out = []
        reader = threading.Thread(target=lambda: out.append(process.stdout.read()))
        reader.start()
        seen = b""
        while True:
            try:
                piece = os.read(master, 4096)
            except OSError:  # on Linux, the other end was closed
                piece = b""
            if not piece:
                break
            seen += piece
            if stop_at is not None and stop_at in seen:
                process.send_signal(signal.SIGINT)
                stop_at = None
        code = process.wait()
        reader.join()
    os.close(master)
    return code, out[0].decode(errors="replace"), seen.decode(errors="replace")


def screen(text):
    """The lines that a terminal shows at the end."""
    lines = []
    for line in text.replace("\r\n", "\n").split("\n"):
        shown = ""
        for part in line.split("\r"):
            shown = part + shown[len(part) :]
        lines.append(shown.rstrip())
    return [line for line in lines if line and "EGL" not in line]


BIG = ["in/rock.blend", "--low", "rock_a_low", "--high", "rock_a_high", "--method", "cast", "--limit", "9"]
BIG += ["--output", "m.png"]


@pytest.mark.slow
@posix
def test_progress_on_a_terminal_is_one_line_that_is_erased(scenes):
    code, _, seen = on_terminal(*BIG, "--size", "128")
    assert code == run_report.DONE
    assert "\rReading rock_a_low, " in seen
    assert "\rrock_a_low: Drawing, " in seen
    assert "%" in seen
    assert screen(seen) == []


@pytest.mark.slow
@posix
def test_a_terminal_shows_the_memory_that_a_bake_of_mesh_files_needs(folder):
    export(folder / "low.obj", zoo.plane("lo"))
    export(folder / "high.obj", zoo.plane("hi", slope=0.2))
    code, _, seen = on_terminal("--low-file", "low.obj", "--high-file", "high.obj", *SMALL, "--output", "m.png")
    assert code == run_report.DONE
    (line,) = screen(seen)
    assert re.fullmatch(r"imprint: low: The bake needs about 0\.\d GB of memory; \d+\.\d GB are free\.", line)


@pytest.mark.slow
@posix
def test_progress_of_several_bakes_has_a_number_and_a_name(scenes):
    (scenes / "jobs.toml").write_text(JOBS)
    code, out, seen = on_terminal("--jobs", "jobs.toml")
    assert code == run_report.FAILED
    for text in ("1/5 rock_a_low: Opening, 0%", "2/5 hero.blend: Opening, 0%", "2/5 Reading hero_b_low, "):
        assert text in seen
    (line,) = screen(seen)
    assert line.startswith("imprint: set 3 (hero_a_lo): ")
    assert "4 done, 1 failed" in out


@pytest.mark.slow
def test_no_progress_in_a_pipe(scenes):
    done = script(*BIG, "--size", "128")
    assert done.returncode == run_report.DONE
    assert [line for line in done.stderr.splitlines() if "EGL" not in line] == []
    assert "\r" not in done.stdout


@pytest.mark.slow
@posix
def test_ctrl_c_leaves_no_files(scenes):
    before = files(scenes)
    code, _, seen = on_terminal(*BIG, "--size", "2048", "--samples", "64", stop_at=b"Drawing")
    assert code == 128 + signal.SIGINT
    assert screen(seen) == ["imprint: stopped, nothing was finished."]
    assert files(scenes) == before


@pytest.mark.slow
@posix
def test_ctrl_c_stops_a_batch_and_reports_finished_bakes(scenes):
    good = {"file": "in/rock.blend", "low": "rock_a_low", "high": "rock_a_high", "output": "1.png"}
    long = {**good, "output": "2.png", "size": 2048, "samples": 64, "method": "cast"}
    (scenes / "jobs.json").write_text(jobs(good, long, {**good, "output": "3.png"}))
    before = files(scenes)
    code, out, seen = on_terminal("--jobs", "jobs.json", "--report", "r.json", stop_at=b"2/3 rock_a_low: Drawing")
    assert code == 128 + signal.SIGINT
    assert screen(seen) == ["imprint: stopped, 1 of 3 were finished."]
    assert files(scenes) == sorted([*before, "1.png", "r.json"])
    assert "1 done, 0 failed, 2 stopped or not begun" in out
    assert [each["name"] for each in reports.bakes(scenes / "r.json")] == ["set 1 (rock_a_low)"]


def test_a_bake_restores_the_handler_of_ctrl_c(scenes, run):
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        assert run(*BIG, "--size", "16")[0] == run_report.DONE
        assert signal.getsignal(signal.SIGINT) is signal.SIG_IGN
    finally:
        signal.signal(signal.SIGINT, before)


def test_a_sequence_has_a_file_and_a_report_for_each_frame(tmp_path):
    low, high = zoo.plane("lo"), zoo.plane("hi", slope=0.2)
    for frame, angle in ((1, 0.0), (3, 0.3)):
        high.rotation_euler.y = angle
        high.keyframe_insert("rotation_euler", frame=frame)
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "scene.blend"))
    words = ["--low", low.name, "--high", high.name, "--space", "object", "--size", "16", "--frames", "1-3"]
    paths = ["--output", str(tmp_path / "map.##.png"), "--report", str(tmp_path / "report.json")]
    assert command.run([*words, *paths]) == 0
    maps = [str(tmp_path / f"map.{frame:02}.png") for frame in (1, 2, 3)]
    assert sorted(map(str, tmp_path.glob("*.png"))) == maps
    report = reports.bake(tmp_path / "report.json")
    assert [frame["output"] for frame in report["reports"]] == [[path] for path in maps]


@pytest.mark.parametrize("wrong", ["3-1", "1", "a-b", "1-", "-3"])
def test_a_wrong_range_of_frames_is_reported(wrong, capsys, tmp_path):
    assert command.run(["--low", "lo", "--output", str(tmp_path / "map.png"), f"--frames={wrong}"]) == 2
    assert "is not a range of frames, such as 1-48" in capsys.readouterr().err


@pytest.mark.parametrize("wrong", ["1-99999999", "1-100001", "1048575-1048575"])
def test_too_many_frames_are_reported_at_once(wrong, capsys, tmp_path):
    assert command.run(["--low", "lo", "--output", str(tmp_path / "map.png"), f"--frames={wrong}"]) == 2
    assert "is too long: frames go up to 1048574, and a sequence has 100000 at most" in capsys.readouterr().err
