# SPDX-License-Identifier: GPL-3.0-or-later
"""The normals, tangents and bitangents of a mesh at the centers of a map's texels, in float64."""

from dataclasses import dataclass

import numpy as np

from tests.support import decoders, raster


@dataclass(frozen=True)
class Frames:
    """covered (H, W) bool: the texels whose center one triangle covers, and for each of these N texels, row by row: normal
    (N, 3), tangent (N, 4) and bitangent (N, 3), of the corners, interpolated."""

    covered: np.ndarray
    normal: np.ndarray
    tangent: np.ndarray
    bitangent: np.ndarray
    is_folded: np.ndarray
    """(N,) Whether a corner's normal points behind the triangle: no map is right there."""

    def decoded(self, normals, basis):
        """Object-space unit normals (N, 3) that an engine of `basis` shows of a tangent-space map (H, W, 3)."""
        return raster.unit(decoders.decoded(normals[self.covered], basis, self.normal, self.tangent, self.bitangent))


def frames(low, size):
    """Those of `low`, an unmodified mesh of triangles and quads with one UV layer. size: (width, height)."""
    mesh = raster.corners(low)
    places = np.concatenate([mesh.uv, np.zeros((*mesh.uv.shape[:2], 1))], axis=2)
    to_clip = np.diag([2.0, 2.0, 1.0, 1.0])
    to_clip[:2, 3] = -1.0
    owner, weights = raster.rasterize(places, to_clip, size)
    vectors = mesh.normal, mesh.tangent, decoders.bitangents(mesh.normal, mesh.tangent)
    between = (raster.interpolate(values, owner, weights) for values in vectors)
    edges = mesh.position[:, 1:] - mesh.position[:, :1]
    face = np.cross(edges[:, 0], edges[:, 1])
    folded = (np.einsum("tcn,tn->tc", mesh.normal, face) <= 0.0).any(axis=1)
    last, _ = raster.rasterize(places[::-1], to_clip, size)
    covered = owner >= 0
    is_single = (len(places) - 1 - last == owner)[covered]
    found = [values[is_single] for values in (*between, folded[owner[covered]])]
    covered[covered] = is_single
    return Frames(covered, *found)
