# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests that images of mesh files are found by names from other machines, and that missing ones are not."""

import pytest

from addon.core.file_structure import found_files


@pytest.fixture
def folder(tmp_path):
    """A folder with pages, as programs for scans name them."""
    (tmp_path / "Textures").mkdir()
    pages = ["Scan_u1_v1_diffuse.png", "my scan 2.jpg", "Textures/model0.jpg", "tile_1001.png", "tile_1003.png"]
    for name in pages:
        (tmp_path / name).write_bytes(b"page")
    (tmp_path / "empty.png").touch()
    (tmp_path / "folder.png").mkdir()
    return tmp_path


FOUND = {
    "Scan_u1_v1_diffuse.png": "Scan_u1_v1_diffuse.png",
    "scan_U1_v1_diffuse.PNG": "Scan_u1_v1_diffuse.png",
    "my scan 2.jpg": "my scan 2.jpg",
    '"my scan 2.jpg"': "my scan 2.jpg",
    "  my scan 2.jpg ": "my scan 2.jpg",
    "Textures/model0.jpg": "Textures/model0.jpg",
    "textures\\Model0.jpg": "Textures/model0.jpg",
    ".\\textures\\model0.jpg": "Textures/model0.jpg",
    "C:\\Users\\me\\my scan 2.jpg": "my scan 2.jpg",
    "D:\\scans\\Textures\\model0.jpg": "Textures/model0.jpg",
    "/home/me/scans/Textures/model0.jpg": "Textures/model0.jpg",
    "../elsewhere/tile_1001.png": "tile_1001.png",
    "tile_<UDIM>.png": "tile_<UDIM>.png",
    "TILE_<UDIM>.PNG": "tile_<UDIM>.png",
    "E:\\x\\tile_<UDIM>.png": "tile_<UDIM>.png",
}


@pytest.mark.parametrize("name", FOUND)
def test_a_page_is_found(folder, name):
    assert found_files.find_file(name, [folder]) == folder / FOUND[name]


@pytest.mark.parametrize(
    "name", ["none.png", "empty.png", "folder.png", "", "/", "C:\\", "a\0b.png", "none_<UDIM>.png", "x" * 5000, ".."]
)
def test_a_missing_page_is_not_found(folder, name):
    assert found_files.find_file(name, [folder]) is None


def test_a_path_of_this_machine_comes_before_a_file_with_its_name(folder, tmp_path_factory):
    other = tmp_path_factory.mktemp("other") / "my scan 2.jpg"
    other.write_bytes(b"other")
    assert found_files.find_file(str(other), [folder]) == other


def test_the_exact_letter_case_comes_first(folder):
    (folder / "MY SCAN 2.JPG").write_bytes(b"another")
    # On file systems that ignore the letter case, this is the same file.
    assert found_files.find_file("my scan 2.jpg", [folder]).name == "my scan 2.jpg"


def test_the_tiles_of_a_page_are_listed(folder):
    (folder / "tile_1002.png").touch()  # empty
    (folder / "tile_10010.png").write_bytes(b"page")
    assert found_files.existing_tiles(folder / "tile_<UDIM>.png") == [1001, 1003]


@pytest.mark.parametrize(
    ("name", "tiled"),
    [("scan_1001.png", "scan_<UDIM>.png"), ("a.1012.jpg", "a.<UDIM>.jpg"), ("x21001.png", None), ("u1_v1.png", None)],
)
def test_numbered_pages_are_tiles(folder, name, tiled):
    assert found_files.tiled_path(folder / name) == (tiled and folder / tiled)


@pytest.mark.parametrize(
    ("name", "place"),
    [("a.png", "a.png"), ("x\\A b.png", "x/A b.png"), ("D:\\scans\\a.png", "a.png"), ("/home/me/a.png", "a.png")],
)
def test_a_missing_page_is_expected_beside_the_mesh_file(folder, name, place):
    assert found_files.expected_path(name, folder) == folder / place
