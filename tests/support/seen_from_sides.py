# SPDX-License-Identifier: GPL-3.0-or-later
"""What a viewer sees of meshes from many sides, in float64 and without a GPU: the oracle of the shading error. It shares no
code with the shaders, nor with the module that measures it."""

from dataclasses import dataclass

import numpy as np

from . import decoders, raster

WORLD, OBJECT, TANGENT = "WORLD", "OBJECT", "TANGENT"


@dataclass(frozen=True)
class Surface:
    """Triangles by corner, in world space: points (T, 3, 3), shading normals in the object's space (T, 3, 3), the matrix of
    normals (3, 3) to world space, UVs (T, 3, 2) and tangents (T, 3, 4)."""

    points: np.ndarray
    normals: np.ndarray
    normal_matrix: np.ndarray
    uv: np.ndarray | None = None
    tangents: np.ndarray | None = None

    @classmethod
    def of(cls, mesh):
        """A mesh as bakes read it. A mirrored object turns its triangles around."""
        corners = mesh.triangles
        if np.linalg.det(mesh.to_world[:3, :3]) < 0.0:
            corners = corners[:, ::-1]
        points = mesh.positions.astype(np.float64) @ mesh.to_world[:3, :3].T + mesh.to_world[:3, 3]
        inverse = np.linalg.inv(mesh.to_world[:3, :3]).T
        if mesh.stretch is not None:
            inverse = inverse @ mesh.stretch.T
        values = (None if each is None else each[corners].astype(np.float64) for each in (mesh.uv, mesh.tangents))
        return cls(points[mesh.vertices[corners]], mesh.normals[corners].astype(np.float64), inverse, *values)


@dataclass(frozen=True)
class NormalMap:
    """Texels (rows, columns, 4) as they are stored, their space and basis, and the axes of the channels."""

    texels: np.ndarray
    space: str = TANGENT
    basis: str = "MIKKTSPACE"
    channels: tuple[str, str, str] = ("+X", "+Y", "+Z")


def fibonacci(count):
    """Directions (count, 3) to viewers: their heights are the middles of equal steps, and each is a golden angle farther around
    than the one before."""
    golden = (1.0 + 5.0**0.5) / 2.0
    height = 1.0 - (np.arange(count) + 0.5) * 2.0 / count
    turn = 2.0 * np.pi * np.arange(count) * (1.0 - 1.0 / golden)
    width = np.sqrt(1.0 - height**2)
    return np.stack([width * np.cos(turn), width * np.sin(turn), height], axis=1)


def measured(highs, low, shown=None, *, views=6, side=96):
    """The shading errors (N,) in degrees, the share of the pixels that one covers alone, and the distances (N,) along the view
    as shares of the diagonal of the box around all."""
    everything = np.concatenate([each.points.reshape(-1, 3) for each in (*highs, low)])
    least, most = everything.min(axis=0), everything.max(axis=0)
    center, diagonal = (least + most) / 2.0, np.linalg.norm(most - least)
    radius = np.linalg.norm(everything - center, axis=1).max()
    degrees, distances, alone, either = [], [], 0, 0
    for towards in fibonacci(views):
        matrix = _matrix(towards, center, radius)
        of_high = [_seen(high, matrix, side, towards, None) for high in highs]
        nearest = np.argmin([depth for _, depth in of_high], axis=0)
        normal, depth = (
            np.take_along_axis(np.stack(each), nearest[None, ..., None] if each[0].ndim == 3 else nearest[None], 0)[0]
            for each in zip(*of_high, strict=True)
        )
        low_normal, low_depth = _seen(low, matrix, side, towards, shown)
        covered, low_covered = np.isfinite(depth), np.isfinite(low_depth)
        both = covered & low_covered
        alone += np.count_nonzero(covered ^ low_covered)
        either += np.count_nonzero(covered | low_covered)
        a, b = normal[both], low_normal[both]
        degrees.append(np.degrees(np.arctan2(np.linalg.norm(np.cross(a, b), axis=1), (a * b).sum(axis=1))))
        distances.append(np.abs(depth[both] - low_depth[both]) / diagonal)
    return np.concatenate(degrees), alone / either, np.concatenate(distances)


def backs(highs, low, *, views=6, side=96):
    """The share of the pixels that either covers at which the low one shows a back face, and a high one a front, and no back on
    any of the nine pixels around."""
    everything = np.concatenate([each.points.reshape(-1, 3) for each in (*highs, low)])
    center = (everything.min(axis=0) + everything.max(axis=0)) / 2.0
    radius, shown, either = np.linalg.norm(everything - center, axis=1).max(), 0, 0
    high = np.concatenate([each.points for each in highs])
    for towards in fibonacci(views):
        is_back, covered = [], []
        for points in (high, low.points):
            owner, _ = raster.rasterize(points, _matrix(towards, center, radius), (side, side))
            a, b, c = np.moveaxis(points, 1, 0)
            is_back.append(((np.cross(b - a, c - a) @ towards) < 0.0)[owner] & (owner >= 0))
            covered.append(owner >= 0)
        around = np.lib.stride_tricks.sliding_window_view(np.pad(is_back[0], 1), (3, 3)).any(axis=(2, 3))
        shown += np.count_nonzero(is_back[1] & covered[0] & ~around)
        either += np.count_nonzero(covered[0] | covered[1])
    return shown / either


def _matrix(towards, center, radius):
    """From world space to a picture whose third coordinate is the distance from the viewer's plane, in world units."""
    aside = np.eye(3)[np.argmin(np.abs(towards))]
    right = raster.unit(np.cross(aside, towards))
    rows = np.array([right, np.cross(towards, right)]) * 0.98 / radius
    matrix = np.eye(4)
    matrix[:2, :3], matrix[2, :3] = rows, -towards
    matrix[:3, 3] = -matrix[:3, :3] @ center
    return matrix


def _seen(surface, matrix, side, towards, shown):
    """The unit normals (side, side, 3) that a viewer sees, and the depths (side, side), infinite where there is nothing."""
    owner, weights = raster.rasterize(surface.points, matrix, (side, side))
    drawn = owner >= 0
    normal = raster.interpolate(surface.normals, owner, weights)
    found = normal @ surface.normal_matrix.T
    if shown is not None:
        uv = raster.interpolate(surface.uv, owner, weights)
        stored = raster.decode(_texels(shown.texels, uv), shown.channels)
        found = stored if shown.space == WORLD else stored @ surface.normal_matrix.T
        if shown.space == TANGENT:
            tangent = raster.interpolate(surface.tangents, owner, weights)
            corner = decoders.bitangents(surface.normals, surface.tangents)
            bitangent = raster.interpolate(corner, owner, weights)
            found = decoders.decoded(stored, shown.basis, normal, tangent, bitangent) @ surface.normal_matrix.T
    a, b, c = np.moveaxis(surface.points, 1, 0)
    is_back = np.cross(b - a, c - a) @ towards < 0.0
    found = raster.unit(found) * np.where(is_back[owner[drawn]], -1.0, 1.0)[:, None]
    normals, depths = np.zeros((side, side, 3)), np.full((side, side), np.inf)
    normals[drawn] = found
    points = raster.interpolate(surface.points, owner, weights)
    depths[drawn] = points @ matrix[2, :3] + matrix[2, 3]
    return normals, depths


def _texels(texels, uv):
    """The map's texels at UVs, which repeat by whole tiles of the triangle: within 0 to 1 here."""
    return raster.bilinear(texels[..., :3], uv)
