# SPDX-License-Identifier: GPL-3.0-or-later
"""Where high triangles are clear, on the GPU, and the programs that let rays through there."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from . import allocation, data_texture
from . import blender_gpu as gpu
from .shader import Program

RECORD = 3
"""Texels of a record in shaders/lib/cutout_lib.glsl."""
LARGEST = 1e4
"""Of a value less its threshold: what half precision holds. It is as exact as need be near 0, where its sign is asked for."""
MOST_PIXELS = 2**25
"""The most pixels of all images together, 256 MiB."""
MARK = -(2**31)
"""Makes the bits of a number those of the same float with a minus."""


@dataclass(frozen=True)
class Cutouts:
    """The tables of shaders/lib/cutout_lib.glsl, of the triangles in the order of a tree.

    Attributes:
        triangles: as cast.Tables has them, with a minus where they may be clear.
        records: where those are clear.
        alphas: the pixels of all images.
    """

    triangles: gpu.types.GPUTexture
    records: gpu.types.GPUTexture
    alphas: gpu.types.GPUTexture

    @property
    def bindings(self) -> dict:
        """What a program of `cutting` is bound to besides."""
        return {"triangles": self.triangles, "cutouts": self.records, "alphas": self.alphas}

    @property
    def bytes(self) -> int:
        """The GPU memory."""
        of_alphas = self.alphas.width * self.alphas.height * allocation.TEXEL_BYTES["RGBA16F"]
        return data_texture.size_of(self.triangles, self.records) + of_alphas


@dataclass(frozen=True)
class Records:
    """Which triangles may be clear, and where.

    Attributes:
        of_triangles: (T,) int. 0 for those that are opaque, or 1 plus a row of the others.
        corners: (N, 3, 2) float32, places in pixels of an image.
        images: (N,) int, the number of each one's image, from 0.
        pixels: of each image.
    """

    of_triangles: np.ndarray
    corners: np.ndarray
    images: np.ndarray
    pixels: Sequence[AlphaPixels]


@dataclass(frozen=True)
class AlphaPixels:
    """An image whose values (h, w) float32 are clear below 0.

    Attributes:
        outside: the value beyond its edges; None to go on with the nearest pixel.
        repeats: whether it is repeated instead.
        is_smooth: whether pixels are interpolated.
    """

    values: np.ndarray
    outside: float | None
    repeats: bool
    is_smooth: bool

    @property
    def size(self) -> tuple[int, int]:
        """Width and height."""
        height, width = np.shape(self.values)
        return width, height

    def texels(self) -> np.ndarray:
        """Four pixels for each, from that at -1, -1: (h + 2, w + 2, 4) float32."""
        around = (1, 2) if self.is_smooth else (1, 1)
        how: dict = {"mode": "wrap" if self.repeats else "edge"}
        if self.outside is not None:
            how = {"mode": "constant", "constant_values": self.outside}
        wide = np.pad(self.values, around, **how).clip(-LARGEST, LARGEST)
        if not self.is_smooth:
            return np.repeat(wide[..., None], 4, axis=-1)
        return np.stack([wide[:-1, :-1], wide[:-1, 1:], wide[1:, :-1], wide[1:, 1:]], axis=-1)


def cutting(program: Program) -> Program:
    """A program that asks where triangles are clear. No texels: it asks seldom, and OpenGL has to have no more images."""
    samplers = ("FLOAT_2D", "cutouts"), ("FLOAT_2D", "alphas")
    return replace(program, library="lib/cutout_lib.glsl", samplers=(*program.samplers, *samplers))


def upload(records: Records, vertices: np.ndarray, own_normals: np.ndarray) -> Cutouts:
    """Upload where triangles are clear. vertices, own_normals: as cast.upload has them."""
    count, others = len(records.of_triangles), len(records.corners)
    texels = data_texture.empty(count + RECORD * others)
    numbers = texels[:count].view(np.int32)
    numbers[:] = data_texture.FIRST_NUMBER
    is_marked = records.of_triangles > 0
    numbers[is_marked, 0] += (count + RECORD * (records.of_triangles[is_marked] - 1)).astype(np.int32)
    first, shown = 0, np.zeros((len(records.pixels), 5), np.float32)
    for number, pixels in enumerate(records.pixels):
        shown[number] = 0.5 * pixels.is_smooth, pixels.repeats, *pixels.size, 0.0
        shown[number].view(np.int32)[4] = first + data_texture.FIRST_NUMBER
        first += (pixels.size[0] + 2) * (pixels.size[1] + 2)
    into = texels[count : count + RECORD * others].reshape(-1, 12)
    into[:, :6] = records.corners.reshape(-1, 6)
    into[:, 6:11] = shown[records.images]
    return Cutouts(
        data_texture.upload_numbers(vertices, own_normals + np.where(is_marked, MARK, 0)),
        data_texture.upload_padded(texels, count + RECORD * others),
        _alphas(records.pixels, first),
    )


def _alphas(images: Sequence[AlphaPixels], count: int) -> gpu.types.GPUTexture:
    texels = np.zeros((max(1, -(-count // data_texture.WIDTH)) * data_texture.WIDTH, 4), np.float32)
    first = 0
    for pixels in images:
        own = pixels.texels().reshape(-1, 4)
        texels[first : first + len(own)] = own
        first += len(own)
    return data_texture.image(texels.reshape(-1, data_texture.WIDTH, 4), "RGBA16F")
