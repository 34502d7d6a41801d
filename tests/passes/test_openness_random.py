# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests ambient occlusion, bent normals, thickness and curvature in random scenes against float64 and every triangle."""

import math

import numpy as np
import pytest

from addon.passes import hemisphere
from addon.passes.hemisphere import Occluders
from tests.support import angles, oracle
from tests.support.hemisphere import COUNT, Probes, tables

pytestmark = pytest.mark.usefixtures("gpu_context")

POINTS = 24
"""The points of a scene. Each is that of many texels, so that its mean over all shifts of the lattice is known closely."""
DIRECTIONS = 20_000
"""The directions of the oracle at each point."""
MEAN = 1.0 / 255
"""The largest error of the mean over the texels of a point: the oracle's own directions err by as much as 0.3/255."""
RMS = 4.0 / 255
"""The largest root mean square error of a texel at 128 rays: small triangles close to the point cost more than large ones."""
BENT = 1.2
"""The largest median error of bent normals at 128 rays, in degrees: half of the directions are blocked, by small triangles."""


def scene(rng, count=30):
    """A floor with hills and random triangles above and below it, and points (POINTS, 3) on it with their normals."""
    n = 6
    x, y = np.meshgrid(np.linspace(-0.6, 0.6, n + 1), np.linspace(-0.6, 0.6, n + 1))
    grid = np.stack([x, y, 0.08 * rng.normal(size=x.shape)], axis=-1)
    a, b, c, d = grid[:-1, :-1], grid[:-1, 1:], grid[1:, 1:], grid[1:, :-1]
    ground = np.concatenate([np.stack(three, axis=-2).reshape(-1, 3, 3) for three in ((a, b, c), (a, c, d))])
    around = rng.uniform(-0.6, 0.6, (count, 1, 3)) + rng.uniform(-0.35, 0.35, (count, 3, 3))
    around[..., 2] += np.where(rng.random(count) < 0.6, 0.55, -0.55)[:, None]
    chosen = rng.choice(len(ground), POINTS, replace=False)
    weights = rng.dirichlet((4.0, 4.0, 4.0), POINTS)
    points = (ground[chosen] * weights[..., None]).sum(axis=1)
    matrix = oracle.rotation(rng)
    triangles = np.float32(np.concatenate([ground, around]) @ matrix.T).astype(np.float64)
    faces = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    faces /= np.linalg.norm(faces, axis=1, keepdims=True)
    # Shading normals lean away from the faces, by another angle on each.
    shading = faces + 0.25 * rng.normal(size=faces.shape)
    shading /= np.linalg.norm(shading, axis=1, keepdims=True)
    return triangles, chosen, points @ matrix.T, faces, shading


def probes_of(triangles, chosen, points, faces, shading):
    """The probes: point number i is that of the texels i, i + POINTS, ..."""
    own = np.arange(COUNT) % POINTS
    uploaded = tables(triangles, np.repeat(shading[:, None], 3, axis=1))
    return Probes(uploaded, points[own], faces[chosen][own])


def sphere(count):
    """Evenly spread directions (count, 3) of a hemisphere around z; the height is uniform."""
    i = np.arange(count)
    z, turn = (i + 0.5) / count, 2.0 * np.pi * i * (math.sqrt(5.0) - 1.0) / 2.0
    return np.stack([np.sqrt(1.0 - z * z) * np.cos(turn), np.sqrt(1.0 - z * z) * np.sin(turn), z], axis=1)


def frame(axis):
    """A rotation (3, 3) that takes z to `axis`."""
    other = np.eye(3)[np.argmin(np.abs(axis))]
    right = np.cross(other, axis)
    right /= np.linalg.norm(right)
    return np.stack([right, np.cross(axis, right), axis], axis=1)


def distances(point, directions, triangles, faces, *, own, sides):
    """The distance (N,) to the nearest triangle with one of these sides, 1 fronts and 2 backs, in each direction."""
    nearest = np.full(len(directions), np.inf)
    for i, (a, b, c) in enumerate(triangles):
        if i == own:
            continue
        slope = directions @ faces[i]
        with np.errstate(divide="ignore", invalid="ignore"):
            t = ((a - point) @ faces[i]) / slope
        at = point + t[:, None] * directions
        inside = np.all([np.cross(q - p, at - p) @ faces[i] >= 0.0 for p, q in ((a, b), (b, c), (c, a))], axis=0)
        is_met = np.where(slope < 0.0, sides & 1, sides & 2) != 0
        nearest = np.where(inside & is_met & (t > 0.0) & (t < nearest), t, nearest)
    return nearest


def random_occluders(rng):
    farthest = None if rng.random() < 0.3 else rng.uniform(0.2, 1.0)
    return Occluders(
        farthest=farthest,
        fade="NONE" if farthest is None else str(rng.choice(hemisphere.FADES)),
        two_sided=bool(rng.random() < 0.5),
        bias=float(rng.choice((0.0, math.radians(15.0)))),
        floor=None if rng.random() < 0.5 else -1.0,
    )


def seen(directions, point, triangles, faces, *, own, how):
    """The visibility (N,) of directions."""
    sides = 3 if how.two_sided else 1
    far = distances(point, directions, triangles, faces, own=own, sides=sides)
    if how.floor is not None:
        with np.errstate(divide="ignore"):
            to_floor = np.where(directions[:, 2] < 0.0, (how.floor - point[2]) / directions[:, 2], np.inf)
        far = np.minimum(far, to_floor)
    farthest = np.inf if how.farthest is None else how.farthest
    share = np.minimum(far / farthest, 1.0) if how.farthest else np.where(np.isinf(far), 1.0, 0.0)
    visible = {
        "NONE": np.where(far >= farthest, 1.0, 0.0),
        "LINEAR": share,
        "SMOOTH": share * share * (3.0 - 2.0 * share),
    }[how.fade]
    return np.where(directions @ faces[own] > 0.0, visible, 0.0)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(1, 9))
def test_openness_in_random_scenes_seeds_1_to_8(seed):
    rng = np.random.default_rng(seed)
    triangles, chosen, points, faces, shading = scene(rng)
    how = random_occluders(rng)
    found, bent = probes_of(triangles, chosen, points, faces, shading).openness(how)
    truth, directions_of_light = np.empty(POINTS), np.empty((POINTS, 3))
    z = np.sqrt(1.0 - (np.arange(DIRECTIONS) + 0.5) / DIRECTIONS * math.cos(how.bias) ** 2)
    around = sphere(DIRECTIONS)
    around[:, :2] *= (np.sqrt(1.0 - z * z) / np.linalg.norm(around[:, :2], axis=1))[:, None]
    around[:, 2] = z
    for i in range(POINTS):
        own = chosen[i]
        directions = around @ frame(shading[own]).T
        visible = seen(directions, points[i], triangles, faces, own=own, how=how)
        truth[i], directions_of_light[i] = visible.mean(), visible @ directions / DIRECTIONS
    expect(found, truth)
    own = np.arange(COUNT) % POINTS
    is_lit = truth[own] > 0.2
    assert is_lit.mean() > 0.2
    length = np.linalg.norm(directions_of_light[own], axis=1)
    error = angles.degrees(
        bent[is_lit] / np.linalg.norm(bent[is_lit], axis=1, keepdims=True),
        (directions_of_light[own] / np.maximum(length, 1e-9)[:, None])[is_lit],
    )
    print(f"bent normals: median {np.median(error):.2f} degrees")
    assert np.median(error) < BENT


def expect(found, truth):
    """Compare texels (COUNT,) with the values of their points (POINTS,)."""
    own = np.arange(COUNT) % POINTS
    error = found - truth[own]
    means = np.array([error[own == i].mean() for i in range(POINTS)])
    rms = math.sqrt((error**2).mean())
    print(f"truth {truth.mean():.3f}, means up to {np.abs(means).max() * 255:.2f}/255, RMS {rms * 255:.2f}/255")
    assert truth.std() > 0.01
    assert np.abs(means).max() < MEAN
    assert rms < RMS


@pytest.mark.slow
@pytest.mark.parametrize("seed", [11, 12, 13])
def test_thickness_in_random_scenes_seeds_11_to_13(seed):
    rng = np.random.default_rng(seed)
    triangles, chosen, points, faces, shading = scene(rng)
    found = probes_of(triangles, chosen, points, faces, shading).thickness(farthest=0.7)
    around = sphere(DIRECTIONS)
    around[:, :2] *= (np.sqrt(around[:, 2]) / np.linalg.norm(around[:, :2], axis=1))[:, None]
    around[:, 2] = np.sqrt(1.0 - around[:, 2])
    truth = np.empty(POINTS)
    for i, own in enumerate(chosen):
        directions = -around @ frame(shading[own]).T
        share = np.minimum(distances(points[i], directions, triangles, faces, own=own, sides=2) / 0.7, 1.0)
        truth[i] = np.where(directions @ faces[own] < 0.0, share, 0.0).mean()
    expect(found, truth)


@pytest.mark.slow
@pytest.mark.parametrize("seed", [21, 22, 23])
def test_curvature_in_random_scenes_seeds_21_to_23(seed):
    rng = np.random.default_rng(seed)
    triangles, chosen, points, faces, shading = scene(rng)
    found = probes_of(triangles, chosen, points, faces, shading).curvature(radius=0.3)
    truth = np.empty(POINTS)
    for i, own in enumerate(chosen):
        out = sphere(DIRECTIONS) @ frame(faces[own]).T
        inner, outer = (
            (np.minimum(distances(points[i], way, triangles, faces, own=own, sides=sides) / 0.3, 1.0) ** 3).mean()
            for way, sides in ((-out, 2), (out, 1))
        )
        share = 0.5 * (inner + 1.0 - outer)
        truth[i] = 0.5 + 2.0 * (0.5 - share)
    expect(found, truth)
