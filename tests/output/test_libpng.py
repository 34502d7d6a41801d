# SPDX-License-Identifier: GPL-3.0-or-later
"""libpng reads the PNG files that Imprint writes. It is another reader than Blender and Pillow, where a system has it."""

import ctypes
import ctypes.util

import numpy as np
import pytest

from addon.output import png_writer


class _Simple(ctypes.Structure):
    """png_image of libpng's simplified interface."""

    _fields_ = (
        ("opaque", ctypes.c_void_p),
        *((name, ctypes.c_uint32) for name in ("version", "width", "height", "format", "flags", "colormap")),
        ("warning", ctypes.c_uint32),
        ("message", ctypes.c_char * 64),
    )


@pytest.mark.parametrize("size", [(1, 1), (1, 7), (300, 1), (17, 33), (700, 500)], ids=str)
def test_libpng_reads_the_bytes_seed_7(size, tmp_path):
    name = ctypes.util.find_library("png16")
    if name is None:
        pytest.skip("libpng is not installed")
    library = ctypes.CDLL(name)
    width, height = size
    texels = np.random.default_rng(7).random((height, width, 4), np.float32)
    made = png_writer.content(texels, 8, has_alpha=True)
    made.write(tmp_path / "map.png", (part() for part in made.parts))
    data = (tmp_path / "map.png").read_bytes()
    image = _Simple(version=1)
    assert library.png_image_begin_read_from_memory(ctypes.byref(image), data, ctypes.c_size_t(len(data)))
    image.format = 3  # red, green, blue and alpha of 8 bits
    found = np.zeros((height, width, 4), np.uint8)
    end_read = library.png_image_finish_read
    assert end_read(ctypes.byref(image), None, found.ctypes.data_as(ctypes.c_void_p), ctypes.c_int32(0), None)
    assert (image.width, image.height, image.message) == (*size, b"")
    np.testing.assert_array_equal(found, np.floor(texels[::-1] * np.float32(255) + np.float32(0.5)))
