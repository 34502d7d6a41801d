# SPDX-License-Identifier: GPL-3.0-or-later
"""High files that do not say how they are shaded are smooth below an angle; all others are as they say."""

import json
from pathlib import Path

import bpy
import numpy as np
import pytest

from addon import api
from addon.cli import command, run_report
from addon.core.file_formats import SMOOTH_BELOW
from addon.scene.importing import PLAIN, import_file, lacks_normals, smooth
from tests.support import angles, scenes, zoo

pytestmark = pytest.mark.usefixtures("gpu_context")

FLAT, SMOOTH = 0.8, 0.2
"""Degrees. Over edges of 1/24 the wave's normals turn by 3.8 degrees at most and 1.5 in the mean. Those of a facet are off by
half of it at the corners; those at vertices, and between them, by the square of it."""


def wave(n=48):
    """A smooth surface: points (P, 3), triangles (T, 3), and normals (P, 3) by its closed form."""
    x, y = np.meshgrid(np.linspace(-1, 1, n + 1), np.linspace(-1, 1, n + 1))
    points = np.stack([x, y, 0.1 * np.sin(4 * x) * np.cos(3 * y)], -1).reshape(-1, 3)
    slopes = np.stack([-0.4 * np.cos(4 * x) * np.cos(3 * y), 0.3 * np.sin(4 * x) * np.sin(3 * y), np.ones_like(x)], -1)
    normals = (slopes / np.linalg.norm(slopes, axis=-1, keepdims=True)).reshape(-1, 3)
    i = np.arange((n + 1) ** 2).reshape(n + 1, n + 1)[:-1, :-1].ravel()
    return points, np.concatenate([np.c_[i, i + 1, i + n + 2], np.c_[i, i + n + 2, i + n + 1]]), normals


def lines(word, rows):
    return "".join(f"{word}{' '.join(f'{value:.7g}' for value in row)}\n" for row in rows)


def stl(points, triangles, normals=None):
    facets = "".join(
        f"facet normal 0 0 0\nouter loop\n{lines('vertex ', points[t])}endloop\nendfacet\n" for t in triangles
    )
    return f"solid s\n{facets}endsolid s\n"


def ply(points, triangles, normals=None):
    names = "x y z" if normals is None else "x y z nx ny nz"
    head = "".join(f"property float {name}\n" for name in names.split())
    rows = points if normals is None else np.hstack([points, normals])
    return (
        f"ply\nformat ascii 1.0\nelement vertex {len(points)}\n{head}element face {len(triangles)}\n"
        f"property list uchar int vertex_indices\nend_header\n{lines('', rows)}{lines('3 ', triangles)}"
    )


def obj(points, triangles, normals=None, shading=""):
    if normals is None:
        return lines("v ", points) + shading + lines("f ", triangles + 1)
    faces = "".join(f"f {' '.join(f'{i}//{i}' for i in t)}\n" for t in triangles + 1)
    return lines("v ", points) + lines("vn ", normals) + shading + faces


WRITERS = {".stl": stl, ".ply": ply, ".obj": obj}


def written(folder, ending, *args, **more):
    path = Path(folder, f"high{ending}")
    path.write_text(WRITERS[ending](*args, **more))
    return path


def corner_normals(path):
    (found,) = import_file(path, PLAIN)
    if lacks_normals(path, found.data):
        smooth(found.data, SMOOTH_BELOW)
    values = np.empty((len(found.data.loops), 3), np.float32)
    found.data.corner_normals.foreach_get("vector", values.ravel())
    return values, found.data


@pytest.fixture
def low_file(tmp_path):
    scenes.select(zoo.plane("low"))
    path = tmp_path / "low.ply"
    bpy.ops.wm.ply_export(filepath=str(path))
    return path


def error(path, low, **more):
    """The degrees by which an object-space map is off the wave, as a median, and the report."""
    result = api.bake(str(low), str(path), size=64, space="world", samples=1, extrusion=0.3, max_distance=0.6, **more)
    x = (np.arange(64) + 0.5) / 32 - 1
    x, y = np.meshgrid(x, x)
    truth = np.stack([-0.4 * np.cos(4 * x) * np.cos(3 * y), 0.3 * np.sin(4 * x) * np.sin(3 * y), np.ones_like(x)], -1)
    found = result.maps["normal"][..., :3] * 2 - 1
    off = angles.degrees(found, truth / np.linalg.norm(truth, axis=-1, keepdims=True))
    return float(np.median(off)), result


@pytest.mark.parametrize("ending", WRITERS)
def test_a_file_that_stores_no_normals_is_smooth_and_says_so(ending, tmp_path, low_file):
    path = written(tmp_path, ending, *wave()[:2])
    if ending == ".obj":  # Blender expects Y up in it
        points, triangles, _ = wave()
        path = written(tmp_path, ending, np.stack([points[:, 0], points[:, 2], -points[:, 1]], -1), triangles)
    off, result = error(path, low_file)
    assert off < SMOOTH, off
    assert list(result.report["smooth_files"].values()) == [SMOOTH_BELOW]
    assert not any("normals" in warning for warning in result.warnings)
    flat, result = error(path, low_file, smooth_files=0)
    assert flat > FLAT, flat
    assert result.report["smooth_files"] == {}


def test_hard_edges_stay_hard(tmp_path):
    """A prism of 8 sides, whose sides meet by 45 degrees as chamfers do."""
    around = np.arange(8) * np.pi / 4
    ring = np.stack([np.cos(around), np.sin(around)], -1)
    points = np.concatenate([np.c_[ring, np.zeros(8)], np.c_[ring, np.ones(8)]])
    i, j = np.arange(8), np.roll(np.arange(8), -1)
    triangles = np.concatenate([np.c_[i, j, j + 8], np.c_[i, j + 8, i + 8]])
    for ending in WRITERS:
        normals, data = corner_normals(written(tmp_path, ending, points, triangles))
        faces = np.empty((len(data.polygons), 3), np.float32)
        data.polygons.foreach_get("normal", faces.ravel())
        assert np.abs(normals - np.repeat(faces, 3, axis=0)).max() < 1e-6


@pytest.mark.parametrize(
    ("ending", "more"),
    [
        (".ply", {"normals": True}),
        (".obj", {"normals": True}),
        (".obj", {"shading": "s off\n"}),
        (".obj", {"shading": "s 1\n"}),
        (".obj", {"normals": True, "shading": "s 0\n"}),
    ],
)
def test_a_file_that_says_how_it_is_shaded_is_left_alone(ending, more, tmp_path):
    points, triangles, normals = wave(4)
    path = written(tmp_path, ending, points, triangles, **more | ({"normals": normals} if "normals" in more else {}))
    (found,) = import_file(path, PLAIN)
    assert not lacks_normals(path, found.data)


def test_gltf_without_normals_is_flat_as_it_says(tmp_path):
    zoo.terrain("high", 4)
    path = tmp_path / "high.glb"
    bpy.ops.export_scene.gltf(filepath=str(path), export_normals=False)
    (found,) = import_file(path, PLAIN)
    assert not lacks_normals(path, found.data)


def test_the_command_tells_and_switches(tmp_path, low_file, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    written(tmp_path, ".ply", *wave(8)[:2])
    words = [
        "--low-file",
        "low.ply",
        "--high-file",
        "high.ply",
        "--output",
        "m.png",
        "--size",
        "32",
        "--extrusion",
        "0.3",
    ]
    words += ["--max-distance", "0.6", "--method", "cast", "--report", "r.json", "--strict", "warnings=0"]
    for more, degrees in (([], SMOOTH_BELOW), (["--smooth-files", "60"], 60), (["--smooth-files", "0"], 0)):
        capsys.readouterr()
        assert command.run([*words, *more]) == run_report.DONE
        out = capsys.readouterr().out
        assert (f"edges below {degrees} degrees are smooth" in out) == bool(degrees)
        (bake,) = json.loads(Path("r.json").read_text())["bakes"]
        assert bake["reports"][0]["smooth_files"] == ({"high": degrees} if degrees else {})
    assert command.run([*words, "--smooth-files", "181"]) == run_report.WRONG_USAGE


def test_the_smoothing_of_normals_works_on_such_a_file(tmp_path, low_file):
    """Facets have hard edges alone, over which nothing is smoothed."""
    path = written(tmp_path, ".stl", *wave()[:2])
    _, result = error(path, low_file, smooth_high=1)
    assert result.report["mended"]["smoothed_median"] > 0.01
    _, result = error(path, low_file, smooth_high=1, smooth_files=0)
    assert result.report["mended"].get("smoothed_median", 0.0) < 1e-3
