# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests ambient occlusion against closed forms."""

import math

import numpy as np
import pytest

from addon.passes import hemisphere
from addon.passes.hemisphere import Occluders
from tests.support import angles, oracle
from tests.support.hemisphere import COUNT, Probes, flipped, form_factor, polygon, rectangle, tables
from tests.support.raster import unit

pytestmark = pytest.mark.usefixtures("gpu_context")


MEAN = 0.5 / 255
"""The largest mean error at 128 rays: half of a step of 8 bits."""
RMS = 2.5 / 255
"""The largest root mean square error at 128 rays: that of a lattice, where independent rays have 8."""
PLATES = 2.6 / 255
"""The same under a plate that covers half of the sky: 2.4 to 2.6 with any lattice of 128 rays, computed in float64 as well."""
EXACT = 1e-6
"""Single precision."""
UP = np.array((0.0, 0.0, 1.0))


def check(found, truth, most=RMS):
    error = found - truth
    rms = math.sqrt((error**2).mean())
    print(f"truth {np.mean(truth):.3f}, mean {error.mean() * 255:+.3f}/255, RMS {rms * 255:.3f}/255")
    assert 0.02 < np.mean(truth) < 0.98  # otherwise the case tests nothing
    assert abs(error.mean()) < MEAN
    assert rms < most


def on_floor(rng, low=-0.5, high=0.5):
    """Random points on the plane z = 0."""
    return np.c_[rng.uniform(low, high, (COUNT, 2)), np.zeros(COUNT)]


def floor(half=1.0):
    return polygon(rectangle((0, 0, 0), (half, 0, 0), (0, half, 0)))


def disc(height, radius, sides=256):
    """The corners of a disc that looks down."""
    turn = -2.0 * np.pi * np.arange(sides) / sides
    return np.stack([radius * np.cos(turn), radius * np.sin(turn), np.full(sides, height)], axis=1)


def turned(rng, triangles, points):
    """The scene in a random position: triangles, points, and the direction that was up."""
    matrix = oracle.rotation(rng)
    return triangles @ matrix.T, points @ matrix.T, matrix @ UP


@pytest.mark.parametrize(("seed", "height", "radius"), [(1, 0.3, 0.4), (2, 0.05, 0.5), (3, 0.6, 0.3)])
def test_a_plane_under_a_disc_seeds_1_to_3(seed, height, radius):
    rng = np.random.default_rng(seed)
    points, shade = on_floor(rng), disc(height, radius)
    truth = 1.0 - form_factor(points, UP, shade)
    triangles, points, up = turned(rng, np.concatenate([floor(), polygon(shade)]), points)
    found, _ = Probes(tables(triangles), points, up).openness()
    check(found, truth)


def test_right_under_a_disc_half_is_blocked_seed_4():
    """On the axis of a disc of radius a at height h, a^2 / (a^2 + h^2) is blocked."""
    triangles = np.concatenate([floor(), polygon(disc(0.3, 0.3))])
    found, _ = Probes(tables(triangles), np.zeros((COUNT, 3)) + (1e-3, 2e-3, 0.0), UP).openness()
    check(found, 0.5)


@pytest.mark.parametrize(("seed", "walls"), [(5, 1), (6, 2)])
def test_in_a_corner_of_two_and_three_walls_seeds_5_and_6(seed, walls):
    """The floor counts as a wall."""
    rng = np.random.default_rng(seed)
    points = on_floor(rng, 0.001, 0.6)
    sides = [
        rectangle((0.0, 0.35, 0.35), (0.0, 0.35, 0.0), (0.0, 0.0, 0.35)),
        rectangle((0.35, 0.0, 0.35), (0.0, 0.0, 0.35), (0.35, 0.0, 0.0)),
    ][:walls]
    truth = 1.0 - sum(form_factor(points, UP, side) for side in sides)
    triangles, points, up = turned(rng, np.concatenate([floor(), *map(polygon, sides)]), points)
    found, _ = Probes(tables(triangles), points, up).openness()
    check(found, truth)


def pit(around=192, down=96):
    """Triangles of the lower half of the unit sphere, seen from inside, and their normals."""
    longitude = 2.0 * np.pi * np.arange(around + 1) / around
    latitude = -0.5 * np.pi * np.arange(down + 1) / down
    points = np.stack(
        [
            np.cos(latitude)[:, None] * np.cos(longitude),
            np.cos(latitude)[:, None] * np.sin(longitude),
            np.broadcast_to(np.sin(latitude)[:, None], (down + 1, around + 1)),
        ],
        axis=-1,
    )
    a, b, c, d = points[:-1, :-1], points[:-1, 1:], points[1:, 1:], points[1:, :-1]
    triangles = np.concatenate([np.stack(three, axis=-2).reshape(-1, 3, 3) for three in ((a, b, c), (a, c, d))])
    return triangles, -triangles


def test_in_a_hemispherical_pit_half_is_blocked_everywhere_seed_7():
    """All parts of a sphere see each other in proportion to their area."""
    rng = np.random.default_rng(7)
    outwards = rng.normal(size=(COUNT, 3))
    outwards /= np.linalg.norm(outwards, axis=1, keepdims=True)
    outwards[:, 2] = -np.abs(outwards[:, 2])
    outwards = outwards[np.argsort(outwards[:, 2])][: COUNT // 2]  # the lower part: not at the rim
    outwards = np.concatenate([outwards, outwards])
    triangles, normals = pit()
    found, bent = Probes(tables(triangles, normals), outwards, -outwards).openness()
    check(found, 0.5)
    # The opening is a disc: its mean direction, with the cosine, by symmetry around the pit's bottom.
    at_bottom = outwards[:, 2] < -0.999
    assert at_bottom.sum() > 3
    assert np.median(angles.degrees(unit(bent[at_bottom]), UP)) < 1.5


@pytest.mark.parametrize("gap", [0.05, 0.3])
@pytest.mark.parametrize("seed", [8, 9])
def test_between_two_parallel_plates_seeds_8_and_9(seed, gap):
    rng = np.random.default_rng(seed)
    plate = rectangle((0.0, 0.0, gap), (0.0, 0.4, 0.0), (0.4, 0.0, 0.0))
    points = on_floor(rng)
    truth = 1.0 - form_factor(points, UP, plate)
    triangles, points, up = turned(rng, np.concatenate([floor(), polygon(plate)]), points)
    found, _ = Probes(tables(triangles), points, up).openness()
    check(found, truth, most=PLATES)


GAP, LIMIT = 0.03, 0.1


def between_plates(fade, gap=GAP, limit=LIMIT):
    """Ambient occlusion under an endless plate, if rays are limited.

    With the distance d to the plate, the share of directions between d and d + dd is 2 gap^2 / d^3 dd.
    """
    x = gap / limit
    blocked = {
        "NONE": 1.0 - x * x,
        "LINEAR": (1.0 - x * x) - 2.0 * (x - x * x),
        "SMOOTH": (1.0 - x * x) + 6.0 * x * x * math.log(x) + 4.0 * x * x * (1.0 - x),
    }
    return 1.0 - blocked[fade]


@pytest.mark.parametrize("fade", hemisphere.FADES)
def test_a_limited_distance_with_each_fade_seed_10(fade):
    rng = np.random.default_rng(10)
    plate = flipped(polygon(rectangle((0, 0, GAP), (1, 0, 0), (0, 1, 0))))
    triangles, points, up = turned(rng, np.concatenate([floor(), plate]), on_floor(rng))
    found, _ = Probes(tables(triangles), points, up).openness(Occluders(farthest=LIMIT, fade=fade))
    check(found, between_plates(fade))


@pytest.mark.parametrize("fade", hemisphere.FADES)
def test_a_floor_blocks_like_a_plate_seed_11(fade):
    rng = np.random.default_rng(11)
    points = on_floor(rng)
    probes = Probes(tables(flipped(floor())), points, -UP)
    found, bent = probes.openness(Occluders(farthest=LIMIT, fade=fade, floor=-GAP))
    check(found, between_plates(fade))
    blocked, bent = probes.openness(Occluders(floor=-GAP))
    assert (blocked == 0.0).all()
    np.testing.assert_allclose(unit(bent), np.broadcast_to(-UP, (COUNT, 3)), atol=EXACT)
    assert np.linalg.norm(bent, axis=1).max() < 1e-3
    assert (probes.openness()[0] == 1.0).all()


def test_a_floor_blocks_the_lower_half_of_a_wall_seed_12():
    rng = np.random.default_rng(12)
    wall = polygon(rectangle((0, 0, 0), (0, 1, 0), (0, 0, 1)))
    points = np.c_[np.zeros(COUNT), rng.uniform(-0.5, 0.5, (COUNT, 2))]
    found, bent = Probes(tables(wall), points, np.array((1.0, 0.0, 0.0))).openness(Occluders(floor=-1.0))
    check(found, 0.5)
    truth = np.array((1.0 / 3.0, 0.0, 2.0 / (3.0 * np.pi)))
    assert np.median(angles.degrees(unit(bent), truth / np.linalg.norm(truth))) < 1.0
    np.testing.assert_allclose(bent.mean(axis=0), truth, atol=2e-3)


def test_backs_block_only_if_they_should_seed_13():
    rng = np.random.default_rng(13)
    points, shade = on_floor(rng), disc(0.2, 0.5)
    triangles = np.concatenate([floor(), flipped(polygon(shade))])
    probes = Probes(tables(triangles), points, UP)
    assert (probes.openness()[0] == 1.0).all()
    check(probes.openness(Occluders(two_sided=True))[0], 1.0 - form_factor(points, UP, shade))


@pytest.mark.parametrize("two_sided", [False, True])
def test_a_plane_of_many_triangles_does_not_block_itself_seed_14(two_sided):
    """In any position, and with points on its edges."""
    for seed in range(14, 18):
        rng = np.random.default_rng(seed)
        n = 40
        grid = np.linspace(-0.7, 0.7, n + 1)
        x, y = np.meshgrid(grid, grid)
        x[1:-1, 1:-1] += rng.uniform(-0.015, 0.015, (n - 1, n - 1))
        points = np.stack([x, y, np.full_like(x, 0.3)], axis=-1)
        a, b, c, d = points[:-1, :-1], points[:-1, 1:], points[1:, 1:], points[1:, :-1]
        triangles = np.concatenate([np.stack(three, axis=-2).reshape(-1, 3, 3) for three in ((a, b, c), (a, c, d))])
        chosen = triangles[rng.integers(0, len(triangles), COUNT)]
        share = rng.random((COUNT, 1)) * (rng.random((COUNT, 1)) < 0.7)
        at = chosen[:, 0] * share + chosen[:, 1] * (1.0 - share)
        triangles, at, up = turned(rng, triangles, at)
        found, _ = Probes(tables(triangles), at, up).openness(Occluders(two_sided=two_sided))
        assert (found == 1.0).all()


def test_bias_leaves_out_directions_near_the_horizon_seed_19():
    """A low wall blocks only what is less than 10 degrees above the horizon."""
    rng = np.random.default_rng(19)
    side = rectangle((0.0, 0.0, 0.02), (0.0, 0.9, 0.0), (0.0, 0.0, 0.02))
    points = np.c_[rng.uniform(0.04 / math.tan(math.radians(10.0)), 0.4, COUNT), np.zeros((COUNT, 2))]
    probes = Probes(tables(np.concatenate([floor(), polygon(side)])), points, UP)
    assert (probes.openness(Occluders(bias=math.radians(10.0)))[0] == 1.0).all()
    assert (probes.openness(rays=1024)[0] < 1.0).mean() > 0.9


def test_bias_widens_what_lies_straight_above_seed_20():
    """A disc on the axis covers r^2 of the projected directions, and r^2 / cos(bias)^2 of those that are left."""
    triangles = np.concatenate([floor(), polygon(disc(0.3, 0.2))])
    bias = math.radians(40.0)
    found, _ = Probes(tables(triangles), np.zeros((COUNT, 3)) + (1e-3, 2e-3, 0.0), UP).openness(Occluders(bias=bias))
    check(found, 1.0 - 0.04 / 0.13 / math.cos(bias) ** 2)


@pytest.mark.parametrize("two_sided", [False, True])
def test_occluders_in_another_tree_of_another_space_seed_21(two_sided):
    rng = np.random.default_rng(21)
    plate = flipped(polygon(rectangle((0, 0, GAP), (1, 0, 0), (0, 1, 0))))
    scale, offset = 0.05, np.array((0.3, -0.2, 0.4))
    for fade in hemisphere.FADES:
        occluders = Occluders(
            tables(np.concatenate([floor(), plate]) * scale + offset),
            scale,
            tuple(offset),
            farthest=LIMIT,
            fade=fade,
            two_sided=two_sided,
        )
        found, _ = Probes(tables(floor()), on_floor(rng), UP).openness(occluders)
        check(found, between_plates(fade))
    above = Occluders(tables(flipped(floor()) * scale + offset), scale, tuple(offset), farthest=LIMIT, floor=-GAP)
    found, _ = Probes(tables(flipped(floor())), on_floor(rng), -UP).openness(above)
    check(found, between_plates("NONE"))


def test_groups_of_rays_add_up_to_the_same_seed_22():
    rng = np.random.default_rng(22)
    triangles = np.concatenate([floor(), polygon(disc(0.3, 0.4))])
    probes = Probes(tables(triangles), on_floor(rng), UP)
    whole, bent = probes.openness()
    parts, bent_by_parts = probes.openness(groups=3)
    np.testing.assert_allclose(parts, whole, atol=EXACT)
    np.testing.assert_allclose(bent_by_parts, bent, atol=EXACT)


# Openness random


POINTS = 24
"""The points of a scene. Each is that of many texels, so that its mean over all shifts of the lattice is known closely."""
DIRECTIONS = 20_000
"""The directions of the oracle at each point."""
RANDOM_MEAN = 1.0 / 255
"""The largest error of the mean over the texels of a point: the oracle's own directions err by as much as 0.3/255."""
RANDOM_RMS = 4.0 / 255
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
            is_met = (np.where(slope < 0.0, sides & 1, sides & 2) != 0) & (t > 0.0) & (t < nearest)
            for p, q in ((a, b), (b, c), (c, a)):
                inwards = np.cross(faces[i], q - p)
                is_met &= (point - p) @ inwards + t * (directions @ inwards) >= 0.0
        nearest = np.where(is_met, t, nearest)
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
    assert np.abs(means).max() < RANDOM_MEAN
    assert rms < RANDOM_RMS


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
