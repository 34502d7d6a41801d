# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests that libraries are found in .blend files of all formats: block heads of 4.x and 5.x, 32 and 64 bits, either order."""

import struct

import pytest

from addon.core.file_structure import blend_files

LIBRARY = b"lib.blend\0" + b"//parts/lib.blend\0" + bytes(8)
HEADS = {
    b"BLENDER-v279": "<4siQii",
    b"BLENDER_v249": "<4siIii",
    b"BLENDER-V263": ">4siQii",
    b"BLENDER_V263": ">4siIii",
    b"BLENDER-v405": "<4siQii",
    b"BLENDER17-01v0500": "<4siQqq",
}
"""The start of a file, and the layout of its block heads: code, size, old address, type, count; from 5.0 on code, type, old
address, size, count."""


def block(start, code, content):
    size = len(content)
    # Other values than the size are so large that they would lead out of the file.
    values = (77777, 88888, size, 99999) if "q" in HEADS[start] else (size, 88888, 77777, 99999)
    return struct.pack(HEADS[start], code, *values) + content


@pytest.mark.parametrize("start", HEADS)
def test_libraries_are_found_between_other_blocks(tmp_path, start):
    path = tmp_path / "scene.blend"
    decoy = b"//not/a/library.blend\0"
    path.write_bytes(
        start
        + block(start, b"REND", decoy)
        + block(start, b"LI\0\0", LIBRARY)
        + block(start, b"LIB\0", decoy)
        + block(start, b"LI\0\0", LIBRARY.replace(b"parts", b"other"))
        + block(start, b"ENDB", b"")
        + block(start, b"LI\0\0", decoy)
    )
    assert blend_files.libraries(path) == [tmp_path / "parts/lib.blend", tmp_path / "other/lib.blend"]


@pytest.mark.parametrize(
    "start", [b"", b"BLENDER", b"BLENDER+v405", b"BLENDER17-01", b"BLENDER18-01v0600", b"PK\3\4 and so on"]
)
def test_other_files_have_none(tmp_path, start):
    path = tmp_path / "scene.blend"
    path.write_bytes(start + block(b"BLENDER-v405", b"LI\0\0", LIBRARY))
    assert blend_files.libraries(path) == []


@pytest.mark.parametrize("start", HEADS)
def test_a_file_that_breaks_off_has_none(tmp_path, start):
    path = tmp_path / "scene.blend"
    path.write_bytes(start + block(start, b"LI\0\0", LIBRARY)[: -len(LIBRARY)])
    assert blend_files.libraries(path) == []
