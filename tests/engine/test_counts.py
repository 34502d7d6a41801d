# SPDX-License-Identifier: GPL-3.0-or-later
"""Costs of a bake that do not depend on the machine: passes, uploads, bytes, and nodes of the tree."""

from collections import Counter

import bpy
import numpy as np
import pytest

from addon.core import progress
from addon.core.settings import Settings
from addon.engine import tree_cache
from addon.jobs import Job, bake_all, bake_pair, live_session
from addon.mesh import bvh
from addon.passes import allocation, data_texture, target
from tests.support import zoo

pytestmark = pytest.mark.usefixtures("gpu_context")

SIZE = 64
TEXELS = SIZE * SIZE


@pytest.fixture
def counts(monkeypatch):
    """How often each program ran, and how many bytes were uploaded and read back, since the test began."""
    seen = Counter()
    bind, vertices, read = target.bind, allocation.corners, target.Target.read
    upload, numbers = data_texture.upload, data_texture.upload_numbers

    def counting_bind(compiled, program, **bindings):
        seen[program.compute or program.fragment] += 1
        return bind(compiled, program, **bindings)

    def counting_vertices(name, values):
        seen["bytes of vertices"] += values.nbytes if len(values) > 3 else 0  # a pass on all texels draws one triangle
        return vertices(name, values)

    def counting_upload(values):
        seen["bytes of tables"] += len(values) * 16
        return upload(values)

    def counting_numbers(*columns):
        seen["bytes of tables"] += len(columns[0]) * 16
        return numbers(*columns)

    def counting_read(self, out, *place, **options):
        seen["bytes read"] += out.nbytes
        return read(self, out, *place, **options)

    monkeypatch.setattr(target, "bind", counting_bind)
    monkeypatch.setattr(allocation, "corners", counting_vertices)
    monkeypatch.setattr(data_texture, "upload", counting_upload)
    monkeypatch.setattr(data_texture, "upload_numbers", counting_numbers)
    monkeypatch.setattr(target.Target, "read", counting_read)
    tree_cache.trees.free()
    return seen


def pair():
    """Two terrains, one over the other: 128 and 8,192 triangles."""
    return zoo.terrain("lo", n=8), zoo.terrain("hi", n=64)


def settings(method, **values):
    return Settings(method=method, width=SIZE, height=SIZE, storage="MEMORY", material=False, **values)


def passes(counts):
    """The runs by shader file, without those of the audit, which draws its own small maps."""
    audit = {
        "audit/overlap_frag.glsl",
        "bake/gbuffer_frag.glsl",
        "bake/points_frag.glsl",
        "audit/triangle_ids_frag.glsl",
        "bake/cast_distance_frag.glsl",
    }
    return {name: count for name, count in counts.items() if name.endswith(".glsl") and name not in audit}


@pytest.mark.parametrize("samples", [1, 4, 64])
def test_flatten_draws_once_per_sample(counts, samples):
    low, high = pair()
    bake_pair(bpy.context, low, [high], settings("FLATTEN", samples=samples))
    accumulated = {}
    if samples > 1:
        accumulated = {"bake/accumulate_comp.glsl": samples, "bake/average_frag.glsl": 1, "bake/turned_frag.glsl": 1}
    assert passes(counts) == {
        "bake/flatten_frag.glsl": samples,
        "bake/tangent_frag.glsl": 1,
        "margin/margin_written_comp.glsl": 1,
        "margin/margin_rows_comp.glsl": 1,
        "margin/margin_columns_comp.glsl": 3,  # of a margin of 16 texels: every 16th row, every 4th, and all
        "margin/margin_fill_frag.glsl": 1,
        **accumulated,
    }


@pytest.mark.parametrize("samples", [1, 4])
def test_cast_dispatches_once_per_sample(counts, samples):
    low, high = pair()
    distances = {"extrusion": 0.3, "max_distance": 0.6}
    bake_pair(bpy.context, low, [high], settings("CAST", samples=samples, **distances))
    found = passes(counts)
    # Up to five more for the audit, on few texels: the lengths of the rays, and what lies behind their hits.
    assert samples <= found["bake/cast_comp.glsl"] <= samples + 5
    assert found["bake/cast_lookup_frag.glsl"] == samples
    assert found["bake/tangent_frag.glsl"] == 1


@pytest.mark.parametrize("method", ["FLATTEN", "CAST"])
def test_texels_without_a_center_draw_the_low_mesh_once_more_for_each_sample(counts, method):
    low, high = zoo.two_islands("low", gap=0.33), zoo.two_islands("high", gap=0.33)
    bake_pair(bpy.context, low, [high], settings(method, samples=4))
    assert passes(counts)["bake/tangent_frag.glsl"] == 1 + 4


def test_bytes_uploaded_and_read_back(counts):
    low, high = pair()
    bake_pair(bpy.context, low, [high], settings("FLATTEN"))
    corners = 4 * (64 * 64 + 8 * 8)
    assert counts["bytes of tables"] == 0
    # UVs and normals of both meshes, tangents of the low one. The audit draws both once more.
    flat = corners * (2 + 3) * 4 + 4 * 8 * 8 * 4 * 4
    assert flat <= counts["bytes of vertices"] <= 4 * flat
    # The map and its state. The audit's small maps have the same size here.
    assert TEXELS * 17 <= counts["bytes read"] <= TEXELS * 17 * 5


def test_a_tree_is_uploaded_once(counts):
    low, high = pair()
    for _ in range(3):
        bake_pair(bpy.context, low, [high], settings("CAST"))
    high, low = 2 * 64 * 64, 2 * 8 * 8
    # Six levels above the one of the high triangles, and three above that of the low ones.
    high_nodes, low_nodes = (
        sum(4**level for level in range(6)) + high // 4,
        sum(4**level for level in range(3)) + low // 4,
    )
    edges = 1  # an empty texture: the low mesh has no hard ones
    # The low triangles once more with their clearances, and once in each audit, whose rays hit them.
    triangles = high + 4 * 2 * low + 3 * low
    points = 65 * 65 + 3 * 9 * 9
    normals = 65 * 65  # one for each vertex of the high mesh
    assert counts["bytes of tables"] == 16 * (3 * (high_nodes + low_nodes) + triangles + points + normals + edges)


@pytest.mark.parametrize("share_image", [False, True])
@pytest.mark.parametrize("method", ["FLATTEN", "CAST"])
def test_targets_are_freed_when_they_exceed_their_limit(monkeypatch, method, share_image):
    def bake(most):
        monkeypatch.setattr(target.common, "most_bytes", most)
        bake_all(bpy.context, [Job(*objects)], settings(method), share_image=share_image)
        return target.common.bytes

    low, high = pair()
    objects = low, [high]
    held = bake(512 * 2**20)
    assert held > TEXELS * 16
    assert bake(held) == held
    assert bake(1) == 0


def test_a_live_map_uploads_only_changed_objects(counts):
    low, high = pair()
    following = live_session.Session(bpy.context, Job(low, [high]), settings("FLATTEN"), progress.Pace())
    following.run(bpy.context)
    counts.clear()
    points = np.empty(len(high.data.vertices) * 3, np.float32)
    high.data.attributes["position"].data.foreach_get("vector", points)
    high.data.attributes["position"].data.foreach_set("vector", points * np.tile((1.0, 1.0, 1.5), len(points) // 3))
    high.data.update()
    bpy.context.view_layer.update()
    following.run(bpy.context, {high.session_uid})
    assert counts["bytes of vertices"] == 4 * 64 * 64 * 3 * 4  # normals
    assert counts["bytes read"] == TEXELS  # which texels are written; the map stays on the GPU
    assert following.texels.shape == (SIZE, SIZE, 4)
    assert counts["bytes read"] == TEXELS * 17
    counts.clear()
    following.run(bpy.context, set())
    assert counts["bytes of vertices"] == 0
    following.free()


def test_rays_visit_few_nodes_seed_3():
    """On a fixed terrain, with the shader's traversal of the tree written in Python."""
    n, rays = 64, 200
    grid = zoo.grid_uv(n, n)
    points = np.column_stack([grid, 0.1 * np.sin(9 * grid[:, 0]) * np.cos(7 * grid[:, 1])]).astype(np.float32)
    quads = zoo.grid_faces(n, n)
    tree = bvh.build(points, np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]]))
    bits = tree.nodes.view(np.uint32).astype(np.int64)
    low, high = bits & 0x7FFF, bits >> 15
    rng = np.random.default_rng(3)
    starts = np.column_stack([rng.random((rays, 2)), np.ones(rays)])
    tilt = np.column_stack([rng.normal(0, 0.3, (rays, 2)), -np.ones(rays)])
    visited = []
    for start, direction in zip((starts - tree.origin) * tree.scale, tilt * tree.scale, strict=True):
        waiting, count = [0], 0
        while waiting:
            node = waiting.pop()
            count += 1
            near = (np.where(direction[:, None] > 0, low[node], high[node]) - start[:, None]) / direction[:, None]
            far = (np.where(direction[:, None] > 0, high[node], low[node]) - start[:, None]) / direction[:, None]
            hit = np.maximum(near.max(axis=0), 0.0) <= far.min(axis=0)
            children = node * 4 + 1 + np.flatnonzero(hit)
            waiting += children[children < tree.first_leaf].tolist()
        visited.append(count)
    assert 5 < np.mean(visited) < 7  # of 3,413
