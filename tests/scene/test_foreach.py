# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests that arrays of what Blender has are as wide and as high as that is."""

import bpy
import numpy as np

from addon.core import foreach


def test_pixels_of_an_image_that_is_not_square():
    image = bpy.data.images.new("wide", 3, 2, float_buffer=True)
    values = np.arange(24, dtype=np.float32) / 32
    image.pixels.foreach_set(values)
    found = foreach.pixels(image)
    assert found.shape == (2, 3, 4)
    assert np.array_equal(found.reshape(-1), values)
