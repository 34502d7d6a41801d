# SPDX-License-Identifier: GPL-3.0-or-later
"""Parts that stand off the surface, and rays beside hard edges, on made meshes without a common UV layout.

The truth is measured by rays of Blender's own tree, straight out of the low mesh's faces.
"""

from dataclasses import dataclass

import bpy
import numpy as np
import pytest
from mathutils import Vector
from mathutils.bvhtree import BVHTree
from mathutils.kdtree import KDTree

from tests.support import angles, judge, maps, scenes
from tests.support.real_meshes import open_pair

pytestmark = [pytest.mark.usefixtures("gpu_context"), pytest.mark.shared]

SIZE = 512
ABOVE = 0.15
"""From where the rays of the truth start: above the highest bolt and below the roof."""
LOST = 0.01
"""Share of a part's texels that may show what is below it. All did, with measured distances and the outermost hit."""
FOUND = 0.6
"""A texel that shows a point at less than this share of the part's height shows what is below the part."""


@dataclass(frozen=True)
class Baked:
    """A bake beside the truth: texels (H, W, ...). is_known: where exactly one low triangle is, and the truth has a hit.

    point, face: of the low mesh, and its face normal. truth: how high the high surface is above it. height: of the hit.
    aside (H, W, 3): how far the hit is from the texel's own normal line. normal: of the map, in world space.
    """

    is_known: np.ndarray
    is_hit: np.ndarray
    point: np.ndarray
    face: np.ndarray
    truth: np.ndarray
    height: np.ndarray
    aside: np.ndarray
    normal: np.ndarray


def bake(assets, name, *, below=np.inf):
    """Bake a file without any setting. below: high triangles are part of the truth where z is less."""
    layers = judge.module(assets)
    low, high = open_pair(assets, name, "layers")
    report = scenes.bake(low, high, method="CAST", space="WORLD", maps=("POSITION",), image="map", size=SIZE)
    texels = maps.pixels(bpy.data.images["map"])
    position = maps.pixels(bpy.data.images[report.maps["position"]["image"]])[..., :3].astype(np.float64)

    points, triangles, uv = layers.mesh("lo")
    owner, count = layers.raster(uv, SIZE)
    is_known = (owner >= 0) & (count == 1)
    point, face = (np.full((SIZE, SIZE, 3), np.nan) for _ in range(2))
    corners = points[triangles]
    weights = _weights(maps.texel_uv(SIZE, SIZE)[is_known], uv[owner[is_known]])
    point[is_known] = np.einsum("nk,nkc->nc", weights, corners[owner[is_known]])
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    face[is_known] = (normals / np.linalg.norm(normals, axis=1, keepdims=True))[owner[is_known]]

    places, faces, _ = layers.mesh("hi")
    faces = faces[places[faces][..., 2].max(axis=1) < below]
    tree = BVHTree.FromPolygons(places.tolist(), faces.tolist())
    truth = np.full((SIZE, SIZE), np.nan)
    for y, x in np.argwhere(is_known):
        away = Vector(face[y, x])
        _, _, _, distance = tree.ray_cast(Vector(point[y, x]) + away * ABOVE, -away)
        truth[y, x] = np.nan if distance is None else ABOVE - distance
    height = ((position - point) * face).sum(axis=2)
    return Baked(
        is_known & np.isfinite(truth),
        texels[..., 3] > 0.0,
        point,
        face,
        truth,
        height,
        position - point - height[..., None] * face,
        angles.decode(texels),
    )


def _weights(places, uv):
    """The barycentric weights (N, 3) of places (N, 2) in triangles (N, 3, 2)."""
    a, e, f = uv[:, 0], uv[:, 1] - uv[:, 0], uv[:, 2] - uv[:, 0]
    q = places - a
    area = e[:, 0] * f[:, 1] - e[:, 1] * f[:, 0]
    u = (q[:, 0] * f[:, 1] - q[:, 1] * f[:, 0]) / area
    v = (q[:, 1] * e[:, 0] - q[:, 0] * e[:, 1]) / area
    return np.stack([1.0 - u - v, u, v], axis=1)


def lost(baked, stands):
    """The share of the texels under standing parts that do not show them."""
    shows = baked.is_hit & (baked.height > FOUND * baked.truth)
    assert np.count_nonzero(stands) > 1000
    return (stands & ~shows).sum() / stands.sum()


@pytest.mark.slow
def test_plates_and_bolts_under_a_roof_are_not_lost(shared_assets):
    roof = 0.15
    baked = bake(shared_assets, "floaters", below=roof)
    stands = baked.is_known & (baked.point[..., 2] < 0.1) & (baked.truth > 0.012)
    share = lost(baked, stands)
    print(f"{np.count_nonzero(stands)} texels, lost {share:.3%}")
    assert share <= LOST


BOLT = 0.08
"""The height of the box's bolts."""
SHIFTED = 0.02
"""Of the bolt's height: how far the points on its top lie aside, on average. 70 percent with smooth directions alone."""
ACROSS = 4.0
"""Degrees, at the 95th percentile, between the normals of texels that touch across a hard edge. 62 with straight directions."""


@pytest.fixture(scope="module")
def box(shared_assets, gpu_context):
    return bake(shared_assets, "box")


def test_bolts_on_a_box_are_not_lost_and_no_ray_misses(box):
    share = lost(box, box.is_known & (box.truth > 0.25 * BOLT))
    print(f"lost {share:.3%}")
    assert share <= LOST
    assert box.is_hit[box.is_known].all()


def test_tops_of_bolts_are_not_skewed(box):
    tops = box.is_known & box.is_hit & (box.truth > 0.94 * BOLT) & (box.height > 0.88 * BOLT)
    shifts = np.linalg.norm(box.aside[tops], axis=1) / BOLT
    print(
        f"{len(shifts)} texels, mean {shifts.mean():.3%}, over 2 % {(shifts > 0.02).mean():.3%}, most {shifts.max():.2%}"
    )
    assert len(shifts) > 1000
    assert shifts.mean() <= SHIFTED


def test_normals_go_on_across_hard_edges(box):
    """The box is -1..1. Each texel beside an edge is compared with the closest one of another face."""
    near = box.is_known & box.is_hit
    points, normals, axes = box.point[near], box.normal[near], np.abs(box.face[near]).argmax(axis=1)
    texel = 2.0 / np.sqrt(near.sum() / 6)
    tree = KDTree(len(points))
    for i, point in enumerate(points):
        tree.insert(point, i)
    tree.balance()
    pairs = []
    for i in np.flatnonzero(np.sort(np.abs(points), axis=1)[:, 1] > 1.0 - 1.01 * texel):
        others = (j for _, j, distance in tree.find_n(points[i], 12) if axes[j] != axes[i] and distance < 1.1 * texel)
        pairs += [(i, j) for j in list(others)[:1]]
    first, second = np.array(pairs).T
    error = angles.degrees(normals[first], normals[second])
    print(f"{len(error)} pairs, mean {error.mean():.2f}, 95th percentile {np.percentile(error, 95):.2f}")
    assert len(error) > 300
    assert np.percentile(error, 95) <= ACROSS
