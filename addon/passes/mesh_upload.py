# SPDX-License-Identifier: GPL-3.0-or-later
"""Uploads meshes to the GPU."""

from __future__ import annotations

import numpy as np

from . import allocation
from . import blender_gpu as gpu


class UploadCache:
    """Caches meshes that are uploaded repeatedly: arrays that did not change stay on the GPU."""

    def __init__(self):
        self._meshes: dict[str, _Buffers] = {}

    def upload(self, key: str, triangles: np.ndarray, **attributes: np.ndarray) -> gpu.types.GPUBatch:
        """Upload the mesh `key`, as the function `upload` does. Do not change uploaded arrays in place."""
        return self._meshes.setdefault(key, _Buffers()).upload(triangles, **attributes)


class _Buffers:
    """The buffers of one mesh."""

    def __init__(self):
        self._triangles: tuple[np.ndarray, gpu.types.GPUIndexBuf] | None = None
        self._attributes: dict[str, tuple[np.ndarray, gpu.types.GPUVertBuf]] = {}

    def upload(self, triangles: np.ndarray, **attributes: np.ndarray) -> gpu.types.GPUBatch:
        if self._triangles is None or not _same(self._triangles[0], triangles):
            self._triangles = triangles, allocation.triangles(triangles)
        for name, values in attributes.items():
            if name not in self._attributes or not _same(self._attributes[name][0], values):
                self._attributes[name] = values, allocation.corners(name, values)
        return _batch(self._triangles[1], [self._attributes[name][1] for name in attributes])


def upload(triangles: np.ndarray, **attributes: np.ndarray) -> gpu.types.GPUBatch:
    """Upload an indexed mesh.

    triangles: (T, 3) int32, indices into the corners. attributes: name = (C, n) float32, one row per corner; each one has
    its own buffer, so that the CPU need not interleave them.
    """
    elements = allocation.triangles(triangles)
    return _batch(elements, [allocation.corners(name, values) for name, values in attributes.items()])


def upload_corners(**attributes: np.ndarray) -> gpu.types.GPUBatch:
    """Upload triangles without indices. attributes: name = (3 T, n) float32, three rows for each triangle."""
    return _batch(None, [allocation.corners(name, values) for name, values in attributes.items()])


def _batch(elements: gpu.types.GPUIndexBuf | None, buffers: list[gpu.types.GPUVertBuf]) -> gpu.types.GPUBatch:
    result = gpu.types.GPUBatch(type="TRIS", buf=buffers[0], **({} if elements is None else {"elem": elements}))
    for buffer in buffers[1:]:
        result.vertbuf_add(buffer)
    return result


def _same(a: np.ndarray, b: np.ndarray) -> bool:
    return a is b or (a.shape == b.shape and np.array_equal(a, b))
