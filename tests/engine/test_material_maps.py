# SPDX-License-Identifier: GPL-3.0-or-later
"""Whole bakes of what the high meshes' materials show, compared with the closed form of the picture on them."""

import bpy
import numpy as np
import pytest

from tests.support import layouts, zoo
from tests.support.layouts import Layout
from tests.support.maps import bake_all_maps

pytestmark = pytest.mark.usefixtures("gpu_context")

SIZE = 96
LOW = Layout(degrees=24.0, scale=0.34)
PAINT = Layout(degrees=-37.0, is_mirrored=True, scale=0.31, center=(0.47, 0.55))
FIELDS, DARK, BRIGHT = 10, 0.2, 0.8
METHODS = ("FLATTEN", "CAST")
WITHIN = 0.5
"""Texels from a border of fields within which a texel may show either field."""
EXACT = 1e-3
"""How far a color may be off, scene-linear, away from borders: coordinates are float32, pages of bytes have 8 bits."""


def pair(material, *, low=LOW, paint=PAINT, n=1):
    """A low square, and a high one that has the low layout too, for Flatten, and a layer for images that is rendered."""
    high = layouts.square("hi", {zoo.LAYER: low, layouts.PAINT: paint}, n=n, z=0.01)
    if material is not None:
        high.data.materials.append(material)
    return layouts.square("lo", {zoo.LAYER: low}), high


def checkered(name="checker", socket="Base_Color", *, dark=DARK, bright=BRIGHT, **properties):
    found = bpy.data.materials.new(name)
    shown = layouts.image(name, layouts.checker(FIELDS, 24, dark=dark, bright=bright))
    layouts.set_inputs(found, **{socket: layouts.texture(found, shown, **properties).outputs["Color"]})
    return found


def assert_shows_checker(texels, *, low=LOW, paint=PAINT, dark=DARK, bright=BRIGHT, size=SIZE):
    """Each texel shows the field at its center, unless a border is within half a texel."""
    points, inside = low.texels(size)
    is_bright, to_border = layouts.fields_at(paint.uv(points), FIELDS)
    to_border *= size * low.scale / (FIELDS * paint.scale)  # texels
    middle = 0.5 * (layouts.linear(dark) + layouts.linear(bright))
    inner = inside & (to_border > WITHIN)
    assert inner.mean() > 0.25
    assert ((texels[..., 0] > middle) == is_bright)[inner].all()
    expected = np.where(is_bright, layouts.linear(bright), layouts.linear(dark))[..., None]
    clear = inside & (to_border > 1.0)
    assert clear.mean() > 0.2
    assert np.abs(texels[..., :3] - expected)[clear].max() < EXACT
    assert (texels[..., 3] == 1.0)[inside].all()


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("samples", [1, 4, 16])
def test_a_checker_comes_back_to_half_a_texel(method, samples):
    _, maps = bake_all_maps(*pair(checkered()), maps=["BASE_COLOR"], size=SIZE, method=method, samples=samples)
    assert_shows_checker(maps["base_color"])
