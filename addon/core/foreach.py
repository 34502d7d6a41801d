# SPDX-License-Identifier: GPL-3.0-or-later
"""Reads what Blender has in collections and images into arrays, all at once by `foreach_get`."""

from typing import Any

import numpy as np


def read(collection: Any, name: str, width: int = 0, dtype: type = np.int32) -> np.ndarray:
    """An attribute of all elements of a collection of Blender: (N,), or (N, width) for vectors."""
    values = np.empty((len(collection), width) if width else len(collection), dtype)
    collection.foreach_get(name, values.reshape(-1))
    return values


def vectors(collection: Any, name: str = "vector", width: int = 3) -> np.ndarray:
    """Vectors of all elements of a collection of Blender, (N, width) float32."""
    return read(collection, name, width, np.float32)


def pixels(image: Any) -> np.ndarray:
    """The pixels of an image of Blender, (height, width, 4) float32, row 0 at v = 0."""
    width, height = image.size
    values = np.empty((height, width, 4), np.float32)
    image.pixels.foreach_get(values.reshape(-1))
    return values
