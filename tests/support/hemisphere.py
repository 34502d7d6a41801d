"""Casts many rays from points on triangles with the passes, and computes what is visible from a point in other ways."""

import gpu
import numpy as np

from addon.core.declarations.choices import Hit
from addon.mesh import bvh
from addon.passes import cast, hemisphere, target

SIZE = 64
COUNT = SIZE * SIZE
"""The points of a test: one for each texel, so that each has another shift of the lattice."""
STEP = 0.005
"""How far off the surface the rays that find its triangles start, in local space."""


def tables(corners, normals=None):
    """Upload triangles (T, 3, 3) with normals (T, 3, 3) by corner; without, those of the triangles."""
    corners = np.asarray(corners, np.float32)
    if normals is None:
        normals = np.repeat(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])[:, None], 3, axis=1)
    numbers = np.arange(len(corners) * 3).reshape(-1, 3)
    tree = bvh.build(corners.reshape(-1, 3), numbers)
    ordered = numbers[tree.order]
    return cast.upload(
        tree,
        corners.reshape(-1, 3),
        ordered,
        np.asarray(normals, np.float32).reshape(-1, 3),
        np.zeros(len(ordered), int),
    )


def texture(values):
    """A texture RGBA32F of SIZE x SIZE texels from values (COUNT, 4)."""
    texels = np.ascontiguousarray(values, np.float32).reshape(SIZE, SIZE, 4)
    return gpu.types.GPUTexture((SIZE, SIZE), format="RGBA32F", data=gpu.types.Buffer("FLOAT", texels.shape, texels))


class Probes:
    """Points (COUNT, 3) on `surface`, found along the normals (COUNT, 3) of the surface there.

    hits: as cast.trace writes them. normals: as cast.look_up writes them. None of the rays may miss.
    """

    def __init__(self, surface, points, normals):
        self.surface = surface
        drawn = target.Target(SIZE, SIZE, ("RGBA32F", "RGBA32F"))
        normals = np.broadcast_to(normals, (COUNT, 3))
        drawn.textures[0] = texture(np.c_[points, np.ones(COUNT)])
        drawn.textures[1] = texture(np.c_[normals, np.full(COUNT, STEP)])
        self._hits = target.Target(SIZE, SIZE, ("RGBA32UI",))
        cast.trace(self._hits, drawn, surface, None, cast.Search(Hit.NEAREST, STEP, 2.0 * STEP, True))
        self._normals = target.Target(SIZE, SIZE, ("RGBA32F",))
        cast.look_up(self._normals, self._hits, drawn, surface, np.eye(3))
        self.hits, self.normals = self._hits.texture, self._normals.texture
        assert (read(self._normals)[:, 3] == 1.0).all()

    def openness(self, occluders=None, rays=128, groups=1):
        """Ambient occlusion (COUNT,) and bent normals (COUNT, 3), from the rays in so many groups."""
        chosen = hemisphere.lattice_of(rays)

        def add(sums, numbers, is_first):
            some = hemisphere.Rays(self.hits, self.surface, chosen, numbers, range(SIZE), is_first)
            hemisphere.add_openness(sums, some, occluders or hemisphere.Occluders())

        sums = added(add, rays, groups)
        into = target.Target(SIZE, SIZE, ("RGBA32F",))
        hemisphere.mean(into, sums, self.normals, rays, hemisphere.OCCLUSION)
        occlusion = read(into)
        hemisphere.bent_normals(into, sums, self.normals, rays, np.eye(3))
        bent = read(into)
        assert (occlusion[:, 3] == 1.0).all()
        assert (bent[:, 3] == 1.0).all()
        return occlusion[:, 0].astype(np.float64), bent[:, :3].astype(np.float64)

    def thickness(self, farthest, rays=128):
        """Thickness (COUNT,)."""
        return self._measured(hemisphere.add_thickness, farthest, rays, hemisphere.THICKNESS)

    def curvature(self, radius, rays=128, value=hemisphere.CURVATURE):
        """Curvature (COUNT,), or another value of the same rays."""
        return self._measured(hemisphere.add_curvature, radius, rays, value)

    def _measured(self, add_rays, length, rays, value):
        chosen = hemisphere.lattice_of(rays)

        def add(sums, numbers, is_first):
            add_rays(sums, hemisphere.Rays(self.hits, self.surface, chosen, numbers, range(SIZE), is_first), length)

        into = target.Target(SIZE, SIZE, ("RGBA32F",))
        hemisphere.mean(into, added(add, rays, 1), self.normals, rays, value)
        values = read(into)
        assert (values[:, 3] == 1.0).all()
        return values[:, 0].astype(np.float64)


def added(add, rays, groups):
    """The sums of rays, added in groups."""
    sums = target.Target(SIZE, SIZE, ("RGBA32F",))
    for group in range(groups):
        add(sums, range(rays)[group::groups], group == 0)
    return sums


def read(from_target):
    """The texels (COUNT, 4) float32 of a target."""
    texels = np.empty((SIZE, SIZE, 4), np.float32)
    from_target.read(texels)
    return texels.reshape(-1, 4)


# Surfaces


def polygon(points):
    """Triangles (n - 2, 3, 3) of a convex polygon (n, 3)."""
    points = np.asarray(points, np.float64)
    return np.stack([np.repeat(points[:1], len(points) - 2, axis=0), points[1:-1], points[2:]], axis=1)


def rectangle(center, right, up):
    """The corners (4, 3) of a rectangle; its front looks along right x up."""
    center, right, up = (np.asarray(vector, np.float64) for vector in (center, right, up))
    return np.stack([center - right - up, center + right - up, center + right + up, center - right + up])


def flipped(triangles):
    """The same triangles with the front behind."""
    return triangles[:, ::-1]


# Closed forms


def form_factor(points, normals, corners):
    """The share (N,) of the cosine-weighted hemisphere at points (N, 3) with normals (N, 3) that a polygon (n, 3) covers.

    J. H. Lambert's formula (1760). The polygon lies above the horizon of all points, and its front faces them.
    """
    vectors = np.asarray(corners, np.float64) - np.asarray(points, np.float64)[:, None]
    vectors /= np.linalg.norm(vectors, axis=2, keepdims=True)
    following = np.roll(vectors, -1, axis=1)
    across = np.cross(vectors, following)
    sine = np.linalg.norm(across, axis=2)
    angle = np.arctan2(sine, (vectors * following).sum(axis=2))
    edges = across / np.maximum(sine, 1e-300)[..., None] * angle[..., None]
    return np.abs((edges.sum(axis=1) * normals).sum(axis=1)) / (2.0 * np.pi)
