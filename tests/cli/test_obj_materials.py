# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests the material libraries of .obj files: which are found, which images they name, and what the importer gets."""

import os
from pathlib import Path

import numpy as np
import pytest

from addon.cli import importers
from addon.core.file_structure import mesh_references


@pytest.fixture
def folder(tmp_path):
    for name in ("a.png", "b c.png", "-odd.png", "s 1 2.png"):
        (tmp_path / name).write_bytes(b"page")
    return tmp_path


def read(folder, library, head="mtllib m.mtl\n"):
    """The lines of the library that the importer gets, and the names of the images' files by placeholder."""
    (folder / "m.mtl").write_bytes(library.encode() if isinstance(library, str) else library)
    (folder / "scan.obj").write_text(head + "v 0 0 0\n")
    found = importers.read_materials(folder / "scan.obj")
    files = {name: page.path.name if page.path else page.name for name, page in found.placeholders.items()}
    return found.content.decode(errors="surrogateescape").splitlines(), files


IMAGES = {
    "map_Kd a.png": ("map_Kd", "a.png"),
    "  map_Kd   b c.png": ("map_Kd", "b c.png"),
    "map_Kd\tA.PNG": ("map_Kd", "a.png"),
    "map_Bump -bm 0.5 b c.png": ("map_Bump -bm 0.5", "b c.png"),
    "map_Kd -s 1 2 3 -clamp on a.png": ("map_Kd -s 1 2 3", "a.png"),
    "map_Kd -colorspace sRGB -o 1 2 b c.png": ("map_Kd -o 1 2", "b c.png"),
    "map_Kd -blendu on -odd none.png": ("map_Kd", "none.png"),
    "map_Kd -s": ("map_Kd", "-s"),
    "refl -type sphere a.png": ("refl -type sphere", "a.png"),
    "map_Kd -o 0.5 a.png": ("map_Kd -o 0.5", "a.png"),
    "map_Kd -odd.png": ("map_Kd", "-odd.png"),
    'map_Kd "b c.png"': ("map_Kd", "b c.png"),
    "norm C:\\scans\\a.png": ("norm", "a.png"),
}


@pytest.mark.parametrize("line", IMAGES)
def test_the_image_of_a_line_is_found_after_its_options(folder, line):
    (first, second, *_), files = read(folder, f"newmtl x\n{line}\n")
    ((placeholder, name),) = files.items()
    assert first == "newmtl x"
    assert (second, name) == (f"{IMAGES[line][0]} {placeholder}", IMAGES[line][1])


@pytest.mark.parametrize("line", IMAGES)
def test_planning_knows_the_files_that_the_importer_gets(folder, line):
    """But for other spellings, which are looked for when the file is imported."""
    _, files = read(folder, f"newmtl x\n{line}\n")
    known = {path.name.lower() for path in mesh_references.of(str(folder / "scan.obj"))}
    assert {"m.mtl", *(name.lower() for name in files.values())} <= known


def test_planning_reads_no_points(folder):
    names = "mtllib m.mtl\n", "mtllib other.mtl\n"
    points = "v 1 2 3\n" * 100
    for head, expected in ((names[0] + points + names[1], ["m.mtl", "other.mtl"]), (points + names[1], [])):
        (folder / "scan.obj").write_text(head)
        assert mesh_references.libraries(folder / "scan.obj", is_whole=False) == expected


@pytest.mark.parametrize("name", ["/", ".", "..", '""', "-clamp on ./"])
def test_a_line_that_names_no_image_is_left_out(folder, name):
    assert read(folder, f"newmtl x\nmap_Kd {name}\n") == (["newmtl x", ""], {})


def test_other_lines_stay_byte_by_byte(folder):
    lines, files = read(folder, b"\xef\xbb\xbfnewmtl na\xefve\r\nKd 0.5 0.5 0.5\r\n\r\n# map_Kd a.png\r\nmap_Kd\r\n")
    assert lines == ["newmtl na\udcefve", "Kd 0.5 0.5 0.5", "", "# map_Kd a.png", "map_Kd"]
    assert files == {}


def test_a_page_of_several_materials_has_one_placeholder_for_each_use(folder):
    """An image that is used as a color and as numbers is decoded in two ways."""
    library = (
        "newmtl x\nmap_Kd a.png\nnewmtl y\nmap_kd A.png\nmap_Pr a.png\nnewmtl z\nmap_Kd none.png\nmap_Kd ./none.png\n"
    )
    (folder / "m.mtl").write_text(library)
    (folder / "scan.obj").write_text("mtllib m.mtl\n")
    pages = importers.read_materials(folder / "scan.obj").placeholders.values()
    assert [(page.name, page.is_color, page.path is None) for page in pages][:2] == [
        ("a.png", True, False),
        ("a.png", False, False),
    ]
    assert {page.name for page in pages if page.path is None} == {"none.png", "./none.png"}


LIBRARIES = {
    "mtllib m.mtl\n": [],
    "# a comment about mtllib none.mtl\nmtllib M.MTL\n": [],
    "mtllib C:\\scans\\m.mtl\n": [],
    "mtllib m.mtl m.mtl\n": [],
    "mtllib none.mtl\nmtllib m.mtl\n": ["none.mtl"],
    "mtllib\n": [],
    "": [],
}


@pytest.mark.parametrize("head", LIBRARIES)
def test_missing_libraries_are_named(folder, head):
    lines, _ = read(folder, "newmtl x\n", head)
    assert importers.missing_libraries(folder / "scan.obj") == LIBRARIES[head]
    assert lines == (["newmtl x"] if "m.mtl" in head.lower().replace("none.mtl", "") else [])


def test_a_library_with_the_name_of_the_obj_counts(folder):
    """As in Blender's importer."""
    (folder / "SCAN.mtl").write_text("newmtl own\n")
    assert read(folder, "newmtl x\n", "mtllib none.mtl\n")[0] == ["newmtl own"]
    assert importers.missing_libraries(folder / "scan.obj") == []
    (folder / "scan.mtl").write_text("newmtl own\nmap_Kd own.png\n")
    assert folder / "own.png" in mesh_references.of(str(folder / "scan.obj"))


def test_a_library_is_found_far_into_a_large_file(folder):
    head = "v 1 2 3\n" * 100_000
    assert read(folder, "newmtl x\n", f"{head}mtllib m.mtl\n{head}")[0] == ["newmtl x"]


@pytest.mark.parametrize("seed", range(20))
def test_random_libraries_never_fail_by_seed(folder, seed):
    random = np.random.default_rng(seed)
    words = [
        "newmtl",
        "map_Kd",
        "norm",
        "-bm",
        "-s",
        "1",
        "a.png",
        "none.png",
        "\\",
        '"',
        "\t",
        "\0",
        "\r",
        "é",
        "<UDIM>",
    ]
    text = "".join(" \n"[int(random.integers(8) == 0)] + words[random.integers(len(words))] for _ in range(400))
    content, files = read(folder, text.encode("latin1" if seed % 2 else "utf-8"))
    assert len([line for line in content if "imprint-image-" in line]) >= len(files)


@pytest.mark.skipif(not os.path.exists("/proc/self/mem"), reason="the files of Linux about processes")
def test_a_library_that_cannot_be_read_is_named_nevertheless(folder):
    """So that planning can refuse it."""
    (folder / "scan.obj").write_text("mtllib m.mtl\nmtllib /proc/self/mem\nv 0 0 0\n")
    (folder / "m.mtl").write_text("newmtl x\nmap_Kd a.png\n")
    found = list(mesh_references.of(str(folder / "scan.obj")))
    assert {Path("/proc/self/mem"), folder / "a.png"} <= set(found)
