# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests the command `asset`: maps, a file for an engine, a scene and a report, and no file if something fails."""

import json

import bpy
import numpy as np
import pytest

from addon.cli import command
from scripts.imprint import ROOT
from tests.support import glb, json_schema, lanes, quick_assets, zoo

pytestmark = pytest.mark.usefixtures("gpu_context")

SCHEMA = json.loads((ROOT / "docs" / "report.schema.json").read_text(encoding="utf-8"))
ASSET = ["asset", "ball.blend", "--triangles", "200", "--size", "64", "--export", "out/ball.glb"]


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """The working folder, with ball.blend: a ball, and a hidden object."""
    monkeypatch.chdir(tmp_path)
    quick_assets.quicken(monkeypatch)
    zoo.ball("Ball_high", 16)
    zoo.cube("Hidden").hide_set(True)
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "ball.blend"))
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    return tmp_path


def files(folder):
    return sorted(str(path.relative_to(folder)) for path in folder.rglob("*") if path.is_file())


def test_a_file_of_a_high_mesh_becomes_a_file_for_an_engine(folder, capfd):
    words = [*ASSET, "--maps", "ao", "--save-blend", "asset.blend", "--report", "report.json"]
    assert command.run(words) == 0
    assert files(folder) == sorted(
        ["asset.blend", "ball.blend", "out/ball.glb", "out/ball.png", "out/ball_ao.png", "report.json"]
    )
    whole = json.loads((folder / "report.json").read_text())
    assert list(json_schema.errors(whole, SCHEMA)) == []
    (entry,) = whole["bakes"]
    assert (entry["state"], entry["problems"]) == ("done", [])
    (report,) = entry["reports"]
    assert report["low"] == "Ball_low" and report["high"] == ["Ball_high"]
    assert report["triangles"]["low"] == pytest.approx(200, abs=4) == report["export"]["triangles"]
    assert report["asset"]["is_made"] and report["appearance"]["pixels"] > 0
    assert "Ball_low: 2" in capfd.readouterr().out
    tree, _ = glb.parse(folder / "out" / "ball.glb")
    assert len(tree["meshes"]) == 1 and len(tree["images"]) == 2
    bpy.ops.wm.open_mainfile(filepath=str(folder / "asset.blend"))
    assert len(bpy.data.objects["Ball_low"].data.uv_layers) == 1


def test_fewer_triangles_than_the_default_are_no_failure(folder, capfd):
    """A ring of 24 triangles; the default is a most, and what the user gives a promise."""
    corners = [
        (x, y, z)
        for z in (0.0, 1.0)
        for x, y in ((2, 2), (-2, 2), (-2, -2), (2, -2), (1, 1), (-1, 1), (-1, -1), (1, -1))
    ]
    sides = [(i, (i + 1) % 4) for i in range(4)]
    quads = [(a, b, b + 8, a + 8) for a, b in sides] + [(b + 4, a + 4, a + 12, b + 12) for a, b in sides]
    quads += [(b, a, a + 4, b + 4) for a, b in sides]
    lines = ["o ring", *(f"v {x} {y} {z}" for x, y, z in corners)]
    lines += ["f " + " ".join(str(number + 1) for number in quad) for quad in quads]
    (folder / "ring.obj").write_text("\n".join(lines) + "\n")
    words = ["asset", "ring.obj", "--size", "64", "--export", "out/ring.glb", "--report", "report.json"]
    assert command.run(words) == 0
    (entry,) = json.loads((folder / "report.json").read_text())["bakes"]
    (report,) = entry["reports"]
    assert report["triangles"]["low"] == 24 and report["asset"]["missed"] == [] == entry["gate"]
    errors = capfd.readouterr().err
    assert "allows no others" not in errors and "swapped" not in errors
    assert command.run([*words, "--triangles", "5000"]) == 4
    assert "has 24 triangles, not 5,000" in capfd.readouterr().err


@pytest.mark.parametrize(
    ("more", "text"),
    [
        (["--cage", "Ball"], "--cage is not for asset"),
        (["--low-file", "ball.obj"], "--low-file is not for asset"),
        (["--pairs"], "--pairs is not for asset"),
        (["--degrees", "two"], "is not degrees"),
        (["--degrees", "0"], "cannot be a limit"),
        (["--distance", "far"], "is not a distance in percent"),
        (["--distance", "0%"], "cannot be a limit"),
        (["--levels", "9"], "levels of detail are not possible"),
        (["--levels", "2", "--export", "out/ball.fbx"], "only .glb has levels in one file"),
        (["--triangles", "2"], "enclose nothing"),
        (["--size", "huge"], "--size"),
        (["--export", "ball.obj"], "does not end in"),
        (["--sise", "64"], "did you mean '--size'?"),
        (["--degree", "2"], "did you mean '--degrees'?"),
    ],
)
def test_wrong_usage(folder, capfd, more, text):
    assert command.run([*ASSET, *more]) == 2
    (line,) = capfd.readouterr().err.splitlines()
    assert text in line
    assert files(folder) == ["ball.blend"]


def test_without_a_file_no_option_is_named_that_it_refuses(folder, capfd):
    assert command.run([ASSET[0], *ASSET[2:], "--high", "Ball"]) == 1
    assert "There is no scene to bake: give a FILE." in capfd.readouterr().err


def test_without_a_place_for_the_result(folder, capfd):
    assert command.run(ASSET[:-2]) == 2
    assert "--export or --output is required" in capfd.readouterr().err


@pytest.mark.parametrize(
    ("more", "text"),
    [
        (["--high", "Bal"], "did you mean 'Ball_high'"),
        (["--high", "Ball_high", "--low", "Nothing"], "no object called 'Nothing'"),
        (["--udim"], "turn UDIM Tiles and Texture Sets off"),
    ],
)
def test_what_fails_writes_nothing(folder, capfd, more, text):
    assert command.run([*ASSET, *more]) == 1
    assert text in capfd.readouterr().err
    assert files(folder) == ["ball.blend"]


@pytest.mark.slow
def test_a_limit_that_cannot_be_kept_is_the_exit_code(folder, capfd):
    assert command.run([*ASSET, "--distance", "0.0001%", "--report", "report.json"]) == 4
    (entry,) = json.loads((folder / "report.json").read_text())["bakes"]
    (text,) = entry["gate"]
    assert entry["state"] == "gate" and "of the size away" in text and text in capfd.readouterr().err
    assert (folder / "out" / "ball.glb").exists()


def test_a_list_makes_nothing_and_a_second_call_has_nothing_left(folder, capfd):
    assert command.run([*ASSET, "--list"]) == 0
    assert files(folder) == ["ball.blend"] and "ball.glb" in capfd.readouterr().out
    assert command.run([*ASSET, "--resume"]) == 0
    before = (folder / "out" / "ball.glb").stat().st_mtime_ns
    assert command.run([*ASSET, "--resume"]) == 0
    assert "1 done before" in capfd.readouterr().out and (folder / "out" / "ball.glb").stat().st_mtime_ns == before
    assert command.run([*ASSET, "--resume", "--triangles", "100"]) == 0  # other limits are another asset
    assert (folder / "out" / "ball.glb").stat().st_mtime_ns > before


@pytest.mark.parametrize("more", [[], pytest.param(["--own-textures"], marks=pytest.mark.slow)])
def test_levels_lie_in_one_file(folder, more):
    assert command.run([*ASSET, "--levels", "1", "--report", "report.json", *more]) == 0
    maps = ["out/Ball_low.png", "out/Ball_low_LOD1.png"] if more else ["out/ball.png"]
    assert files(folder) == sorted(["ball.blend", *maps, "out/ball.glb", "report.json"])
    (entry,) = json.loads((folder / "report.json").read_text())["bakes"]
    assert [report["triangles"]["low"] for report in entry["reports"]] == [200, 100]
    assert [report["low"] for report in entry["reports"]] == ["Ball_low_LOD0", "Ball_low_LOD1"]
    tree, _ = glb.parse(folder / "out" / "ball.glb")
    assert [node["name"] for node in tree["nodes"]] == ["Ball_low_LOD0", "Ball_low_LOD1"]
    assert len(tree["meshes"]) == 2 and len(tree["images"]) == len(tree["materials"]) == (2 if more else 1)


def test_an_asset_of_a_scene_that_has_it_keeps_its_low_mesh(folder):
    words = [
        "--levels",
        "1",
        "--report",
        "report.json",
        "--save-blend",
        "asset.blend",
        "--size",
        "64",
        "--output",
        "a.png",
    ]
    assert command.run(["asset", "ball.blend", "--triangles", "200", *words]) == 0
    assert command.run(["asset", "asset.blend", *words]) == 0
    (entry,) = json.loads((folder / "report.json").read_text())["bakes"]
    assert [report["low"] for report in entry["reports"]] == ["Ball_low_LOD0", "Ball_low_LOD1"]
    assert entry["reports"][0]["high"] == ["Ball_high"]
    bpy.ops.wm.open_mainfile(filepath=str(folder / "asset.blend"))
    assert sorted(bpy.data.objects.keys()) == ["Ball_high", "Ball_low_LOD0", "Ball_low_LOD1", "Hidden"]


@pytest.mark.slow
def test_a_limit_of_strict_that_is_missed_is_the_exit_code(folder):
    assert command.run([*ASSET, "--strict", "appearance.p99<0.001deg"]) == 4


def mesh(points, faces):
    data = bpy.data.meshes.new("Odd")
    data.from_pydata(np.asarray(points, float).tolist(), [], np.asarray(faces).tolist())
    bpy.context.scene.collection.objects.link(bpy.data.objects.new("Odd", data))
    return data


def loose_quads(count):
    """Unit squares at random places, turned at random."""
    rng = np.random.default_rng(7)
    axes = np.linalg.qr(rng.normal(size=(count, 3, 3)))[0][:, :2]
    corners = np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)]) / 2.0
    points = rng.uniform(-9.0, 9.0, (count, 1, 3)) + np.einsum("kc,ncd->nkd", corners, axes)
    return mesh(points.reshape(-1, 3), np.arange(4 * count).reshape(-1, 4))


def fan(blades):
    """Triangles around one edge."""
    angles = 2.0 * np.pi * np.arange(blades) / blades
    tips = np.stack([np.cos(angles), np.sin(angles), 0.5 + 0.0 * angles], axis=1)
    return mesh([(0, 0, 0), (0, 0, 1), *tips], [(0, 1, 2 + number) for number in range(blades)])


def box(change):
    """A cube without UVs, changed in a way."""
    data = zoo.cube("Odd").data
    data.uv_layers.remove(data.uv_layers[0])
    change(data)


def with_empty_uvs(data):
    data.uv_layers.new(name="Empty").uv.foreach_set("vector", np.zeros(2 * len(data.loops), np.float32))


def with_a_lone_seam(data):
    data.edges[0].use_seam = True


LINE, SQUARE = [(0, 0, 0), (1, 0, 0), (2, 0, 0)], [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)]
NO_AREA = "'Odd' has no faces with an area"
ODD = {
    "no area": (lambda: mesh(LINE, [(0, 1, 2)]), [], 1, NO_AREA),
    "no faces": (lambda: mesh(LINE, np.zeros((0, 3), int)), [], 1, "'Odd' has no faces."),
    "no vertices": (lambda: mesh(np.zeros((0, 3)), np.zeros((0, 3), int)), [], 1, "'Odd' has no faces."),
    "no area, kept": (lambda: mesh(LINE, [(0, 1, 2)]), ["--keep"], 1, "'Odd'"),
    "one triangle": (lambda: mesh(SQUARE, [(0, 1, 2)]), [], 0, 1),
    "one triangle, kept": (lambda: mesh(SQUARE, [(0, 1, 2)]), ["--keep"], 0, 1),
    "flat": (lambda: mesh(SQUARE, [(0, 1, 2, 3)]), [], 0, 2),
    "flat, as quads": (lambda: mesh(SQUARE, [(0, 1, 2, 3)]), ["--quads"], 0, 2),
    "a fan": (lambda: fan(9), [], 0, 9),
    "loose quads": (lambda: loose_quads(1000), ["--triangles", "400", "--size", "256"], 0, 400),
    "loose quads on a small map": (lambda: loose_quads(1000), ["--triangles", "400"], 1, "set a larger map"),
    "empty UVs": (lambda: box(with_empty_uvs), ["--keep"], 0, 12),
    "a lone seam": (lambda: box(with_a_lone_seam), ["--keep"], 0, 12),
    "a limit": (lambda: box(lambda data: None), ["--distance", "1e-9%"], 0, 12),
    "a limit that cannot be met": (lambda: zoo.ball("Odd", 8), ["--distance", "1e-9%"], 4, "of the size away"),
    "many levels": (lambda: box(lambda data: None), ["--levels", "8"], 0, 12),
}
"""What is built, more words, the exit code, and part of the sentence or how many triangles the low mesh has at most."""


@pytest.mark.parametrize("name", lanes.slow_but(["no area", "no faces", "one triangle"], ODD))
def test_odd_input_is_a_mesh_or_a_sentence(folder, capfd, name):
    build, more, code, result = ODD[name]
    build()
    bpy.ops.wm.save_as_mainfile(filepath=str(folder / "odd.blend"))
    words = ["asset", "odd.blend", "--size", "64", "--export", "out/odd.glb", "--report", "report.json", *more]
    found, errors = command.run(words), capfd.readouterr().err
    assert found == code, errors
    assert "Traceback" not in errors
    (entry,) = json.loads((folder / "report.json").read_text())["bakes"]
    if code == 1:
        (line,) = [line for line in errors.splitlines() if "error" in line or "Odd" in line]
        assert result in line and line.endswith(".") and entry["reports"] == []
        assert not (folder / "out").exists()
        return
    assert result in errors if code else entry["reports"][0]["triangles"]["low"] <= 1.02 * result
    tree, _ = glb.parse(folder / "out" / "odd.glb")
    assert len(tree["meshes"]) == len(entry["reports"])
