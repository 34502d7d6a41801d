# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests the colors of scans from their files to the map: pages, vertex colors, embedded images, UDIM tiles, missing pages."""

import re

import bpy
import numpy as np
import pytest

from addon.cli import command, run_report
from tests.support import maps, reports, scans

pytestmark = pytest.mark.usefixtures("gpu_context")

STEP = 1.5 / 255.0
"""An error of colors: pages and maps have 8 bits."""
SIDE = 32
WORDS = ["--size", SIDE, "--margin", "0", "--depth", "8", "--maps", "base-color", "--output", "m.png", "--limit", "9"]
FAR = (512_345.0, 5_412_345.0, 312.0)
"""A place in meters as in maps of a country."""


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """The working folder, with a low mesh whose UVs fill the map."""
    monkeypatch.chdir(tmp_path)
    scans.write_obj(tmp_path / "low.obj", scans.strips(1))
    return tmp_path


@pytest.fixture
def colors(folder, capsys):
    """A function that bakes files. It returns the base color map (SIDE, SIDE, 3), as stored, and the standard error."""

    def bake(high, *words, low="low.obj"):
        code = command.run([str(word) for word in ("--low-file", low, "--high-file", high, *WORDS, *words)])
        err = capsys.readouterr().err
        assert code == run_report.DONE, err
        image = bpy.data.images.load(str(folder / "m_base_color.png"))
        image.colorspace_settings.is_data = True
        return maps.pixels(image)[..., :3], err

    return bake


def check_strips(found, expected):
    """Check the color in the middle of each strip along u."""
    width = SIDE // len(expected)
    for number, color in enumerate(expected):
        inside = found[4:-4, number * width + 2 : (number + 1) * width - 2]
        assert np.abs(inside - color).max() < STEP


@pytest.fixture
def paged(folder):
    """A function that writes a scan with four pages, and returns its file's name."""

    def write(place=(0.0, 0.0, 0.0), missing=()):
        materials = [f"m{number}" for number in range(4)]
        for number, color in enumerate(scans.COLORS):
            if number not in missing:
                scans.texture(folder / f"scan_u{number + 1}_v1_diffuse.png", color)
        said = {name: f"D:\\scans\\SCAN_u{number + 1}_v1_diffuse.png" for number, name in enumerate(materials)}
        scans.write_library(folder / "scan.mtl", said)
        surface = scans.strips(4, place, height=0.02, n=16)
        scans.write_obj(folder / "scan.obj", surface, materials=materials, library="scan.mtl")
        return "scan.obj"

    return write


@pytest.mark.parametrize("method", ["cast", "flatten"])
def test_each_page_shows_where_its_material_is(paged, colors, method):
    check_strips(colors(paged(), "--method", method)[0], scans.COLORS)


def test_a_far_scan_has_the_same_colors(folder, paged, colors):
    scans.write_obj(folder / "far.obj", scans.strips(1, FAR))
    check_strips(colors(paged(FAR), "--method", "cast", low="far.obj")[0], scans.COLORS)


def test_a_far_scan_of_several_objects(folder, paged, colors):
    """As programs write them that cut large scans into parts."""
    scans.write_obj(folder / "far.obj", scans.strips(1, FAR))
    scan = folder / paged(FAR)
    scan.write_text(re.sub(r"^usemtl m(\d)", r"o part \1\nusemtl m\1", scan.read_text(), flags=re.MULTILINE))
    found, err = colors(scan, "--method", "cast", "--report", "r.json", low="far.obj")
    check_strips(found, scans.COLORS)
    assert err == ""
    assert reports.one(folder / "r.json")["high"] == [f"part {number}" for number in range(4)]


def test_missing_pages_are_left_out_if_that_is_allowed(folder, paged, colors):
    found, err = colors(paged(missing=[1]), "--method", "cast", "--allow-missing-files")
    (line,) = err.splitlines()
    assert line.startswith('imprint: warning: Material "m1": Base Color')
    assert str(folder / "SCAN_u2_v1_diffuse.png") in line
    width = SIDE // 4
    for number in (0, 2, 3):
        inside = found[4:-4, number * width + 2 : (number + 1) * width - 2]
        assert np.abs(inside - scans.COLORS[number]).max() < STEP


def test_a_missing_library_is_named_once(folder, paged, colors):
    name = paged()
    (folder / "scan.mtl").unlink()
    _, err = colors(name, "--method", "cast", "--allow-missing-files")
    assert err == (
        f"imprint: warning: 1 file of the high meshes' materials cannot be found: {str(folder / 'scan.mtl')!r}.\n"
    )


def test_embedded_images_of_a_glb(folder, paged, colors):
    bpy.ops.wm.obj_import(filepath=str(folder / paged()))
    for material in bpy.data.materials:
        for node in material.node_tree.nodes:
            if node.type == "TEX_IMAGE":
                number = int(node.image.filepath.split("_u")[1][0])
                node.image = bpy.data.images.load(str(folder / f"scan_u{number}_v1_diffuse.png"))
    bpy.ops.export_scene.gltf(filepath=str(folder / "scan.glb"))
    for page in folder.glob("scan_u*"):
        page.unlink()
    check_strips(colors("scan.glb", "--method", "cast")[0], scans.COLORS)


def test_tiles_of_one_material(folder, colors):
    for tile, color in zip((1001, 1002, 1011), scans.COLORS, strict=False):
        scans.texture(folder / f"page_{tile}.png", color)
    scans.write_library(folder / "scan.mtl", {"m": "page_1001.png"})
    offsets = [(0, 0), (1, 0), (0, 1)]
    surface = scans.strips(3, height=0.02, n=16)
    scans.write_obj(folder / "scan.obj", surface, materials=["m"] * 3, library="scan.mtl", uv_offsets=offsets)
    found, _ = colors("scan.obj", "--method", "cast")
    for u, color in zip((4, 15, 26), scans.COLORS, strict=False):
        assert np.abs(found[4:-4, u] - color).max() < STEP


def test_vertex_colors_of_a_ply(folder, colors):
    """They are stored as sRGB, and are linear in the file's coordinates where they do not differ."""
    points, _, parts = scans.strips(2, height=0.02, n=16)
    stored = np.array([230, 26, 51]), np.array([51, 204, 26])
    values = np.where(points[:, :1] < -0.1, *stored).astype(np.uint8)
    scans.write_ply(folder / "scan.ply", points, np.concatenate(parts), colors=values)
    found, _ = colors("scan.ply", "--method", "cast", "--high-up", "z")
    assert np.abs(found[4:-4, 2:12] * 255.0 - stored[0]).max() < 255.0 * STEP
    assert np.abs(found[4:-4, 18:-2] * 255.0 - stored[1]).max() < 255.0 * STEP


def test_a_ply_with_an_image_and_uvs_by_face(folder, colors):
    points, uv, parts = scans.strips(2, height=0.02, n=16)
    faces = np.concatenate([quads[:, [0, 1, 2, 0, 2, 3]].reshape(-1, 3) for quads in parts])
    images = np.repeat([0, 1], len(faces) // 2)
    for number in range(2):
        scans.texture(folder / f"page{number}.png", scans.COLORS[number])
    scans.write_textured_ply(folder / "scan.ply", (points, faces, uv[faces]), images, ["page0.png", "page1.png"])
    check_strips(colors("scan.ply", "--method", "cast")[0], scans.COLORS[:2])
