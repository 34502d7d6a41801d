# SPDX-License-Identifier: GPL-3.0-or-later
"""Reads image files as other programs do: with OpenImageIO, and with Pillow if it supports the format."""

import importlib
import sys
from pathlib import Path

import bpy
import numpy as np
from PIL import Image


def _openimageio():
    """The OpenImageIO module of Blender's Python."""
    folder = next(Path(bpy.utils.resource_path("LOCAL"), "python").rglob("site-packages"))
    sys.path.append(str(folder))
    try:
        return importlib.import_module("OpenImageIO")
    finally:
        sys.path.remove(str(folder))


def read(path) -> np.ndarray:
    """The stored values (H, W, 4) of a file, in its own type, row 0 at v = 0; (H, W, 1) of a gray one without alpha."""
    oiio = _openimageio()
    as_it_is = oiio.ImageSpec()
    as_it_is.attribute("oiio:UnassociatedAlpha", 1)  # otherwise OpenImageIO multiplies colors with alpha
    picture = oiio.ImageInput.open(str(path), as_it_is)
    assert picture, oiio.geterror()
    spec = picture.spec()
    assert spec.channelnames in (("R", "G", "B", "A"), ("Y", "A"), ("Y",))
    values = picture.read_image(spec.format)
    assert values is not None, picture.geterror()
    picture.close()
    values = np.asarray(values).reshape(spec.height, spec.width, -1)[::-1]
    return values[..., [0, 0, 0, 1]] if values.shape[-1] == 2 else values


def as_stored(path) -> np.ndarray:
    """The stored values (H, W, channels) of a file, in its own type, the top row first."""
    oiio = _openimageio()
    picture = oiio.ImageInput.open(str(path))
    assert picture, oiio.geterror()
    values = picture.read_image(picture.spec().format)
    assert values is not None, picture.geterror()
    picture.close()
    return np.asarray(values)


def read_passes(path) -> dict[str, np.ndarray]:
    """The passes (H, W, channels) of a multilayer EXR of one view layer by name, in their own type, row 0 at v = 0."""
    oiio = _openimageio()
    picture = oiio.ImageInput.open(str(path))
    assert picture, oiio.geterror()
    passes = {}
    while picture.seek_subimage(len(passes), 0):
        spec = picture.spec()
        passes[spec["name"].split(".")[-1]] = np.asarray(picture.read_image(spec.format))[::-1]
    picture.close()
    return passes


def pillow(path) -> np.ndarray:
    """The bytes (H, W, 4) of a file as Pillow reads it, row 0 at v = 0. Raises OSError for a truncated file."""
    with Image.open(path) as picture:
        assert picture.mode in ("RGBA", "LA")
        return np.asarray(picture.convert("RGBA"))[::-1]
