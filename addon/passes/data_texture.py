# SPDX-License-Identifier: GPL-3.0-or-later
"""Arrays that shaders read, stored in textures: the gpu module has no storage buffers."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from ..core import threads
from ..core.errors import BakeError
from . import allocation
from . import blender_gpu as gpu

WIDTH = 4096
"""As in shaders/lib/texture_lib.glsl."""
COPIED_ROWS = 2**14
"""Rows that a thread writes at once, so that they fit in a processor's cache."""
FIRST_NUMBER = 2**23
"""As in shaders/lib/triangle_lib.glsl."""


class BuiltTree(Protocol):
    """A tree as mesh.bvh.build makes it."""

    @property
    def nodes(self) -> np.ndarray: ...
    @property
    def first_leaf(self) -> int: ...
    @property
    def origin(self) -> np.ndarray: ...
    @property
    def scale(self) -> np.ndarray: ...


@dataclass(frozen=True)
class Tree:
    """A tree (mesh.bvh.Tree) on the GPU, as shaders/lib/tree_lib.glsl walks it.

    Attributes:
        nodes: The boxes of all nodes.
        first_leaf: The number of the first node that is a leaf.
        origin: Where the grid of boxes begins (3,).
        scale: The size of a step of the grid (3,).
    """

    nodes: gpu.types.GPUTexture
    first_leaf: int
    origin: np.ndarray
    scale: np.ndarray

    def bindings(self, prefix: str) -> dict:
        """What the nodes and the `tree_constants` of this prefix are bound to."""
        return {
            f"{prefix}_nodes": self.nodes,
            f"{prefix}_origin": (*self.origin, 0.0),
            f"{prefix}_scale": (*self.scale, 0.0),
            f"{prefix}_first_leaf": self.first_leaf,
        }


def tree_constants(prefix: str) -> tuple[tuple[str, str], ...]:
    """The constants of a Program that walks a tree."""
    return ("VEC4", f"{prefix}_origin"), ("VEC4", f"{prefix}_scale"), ("INT", f"{prefix}_first_leaf")


def upload_tree(tree: BuiltTree) -> Tree:
    """Upload a tree (bvh.Tree)."""
    return Tree(upload(tree.nodes.reshape(-1, 4)), tree.first_leaf, tree.origin, tree.scale)


MOST_ROWS = 16384
"""Of a data texture: 1 GiB, which is what Vulkan grants at least for one texture."""
CHECKED = 2**24
"""Bytes. Whether a table of so many has arrived is checked: OpenGL does not say that it lacked memory."""


def limit() -> int:
    """The largest number of texels of four floats that a data texture can hold on this GPU."""
    return WIDTH * min(gpu.capabilities.max_texture_size_get(), MOST_ROWS)


def size_of(*textures: gpu.types.GPUTexture) -> int:
    """The GPU memory of data textures, in bytes."""
    return sum(texture.width * texture.height * 16 for texture in textures)


def upload(values: np.ndarray) -> gpu.types.GPUTexture:
    """Upload `values` (N, 3 or 4) float32 to a texture; element i is in row i / WIDTH."""
    padded = empty(len(values))

    def copy(part: slice) -> None:
        for axis in range(values.shape[1]):  # faster than all at once, into rows that are longer
            padded[part, axis] = values[part, axis]

    threads.for_blocks(len(values), copy, COPIED_ROWS)
    return upload_padded(padded, len(values))


def upload_numbers(*columns: np.ndarray) -> gpu.types.GPUTexture:
    """Upload whole numbers from 0 below 2^30, (N,) or (N, k) int, side by side: at most four for each texel.

    shaders/lib/triangle_lib.glsl reads them: the bits of a texel are the numbers plus FIRST_NUMBER.
    """
    texels = empty(len(columns[0]))
    bits = texels.view(np.int32)
    channels = [column for each in columns for column in np.atleast_2d(each.T)]

    def copy(part: slice) -> None:
        for axis, values in enumerate(channels):
            np.add(values[part], FIRST_NUMBER, out=bits[part, axis], casting="unsafe")

    threads.for_blocks(len(columns[0]), copy, COPIED_ROWS)
    return upload_padded(texels, len(columns[0]))


def image(values: np.ndarray, texel: str = "RGBA32F") -> gpu.types.GPUTexture:
    """A texture of this format with the texels of `values`, (height, width, 4), or (height, width) for a single channel."""
    values = np.ascontiguousarray(values, np.float32)
    return allocation.texture(values.shape[1::-1], texel, values)


def empty(count: int) -> np.ndarray:
    """A zeroed array (rows * WIDTH, 4) float32 with space for `count` texels. Raises BakeError for more than `limit`."""
    if count > limit():
        raise BakeError(f"The meshes have {count:,} different values in a table; this GPU's textures hold {limit():,}.")
    return np.zeros((max(1, -(-count // WIDTH)) * WIDTH, 4), np.float32)


def upload_padded(padded: np.ndarray, count: int) -> gpu.types.GPUTexture:
    """Upload an array that `empty` made for `count` texels. Raises NoGpuMemory if the last one of many does not arrive."""
    texture = image(padded.reshape(-1, WIDTH, 4))
    if padded.nbytes >= CHECKED:
        row, column = divmod(count - 1, WIDTH)
        allocation.check_arrived(texture, (column, row), padded[count - 1])
    return texture
