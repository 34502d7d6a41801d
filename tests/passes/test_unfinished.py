# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests that rays with more turns of loops than a driver grants are finished, and are the same wherever a dispatch ends."""

import math
import re
from contextlib import contextmanager

import numpy as np
import pytest

from addon.core.declarations.choices import Hit
from addon.core.progress import SLICE_ROWS, Pace
from addon.mesh import bvh, edges
from addon.passes import cast, hemisphere, shader, target, unfinished
from tests.passes import test_owned_hits
from tests.support import cut_scenes, lanes, maps, oracle, scenes
from tests.support.hemisphere import (
    Probes,
    cards,
    directions_up,
    distances,
    lattice_points,
    layers,
    needles,
    polygon,
    read,
    rectangle,
    tables,
    texture,
)

pytestmark = pytest.mark.usefixtures("gpu_context")

SIDE = 8
"""Texels along each side of a map of these tests."""
RMS = 2.0 / 255
"""The largest root mean square error against the same rays in double precision."""
UNLIMITED = 10**6
"""More turns than these rays take: less than a driver grants to so few."""
FEW = 9
"""So few turns that all rays are left, also in the middle of a node's triangles."""
UP = np.array((0.0, 0.0, 1.0))
FARTHEST, RAYS = 0.7, 64
MAPS = "occlusion", "thickness", "curvature"
FLOOR = polygon(rectangle((0, 0, 0), (1, 0, 0), (0, 1, 0)))
SHAPES = {
    "needles": lambda rng, many: needles(rng, *((4000,) if many else (60, 0.8, 0.15))),
    "hay": lambda rng, many: needles(rng, 3000 if many else 150, length=0.3, width=0.02),
    "cards": lambda rng, many: cards(rng, 700 if many else 60),
    "layers": lambda rng, many: layers(100 if many else 12),
}


def shape(name, *, many):
    """Triangles (T, 3, 3) over and under a floor, and points (SIDE * SIDE, 3) on it."""
    rng = np.random.default_rng(list(SHAPES).index(name))
    points = np.c_[rng.uniform(-0.8, 0.8, (SIDE * SIDE, 2)), np.zeros(SIDE * SIDE)]
    return np.concatenate([FLOOR, SHAPES[name](rng, many)]), points


@contextmanager
def turns(monkeypatch, most):
    """In this block, a lane has so many turns in a dispatch."""
    original, cleared = shader.source, shader.load.cache_clear
    with monkeypatch.context() as patch:
        few = rf"\1 {most};"
        patch.setattr(shader, "source", lambda *names: re.sub(r"(TURNS_MOST =) \d+;", few, original(*names)))
        cleared()
        try:
            yield
        finally:
            cleared()


@contextmanager
def counted_dispatches(monkeypatch):
    """The stages that are run in this block."""
    run, stages = unfinished._leaves, []

    def counted(*args, stage, **bindings):
        stages.append(stage)
        return run(*args, stage=stage, **bindings)

    with monkeypatch.context() as patch:
        patch.setattr(unfinished, "_leaves", counted)
        yield stages


def from_hits(corners, points, rays=8):
    """What rays from the points measure, by name."""
    probes = Probes(tables(corners), points, UP)
    smooth = hemisphere.Occluders(farthest=FARTHEST, fade="SMOOTH", two_sided=True)
    return {
        "occlusion": probes.openness(rays=rays),
        "faded": probes.openness(smooth, rays=rays),
        "thickness": probes.thickness(FARTHEST, rays=rays),
        "curvature": probes.curvature(FARTHEST, rays=rays),
    }


def cast_down(corners, rule, *, facing_only=False):
    """The hits of rays from above a low mesh of two planes, the lower one of which has no rays."""
    corners = np.asarray(corners, np.float32)
    low = np.concatenate([FLOOR, FLOOR - (0.0, 0.0, 0.3)]).astype(np.float32)
    numbers = np.arange(low.size // 3).reshape(-1, 3)
    low_tree = bvh.build(low.reshape(-1, 3), numbers)
    across = edges.neighbors(low.reshape(-1, 3), numbers)
    place = np.empty(len(low), int)
    place[low_tree.order] = np.arange(len(low))
    moved = np.where(across >= 0, place[across], -1)[low_tree.order]
    owners = cast.upload_owners(low_tree, low[low_tree.order], moved, room=1e8, has_clearances=False)
    rng = np.random.default_rng(5)
    drawn = target.Target(SIDE, SIDE, ("RGBA32F", "RGBA32F"))
    texels = np.zeros((2, SIDE * SIDE, 4), np.float32)
    texels[0, :, :2] = rng.uniform(-0.8, 0.8, (SIDE * SIDE, 2))
    on_first = texels[0, :, 1] < texels[0, :, 0]  # the halves of the square
    texels[0, :, 3] = np.where(on_first, place[0], place[1]) + 1
    texels[1, :] = 0.0, 0.0, 1.0, 0.5
    drawn.textures[:] = map(texture, texels)
    hits, found = target.Target(SIDE, SIDE, ("RGBA32UI",)), target.Target(SIDE, SIDE, ("RGBA32F",))
    cast.trace(hits, drawn, tables(corners), owners, cast.Search(rule, 1.0, 1e8, facing_only))
    cast.heights(found, hits, drawn)
    return read(found), *cast.read_hits(hits)


def same_to_the_bit(one, other):
    return all(np.array_equal(a, b, equal_nan=True) for a, b in zip(one, other, strict=True))


@pytest.mark.parametrize("name", lanes.slow_but(["needles"], list(SHAPES)))
def test_rays_from_hits_go_on_exactly_where_they_were(name, monkeypatch):
    corners, points = shape(name, many=False)
    with turns(monkeypatch, UNLIMITED), counted_dispatches(monkeypatch) as stages:
        whole = from_hits(corners, points)
    assert set(stages) == {unfinished.ALL}
    with turns(monkeypatch, FEW), counted_dispatches(monkeypatch) as stages:
        in_pieces = from_hits(corners, points)
    assert stages.count(unfinished.GO_ON) > 10
    for what, values in whole.items():
        assert same_to_the_bit(values, in_pieces[what]), what
        levels = len(np.unique(values[0] if isinstance(values, tuple) else values))
        assert levels > 2 or name == "layers", what  # of which all are the same


@pytest.mark.parametrize("name", lanes.slow_but(["layers"], list(SHAPES)))
def test_hits_of_the_low_mesh_go_on_exactly_where_they_were(name, monkeypatch):
    corners, _ = shape(name, many=False)
    rules = (Hit.OWN, False), (Hit.OWN, True), (Hit.OUTERMOST, False), (Hit.NEAREST, True)
    with turns(monkeypatch, UNLIMITED):
        whole = [cast_down(corners, rule, facing_only=facing) for rule, facing in rules]
    with turns(monkeypatch, FEW), counted_dispatches(monkeypatch) as stages:
        in_pieces = [cast_down(corners, rule, facing_only=facing) for rule, facing in rules]
    assert stages.count(unfinished.GO_ON) > 10
    for one, other in zip(whole, in_pieces, strict=True):
        assert same_to_the_bit(one, other)
        assert (one[0][:, 3] > 0.0).all()
    # Some do not own their outermost hit, but of cards, which are all nearer to this plane.
    assert np.array_equal(whole[0][0], whole[2][0]) == (name == "cards")


def measured(corners, points):
    """Occlusion, thickness and curvature from RAYS in single precision: (N,) each."""
    probes = Probes(tables(corners), points, UP)
    occlusion, _ = probes.openness(rays=RAYS)
    return occlusion, probes.thickness(FARTHEST, rays=RAYS), probes.curvature(FARTHEST, rays=RAYS)


def truth(corners, points):
    """The same in double precision, of the same rays."""
    u, v = np.moveaxis(lattice_points(SIDE, RAYS), -1, 0)
    up, down = directions_up(np.sqrt(1.0 - u), v), directions_up(-np.sqrt(1.0 - u), v)
    flat = directions_up(u * u, v)
    corners = corners[len(FLOOR) :]  # rays do not meet the plane that they start from
    ends = distances(points, up, corners, hemisphere.UNLIMITED, backs=False)
    inside = distances(points, down, corners, FARTHEST, fronts=False) / FARTHEST
    inner = distances(points, -flat, corners, FARTHEST, fronts=False) / FARTHEST
    outer = distances(points, flat, corners, FARTHEST, backs=False) / FARTHEST
    curvature = 0.5 + (2.0 * u * ((1.0 - inner**3) - (1.0 - outer**3))).mean(axis=1)
    return (ends == hemisphere.UNLIMITED).mean(axis=1), inside.mean(axis=1), curvature


def check(what, found, right):
    rms = math.sqrt(((found - right) ** 2).mean())
    print(f"{what}: {found.mean():.4f}, right is {right.mean():.4f}, RMS {rms * 255:.3f}/255")
    assert rms < RMS


def test_a_dispatch_has_more_turns_than_llvmpipe_grants():
    """Then curvature was wrong by 4/255 and more."""
    _, points = shape("needles", many=False)
    corners = np.concatenate([FLOOR, needles(np.random.default_rng(8), 2500)])
    found = Probes(tables(corners), points, UP).curvature(FARTHEST, rays=RAYS)
    check("curvature", found, truth(corners, points)[2])


@pytest.mark.slow
@pytest.mark.parametrize("name", SHAPES)
def test_rays_through_many_triangles_are_as_in_double_precision(name):
    corners, points = shape(name, many=True)
    for what, *both in zip(MAPS, measured(corners, points), truth(corners, points), strict=True):
        check(what, *both)


def sums_by(at_once, monkeypatch, corners, points, rays):
    """The sums of occlusion and thickness from dispatches of so many rays, to the bit."""
    probes, lattice, found = Probes(tables(corners), points, UP), hemisphere.lattice_of(rays), []
    monkeypatch.setattr(hemisphere, "AT_ONCE", at_once)
    faded = hemisphere.Occluders(farthest=FARTHEST, fade="SMOOTH")
    adds = (
        lambda sums, some: hemisphere.add_openness(sums, some, faded),
        lambda sums, some: hemisphere.add_thickness(sums, some, FARTHEST),
    )
    for add in adds:
        sums, covered = target.Target(SIDE, SIDE, ("RGBA32F",)), np.full(SIDE // SLICE_ROWS, float(SLICE_ROWS * SIDE))

        def draw(rows, numbers, is_first, add=add, sums=sums):
            add(sums, hemisphere.Rays(probes.hits, probes.surface, lattice, numbers, rows, is_first))

        dispatched = list(
            hemisphere.slices(Pace(), hemisphere.ADD_OPENNESS, (SIDE, SIDE), covered, range(rays), draw=draw)
        )
        assert len(dispatched) == -(-rays // at_once)
        found.append(read(sums))
    return found


def test_sums_do_not_depend_on_the_rays_of_a_dispatch(monkeypatch):
    """Nor does the order in which rays are added, by which floats differ."""
    corners, points = shape("cards", many=False)
    by_size = [sums_by(at_once, monkeypatch, corners, points, 128) for at_once in (4, 8, 16, 32, 64)]
    assert all(same_to_the_bit(one, by_size[-1]) for one in by_size)
    assert all(len(np.unique(sums)) > 40 for sums in by_size[-1])


@pytest.mark.parametrize("values", [{"samples": 16, "maps": ["HEIGHT"]}, {"maps": ["AO", "BENT_NORMAL"], "rays": 16}])
def test_a_bake_is_the_same_wherever_dispatches_end(values, monkeypatch):
    """With adaptive samples, some texels alone are traced; rays of blocks pass the tree together."""
    monkeypatch.setattr(cast, "LEAST_PACKETS", 1)
    low, high = scenes.terrains()
    bakes = []
    for most in (UNLIMITED, FEW):
        with turns(monkeypatch, most), counted_dispatches(monkeypatch) as stages:
            bakes.append(maps.bake_all_maps(low, high, size=16, method="CAST", **values)[1])
        assert (unfinished.GO_ON in stages) == (most == FEW)
    for name, texels in bakes[0].items():
        assert np.array_equal(texels, bakes[1][name]), name
        assert texels[..., :3].std() > 0.0


@pytest.mark.parametrize("hit", ["OWN", "OUTERMOST"])
def test_cut_outs_are_the_same_wherever_dispatches_end(hit, monkeypatch):
    """Also where a ray starts again, since it met nothing but what is clear."""
    low, card = scenes.planes("low", "card", height=0.05)
    hair = cut_scenes.hair(by_hand=False)[1]
    cut_scenes.color_over(card, np.eye(8) * 0.2, extension="EXTEND")
    bakes = []
    for most in (UNLIMITED, FEW):
        with turns(monkeypatch, most), counted_dispatches(monkeypatch) as stages:
            values = {
                "maps": ["AO", "HEIGHT"],
                "rays": 16,
                "two_sided": True,
                "hit": hit,
                "extrusion": 0.6,
                "max_distance": 0.9,
            }
            bakes.append(maps.bake_all_maps(low, hair, card, size=16, method="CAST", **values)[1])
        assert (unfinished.GO_ON in stages) == (most == FEW)
    for name, texels in bakes[0].items():
        assert np.array_equal(texels, bakes[1][name]), name
        assert texels[..., :3].std() > 0.0


def test_owners_of_many_hits_go_on_exactly_where_they_were_seed_3(monkeypatch):
    """Rays through a cloud of triangles, of which few belong to the texel."""
    rng = np.random.default_rng(3)
    low = np.ascontiguousarray(oracle.icosphere(2), np.float32)
    high = np.concatenate([low[::2] * 1.02, needles(rng, 300, 0.5, 0.3) * (1.0, 1.0, 2.0)]).astype(np.float32)
    normals = np.repeat(np.cross(high[:, 1] - high[:, 0], high[:, 2] - high[:, 0])[:, None], 3, axis=1)
    across = edges.neighbors(low.reshape(-1, 3), np.arange(low.size // 3).reshape(-1, 3))
    rays, found = test_owned_hits.rays_from(rng, low, 0.6), []
    for most in (UNLIMITED, FEW):
        with turns(monkeypatch, most):
            found.append(test_owned_hits.trace(rays, high, normals, low, across))
    assert same_to_the_bit(*found)
    _, is_hit, is_not_owned, is_from_behind, _ = found[0]
    assert is_hit.mean() > 0.5
    assert min(is_not_owned.mean(), is_from_behind.mean()) > 0.01
