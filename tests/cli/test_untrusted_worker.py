# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests the process that bakes files of others: its rights, and what .blend and mesh files can make it do."""

import ctypes
import json
import os
import pickle
import random
import shutil
import socket
import subprocess
import sys
import zipfile
from pathlib import Path

import bpy
import numpy as np
import pytest

from addon.cli import command, run_report, scene_files, worker_messages, worker_process
from addon.cli.run_report import Entry, State
from addon.cli.untrusted import Bounds, Sandbox
from addon.core.report import Report
from scripts.imprint import ROOT
from tests.support import untrusted, zoo
from tests.support.untrusted import MESH, bake

pytestmark = untrusted.needs_sandbox


@pytest.fixture
def root(tmp_path, monkeypatch):
    return untrusted.folder(tmp_path, monkeypatch)


@pytest.fixture
def victims(root):
    """What a worker may not reach: a process, a server, a socket and shared memory of this machine."""
    libc, key = ctypes.CDLL(None), random.getrandbits(30)
    memory = libc.shmget(key, 4096, 0o1600)
    with (
        subprocess.Popen([sys.executable, "-c", "input()"], stdin=subprocess.PIPE) as process,
        socket.create_server(("127.0.0.1", 0)) as server,
        socket.socket(socket.AF_UNIX) as local,
    ):
        name = f"\0imprint-{key}"
        local.bind(name)
        local.listen()
        (root / "job/victim.json").write_text(json.dumps([process.pid, server.getsockname()[1], name, key]))
        yield process
        process.kill()
    libc.shmctl(memory, 0, None)


def test_a_process_that_a_file_has_taken_over_can_do_nothing_else(root, victims, monkeypatch):
    monkeypatch.setenv("PASSWORD", "secret")
    (root / "job/steal.obj").write_bytes((root / "job/low.obj").read_bytes())
    entry = bake(root, [{**MESH, "low-file": "steal.obj", "output": "out/m.png"}])[1]
    assert entry["state"] == "done"
    said = next(line for line in Path(entry["log"]).read_text().splitlines() if line.startswith("STEAL "))
    assert {name: what for name, what in json.loads(said.removeprefix("STEAL ")).items() if what == "done"} == {}
    assert sorted(path.name for path in (root / "job/out").iterdir()) == ["large", "link", "m.png"]
    assert victims.poll() is None


def test_folders_may_be_named_over_links_and_with_a_folder_of_the_log(root):
    (root / "way").symlink_to(root / "job")
    (root / "maps").mkdir()
    call = [sys.executable, str(ROOT / "scripts/bake.py"), "--untrusted", "--log", str(root / "maps/logs")]
    call += ["--low-file", str(root / "way/low.obj"), "--high-file", str(root / "way/high.obj"), "--size", "16"]
    done = subprocess.run(
        [*call, "--output", "maps/m.png"],
        cwd=root,
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        check=False,
    )
    assert (done.returncode, (root / "maps/m.png").exists()) == (run_report.DONE, True), done.stderr


@pytest.mark.parametrize(
    ("program", "error"),
    [
        ("", "--untrusted needs bwrap: install the package bubblewrap, or bake each job in a container"),
        (
            "echo bwrap: no rights >&2; exit 1",
            "bubblewrap, which may not run here (bwrap: no rights): bake each job in",
        ),
    ],
)
def test_without_a_sandbox_nothing_is_baked(root, monkeypatch, capfd, program, error):
    """As in a container that may not make user namespaces."""
    (root / "bin").mkdir()
    for name in ("prlimit", "choom"):
        (root / "bin" / name).symlink_to(shutil.which(name))
    if program:
        (root / "bin/bwrap").write_text(f"#!/bin/sh\n{program}\n")
        (root / "bin/bwrap").chmod(0o755)
    monkeypatch.setenv("PATH", str(root / "bin"))
    call = ["--low-file", "low.obj", "--high-file", "high.obj", "--output", "m.png", "--untrusted"]
    assert command.run(call, may_start_processes=True) == run_report.WRONG_USAGE
    assert error in capfd.readouterr().err
    assert not (root / "job/m.png").exists()


def test_an_environment_that_is_a_link_is_readable(tmp_path, monkeypatch):
    (tmp_path / "real").mkdir()
    (tmp_path / "link").symlink_to(tmp_path / "real")
    for name in ("in", "out"):
        (tmp_path / name).mkdir()
    monkeypatch.setattr(sys, "prefix", str(tmp_path / "link"))
    sandbox = Sandbox(Bounds(str(tmp_path / "in"), str(tmp_path / "out")), 1 << 30)
    assert str(tmp_path / "real") in sandbox.command([sys.executable])
    sandbox.close()


def test_another_system_has_no_sandbox(root, monkeypatch, capfd):
    monkeypatch.setattr(sys, "platform", "darwin")
    call = ["--low-file", "low.obj", "--high-file", "high.obj", "--output", "m.png", "--untrusted"]
    assert command.run(call, may_start_processes=True) == run_report.WRONG_USAGE
    assert "--untrusted needs bubblewrap, which exists on Linux alone" in capfd.readouterr().err


def test_a_process_that_a_file_has_taken_over_cannot_lie_of_what_it_wrote(root):
    (root / "job/lie.obj").write_bytes((root / "job/low.obj").read_bytes())
    entry = bake(root, [{**MESH, "low-file": "lie.obj", "output": "out/m.png"}])[1]
    assert (entry["state"], entry["files"], entry["picture"]) == ("failed", [], "")
    assert "'/etc/passwd', is not in" in entry["error"]


def test_all_kinds_of_files_are_those_that_were_planned(root):
    """Names that only the open scene gives, and files beside others, too."""
    for name, material in (("a_low", "x/y"), ("a_high", "z")):
        zoo.plane(name, slope=0.1).data.materials.append(bpy.data.materials.new(material))
    saved(root, "s.blend")
    usual = {"file": "s.blend", "low": "a_low", "high": "a_high"}
    found = bake(
        root,
        [
            {**usual, "output": "out/sets/{low}_{material}.png", "texture-sets": True, "maps": "height"},
            {"file": "s.blend", "pairs": True, "output": "out/pairs/{low}.png"},
            {**usual, "output": "out/tiles/m.<UDIM>.exr", "mip-files": True, "maps": "ao,position"},
            {
                **usual,
                "basis": "MIKKTSPACE",
                "output": "out/all/m_normal.png",
                "maps": "ao,base-color",
                "export": "out/all/{low}.usda",
            },
            {**usual, "output": "out/scene/m.png", "save-blend": "out/scene/s.blend"},
            {**usual, "output": "out/frames/m_##.png", "frames": "1-3"},
        ],
    )
    assert [entry["error"] for entry in found.values()] == [""] * 6
    written = {os.path.relpath(each["path"], root / "job/out") for entry in found.values() for each in entry["files"]}
    assert {
        "sets/a_low_x_y.png",
        "pairs/a_low.png",
        "tiles/m.1001.exr",
        "all/a_low.usda",
        "scene/s.blend",
        "frames/m_03.png",
    } <= {*written}


def saved(root, name):
    bpy.ops.wm.save_as_mainfile(filepath=str(root / "job" / name))
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)


def scene():
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    zoo.plane("lo")
    return zoo.plane("hi", slope=0.1)


@pytest.mark.slow
def test_blend_files(root):
    """One worker bakes all, so that one file could spoil the next."""
    marker = f"open({str(root / 'job/out/MARKER')!r}, 'w')"  # where it would be allowed
    OF = {"low": "lo", "high": "hi"}

    high = scene()
    text = bpy.data.texts.new("evil.py")
    text.write(marker)
    text.use_module = True
    driver = high.driver_add("location", 2).driver
    driver.expression = f"__import__('builtins').{marker} and 0"
    saved(root, "scripts.blend")

    scene()
    for place in ("/etc/secret.png", "//../outside/secret.png", "//link/secret.png", "//in.png"):
        image = bpy.data.images.new(place, 4, 4)
        image.source, image.filepath, image.use_fake_user = "FILE", place, True
    font = bpy.data.fonts.load("<builtin>")
    font.use_fake_user = True
    saved(root, "images.blend")

    high = scene()
    tree = bpy.data.node_groups.new("Reads", "GeometryNodeTree")
    tree.interface.new_socket("Geometry", in_out="OUTPUT", socket_type="NodeSocketGeometry")
    node = tree.nodes.new("GeometryNodeImportOBJ")
    node.inputs["Path"].default_value = str(root / "outside/secret.obj")
    tree.links.new(node.outputs[0], tree.nodes.new("NodeGroupOutput").inputs[0])
    high.modifiers.new("Reads", "NODES").node_group = tree
    saved(root, "nodes.blend")

    high = scene()
    bpy.data.objects["lo"].name = "../../lo"
    saved(root, "names.blend")

    high = scene()
    image = bpy.data.images.new("packed", 4, 4)
    image.pack()
    image.use_fake_user = True
    saved(root, "packed.blend")

    found = bake(
        root,
        [
            {"file": "scripts.blend", **OF, "output": "out/scripts.png"},
            {"file": "images.blend", **OF, "output": "out/images.png"},
            {"file": "nodes.blend", **OF, "output": "out/nodes.png"},
            {"file": "names.blend", "low": "../../lo", "high": "hi", "output": "out/{low}.png"},
            {"file": "packed.blend", **OF, "output": "out/packed.png"},
            {"low-file": "scripts.blend", "high-file": "high.obj", "output": "out/appended.png"},
        ],
    )
    assert not (root / "job/out/MARKER").exists()
    assert [found[number]["state"] for number in range(1, 6)] == ["done", "done", "failed", "done", "done"]
    scripts, images, names = (found[number]["reports"][0]["warnings"] for number in (1, 2, 4))
    assert any(line.startswith("Scripts of the file were not run") for line in scripts)
    (warning,) = [line for line in images if "were not read" in line]
    assert warning.count("secret.png") == 3 and "in.png" not in warning
    assert found[3]["error"].startswith("The node 'Import OBJ' of 'Reads' imports a file")
    assert [os.path.relpath(each["path"], root / "job/out") for each in found[4]["files"]] == [".._.._lo.png"]
    assert not [line for line in names if "not read" in line]
    assert found[6]["error"].count(".") >= 1  # two meshes


def test_paths_of_files_outside_are_emptied(tmp_path):
    """So that nothing that evaluates the scene later reads them."""
    outside, inside = (bpy.data.images.new(name, 4, 4) for name in "ab")
    for image, path in ((outside, "/etc/secret.png"), (inside, str(tmp_path / "in.png"))):
        image.source, image.filepath = "FILE", path
    (note,) = scene_files.leave_out([str(tmp_path)])
    assert (outside.filepath, inside.filepath) == ("", str(tmp_path / "in.png"))
    assert "'/etc/secret.png'" in note
    assert scene_files.leave_out([str(tmp_path)]) == []


def test_preferences_cannot_allow_scripts(monkeypatch):
    paths = bpy.context.preferences.filepaths
    monkeypatch.setattr(paths, "use_scripts_auto_execute", True)
    scene_files.forbid_scripts()
    assert not paths.use_scripts_auto_execute
    given = ["blender", "-b", "--command", "imprint", "--jobs", "j"]
    monkeypatch.setitem(
        sys.modules, "bpy", type("Blender", (), {"app": type("App", (), {"module": False, "binary_path": "/b"})})
    )
    words = worker_process.command(given, is_untrusted=True)
    assert words == ["/b", "-b", "--disable-autoexec", "--command", "imprint", "worker"]


TRIANGLE = (
    'def Mesh "mesh" {\npoint3f[] points = [(0,1,0),(99,1,0),(0,1,-99)]\nint[] faceVertexCounts = [3]\n'
    "int[] faceVertexIndices = [0,1,2]\n}"
)


@pytest.mark.slow
def test_files_that_a_usd_refers_to_elsewhere_are_named(root):
    """Only its importer finds them. A mesh from there would be baked, and one of its own alone is not what was meant."""
    job, model = root / "job", root / "outside/model.usda"
    for path in (model, job / "model.usda"):
        path.write_text(f"#usda 1.0\n{TRIANGLE}\n")
    refer = 'def "a" (references = @{}@</mesh>) {{}}\n'
    texts = {
        "up": refer.format("../outside/model.usda"),
        "absolute": refer.format(model),
        "link": refer.format("link/model.usda"),
        "mesh of its own": f"{TRIANGLE}\n" + refer.format("../outside/model.usda"),
        "payload": refer.format("../outside/model.usda").replace("references", "payload"),
        "layer": "(subLayers = [@../outside/model.usda@])\n",
        "by another": refer.format("up.usda").replace("</mesh>", "</a>"),
        "none": refer.format("../outside/none.usda"),
        "inside": refer.format("model.usda"),
    }
    for name, text in texts.items():
        (job / f"{name}.usda").write_text(f"#usda 1.0\n{text}")
    sets = [
        {
            **MESH,
            "high-file": f"{name}.usda",
            "method": "cast",
            "max-distance": 9,
            "extrusion": 9,
        }
        for name in texts
    ]
    for name, text in texts.items():
        with zipfile.ZipFile(job / f"{name}.usdz", "w") as archive:
            archive.writestr("a.usda", f"#usda 1.0\n{text}")
    sets += [{**each, "high-file": each["high-file"].replace(".usda", ".usdz")} for each in sets[:-1]]
    sets = [{**each, "output": f"out/{number}.png"} for number, each in enumerate(sets)]
    found = list(bake(root, sets).values())
    outside, inside, archives = found[: len(texts) - 1], found[len(texts) - 1], found[len(texts) :]
    for entry in archives:  # names without a root are looked for in the archive
        assert "', which is not in" in entry["error"] or "', which cannot be read." in entry["error"]
    for entry in (*outside, archives[list(texts).index("absolute")]):
        assert f"{'none.usda' if 'none' in entry['error'] else 'model.usda'}', which is not in" in entry["error"]
        assert entry["error"].endswith("the only folder that --untrusted reads.")
    assert inside["state"] == "done"


@pytest.mark.slow
def test_mesh_files(root):
    """Sizes that are lies."""
    job, mesh = root / "job", (root / "job/high.obj").read_text()
    (job / "index.obj").write_text(f"{mesh}f 999999999/1 2/2 3/3\n")
    (job / "many.ply").write_text("ply\nformat ascii 1.0\nelement vertex 4000000000\nproperty float x\nend_header\n")
    (job / "many.stl").write_bytes(bytes(80) + b"\xff\xff\xff\x7f")
    accessor = {"bufferView": 0, "componentType": 5126, "count": 2**31 - 1, "type": "VEC3"}
    lie = {
        "asset": {"version": "2.0"},
        "buffers": [{"uri": "data:application/octet-stream;base64,AAAA", "byteLength": 3}],
        "bufferViews": [{"buffer": 0, "byteLength": 2**31}],
        "accessors": [accessor],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}],
        "nodes": [{"mesh": 0}],
        "scenes": [{"nodes": [0]}],
    }
    (job / "lie.gltf").write_text(json.dumps(lie))
    (job / "deep.gltf").write_text("[" * 100_000)
    (job / "uri.gltf").write_text(json.dumps({**lie, "buffers": [{"uri": "file:///etc/passwd", "byteLength": 9}]}))
    rng = np.random.default_rng(7)
    for number in range(8):  # broken in the middle
        content = bytearray(mesh.encode())
        for place in rng.integers(0, len(content), 20):
            content[place] = rng.integers(0, 256)
        (job / f"fuzz{number}.obj").write_bytes(content)
    names = ["index.obj", "many.ply", "many.stl"]
    names += ["lie.gltf", "deep.gltf", "uri.gltf", *(f"fuzz{number}.obj" for number in range(8))]
    sets = [{**MESH, "high-file": name, "output": f"out/{name}.png", "maps": "base-color"} for name in names]
    sets.append({**MESH, "output": "out/good.png"})
    found = bake(root, sets, "--max-memory", "2G", "--timeout", "60")
    assert found[len(sets)]["state"] == "done"
    by_name = dict(zip(names, found.values(), strict=False))
    for name, entry in by_name.items():
        assert entry["state"] == "done" or len(entry["error"].splitlines()) == 1, name


class Code:
    """Runs code where it is unpickled."""

    def __reduce__(self):
        return eval, ("1",)


@pytest.mark.parametrize(
    "content",
    [
        pickle.dumps(Code()),
        pickle.dumps(worker_messages.packed),
        b"",
        b"garbage",
        b"7",
        b"[]",
        b"[" * 100_000,
        b'["Code", {}]',
    ],
    ids=["code", "function", "nothing", "garbage", "number", "empty list", "deep", "another class"],
)
def test_a_message_of_a_worker_cannot_run_code(content):
    with pytest.raises(OSError, match="no message"):
        worker_messages.unpacked(content)


FILE = {"path": "/a", "bytes": 1, "sha256": "0" * 64, "what": "map"}
REPORT = Report("CAST", "TANGENT", (16, 16), "low", ["high"]).to_dict()


@pytest.mark.parametrize("is_trusted", [True, False])
def test_messages_of_a_worker_arrive(is_trusted):
    report = json.loads(json.dumps(REPORT))
    for message in (
        worker_messages.Ready(),
        worker_messages.Accepted(),
        worker_messages.Percent("a", "b", 0.5),
        worker_messages.Percent("a", "b", 1),
        worker_messages.Line("x\udc80"),
        worker_messages.FilesFound(["a"], [("b", "c")]),
        Entry(1, "a", State.GATE, files=[FILE], reports=[report], warnings=["b"], image=b"c\0d"),
    ):
        assert worker_messages.unpacked(worker_messages.packed(message), is_trusted=is_trusted) == message


def done(**values):
    """A result with other values in its entry."""
    found = Entry(1, "a", files=[FILE])
    vars(found).update(values)
    return worker_messages.packed(found)


def lacking(name):
    text, _, picture = done().partition(b"\0")
    kind, values = json.loads(text)
    del values[name]
    return json.dumps([kind, values]).encode() + b"\0" + picture


LIES = {
    "a text for a number": worker_messages.packed(worker_messages.Percent("a", "b", "0.5")),
    "a number for a text": worker_messages.packed(worker_messages.Line(7)),
    "files of one word": worker_messages.packed(worker_messages.FilesFound(["a"], [("b",)])),
    "no list": worker_messages.packed(worker_messages.FilesFound("abc")),
    "no values": b'["Line", []]',
    "values of another": b'["Line", {"subject": "a"}]',
    "no entry": b'["Entry", {"name": "a", "warnings": [], "is_listed": true}]',
    "a number in the entry": done(error=7),
    "a state that is none": done(state="finished"),
    "a file that is a text": done(files=["/a"]),
    "a file in no folder": done(files=[{**FILE, "path": "a.png"}]),
    "a hash that is a number": done(inputs=[{**FILE, "sha256": 7}]),
    "a file without a path": done(files=[{"what": "map"}]),
    "a report without figures": done(reports=[{}]),
    "a figure that is a text": done(reports=[{**REPORT, "missed": "x"}]),
    "a check without a share": done(reports=[{**REPORT, "checks": {"unsure": {}}}]),
    "warnings that are none": done(reports=[{**REPORT, "warnings": [7]}]),
    "without its log": lacking("log"),
    "without its error": lacking("error"),
}


@pytest.mark.parametrize("content", LIES.values(), ids=LIES)
def test_a_message_of_other_types_is_none(content):
    """Its parent would fail at it, and end all bakes."""
    with pytest.raises(OSError, match="no message"):
        worker_messages.unpacked(content, is_trusted=False)
