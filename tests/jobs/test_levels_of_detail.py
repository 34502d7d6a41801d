# SPDX-License-Identifier: GPL-3.0-or-later
"""Chains of levels of detail: meshes within their limits, with the UV borders of the original."""

from dataclasses import replace

import bpy
import numpy as np
import pytest

from addon import older_blender
from addon.core.errors import BakeError, NoGpu
from addon.core.levels import limits
from addon.core.progress import Pace, finish
from addon.core.settings import Settings
from addon.jobs import lod, shared_bake, temporary
from addon.jobs.simplify import decimation, texel_judge
from addon.scene import mesh_reader
from tests.support import scenes, zoo
from tests.support.real_meshes import open_pair
from tests.support.snapshot import difference, snapshot

pytestmark = pytest.mark.usefixtures("gpu_context")

SETTINGS = Settings(width=128, height=128, storage="MEMORY", depth=16)
CLOSE = 0.02
"""The relative error of percentiles of texels, whose centers are not at the extremes."""


def chain(obj, degrees, percent="", settings=SETTINGS):
    return finish(lod.work(bpy.context, obj, limits(degrees, percent), settings, Pace()))


def measured(original, level, settings=SETTINGS):
    """The deviations of the mesh of `level` from that of `original`."""
    surface = mesh_reader.surface(original.data, "UVMap", "original", np.eye(4), with_faces=True)
    small = texel_judge.settings_for(settings)
    return finish(texel_judge.measure(surface, level.data, "UVMap", small, Pace()))


def borders(obj):
    """The edges of UV islands: pairs of UVs, each with the positions of both ends."""
    data = obj.data
    surface = mesh_reader.surface(data, data.uv_layers[0].name, obj.name, np.eye(4))
    start, stop = (np.roll(surface.triangles, -i, axis=1).reshape(-1) for i in range(2))
    rows = np.concatenate([np.hstack([surface.uv[c], surface.positions[surface.vertices[c]]]) for c in (start, stop)])
    ends = np.stack(np.split(rows, 2), axis=1).astype(np.float32)
    turned = np.array([a.tobytes() > b.tobytes() for a, b in ends])
    ends[turned] = ends[turned][:, ::-1]
    keys, counts = np.unique(ends.reshape(len(ends), -1), axis=0, return_counts=True)
    return {key.tobytes() for key in keys[counts == 1]}


@pytest.mark.slow
def test_a_chain_is_within_its_limits_and_five_percent_fewer_are_not():
    original = zoo.terrain("Hill", 24)
    report = chain(original, "2, 0.6, 90", "3, 90, 0.5")
    assert [level.name for level in report.levels] == ["Hill_LOD1", "Hill_LOD2", "Hill_LOD3"]
    triangles = [level.triangles for level in report.levels]
    assert triangles == sorted(triangles, reverse=True) and triangles[0] < report.triangles == 2 * 24 * 24
    for level in report.levels:
        assert level.limit.excess(level.degrees, level.distance) <= 1.0
        if level.beyond:
            assert level.limit.excess(level.beyond_degrees, level.beyond_distance) > 1.0
            assert level.beyond >= int(0.95 * level.triangles) - 1
        obj = bpy.data.objects[level.name]
        assert len(obj.data.polygons) == level.triangles
        assert borders(obj) == borders(original)
        again = measured(original, obj)
        assert (again.degrees, again.distance) == pytest.approx((level.degrees, level.distance))
        assert again.excess(level.limit) <= 1.0


def test_levels_are_objects_of_a_collection_with_maps_of_their_own_and_nothing_else_changes():
    original = zoo.terrain("Hill", 16)
    scenes.material("Grass", original)
    original.location, original.rotation_euler = (1.0, 2.0, 3.0), (0.3, 0.2, 1.0)
    original.parent = scenes.link(bpy.data.objects.new("Uneven", None))
    original.parent.scale = 0.5, 1.0, 1.5
    bpy.context.view_layer.update()
    group = original.vertex_groups.new(name="bones")
    group.add([0, 1, 2], 0.5, "REPLACE")
    before = snapshot()
    report = chain(original, "", "1, 3")
    after = snapshot()
    changed = {key for key in difference(before, after) if key in before}
    allowed = {"objects", "meshes", "collections", "materials", "images"}
    layers = {key for key in changed if isinstance(key, tuple) and key[0] == bpy.context.scene.name}
    assert changed - layers <= allowed
    objects = list(bpy.data.collections["Hill_LODs"].objects)
    assert [obj.name for obj in objects] == ["Hill_LOD1", "Hill_LOD2"]
    for obj, level in zip(objects, report.levels, strict=True):
        np.testing.assert_allclose(obj.matrix_world, original.matrix_world, atol=1e-5)
        assert obj.data.uv_layers[0].name == "UVMap"
        assert [group.name for group in obj.vertex_groups] == ["bones"]
        (material,) = obj.data.materials
        assert material.name != "Grass"
        assert level.bake.image in {node.image.name for node in material.node_tree.nodes if node.type == "TEX_IMAGE"}
    assert len({level.bake.image for level in report.levels}) == 2
    assert not [data for data in bpy.data.meshes if data.users == 0]
    assert len(bpy.data.scenes) == 1


def test_the_bar_never_goes_back_and_makes_no_leap():
    steps = lod.work(bpy.context, zoo.terrain("Hill", 12), limits("1, 4", ""), SETTINGS, Pace(0.0))
    done = [each.done for each in steps]
    assert done == sorted(done) and done[-1] == 1.0
    assert max(np.diff(done)) < 0.15


def step():
    """A gentle wave with a low, curved step, whose wall has 6 % of the texels and needs more triangles than the rest."""

    def surface(u, v):
        wall = np.clip((u - 0.47) / 0.06, 0.0, 1.0)
        x = np.where(u < 0.47, u / 0.47 - 1.0, np.where(u > 0.53, (u - 0.53) / 0.47, 0.0))
        x = x + 0.05 * np.sin(7.0 * v) * (1.0 - x**2)
        return np.stack([x, 2.0 * v - 1.0, 0.04 * wall + 0.1 * np.sin(3.0 * x) * np.cos(2.0 * v)], axis=1)

    return zoo.sheet("Step", surface, 100, 24)


@pytest.mark.slow
def test_triangles_beyond_the_limit_are_kept_and_the_rest_becomes_coarser(monkeypatch):
    kept = chain(step(), "1", "5").levels[0]
    monkeypatch.setattr(decimation.UvDecimation, "corrected", lambda *_: None)
    free = chain(step(), "1", "5").levels[0]
    assert kept.triangles < 0.8 * free.triangles


def test_vertices_around_texels_are_found_on_all_layers():
    plane = zoo.plane("Plane", 2)  # two by two quads, of which two share texels
    uv = np.empty(len(plane.data.loops) * 2, np.float32)
    plane.data.uv_layers[0].uv.foreach_get("vector", uv)
    uv[::2] = np.abs(2.0 * uv[::2] - 1.0)
    plane.data.uv_layers[0].uv.foreach_set("vector", uv)
    with temporary.meshes():
        source = decimation.read_original(bpy.context, plane, "", "RENDER")
        texels = np.zeros((64, 64), bool)
        assert not source.vertices_on(texels).any()
        texels[:31] = True
        points = source.surface.positions[source.vertices_on(texels)]
    assert sorted({(round(float(x), 3), round(float(y), 3)) for x, y, _ in points}) == [
        (x, y) for x in (-1.0, 0.0, 1.0) for y in (-1.0, 0.0)
    ]


def test_a_mesh_whose_vertices_are_all_kept_stays_as_it_is():
    with temporary.meshes():
        source = decimation.read_original(bpy.context, zoo.terrain("Hill", 12), "", "RENDER")
        data = decimation.decimated(source.data, 20, np.zeros(len(source.data.vertices), bool))
        assert mesh_reader.count_triangles(data) == source.triangles
        assert len(data.vertices) == len(source.data.vertices)


@pytest.mark.parametrize("degrees", [1.0, 3.0])
def test_uvs_that_slide_are_measured_on_a_cylinder(degrees):
    def cylinder(name, turned):
        def surface(u, v):
            angle = np.pi * u + np.radians(turned)
            return np.stack([np.cos(angle), np.sin(angle), 2.0 * v - 1.0], axis=1)

        return zoo.sheet(name, surface, 512, 1)

    found = measured(cylinder("a", 0.0), cylinder("b", degrees))
    # On the strip that is turned past the edge, rays meet nothing: these texels count as 180 degrees.
    assert found.degrees == pytest.approx(degrees if degrees < 180 * 0.01 else 180.0, rel=CLOSE)


def test_the_map_without_error_costs_what_its_bits_cost():
    plain, bumps = zoo.plane("Plain"), zoo.terrain("Hill", 32, height=0.02)
    assert measured(bumps, bumps).degrees < 0.05
    rounded = measured(bumps, plain, replace(SETTINGS, depth=8))
    assert 0.1 < rounded.degrees < 0.5
    assert rounded.bare_degrees > 5.0


def test_distances_are_shares_of_the_longest_side():
    original, level = zoo.plane("a", 4), zoo.plane("b", 4)
    points = np.empty(25 * 3, np.float32)
    level.data.attributes["position"].data.foreach_get("vector", points)
    points[2::3] = 0.03
    level.data.attributes["position"].data.foreach_set("vector", points)
    assert measured(original, level).distance == pytest.approx(0.03 / 2.0, rel=1e-3)


def test_uvs_move_to_where_vertices_lie(monkeypatch):
    """On a sheet that is stretched in UV space, collapsing edges moves vertices off the place of their UVs."""

    def surface(u, v):
        return np.stack([2 * u**2 - 1, 2 * v - 1, 0.1 * np.sin(9 * u) * np.sin(7 * v)], axis=1)

    obj = zoo.sheet("Sheet", surface, 48, 48)
    with temporary.meshes():
        original = decimation.read_original(bpy.context, obj, "", "RENDER")
        separation = []
        for moves_uvs in (True, False):
            data = decimation.decimated(original.data, 400, ~original.is_kept)
            data = decimation.with_moved_uvs(data, original.data) if moves_uvs else data
            surface_of = mesh_reader.surface(data, "UVMap", "level", np.eye(4))
            points = surface_of.positions[surface_of.vertices]
            separation.append(np.abs(2 * surface_of.uv[:, 0] ** 2 - 1 - points[:, 0]).mean())
    assert separation[0] < 0.2 * separation[1]


def steps_of(obj, count):
    """Do `count` steps of a chain and close it. Returns whether it was not yet done."""
    work = lod.work(bpy.context, obj, limits("", "3"), SETTINGS, Pace(0.0))
    for _ in range(count):
        if next(work, None) is None:
            return False
    work.close()
    return True


@pytest.mark.slow
def test_a_chain_that_is_stopped_leaves_nothing():
    obj = zoo.terrain("Hill", 12)
    before = snapshot()
    count = 1
    while steps_of(obj, count):
        assert difference(before, snapshot()) == {}
        count = int(1.7 * count) + 1
    assert count > 30


def test_a_map_that_fails_leaves_nothing(monkeypatch):
    obj = zoo.terrain("Hill", 12)
    scenes.material("Grass", obj)
    bake, calls = shared_bake.bake_job, []

    def failing(*arguments):
        calls.append(arguments)
        if len(calls) == 2:
            raise BakeError("The disk is full.")
        return bake(*arguments)

    monkeypatch.setattr(shared_bake, "bake_job", failing)
    before = snapshot()
    with pytest.raises(BakeError, match="full"):
        chain(obj, "", "3, 4")
    assert difference(before, snapshot()) == {}


def test_bad_input_is_one_sentence_and_changes_nothing():
    obj = zoo.terrain("Hill", 8)
    empty = scenes.link(bpy.data.objects.new("Empty", None))
    bare = zoo.plane("Bare")
    bare.data.uv_layers.remove(bare.data.uv_layers[0])
    aside = zoo.plane("Aside", 8)
    aside.data.uv_layers[0].uv.foreach_set("vector", np.full(len(aside.data.loops) * 2, 3.0, np.float32))
    before = snapshot()
    for source, degrees, settings, text in (
        (empty, "1", SETTINGS, "no mesh"),
        (bare, "1", SETTINGS, "UV layer"),
        (aside, "1", SETTINGS, "outside"),
        (obj, "0.1", replace(SETTINGS, depth=8), "alone deviates"),
        (obj, "1", replace(SETTINGS, udim=True, storage="PACK"), "UDIM"),
        (obj, "1,2", replace(SETTINGS, image="same"), "same"),
        (obj, "1", replace(SETTINGS, uv_layer="none"), "none"),
    ):
        with pytest.raises(BakeError, match=text) as caught:
            chain(source, degrees, settings=settings)
        assert str(caught.value).endswith(".") and "\n" not in str(caught.value)
        assert difference(before, snapshot()) == {}


def test_without_a_gpu_nothing_is_made(monkeypatch):
    def fails():
        raise SystemError("no display")

    obj = zoo.terrain("Hill", 8)
    before = snapshot()
    monkeypatch.setattr(older_blender, "start_gpu", fails)
    with pytest.raises(NoGpu, match="There is no GPU to bake on: no display"):
        chain(obj, "1")
    assert difference(before, snapshot()) == {}


@pytest.mark.shared
@pytest.mark.slow
@pytest.mark.parametrize("name", ["king_40480_4000", "shaderball_48048_23378"])
def test_chains_of_real_meshes_to_1_2_and_4_degrees(shared_assets, name):
    """The high meshes of the pairs, with 8 bits."""
    _, original = open_pair(shared_assets, name)
    report = chain(original, "1,2,4", "1", settings=replace(SETTINGS, width=1024, height=1024, depth=8))
    print("\n".join(report.table()))
    assert len(report.levels) == 3
    for level, amount in zip(report.levels, (1.0, 2.0, 4.0), strict=True):
        assert level.degrees <= amount < level.beyond_degrees
        assert level.distance <= 0.01
        assert level.beyond >= int(0.95 * level.triangles) - 1
        assert borders(bpy.data.objects[level.name]) == borders(original)
