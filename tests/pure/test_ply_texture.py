# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests that UVs by face are read from .ply files only where they are certain."""

import numpy as np
import pytest

from addon.core.file_structure import ply_files
from tests.support import random_cases

HEAD = (
    "ply\nformat {form} 1.0\ncomment TextureFile my page.png\nelement vertex 3\nproperty float x\nproperty float y\n"
    "property float z\nelement face {count}\nproperty list uchar int vertex_indices\nproperty list uchar float texcoord\n"
    "end_header\n"
)
POINTS = "0 0 0\n1 0 0\n0 1 0\n"


def read(tmp_path, text):
    (tmp_path / "scan.ply").write_bytes(text if isinstance(text, bytes) else text.encode())
    return ply_files.read_texture(tmp_path / "scan.ply")


def test_uvs_of_triangles_are_read(tmp_path):
    found = read(tmp_path, HEAD.format(form="ascii", count=1) + POINTS + "3 0 1 2 6 0 0 1 0 0 0.5\n")
    assert found.names == ["my page.png"]
    assert found.corners.tolist() == [[0, 1, 2]]
    assert found.uv.tolist() == [[[0, 0], [1, 0], [0, 0.5]]]
    assert found.images.tolist() == [0]


OTHERS = {
    "a triangle without UVs": "3 0 1 2 0\n3 0 1 2 6 0 0 1 0 0 1\n",
    "a quad": "4 0 1 2 0 8 0 0 1 0 0 1 1 1\n3 0 1 2 6 0 0 1 0 0 1\n",
    "words": "3 0 1 2 6 a b c d e f\n3 0 1 2 6 0 0 1 0 0 1\n",
    "nothing": "",
}


@pytest.mark.parametrize("case", OTHERS)
def test_other_faces_have_no_uvs(tmp_path, case):
    found = read(tmp_path, HEAD.format(form="ascii", count=2) + POINTS + OTHERS[case])
    assert found.names == ["my page.png"]
    assert found.uv is None or len(found.uv) == 0


def test_a_truncated_binary_file_has_no_uvs(tmp_path):
    head = HEAD.format(form="binary_little_endian", count=1).encode()
    points = np.zeros((3, 3), "<f4").tobytes()
    face = np.array([(3, (0, 1, 2), 6, (0.5,) * 6)], "u1,(3,)<i4,u1,(6,)<f4").tobytes()
    assert read(tmp_path, head + points + face).uv.tolist() == [[[0.5, 0.5]] * 3]
    assert read(tmp_path, head + points + face[:-1]).uv is None
    assert read(tmp_path, head + points + face.replace(b"\3", b"\4", 1)).uv is None


def test_a_file_without_images_has_no_texture(tmp_path):
    text = HEAD.format(form="ascii", count=0).replace("comment TextureFile my page.png\n", "")
    assert read(tmp_path, text) is None
    for content in (
        b"",
        b"ply\n",
        b"\0" * 100_000,
        b"ply\nformat ascii 1.0\nelement vertex 9\nproperty word x\nend_header\n",
    ):
        assert read(tmp_path, content) is None


@random_cases.seeds(20, fast=2)
def test_random_headers_never_fail_by_seed(tmp_path, seed):
    random = np.random.default_rng(seed)
    words = [
        "ply",
        "format",
        "ascii",
        "1.0",
        "element",
        "vertex",
        "face",
        "3",
        "property",
        "list",
        "uchar",
        "float",
        "x",
    ]
    words += [
        "texcoord",
        "vertex_indices",
        "comment",
        "TextureFile",
        "a.png",
        "end_header",
        "é",
        "-1",
        "99999999999999999999",
    ]
    lines = [" ".join(words[random.integers(len(words))] for _ in range(random.integers(1, 6))) for _ in range(30)]
    lines = ["ply", "format ascii 1.0", "comment TextureFile a.png", *lines, "end_header", "1 2 3"]
    (tmp_path / "scan.ply").write_text("\n".join(lines))
    ply_files.read_header(tmp_path / "scan.ply")
    ply_files.read_texture(tmp_path / "scan.ply")
