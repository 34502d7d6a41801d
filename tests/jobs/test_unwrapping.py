# SPDX-License-Identifier: GPL-3.0-or-later
"""Meshes without UVs are unwrapped: how well is measured by closed forms, and as the checks of a bake see it."""

import re
from dataclasses import replace

import bpy
import numpy as np
import pytest

from addon.core.errors import BakeError
from addon.core.progress import finish
from addon.core.settings import Settings
from addon.jobs import Job, bake_jobs, flattening, unwrapping
from addon.mesh import uv_islands, uv_stretch
from addon.scene import mesh_reader
from tests.support import lanes, zoo

USUAL = {"width": 256, "height": 256, "method": "CAST", "margin": 4, "storage": "MEMORY", "material": False}
SETTINGS = Settings(**USUAL)


def bare(obj):
    """The object without its UVs."""
    obj.data.uv_layers.remove(obj.data.uv_layers[0])
    return obj


def state():
    """What must stay as it was."""
    return (
        {kind: len(getattr(bpy.data, kind)) for kind in ("scenes", "objects", "meshes")},
        bpy.context.scene.name,
        bpy.context.mode,
        [obj.name for obj in bpy.context.selected_objects],
    )


def test_a_mesh_is_unwrapped_and_nothing_else_changes():
    low = bare(zoo.cube("lo"))
    low.scale = (1.0, 2.0, 3.0)
    bpy.context.view_layer.update()
    before = state()
    said = unwrapping.unwrap(low, SETTINGS)
    assert state() == before
    assert re.match(r"'lo' is unwrapped: [1-6] islands by ", said)
    assert "stretch 1.00 (angles), 1.00 (areas)" in said  # at the scale of the object
    (layer,) = low.data.uv_layers
    assert low.data.uv_layers.active == layer and layer.active_render
    assert not any(edge.use_seam for edge in low.data.edges)
    uv = np.empty((len(low.data.loops), 2), np.float32)
    layer.uv.foreach_get("vector", uv.reshape(-1))
    assert uv.min() > 0.0 and uv.max() < 1.0


@pytest.mark.parametrize("share", [0.3, 1.0])
def test_uvs_that_are_not_finite_count_for_nothing(share):
    """As broken importers write them: no face is left out for those that it had."""
    plain, broken = zoo.ball("plain", 12), zoo.ball("broken", 12)
    uv = np.random.default_rng(0).random((len(broken.data.loops), 2), np.float32)
    uv[: round(share * len(uv))] = np.nan
    broken.data.uv_layers.new(name="Broken").uv.foreach_set("vector", uv.reshape(-1))
    for each in (plain, broken):
        unwrapping.unwrap(each, SETTINGS)
    found = [mesh_reader.uvs(each.data, each.data.uv_layers.active.name) for each in (plain, broken)]
    assert np.array_equal(*found)


def test_sharp_edges_are_borders_of_islands():
    low = bare(zoo.cube("lo"))
    low.data.set_sharp_from_angle(angle=0.5)
    assert "6 islands" in unwrapping.unwrap(low, SETTINGS)


@pytest.mark.usefixtures("gpu_context")
@pytest.mark.parametrize("mips", lanes.slow_but([4], [1, 4]))
def test_islands_have_the_margin_that_mip_levels_need(mips):
    low = bare(zoo.terrain("lo", 10, height=0.8))
    high = zoo.terrain("high", 40, height=0.8)
    chosen = Settings(**USUAL, mips=mips)
    unwrapping.unwrap(low, chosen)
    (report,) = bake_jobs.bake_all(bpy.context, [Job(low, [high])], chosen)
    assert report.checks["gaps"]["share"] < 1e-3
    assert report.checks["overlap"]["share"] < 1e-3
    assert report.checks["no_area"]["count"] == 0


def sharpness(obj):
    """That of the active UV map of an object's own mesh, as the closed forms above have it."""
    data = obj.data
    corners = mesh_reader.triangles(data)
    points = mesh_reader.points(data)[mesh_reader.corner_vertices(data)]
    return uv_stretch.measure(points[corners], mesh_reader.uvs(data, data.uv_layers.active.name)[corners]).sharpness


@pytest.mark.parametrize("build", [lambda: zoo.terrain("lo", 8, height=0.8), lambda: zoo.sphere("lo", 8)])
def test_maps_are_sharper_than_by_smart_project(build):
    """Which gets half the distance between islands."""
    low, rival = bare(build()), bare(build())
    rival.data.uv_layers.new()
    with flattening.editing(rival):
        bpy.ops.uv.smart_project(island_margin=unwrapping.margin(SETTINGS.sampling), margin_method="FRACTION")
    unwrapping.unwrap(low, SETTINGS)
    assert sharpness(low) > sharpness(rival)


def own_mirror():
    """A ball with bumps that are the same on both sides of x = 0, and on no others."""
    bpy.ops.mesh.primitive_uv_sphere_add(segments=16, ring_count=10)
    low = bare(bpy.context.object)
    points = mesh_reader.points(low.data).astype(np.float64)
    x, y, z = points.T
    points *= 1.0 + 0.1 * np.stack([np.sin(5.0 * y + 3.0 * z), np.cos(4.0 * z), np.abs(x)], axis=1)
    low.data.vertices.foreach_set("co", points.astype(np.float32).reshape(-1))
    return low


def islands_of(low):
    """The island of each face, and the face that is its mirror image."""
    mesh = mesh_reader.surface(low.data, unwrapping.NAME, "lo", np.eye(4), with_faces=True)
    islands = np.zeros(len(low.data.polygons), int)
    islands[mesh.faces] = uv_islands.islands(mesh)
    middles = np.array([polygon.center for polygon in low.data.polygons])
    apart = np.linalg.norm(middles[:, None] - middles * (-1.0, 1.0, 1.0), axis=2)
    assert apart.min(axis=1).max() < 1e-4
    areas = np.abs(np.linalg.det(np.diff(mesh.uv[mesh.triangles].astype(float), axis=1)))
    return islands, apart.argmin(axis=1), np.bincount(mesh.faces, areas)


@pytest.mark.slow
def test_islands_of_a_mesh_that_is_its_own_mirror_are_so_too(monkeypatch):
    """They have the same faces, mirrored, and those that do not cross the plane have the same shape."""
    monkeypatch.setattr(unwrapping, "CLOSE", 0.3)
    low = own_mirror()
    unwrapping.unwrap(low, SETTINGS)
    islands, image, areas = islands_of(low)
    pairs = set(zip(islands.tolist(), islands[image].tolist(), strict=True))
    assert len(pairs) == islands.max() + 1 > 1
    is_pair = islands != islands[image]
    assert areas[is_pair] == pytest.approx(areas[image[is_pair]], rel=1e-3)


@pytest.mark.parametrize(("least", "count"), [(0.0, 1), (10.0, 2)])
def test_an_island_whose_border_costs_more_than_its_area_is_joined_with_another(monkeypatch, least, count):
    """The corner of a flat grid, if what is left of the figure is enough."""
    monkeypatch.setattr(unwrapping, "JOINED", least)
    low = zoo.plane("lo", 16)
    work = unwrapping._Unwrapping(low, unwrapping._read(low), SETTINGS.sampling)
    labels = (np.arange(len(low.data.polygons)) == 0).astype(int)
    way = unwrapping.Unwrapped(unwrapping.CHARTS, finish(work._flattener.flattened(labels)))
    assert len(finish(work._without_crumbs(way)).flattened.stretch) == count


@pytest.mark.parametrize("figure", [0.01, 0.99])
def test_mirrored_islands_are_taken_if_they_use_the_map_as_well(monkeypatch, figure):
    def mirrored(self, packed):
        yield from ()
        return replace(packed, stacked=0.25, layout=replace(packed.layout, sharpness=figure))

    monkeypatch.setattr(unwrapping._Unwrapping, "mirrored", mirrored)
    said = unwrapping.unwrap(bare(zoo.terrain("lo", 4, height=0.3)), SETTINGS)
    assert ("25% of the faces on others" in said) == (figure > 0.5)


def test_charts_that_always_overlap_become_single_faces(monkeypatch):
    monkeypatch.setattr(
        flattening.uv_crossings, "crossing", lambda uv, nodes, islands: np.bincount(islands)[islands] > 2
    )
    assert "16 islands" in unwrapping.unwrap(bare(zoo.terrain("lo", 4, height=0.3)), SETTINGS)


def strip_of(count, width=0.1):
    """A flat strip of quads, wound up along a spring."""
    turn = 0.3 * np.arange(count + 1)
    rim = np.stack([np.cos(turn), np.sin(turn), 0.05 * turn], axis=1)
    data = bpy.data.meshes.new("spring")
    points = np.concatenate([rim, rim + (0.0, 0.0, width)])
    quads = [(k, k + 1, count + 2 + k, count + 1 + k) for k in range(count)]
    data.from_pydata(points.tolist(), [], quads)
    obj = bpy.data.objects.new("spring", data)
    bpy.context.scene.collection.objects.link(obj)
    return obj


def figures(said):
    """The islands and the share of the map in the sentence of Unwrap."""
    return int(re.search(r"([\d,]+) islands", said)[1]), int(re.search(r"(\d+)% of the map", said)[1])


def test_an_island_much_longer_than_the_map_is_halved():
    """A strip of 24 by 0.1, of which one island would use less than 1 % of the map."""
    islands, used = figures(unwrapping.unwrap(strip_of(80), SETTINGS))
    assert 4 <= islands <= 40 and used > 40


def test_a_flat_ring_stays_whole():
    ring = zoo.plane("ring")
    angle = 2.0 * np.pi * np.arange(24) / 24
    rim = np.stack([np.cos(angle), np.sin(angle), 0.0 * angle], axis=1)
    data = bpy.data.meshes.new("ring")
    quads = [(k, (k + 1) % 24, 24 + (k + 1) % 24, 24 + k) for k in range(24)]
    data.from_pydata(np.concatenate([rim, 0.6 * rim]).tolist(), [], quads)
    ring.data = data
    islands, used = figures(unwrapping.unwrap(ring, SETTINGS))
    assert islands == 1 and used > 45


def test_the_copy_of_a_mesh_is_unwrapped_in_small_steps(monkeypatch):
    """So that Esc ends it at once: no call of Blender has many more faces than AT_ONCE, and events come before one with
    more."""
    monkeypatch.setattr(flattening, "AT_ONCE", 20)
    calls, is_told, unwrapped = [], False, flattening.Flattener._by_blender
    monkeypatch.setattr(
        flattening.Flattener,
        "_by_blender",
        lambda self, faces, *rest: calls.append((len(faces), is_told)) or unwrapped(self, faces, *rest),
    )
    for step in unwrapping.work(bare(zoo.sphere("lo", 8)), SETTINGS, is_quick=True):
        is_told = step.is_before_long
    assert len(calls) > 2 and max(calls) < (100, True)
    assert {is_told == (size > 20) for size, is_told in calls} == {True} and len({told for _, told in calls}) == 2


def test_no_chart_of_too_many_faces_is_unwrapped_by_blender(monkeypatch):
    """Nor is one taken that is projected with stretch: both the charts and the mesh's seams are cut further."""
    monkeypatch.setattr(flattening, "AT_ONCE", 1)
    monkeypatch.setattr(flattening, "MOST", 12)
    sizes, unwrapped = [], flattening.Flattener._by_blender
    monkeypatch.setattr(
        flattening.Flattener,
        "_by_blender",
        lambda self, faces, *rest: sizes.append(len(faces)) or unwrapped(self, faces, *rest),
    )
    low = zoo.terrain("lo", 6, height=0.8)
    work = unwrapping._Unwrapping(low, unwrapping._read(low), SETTINGS.sampling)
    whole = finish(work._flattener.sound(np.zeros(36, int)))
    levels = finish(work._levels(unwrapping.COARSE, is_draft=False))
    assert sizes and max(sizes) <= 12
    assert len(whole.stretch) >= 3 and np.bincount(whole.labels).max() <= 12 and not whole.is_bad.any()
    assert max(np.bincount(level.labels).max() for level in levels) <= 12
    plane = zoo.plane("plane", 6)
    work = unwrapping._Unwrapping(plane, unwrapping._read(plane), SETTINGS.sampling)
    assert len(finish(work._flattener.sound(np.zeros(36, int))).stretch) == 1  # flat charts may have any number


def test_seams_of_the_mesh_are_tried_and_stay(monkeypatch):
    monkeypatch.setattr(unwrapping, "STEPS", (1000.0,))  # many charts: the seams are better
    low = bare(zoo.terrain("lo", 6, height=0.8))
    for edge in low.data.edges:
        edge.use_seam = all(abs(low.data.vertices[k].co.x) < 0.1 for k in edge.vertices)
    seams = [edge.use_seam for edge in low.data.edges]
    assert 0 < sum(seams) < len(seams)
    assert "2 islands by the mesh's seams" in unwrapping.unwrap(low, SETTINGS)
    assert [edge.use_seam for edge in low.data.edges] == seams


def test_what_cannot_be_unwrapped_stays_as_it_is():
    empty = bpy.data.objects.new("empty", bpy.data.meshes.new("empty"))
    bpy.context.scene.collection.objects.link(empty)
    with pytest.raises(BakeError, match="has no faces"):
        unwrapping.unwrap(empty, SETTINGS)
    flat = bare(zoo.plane("flat"))
    flat.data.vertices.foreach_set("co", np.zeros(12, np.float32))
    before = state()
    with pytest.raises(BakeError, match="its faces have no area"):
        unwrapping.unwrap(flat, SETTINGS)
    assert not flat.data.uv_layers and state() == before
