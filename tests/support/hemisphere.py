"""Casts many rays from points on triangles with the passes, and computes what is visible from a point in other ways."""

import math

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
    """A square texture RGBA32F from values (N, 4)."""
    side = math.isqrt(len(values))
    texels = np.ascontiguousarray(values, np.float32).reshape(side, side, 4)
    return gpu.types.GPUTexture((side, side), format="RGBA32F", data=gpu.types.Buffer("FLOAT", texels.shape, texels))


class Probes:
    """Points (N, 3) on `surface`, N a square number such as COUNT, found along the normals (N, 3) of the surface there.

    hits: as cast.trace writes them. normals: as cast.look_up writes them. None of the rays may miss.
    """

    def __init__(self, surface, points, normals):
        self.surface, self.side = surface, math.isqrt(len(points))
        drawn = self._target("RGBA32F", "RGBA32F")
        normals = np.broadcast_to(normals, points.shape)
        drawn.textures[0] = texture(np.c_[points, np.ones(len(points))])
        drawn.textures[1] = texture(np.c_[normals, np.full(len(points), STEP)])
        self._hits = self._target("RGBA32UI")
        cast.trace(self._hits, drawn, surface, None, cast.Search(Hit.NEAREST, STEP, 2.0 * STEP, True))
        self._normals = self._target("RGBA32F")
        cast.look_up(self._normals, self._hits, drawn, surface, np.eye(3))
        self.hits, self.normals = self._hits.texture, self._normals.texture
        assert (read(self._normals)[:, 3] == 1.0).all()

    def _target(self, *formats):
        return target.Target(self.side, self.side, formats)

    def openness(self, occluders=None, rays=128, groups=1):
        """Ambient occlusion (N,) and bent normals (N, 3), from the rays in so many groups."""
        chosen = hemisphere.lattice_of(rays)

        def add(sums, numbers, is_first):
            some = hemisphere.Rays(self.hits, self.surface, chosen, numbers, range(self.side), is_first)
            hemisphere.add_openness(sums, some, occluders or hemisphere.Occluders())

        sums = self._added(add, rays, groups)
        into = self._target("RGBA32F")
        hemisphere.mean(into, sums, self.normals, rays, hemisphere.OCCLUSION)
        occlusion = read(into)
        hemisphere.bent_normals(into, sums, self.normals, rays, np.eye(3))
        bent = read(into)
        assert (occlusion[:, 3] == 1.0).all()
        assert (bent[:, 3] == 1.0).all()
        return occlusion[:, 0].astype(np.float64), bent[:, :3].astype(np.float64)

    def thickness(self, farthest, rays=128):
        """Thickness (N,)."""
        return self._measured(hemisphere.add_thickness, farthest, rays, hemisphere.THICKNESS)

    def curvature(self, radius, rays=128, value=hemisphere.CURVATURE):
        """Curvature (N,), or another value of the same rays."""
        return self._measured(hemisphere.add_curvature, radius, rays, value)

    def _measured(self, add_rays, length, rays, value):
        chosen = hemisphere.lattice_of(rays)

        def add(sums, numbers, is_first):
            add_rays(
                sums, hemisphere.Rays(self.hits, self.surface, chosen, numbers, range(self.side), is_first), length
            )

        into = self._target("RGBA32F")
        hemisphere.mean(into, self._added(add, rays, 1), self.normals, rays, value)
        values = read(into)
        assert (values[:, 3] == 1.0).all()
        return values[:, 0].astype(np.float64)

    def _added(self, add, rays, groups):
        """The sums of rays, added in groups."""
        sums = self._target("RGBA32F")
        for group in range(groups):
            add(sums, range(rays)[group::groups], group == 0)
        return sums


def read(from_target):
    """The texels (N, 4) float32 of a target."""
    texels = np.empty((from_target.height, from_target.width, 4), np.float32)
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


def needles(rng, count, length=0.8, width=0.002):
    """Long thin triangles in all directions around the origin."""
    centers = rng.uniform(-1.0, 1.0, (count, 3)) * (1.0, 1.0, 0.5)
    along, across = (rng.normal(size=(count, 3)) for _ in range(2))
    along *= length / np.linalg.norm(along, axis=1, keepdims=True)
    across = np.cross(along, across)
    across *= width / np.linalg.norm(across, axis=1, keepdims=True)
    return np.stack([centers - along, centers + along, centers + 0.9 * along + across], axis=1)


def cards(rng, count, side=0.1):
    """Upright squares at random places, as hair and leaves have, each with two sides."""
    centers, turn = rng.uniform(-0.8, 0.8, (count, 3)), rng.uniform(0.0, np.pi, count)
    right = side * np.stack([np.cos(turn), np.sin(turn), rng.normal(size=count) * 0.3], axis=1)
    up = np.array((0.0, 0.0, 3.0 * side))
    corners = np.stack([centers - right - up, centers + right - up, centers + right + up, centers - right + up], axis=1)
    halves = np.concatenate([corners[:, [0, 1, 2]], corners[:, [0, 2, 3]]])
    return np.concatenate([halves, flipped(halves)])


def layers(count, height=0.3):
    """Planes above each other, by turns seen from above and from below."""
    plates = [polygon(rectangle((0, 0, height * (i + 1) / count), (1, 0, 0), (0, 1, 0))) for i in range(count)]
    return np.concatenate([flipped(plate) if i % 2 else plate for i, plate in enumerate(plates)])


# In double precision


def _cell_shift(side, lattice):
    """The shifts (side, side, 2) of the lattice of each texel: the R2 sequence along a Hilbert curve."""
    y, x = np.indices((side, side)) % hemisphere.SHIFTS
    place, size = np.zeros((side, side), int), hemisphere.SHIFTS // 2
    while size:
        right, above = (x & size) > 0, (y & size) > 0
        place += size * size * ((3 * right) ^ above)
        flipped_x, flipped_y = np.where(right, 63 - y, y), np.where(right, 63 - x, x)
        x, y = np.where(above, x, flipped_x), np.where(above, y, flipped_y)
        size //= 2
    # In single precision, as the shader has it: the fraction of a large number.
    share = np.float32(0.5) + place[..., None].astype(np.float32) * np.array((0.7548776662, 0.5698402910), np.float32)
    share = (share - np.floor(share)).astype(np.float64)
    return share[..., :1] * lattice.cell[:2] + share[..., 1:] * lattice.cell[2:]


def lattice_points(side, rays):
    """The points (side * side, rays, 2) float64 of the lattices of all texels."""
    lattice = hemisphere.lattice_of(rays)
    points = np.arange(rays)[:, None] * np.array(lattice.step) % rays / rays
    return (points + _cell_shift(side, lattice).reshape(-1, 1, 2)) % 1.0


def directions_up(cosine, turn):
    """Unit directions (..., 3) around the z axis."""
    sine = np.sqrt(np.maximum(1.0 - cosine**2, 0.0))
    return np.stack([sine * np.cos(2.0 * np.pi * turn), sine * np.sin(2.0 * np.pi * turn), cosine], axis=-1)


def distances(points, directions, corners, farthest, *, fronts=True, backs=True):
    """How far rays (N, R, 3) from points (N, 3) go to the nearest of triangles (T, 3, 3), at most `farthest`: (N, R)."""
    edge1, edge2 = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    normals = np.cross(edge1, edge2)
    found = np.empty(directions.shape[:2])
    for i, (point, some) in enumerate(zip(points, directions, strict=True)):
        offset = point - corners[:, 0]
        with np.errstate(divide="ignore", invalid="ignore"):
            facing = -some @ normals.T
            u, v = some @ np.cross(edge2, offset).T / facing, some @ np.cross(offset, edge1).T / facing
            t = (normals * offset).sum(axis=1) / facing
            is_hit = (u >= 0.0) & (v >= 0.0) & (u + v <= 1.0) & (t > 1e-5)
        is_hit &= ((facing > 0.0) & fronts) | ((facing < 0.0) & backs)
        found[i] = np.where(is_hit, t, farthest).min(axis=1)
    return np.minimum(found, farthest)


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
