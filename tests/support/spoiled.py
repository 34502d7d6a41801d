# SPDX-License-Identifier: GPL-3.0-or-later
"""Spoils a clean mesh as scans, CAD and generated meshes are: faces turned over, doubles behind the surface, debris, vertices
that are not joined, noise, holes. The truth about its maps is the clean mesh.

All of it follows from the generator of random numbers.
"""

from dataclasses import dataclass, replace

import bpy
import numpy as np

from addon.mesh import edges
from tests.support import angles, zoo

COLOR = "Color"
WRONG = 30.0
"""Degrees from the clean map's normal that no rounding makes: the texel shows another place, or the other side."""


@dataclass(frozen=True)
class Soup:
    """A mesh of triangles: points (V, 3), triangles (T, 3), indices of them, and UVs (T, 3, 2) or None."""

    points: np.ndarray
    triangles: np.ndarray
    uv: np.ndarray | None = None

    @property
    def diagonal(self) -> float:
        return float(np.linalg.norm(np.ptp(self.points, axis=0)))

    @property
    def normals(self) -> np.ndarray:
        """Unit normals of the points."""
        corners = self.points[self.triangles]
        faces = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        sums = np.zeros_like(self.points)
        for corner in range(3):
            np.add.at(sums, self.triangles[:, corner], faces)
        return sums / np.maximum(np.linalg.norm(sums, axis=1, keepdims=True), 1e-30)

    @property
    def edge(self) -> float:
        """The median length of an edge."""
        corners = self.points[self.triangles]
        return float(np.median(np.linalg.norm(corners[:, 1] - corners[:, 0], axis=1)))

    def at(self, chosen: np.ndarray) -> "Soup":
        return replace(self, triangles=self.triangles[chosen], uv=None if self.uv is None else self.uv[chosen])


def of_object(obj: bpy.types.Object) -> Soup:
    """The triangles of an object's own mesh, in the world."""
    data, matrix = obj.data, np.array(obj.matrix_world)
    data.calc_loop_triangles()
    points = np.empty((len(data.vertices), 3), np.float32)
    data.vertices.foreach_get("co", points.reshape(-1))
    loops, triangles = np.empty((2, len(data.loop_triangles), 3), np.int32)
    data.loop_triangles.foreach_get("loops", loops.reshape(-1))
    data.loop_triangles.foreach_get("vertices", triangles.reshape(-1))
    uv = None
    if data.uv_layers.active is not None:
        uv = np.empty((len(data.loops), 2), np.float32)
        data.uv_layers.active.uv.foreach_get("vector", uv.reshape(-1))
        uv = uv[loops]
    return Soup(points @ matrix[:3, :3].T + matrix[:3, 3], triangles, uv)


def build(name: str, soup: Soup, *, smooth: bool = True, like: Soup | None = None) -> bpy.types.Object:
    """An object of a soup. like: the clean mesh; then its material has a base color that follows from the place in it."""
    obj = zoo.build(name, soup.points, soup.triangles, soup.uv, smooth=smooth)
    if like is not None:
        color(obj, (soup.points - like.points.min(axis=0)) / like.diagonal)
    return obj


def color(obj: bpy.types.Object, places: np.ndarray) -> None:
    """Give an object a base color that follows from places (V, 3), of its vertices."""
    layer = obj.data.color_attributes.new(COLOR, "FLOAT_COLOR", "POINT")
    values = np.ones((len(obj.data.vertices), 4), np.float32)
    values[:, :3] = 0.5 + 0.4 * np.sin(10.0 * places)
    layer.data.foreach_set("color", values.reshape(-1))
    material = bpy.data.materials.new("colors")
    material.use_nodes = True
    nodes, links = material.node_tree.nodes, material.node_tree.links
    shown = nodes.new("ShaderNodeVertexColor")
    shown.layer_name = COLOR
    links.new(
        shown.outputs["Color"], next(node for node in nodes if node.type == "BSDF_PRINCIPLED").inputs["Base Color"]
    )
    obj.data.materials.append(material)


def regions(soup: Soup, rng: np.random.Generator, share: float, count: int = 12) -> np.ndarray:
    """Which triangles (T,) bool are in `count` connected regions that together have this share of them."""
    beside = edges.neighbors(soup.points.astype(np.float32), soup.triangles)
    found = np.zeros(len(soup.triangles), bool)
    wanted = int(share * len(found))
    found[rng.choice(len(found), min(count, wanted), replace=False)] = True
    while np.count_nonzero(found) < wanted:
        rim = beside[found].reshape(-1)
        new = np.unique(rim[rim >= 0])
        new = new[~found[new]]
        if not len(new):
            new = rng.choice(np.flatnonzero(~found), 1)
        found[new[: wanted - np.count_nonzero(found)]] = True
    return found


def flipped(soup: Soup, chosen: np.ndarray) -> Soup:
    """`soup` with some triangles (T,) bool turned over."""
    triangles = np.where(chosen[:, None], soup.triangles[:, ::-1], soup.triangles)
    uv = soup.uv if soup.uv is None else np.where(chosen[:, None, None], soup.uv[:, ::-1], soup.uv)
    return replace(soup, triangles=triangles, uv=uv)


def flipped_at_random(soup: Soup, rng: np.random.Generator, share: float) -> Soup:
    return flipped(soup, rng.random(len(soup.triangles)) < share)


def flipped_in_regions(soup: Soup, rng: np.random.Generator, share: float) -> Soup:
    return flipped(soup, regions(soup, rng, share))


def joined(one: Soup, other: Soup) -> Soup:
    uv = None if one.uv is None or other.uv is None else np.concatenate([one.uv, other.uv])
    triangles = np.concatenate([one.triangles, other.triangles + len(one.points)])
    return Soup(np.concatenate([one.points, other.points]), triangles, uv)


def with_doubles(
    soup: Soup, rng: np.random.Generator, share: float, depth: float = 0.004, noise: float = 0.001
) -> Soup:
    """Copies of regions, moved inward by up to `depth` of the diagonal with noise, turned to either side."""
    some = soup.at(regions(soup, rng, share))
    deep = depth * (0.3 + 0.7 * rng.random((len(soup.points), 1)))
    inside = soup.points - soup.normals * soup.diagonal * deep
    inside = inside + rng.normal(0.0, noise * soup.diagonal, inside.shape)
    used, numbers = np.unique(some.triangles, return_inverse=True)
    some = replace(some, points=inside[used], triangles=numbers.reshape(-1, 3))
    return joined(soup, flipped_at_random(some, rng, 0.5 * rng.random()))


def with_debris(soup: Soup, rng: np.random.Generator, count: int, size: float = 0.002) -> Soup:
    """Small triangles at random places inside the surface, each of its own."""
    chosen = rng.integers(0, len(soup.triangles), count)
    inward = -soup.normals[soup.triangles[chosen, 0]] * soup.diagonal * (0.005 + 0.01 * rng.random((count, 1)))
    places = soup.points[soup.triangles[chosen, 0]] + inward
    points = places[:, None] + rng.normal(0.0, size * soup.diagonal, (count, 3, 3))
    debris = Soup(points.reshape(-1, 3), np.arange(3 * count).reshape(-1, 3))
    if soup.uv is not None:
        debris = replace(debris, uv=soup.uv[chosen])
    return joined(soup, debris)


def unwelded(soup: Soup, rng: np.random.Generator, share: float) -> Soup:
    """Some triangles with vertices of their own."""
    chosen = np.flatnonzero(rng.random(len(soup.triangles)) < share)
    triangles = soup.triangles.copy()
    points = soup.points[triangles[chosen]].reshape(-1, 3)
    triangles[chosen] = len(soup.points) + np.arange(len(points)).reshape(-1, 3)
    return replace(soup, points=np.concatenate([soup.points, points]), triangles=triangles)


def noisy(soup: Soup, rng: np.random.Generator, amount: float) -> Soup:
    """Points moved at random, by about this share of an edge."""
    return replace(soup, points=soup.points + rng.normal(0.0, amount * soup.edge, soup.points.shape))


def with_holes(soup: Soup, rng: np.random.Generator, share: float) -> Soup:
    return soup.at(rng.random(len(soup.triangles)) >= share)


def all_together(soup: Soup, rng: np.random.Generator) -> Soup:
    """As a generator makes it."""
    soup = noisy(soup, rng, 0.02)
    soup = with_doubles(soup, rng, 0.2)
    soup = with_debris(soup, rng, len(soup.triangles) // 200)
    soup = flipped_in_regions(flipped_at_random(soup, rng, 0.05), rng, 0.1)
    return with_holes(unwelded(soup, rng, 0.1), rng, 0.0005)


def wrong(clean: np.ndarray, other: np.ndarray) -> float:
    """The share of the texels of a map in object or world space whose normal is wrong, or that one of two maps lacks."""
    both = (clean[..., 3] > 0) & (other[..., 3] > 0)
    far = angles.degrees(angles.decode(clean), angles.decode(other)) > WRONG
    covered = np.count_nonzero(clean[..., 3] > 0)
    return (np.count_nonzero(both & far) + np.count_nonzero((clean[..., 3] > 0) != (other[..., 3] > 0))) / covered
