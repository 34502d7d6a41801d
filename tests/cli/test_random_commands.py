# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests random combinations of jobs, folders, links and reports: none changes its inputs or another result.

The seed is in the test's name. For more of them: IMPRINT_RANDOM=0:200 pytest tests/cli/test_random_commands.py
"""

import hashlib
import json
import os
import shutil
from pathlib import Path

import bpy
import numpy as np
import pytest

from addon.cli import command, run_report
from addon.core.file_structure import blend_files, mesh_references
from tests.support import random_cases, scenes, zoo

pytestmark = [
    pytest.mark.usefixtures("gpu_context"),
    pytest.mark.skipif(os.name == "nt", reason="links of POSIX"),
    pytest.mark.filterwarnings("ignore:Setting the shape:DeprecationWarning"),
]

SMALL = ["--size", "16", "--margin", "0", "--limit", "9", "--method", "flatten"]
TEXTURES = ("skin.png", "skin.1001.png", "skin_0001.png", "rock_a_low.png", "rock_a_low_height.png")
STARTS = {".png": b"\x89PNG", ".json": (b"{", b"["), ".blend": (b"BLENDER", b"\x28\xb5\x2f\xfd")}
"""The first bytes of files."""


outcomes = random_cases.counted(40, baked=0.2, refused=0.2)


@pytest.fixture(scope="module")
def inputs(tmp_path_factory):
    """A folder with scenes, one of them with a library, and with meshes that refer to materials and textures."""
    folder = tmp_path_factory.mktemp("inputs")
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    for name in ("rock_a", "rock_b"):
        zoo.plane(f"{name}_low")
        zoo.plane(f"{name}_high", slope=0.5)
    bpy.ops.wm.save_as_mainfile(filepath=str(folder / "rock.blend"))
    bpy.ops.wm.save_as_mainfile(filepath=str(folder / "lib.blend"))
    for obj in list(bpy.data.objects):
        for other in bpy.data.objects:
            other.select_set(other == obj)
        bpy.ops.wm.obj_export(filepath=str(folder / f"{obj.name}.obj"), export_selected_objects=True)
        if obj.name == "rock_b_high":
            path = str(folder / f"{obj.name}.gltf")
            bpy.ops.export_scene.gltf(filepath=path, use_selection=True, export_format="GLTF_SEPARATE")
            (folder / f"{obj.name}.obj").unlink()
            (folder / f"{obj.name}.mtl").unlink()
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    scenes.from_library(folder / "lib.blend", "objects")
    bpy.ops.wm.save_as_mainfile(filepath=str(folder / "linked.blend"))
    for name in TEXTURES:
        scenes.image_file(folder / name)
    text = "".join(f"newmtl m{number}\nmap_Kd {name}\n" for number, name in enumerate(TEXTURES))
    (folder / "rock_a_high.mtl").write_text(text)
    points = (folder / "rock_a_high.obj").read_text()
    (folder / "rock_a_high.obj").write_text(f"mtllib rock_a_high.mtl\n{points}")
    return folder


@pytest.fixture
def place(inputs, tmp_path, monkeypatch):
    """The working folder: in/, with links into it, and out/ with an older map."""
    monkeypatch.chdir(tmp_path)
    shutil.copytree(inputs, tmp_path / "in")
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "old.png").write_bytes(b"\x89PNG of an earlier bake")
    (tmp_path / "soft").symlink_to("in")
    for path in sorted((tmp_path / "in").iterdir()):
        (tmp_path / f"soft_{path.name}").symlink_to(Path("in", path.name))
        os.link(path, tmp_path / f"hard_{path.name}")
    return tmp_path


def tree(folder):
    """The paths in a folder, with the targets of links and hashes of the content of files."""
    result = {}
    for path in sorted(folder.rglob("*")):
        if path.is_symlink():
            result[path] = os.readlink(path)
        elif path.is_file():
            result[path] = hashlib.blake2b(path.read_bytes()).hexdigest()
    return result


class Case:
    """One random call, from the generator `rng`."""

    def __init__(self, rng, folder):
        self.rng, self.folder = rng, folder
        self.files = sorted(path.name for path in (folder / "in").iterdir())
        self.is_bold = rng.random() < 0.55
        """Whether outputs may overwrite inputs or other results."""
        self.written = []

    def pick(self, *choices):
        return random_cases.any_of(self.rng, choices)

    def disguise(self, name):
        """An unusual spelling of the path in/name."""
        return self.pick(
            *(f"in/{name}", f"./in/{name}", f"out/../in/{name}", f"in//{name}", f"soft/{name}", f"soft/../in/{name}"),
            *(f"{self.folder}/in/{name}", f"/{self.folder}/in/{name}", f"in/./{name}", f"soft_{name}", f"hard_{name}"),
            *(f"in/{name.upper()}", f"new/../in/{name}"),
        )

    def source(self, name):
        return self.pick(f"in/{name}", f"soft/{name}", f"./in/../in/{name}", f"soft_{name}")

    def output(self, ending):
        """A path for a file with this ending: a new one, or that of an input or of another result."""
        if self.is_bold and self.rng.random() < 0.45:
            fitting = [name for name in self.files if name.endswith(ending)]
            # A report may have any name.
            return self.disguise(self.pick(*(fitting if fitting and ending != ".json" else self.files)))
        if self.is_bold and self.written and self.rng.random() < 0.3:
            return self.pick(*self.written)
        self.written.append(f"{self.pick('out', 'out', 'new/folder', 'in')}/x{len(self.written)}{ending}")
        return self.pick(self.written[-1], f"./{self.written[-1]}")

    def map(self):
        """Options of the map. Tiles, other maps and {low} add files."""
        folder = self.pick("out", "out", "new/deep") if not self.is_bold else self.pick("out", "in", "soft")
        stem = self.pick("x", "{low}", "skin") if self.is_bold else self.pick("{low}", "fresh{low}", "old{low}")
        number = len(self.written)
        return self.pick(
            {"output": f"{folder}/{stem}.png"},
            {"output": f"{folder}/{stem}{number}.png", "mask": True},
            {"output": f"{folder}/{stem}.<UDIM>.png"},
            {"output": f"{folder}/{stem}.png", "tiles": "1001"},
            {"output": f"{folder}/{stem}.png", "maps": "height"},
            {"output": self.output(".png")},
        )

    def objects(self):
        """Options for the objects."""
        name = self.pick("rock_a", "rock_b")
        high = "rock_a_high.obj" if name == "rock_a" else "rock_b_high.gltf"
        scene = self.source(self.pick("rock.blend", "linked.blend"))
        return self.pick(
            {"file": scene, "low": f"{name}_low", "high": f"{name}_high"},
            {"file": scene, "low": f"{name}_low", "high": f"{name}_high", "no-material": True},
            {"low-file": self.source(f"{name}_low.obj"), "high-file": self.source(high)},
            {"low-file": self.source(f"{name}_low.obj"), "high-file": self.source(high)},
            {"file": self.source("rock.blend"), "pairs": True},
        )

    def bake(self):
        """All options of a bake."""
        options = {**self.objects(), **self.map()}
        if "tiles" not in options and "<UDIM>" not in options["output"] and "pairs" not in options:
            options |= self.pick({}, {}, {"frames": "1-2"})
        options |= self.pick({}, {"report": self.output(".json")})
        options |= self.pick({}, {}, {"save-blend": self.output(".blend")})
        return options

    def words(self):
        """The whole call."""
        kind = self.pick("one", "one", "jobs", "jobs", "folder")
        if kind == "one":
            self.bakes = [self.bake()]
            return [*as_words(self.bakes[0]), *SMALL]
        report = self.pick([], ["--report", self.output(".json")], ["--report", "jobs.json"] if self.is_bold else [])
        if kind == "folder":
            self.bakes = [{"pairs": self.pick("in", "soft", "./in"), **self.map()}]
            return [*as_words(self.bakes[0]), *report, *SMALL]
        self.bakes = [{**self.bake(), **self.pick({}, {}, {"low": "none"})} for _ in range(self.rng.integers(1, 4))]
        (self.folder / "jobs.json").write_text(json.dumps({"bake": self.bakes}))
        return ["--jobs", self.pick("jobs.json", "./jobs.json"), *report, *SMALL]


def as_words(options):
    result = []
    for key, value in options.items():
        result += [value] if key == "file" else [f"--{key}"] if value is True else [f"--{key}={value}"]
    return result


NAMED_IN = {
    "linked.blend": ["lib.blend"],
    "rock_a_low.obj": ["rock_a_low.mtl"],
    "rock_b_low.obj": ["rock_b_low.mtl"],
    "rock_a_high.obj": ["rock_a_high.mtl", *TEXTURES],
    "rock_b_high.gltf": ["rock_b_high.bin"],
}
"""The other files that are read with a file."""


def read_by(options, folder):
    """The real paths of the files that a bake reads, found without the code under test."""
    names = [options[key] for key in ("file", "low-file", "high-file") if key in options]
    if isinstance(options.get("pairs"), str):
        names += [str(path) for path in (folder / "in").iterdir() if path.suffix in {".obj", ".gltf", ".blend"}]
    real = {os.path.realpath(name) for name in names}
    return real | {str(Path(path).with_name(name)) for path in real for name in NAMED_IN.get(Path(path).name, ())}


def protected(bakes, folder):
    """The files that must not change: all that are read, except a scene that is saved over itself."""
    reads = [read_by(options, folder) for options in bakes]
    result = set().union(*reads, {str(folder / "jobs.json")})
    for number, options in enumerate(bakes):
        saved = {os.path.realpath(options[key]) for key in ("save-blend",) if key in options}
        opened = {os.path.realpath(options[key]) for key in ("file",) if key in options}
        result -= (saved & opened) - set().union(*reads[:number], *reads[number + 1 :])
    return result


@random_cases.seeds(60, fast=2)
def test_no_input_is_changed_by_seed(place, outcomes, capsys, seed):
    case = Case(np.random.default_rng(seed), place)
    words = case.words()
    before = tree(place)
    code = command.run(words)
    captured = capsys.readouterr()
    after = tree(place)
    context = (words, captured.err, (place / "jobs.json").read_text() if (place / "jobs.json").exists() else "")
    assert "Traceback" not in captured.err, context
    for path in protected(case.bakes, place).intersection(map(str, before)):
        assert after.get(Path(path)) == before.get(Path(path)), (path, context)
    for path, content in before.items():
        assert not path.is_symlink() or after.get(path) == content, (path, context)
    assert not [path for path in after if ".partial" in path.name], context
    if code == run_report.WRONG_USAGE:
        outcomes["refused"] += 1
        assert after == before, context
        assert captured.err.startswith("imprint: ")
    elif code == run_report.DONE:
        outcomes["baked"] += 1
        assert after != before, context
        for path in set(after) - set(before):
            starts = STARTS[path.suffix]
            assert path.read_bytes().startswith(starts), (path, context)
    else:
        outcomes["failed"] += 1


# Clashes that are found only in open files


@pytest.mark.parametrize("packed", [False, True])
def test_libraries_are_found_without_opening_a_file(place, packed):
    bpy.ops.wm.open_mainfile(filepath=str(place / "in" / "linked.blend"))
    path = place / "in" / "copy.blend"
    bpy.ops.wm.save_as_mainfile(filepath=str(path), copy=True, compress=packed)
    assert path.read_bytes().startswith(STARTS[".blend"][packed])
    assert place / "in" / "lib.blend" in blend_files.libraries(path)
    content = path.read_bytes()
    for broken in (content[:1000], content[:10], content[:400] + b"no stream" + content[400:], b""):
        path.write_bytes(broken)
        blend_files.libraries(path)  # must not raise
    assert blend_files.libraries(path) == []
    assert blend_files.libraries(place / "in" / "rock_a_low.obj") == []


def test_a_texture_that_only_the_importer_finds_is_not_overwritten(place, capsys, monkeypatch):
    monkeypatch.setattr(mesh_references, "of", lambda *_: iter(()))
    mesh = place / "in" / "rock_a_high.obj"
    mesh.write_text(mesh.read_text().replace("\nf ", "\nusemtl m0\nf ", 1))
    before = tree(place)
    words = ["--low-file=in/rock_a_low.obj", "--high-file=in/rock_a_high.obj", "--output=in/skin.png", *SMALL]
    assert command.run(words) == run_report.WRONG_USAGE
    assert "would overwrite a texture of the meshes" in capsys.readouterr().err
    assert tree(place) == before


@pytest.mark.parametrize("name", ["rock_b_high.bin", "a%20b.bin", "far/deep.bin"])
def test_the_buffer_of_a_gltf_file_is_not_overwritten(place, capsys, name):
    path = place / "in" / "rock_b_high.gltf"
    table = json.loads(path.read_text())
    table["buffers"][0]["uri"] = name
    path.write_text(json.dumps(table))
    words = ["--low-file=in/rock_b_low.obj", "--high-file=in/rock_b_high.gltf", "--output=out/m.png", *SMALL]
    assert command.run([*words, f"--report=in/{name.replace('%20', ' ')}"]) == run_report.WRONG_USAGE
    assert "what 'rock_b_high.gltf' refers to" in capsys.readouterr().err
