# SPDX-License-Identifier: GPL-3.0-or-later
"""Small meshes of known shape. Each function returns an object that is linked to the scene's collection."""

import bpy
import numpy as np

LAYER = "UVMap"


def build(name, points, faces, uv=None, *, normals=None, smooth=True) -> bpy.types.Object:
    """An object from arrays.

    points (V, 3); faces (F, n) indices of points; uv (F, n, 2) by corner, or None for no UV layer; normals (F, n, 3)
    custom corner normals, kept as they are.
    """
    faces = np.asarray(faces, np.int32)
    count, sides = faces.shape
    data = bpy.data.meshes.new(name)
    data.vertices.add(len(points))
    data.attributes["position"].data.foreach_set("vector", np.asarray(points, np.float32).ravel())
    data.loops.add(count * sides)
    data.loops.foreach_set("vertex_index", faces.ravel())
    data.polygons.add(count)
    data.polygons.foreach_set("loop_start", np.arange(0, count * sides, sides, dtype=np.int32))
    data.update(calc_edges=True)
    data.polygons.foreach_set("use_smooth", np.full(count, smooth))
    if uv is not None:
        data.uv_layers.new(name=LAYER).uv.foreach_set("vector", np.asarray(uv, np.float32).ravel())
    if normals is not None:
        # Blender keeps vectors exactly; normals_split_custom_set would round them.
        layer = data.attributes.new("custom_normal", "FLOAT_VECTOR", "CORNER")
        layer.data.foreach_set("vector", np.asarray(normals, np.float32).ravel())
    obj = bpy.data.objects.new(name, data)
    bpy.context.scene.collection.objects.link(obj)
    return obj


def grid_faces(nu: int, nv: int, offset: int = 0) -> np.ndarray:
    """The (nu * nv, 4) quads, counter-clockwise, of a grid of (nu + 1) x (nv + 1) points, rows of constant v."""
    i, j = np.meshgrid(np.arange(nu), np.arange(nv))
    first = (offset + i + j * (nu + 1)).ravel()
    return np.stack([first, first + 1, first + nu + 2, first + nu + 1], axis=1)


def grid_uv(nu: int, nv: int) -> np.ndarray:
    """The UVs (points, 2) of such a grid, which fills 0..1."""
    u, v = np.meshgrid(np.linspace(0, 1, nu + 1), np.linspace(0, 1, nv + 1))
    return np.stack([u.ravel(), v.ravel()], axis=1)


def sheet(name, surface, nu, nv, **options) -> bpy.types.Object:
    """A grid over `surface`, a function from u and v (N,) to points (N, 3). The UVs fill 0..1."""
    uv, faces = grid_uv(nu, nv), grid_faces(nu, nv)
    return build(name, surface(*uv.T), faces, uv[faces], **options)


def plane(name="Plane", n=1, *, slope=0.0, **options) -> bpy.types.Object:
    """The square -1..1 in n x n quads, facing +Z; with a slope, z rises by it for each unit of x."""
    return sheet(name, lambda u, v: np.stack([2 * u - 1, 2 * v - 1, slope * (2 * u - 1)], axis=1), n, n, **options)


def terrain(name="Terrain", n=32, *, height=0.1, waves=2, **options) -> bpy.types.Object:
    """z = height * sin(2 pi waves u) * sin(2 pi waves v) over the square -1..1."""

    def surface(u, v):
        z = height * np.sin(2 * np.pi * waves * u) * np.sin(2 * np.pi * waves * v)
        return np.stack([2 * u - 1, 2 * v - 1, z], axis=1)

    return sheet(name, surface, n, n, **options)


def sphere(name="Sphere", n=32, *, latitude=75.0, **options) -> bpy.types.Object:
    """The belt of the unit sphere up to `latitude` degrees: u is the longitude, v the latitude; normals are exact.

    No poles, where a triangle's corner has no u of its own, and the seam's points are there twice.
    """

    def surface(u, v):
        longitude, lat = 2 * np.pi * u, np.radians(latitude) * (2 * v - 1)
        return np.stack([np.cos(longitude) * np.cos(lat), np.sin(longitude) * np.cos(lat), np.sin(lat)], axis=1)

    normals = surface(*grid_uv(2 * n, n).T)[grid_faces(2 * n, n)]
    return sheet(name, surface, 2 * n, n, normals=normals, **options)


def ball(name="Ball", rings=12, **options) -> bpy.types.Object:
    """The whole unit sphere in triangles, closed, without UVs."""
    down, around = np.arange(1, rings) * np.pi / rings, np.arange(2 * rings) * np.pi / rings
    down, around = np.meshgrid(down, around, indexing="ij")
    belt = np.stack([np.sin(down) * np.cos(around), np.sin(down) * np.sin(around), np.cos(down)], axis=-1)
    points = np.concatenate([belt.reshape(-1, 3), [(0, 0, 1), (0, 0, -1)]])
    number = np.arange(2 * rings)
    following, row = (number + 1) % (2 * rings), 2 * rings * np.arange(rings - 2)[:, None]
    a, b, c, d = (row + number, row + following, row + 2 * rings + number, row + 2 * rings + following)
    last = 2 * rings * (rings - 2)
    north, south = np.full(2 * rings, len(points) - 2), np.full(2 * rings, len(points) - 1)
    parts = [(a, c, b), (b, c, d), (north, number, following), (south, last + following, last + number)]
    faces = np.concatenate([np.stack([each.reshape(-1) for each in part], axis=1) for part in parts])
    return build(name, points, faces, **options)


def cube(name="Cube", *, gap=0.05, **options) -> bpy.types.Object:
    """The cube -1..1. Each face fills one cell of a 3 x 2 atlas, up to `gap` of the cell's size from its border."""
    points = np.array([(x, y, z) for z in (-1, 1) for y in (-1, 1) for x in (-1, 1)])
    faces = [(0, 2, 3, 1), (4, 5, 7, 6), (0, 1, 5, 4), (2, 6, 7, 3), (0, 4, 6, 2), (1, 3, 7, 5)]
    corner = np.array([(0, 0), (1, 0), (1, 1), (0, 1)]) * (1 - 2 * gap) + gap
    cells = np.array([(i, j) for j in range(2) for i in range(3)])
    uv = (cells[:, None] + corner) / (3, 2)
    return build(name, points, faces, uv, **{"smooth": False} | options)


def disc(name="Disc", sides=7, **options) -> bpy.types.Object:
    """One n-gon in the unit circle, facing +Z."""
    angle = 2 * np.pi * np.arange(sides) / sides
    points = np.stack([np.cos(angle), np.sin(angle), np.zeros(sides)], axis=1)
    return build(name, points, [range(sides)], points[None, :, :2] * 0.5 + 0.5, **options)


def two_islands(name="Islands", *, gap=0.25, **options) -> bpy.types.Object:
    """Two squares side by side in the plane whose UV islands, one left and one right, are `gap` apart."""
    points = np.array([(x, y, 0) for x in (-2, 0, 0, 2) for y in (-1, 1)])
    faces = [(0, 2, 3, 1), (4, 6, 7, 5)]
    corner, width = np.array([(0, 0), (1, 0), (1, 1), (0, 1)]), (1 - gap) / 2
    uv = np.stack([corner * (width, 1), corner * (width, 1) + (1 - width, 0)])
    return build(name, points, faces, uv, **options)


def mirrored(name="Mirrored", n=8, *, slope=0.0, **options) -> bpy.types.Object:
    """The square -1..1 in two halves that share their UVs: u = |x|, so that the left half's islands are mirrored.

    With a slope it is a roof: z falls by it for each unit of |x|.
    """
    u, v = grid_uv(n, n).T
    halves = [np.stack([side * u, 2 * v - 1, -slope * u], axis=1) for side in (1, -1)]
    right, left = grid_faces(n, n), grid_faces(n, n)[:, ::-1]
    faces, uv = np.concatenate([right, left + len(u)]), grid_uv(n, n)
    return build(name, np.concatenate(halves), faces, np.concatenate([uv[right], uv[left]]), **options)


def terrains_in_slots(method):
    """A low terrain and a high one in the panel's slots, set up for a small map by this method."""
    low, high = terrain("lo", n=8), terrain("hi", n=24, height=0.15)
    settings = bpy.context.scene.imprint
    settings.low = low
    settings.highs.add().object = high
    settings.method, settings.width, settings.height = method, 64, 64
    return low, high
