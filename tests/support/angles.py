"""Measures angles between decoded normals, and selects the texels to compare."""

import numpy as np


def decode(texels: np.ndarray) -> np.ndarray:
    """Unit normals (H, W, 3) float64 of a stored map (H, W, >= 3)."""
    normals = texels[..., :3].astype(np.float64) * 2.0 - 1.0
    return normals / np.maximum(np.linalg.norm(normals, axis=-1, keepdims=True), 1e-12)


def degrees(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Angle between unit vectors (..., 3): exact for small angles, where the arc cosine is not."""
    return np.degrees(2.0 * np.arctan2(np.linalg.norm(a - b, axis=-1), np.linalg.norm(a + b, axis=-1)))


def eroded(mask: np.ndarray, texels: int) -> np.ndarray:
    """`mask` (H, W) without the texels within `texels`, diagonally as well, of its border or of the map's."""
    for _ in range(texels):
        padded = np.pad(mask, 1)
        mask = np.logical_and.reduce(
            [
                padded[1 + y : 1 + y + mask.shape[0], 1 + x : 1 + x + mask.shape[1]]
                for y in (-1, 0, 1)
                for x in (-1, 0, 1)
            ]
        )
    return mask
