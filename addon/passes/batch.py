# SPDX-License-Identifier: GPL-3.0-or-later
"""Meshes on the GPU."""

import gpu
import numpy as np


def upload(triangles: np.ndarray, **attributes: np.ndarray) -> gpu.types.GPUBatch:
    """Upload an indexed mesh.

    triangles: (T, 3) int32, indices into the corners. attributes: name = (C, n) float32, one row a corner; each gets a
    buffer of its own, so that nothing is interleaved on the CPU.
    """
    batch = None
    for name, values in attributes.items():
        layout = gpu.types.GPUVertFormat()
        layout.attr_add(id=name, comp_type="F32", len=values.shape[1], fetch_mode="FLOAT")
        buffer = gpu.types.GPUVertBuf(layout, len(values))
        buffer.attr_fill(name, values)
        if batch is None:
            batch = gpu.types.GPUBatch(type="TRIS", buf=buffer, elem=gpu.types.GPUIndexBuf(type="TRIS", seq=triangles))
        else:
            batch.vertbuf_add(buffer)
    return batch
