# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests turning edges within a UV layout: to where places are nearer, with the layout as it was."""

from dataclasses import replace

import numpy as np
import pytest

from addon.mesh.carried_normals import INNER, found_on
from addon.mesh.layout_collapse import Charted
from addon.mesh.layout_flips import Shown, flipped
from addon.mesh.topology import EdgeTable
from tests.pure.test_collapse import grid

QUAD = np.array([(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)], float)


def laid(points, triangles, *, uv=None, labels=None):
    """A mesh whose second UV layer is where it is from above, or `uv` (V, 2)."""
    uv = points[:, :2] if uv is None else uv
    values = np.concatenate([0.5 * uv, uv], axis=1)[triangles]
    return Charted(points, triangles, values, np.zeros(len(triangles), int) if labels is None else labels, layers=2)


def shown_of(mesh, height):
    """What a mesh shows of places with a height above the layout."""
    uv = mesh.values[..., 2:]
    places = np.einsum("kc,tcx->tkx", INNER, uv).reshape(-1, 2)
    corners = np.concatenate([uv, np.zeros((*uv.shape[:2], 1))], axis=2)
    triangles, shares, _ = found_on(corners, np.pad(places, ((0, 0), (0, 1))))
    return Shown(places, np.column_stack([places, height(places)]), np.ones(len(places)), triangles, shares)


def squares(mesh, shown):
    return shown.squares(mesh)


def ridge(places):
    """Along the diagonal that the mesh does not have."""
    return -0.3 * np.abs(places[:, 0] + places[:, 1] - 1.0)


def across():
    points = QUAD.copy()
    points[:, 2] = ridge(points[:, :2])
    return laid(points, np.array([(0, 1, 2), (0, 2, 3)]))


def test_an_edge_turns_to_a_ridge():
    mesh = across()
    shown = shown_of(mesh, ridge)
    turned, found = flipped(mesh, shown, 1)
    assert {frozenset(each) for each in turned.triangles.tolist()} == {frozenset((0, 1, 3)), frozenset((1, 2, 3))}
    assert squares(mesh, shown).sum() > 0.1 and squares(turned, found).sum() == pytest.approx(0.0, abs=1e-12)
    assert turned.values[..., 2:] == pytest.approx(turned.points[turned.triangles][..., :2])
    assert flipped(turned, found, 1)[0] is turned


@pytest.mark.parametrize("noise", [0.0, 1e-17])
def test_uvs_on_a_line_flip_nothing_seed_2(noise):
    """Their areas are rounding."""
    dice = np.random.default_rng(2)
    points, triangles = grid(8)
    along = dice.uniform(0.0, 1.0, len(points))
    uv = np.stack([along, along / 3.0], axis=1) + dice.normal(0.0, noise, (len(points), 2))
    mesh = laid(points, triangles, uv=uv)
    which, shares = dice.integers(0, len(triangles), 2000), dice.dirichlet([1.0, 1.0, 1.0], 2000)
    uvs, places = (np.einsum("nc,ncx->nx", shares, each[triangles[which]]) for each in (uv, points))
    shown = Shown(uvs, places + dice.normal(0.0, 0.3, places.shape), np.ones(2000), which, shares)
    assert flipped(mesh, shown, 1)[0] is mesh


def test_lines_stay_where_they_are():
    mesh = replace(across(), labels=np.array([0, 1]))
    assert flipped(mesh, shown_of(mesh, ridge), 1)[0] is mesh


def test_what_is_flat_stays_as_it_is():
    """Whatever rounding says."""
    points, triangles = grid(6)
    mesh = laid(points / 3.0, triangles)
    shown = shown_of(mesh, lambda places: 1e-9 * np.sin(1e5 * places[:, 0]))
    assert flipped(mesh, shown, 1)[0] is mesh


@pytest.mark.parametrize("layer", [0, 1])
def test_no_triangle_turns_over_in_a_layer(layer):
    """Of a quad that has a corner within the other three there: the diagonal beside it lies outside. The places are of the
    other layer."""
    mesh, uv = across(), QUAD[:, :2].copy()
    uv[2] = 0.2, 0.2
    layers = [QUAD[:, :2], uv] if layer else [uv, QUAD[:, :2]]
    mesh = replace(mesh, values=np.concatenate(layers, axis=1)[mesh.triangles])
    assert flipped(mesh, shown_of(across(), ridge), 1 - layer)[0] is mesh


@pytest.mark.parametrize("third", [(0.3, 0.3), (0.52, 0.52)])
def test_no_triangle_turns_over_or_becomes_thin_on_the_surface(third):
    """Of a dart, and of three points that are nearly on a line."""
    points = QUAD.copy()
    points[2, :2] = third
    mesh = laid(points, np.array([(0, 1, 2), (0, 2, 3)]), uv=QUAD[:, :2])
    shown = replace(shown_of(mesh, ridge), points=np.tile([0.5, 0.5, 0.0], (2 * len(INNER), 1)))
    assert flipped(mesh, shown, 1)[0] is mesh


@pytest.mark.parametrize(("weight", "turns"), [(0.05, False), (0.5, True)])
def test_a_flip_must_save_enough(weight, turns):
    """One place is nearer after it; another one, at a corner, is as far off as before."""
    mesh = across()
    shown = Shown(
        np.array([(0.5, 0.5), (0.0, 0.0)]),
        np.array([(0.5, 0.5, 0.0), (0.0, 0.0, 1.0 + mesh.points[0, 2])]),
        np.array([weight, 1.0]),
        np.array([0, 0]),
        np.array([(0.5, 0.0, 0.5), (1.0, 0.0, 0.0)]),
    )
    assert (flipped(mesh, shown, 1)[0] is not mesh) == turns


def test_two_flips_do_not_make_the_same_edge():
    """Of a double pyramid, between whose tips each edge around it would turn to go."""
    points = np.array([(1, 0, 0), (0, 1, 0), (-1, 0, 0), (0, -1, 0), (0, 0, 1), (0, 0, -1)], float)
    first = np.arange(4)
    last = (first + 1) % 4
    triangles = np.stack([first, last, np.full(4, 4), last, first, np.full(4, 5)], axis=1).reshape(8, 3)
    uv = np.tile([(0.0, 0.0), (1.0, 1.0), (0.0, 1.0), (1.0, 1.0), (0.0, 0.0), (1.0, 0.0)], (4, 1)).reshape(8, 3, 2)
    uv += 2.0 * np.repeat(first, 2)[:, None, None]
    mesh = Charted(points, triangles, uv, np.zeros(8, int))
    middles = np.repeat(2.0 * first + 0.5, 2).reshape(4, 2)
    shares = np.tile([0.5, 0.5, 0.0], (4, 1))
    shown = Shown(middles, np.zeros((4, 3)), np.ones(4), 2 * first, shares)
    turned, _ = flipped(mesh, shown, 0)
    assert EdgeTable.of(turned.triangles).counts.tolist().count(2) == 12
    assert len(np.unique(np.sort(turned.triangles, axis=1), axis=0)) == 8


def test_edges_that_are_there_are_not_made_again():
    """A tetrahedron without a layout of its last two faces: its sixth edge is where another would turn to."""
    triangles = np.array([(0, 1, 2), (0, 2, 3), (1, 0, 3), (1, 3, 2)])
    mesh = replace(laid(across().points, triangles), labels=np.array([0, 0, 1, 1]))
    own = shown_of(across(), ridge)
    assert flipped(mesh, own, 1)[0] is mesh


def test_bumps_are_nearer_and_places_stay_in_the_layout():
    def bumps(places):
        return 0.2 * np.sin(7.0 * places[:, 0] + 3.0) * np.cos(5.0 * places[:, 1] - places[:, 0])

    points, triangles = grid(8)
    points[:, 2] = bumps(points[:, :2])
    mesh = laid(points, triangles)
    shown = shown_of(laid(*grid(16)), bumps)
    here = shown_of(mesh, bumps)
    triangles, shares, _ = found_on(
        np.pad(mesh.values[..., 2:], ((0, 0), (0, 0), (0, 1))), np.pad(shown.uv, ((0, 0), (0, 1)))
    )
    shown = replace(shown, triangles=triangles, shares=shares)
    assert len(here.uv) < len(shown.uv)
    turned, found = flipped(mesh, shown, 1)
    assert squares(turned, found).sum() < 0.8 * squares(mesh, shown).sum()
    uv = np.einsum("nc,ncx->nx", found.shares, turned.values[found.triangles][..., 2:])
    assert uv == pytest.approx(shown.uv, abs=1e-6)
    assert turned.values[..., 2:] == pytest.approx(turned.points[turned.triangles][..., :2])
    assert (np.linalg.det(turned.values[:, 1:, 2:] - turned.values[:, :1, 2:]) > 0.0).all()
    before, after = (EdgeTable.of(each.triangles) for each in (mesh, turned))
    assert after.counts.max() == 2 and len(after.counts) == len(before.counts)
    assert not np.array_equal(after.keys, before.keys)
