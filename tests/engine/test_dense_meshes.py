# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests that Flatten's map is the same to the bit when triangles are left out, or drawn in parts."""

from dataclasses import replace

import bmesh
import bpy
import numpy as np
import pytest

from addon.core.errors import BakeError
from addon.core.progress import Timings
from addon.core.settings import Settings
from addon.engine import high_meshes, separation, tree_cache
from addon.engine.bands import Band
from addon.engine.high_meshes import HighBatches
from addon.jobs import bake_pair
from addon.mesh import bvh
from addon.mesh.triangle_mesh import Mesh
from addon.passes import cast, data_texture, high_in_uv, mesh_upload, shader, target
from addon.scene import reading
from tests.support import maps, random_cases, zoo

pytestmark = pytest.mark.usefixtures("gpu_context")


SIZE = 40, 24
BANDS = {
    "whole": Band(0, 24, SIZE, 0),
    "rows": Band(8, 16, SIZE, 3),
    "sample": Band(0, 24, SIZE, 0, offset=(0.3125, -0.4375)),
    "tile": Band(0, 24, SIZE, 0, tile=1012),
}


def random_mesh(seed, count=6000):
    """Triangles of all sizes around and below that of a texel, many on top of others, corners on texel centers among them."""
    random = np.random.default_rng(seed)
    middle = random.uniform(-0.2, 2.2, (count, 1, 2))
    corners = middle + random.normal(0, 1, (count, 3, 2)) * 10.0 ** random.uniform(-4, -1.2, (count, 1, 1))
    on_grid = random.random((count, 3)) < 0.3
    corners[on_grid] = (np.round(corners[on_grid] * SIZE * 2) + random.uniform(-0.04, 0.04)) / (2 * np.array(SIZE))
    numbers = random.permutation(3 * count).astype(np.int32)
    uv = np.empty((3 * count, 2), np.float32)
    uv[numbers] = corners.reshape(-1, 2)
    normals = random.normal(0, 1, (3 * count, 3)).astype(np.float32)
    return Mesh(
        f"mesh {seed}",
        normals.copy(),
        np.arange(3 * count, dtype=np.int32),
        normals,
        numbers.reshape(-1, 3),
        np.eye(4),
        uv=uv,
    )


def counted(monkeypatch, name="upload_corners"):
    """The calls of a function of mesh_upload from here on, as a list."""
    calls, upload = [], getattr(mesh_upload, name)
    monkeypatch.setattr(mesh_upload, name, lambda *args, **attributes: calls.append(1) or upload(*args, **attributes))
    return calls


def drawn(highs, band, uploads=None):
    into = target.get("test", band.width, band.height, "RGBA32F")
    shares = list(HighBatches(highs, None, Timings(), uploads).draw(into, band))
    texels = np.empty((band.height, band.width, 4), np.float32)
    into.read(texels)
    return texels, shares


def drawn_whole(monkeypatch, highs, band):
    """As `drawn`, with all triangles."""
    with monkeypatch.context() as patch:
        patch.setattr(high_meshes, "DENSE", 10**6)
        return drawn(highs, band)


@pytest.mark.parametrize("band", BANDS.values(), ids=BANDS)
@random_cases.seeds(5, fast=2)
def test_leaving_out_random_triangles_changes_no_bit(monkeypatch, seed, band):
    highs = [random_mesh(seed), random_mesh(seed + 100)]
    whole, shares = drawn_whole(monkeypatch, highs, band)
    assert shares == [1.0]
    assert (whole[..., 3] > 0.0).mean() > 0.3
    monkeypatch.setattr(high_meshes, "MOST_WHOLE", 0)
    monkeypatch.setattr(high_meshes, "PART", 2500)
    in_parts, shares = drawn(highs, band)
    assert len(shares) == 6
    assert shares[-1] == 1.0
    assert in_parts.tobytes() == whole.tobytes()


@random_cases.seeds(3, fast=2)
def test_random_triangles_drawn_in_steps_change_no_bit(monkeypatch, seed):
    highs, band = [random_mesh(seed)], BANDS["rows"]
    monkeypatch.setattr(shader, "in_software", lambda: True)
    whole, _ = drawn_whole(monkeypatch, highs, band)
    monkeypatch.setattr(high_in_uv, "TRIANGLES_AT_ONCE", 777)
    assert drawn_whole(monkeypatch, highs, band)[0].tobytes() == whole.tobytes()


def side_by_side(mesh):
    """`mesh` with its corners in the order of its triangles, of which every second one shares a corner with the one before."""
    corners = mesh.triangles.reshape(-1)
    triangles = np.arange(len(corners), dtype=np.int32).reshape(-1, 3)
    triangles[1::2, 0] = triangles[::2, 2]
    return replace(
        mesh, vertices=mesh.vertices[corners], normals=mesh.normals[corners], uv=mesh.uv[corners], triangles=triangles
    )


@pytest.mark.parametrize("order", [side_by_side, lambda mesh: mesh], ids=["side by side", "mixed"])
@random_cases.seeds(3, fast=2)
def test_random_triangles_uploaded_in_pieces_change_no_bit(monkeypatch, seed, order):
    highs, band = [order(random_mesh(seed)), order(random_mesh(seed + 100, 900))], BANDS["rows"]
    monkeypatch.setattr(shader, "in_software", lambda: True)
    whole, _ = drawn_whole(monkeypatch, highs, band)
    monkeypatch.setattr(high_meshes, "PIECE", 50)
    monkeypatch.setattr(high_in_uv, "TRIANGLES_AT_ONCE", 20)
    with_indices, without = counted(monkeypatch, "upload"), counted(monkeypatch)
    assert drawn_whole(monkeypatch, highs, band)[0].tobytes() == whole.tobytes()
    assert (len(with_indices), len(without)) == ((138, 0) if order is side_by_side else (0, 138))


def test_pieces_stay_on_the_gpu_for_later_samples(monkeypatch):
    monkeypatch.setattr(shader, "in_software", lambda: True)
    monkeypatch.setattr(high_meshes, "DENSE", 10**6)
    monkeypatch.setattr(high_meshes, "PIECE", 1000)
    batches, into = HighBatches([side_by_side(random_mesh(3))], None, Timings()), target.get("test", *SIZE, "RGBA32F")
    list(batches.draw(into, BANDS["whole"]))
    uploads = counted(monkeypatch, "upload")
    texels = np.empty((SIZE[1], SIZE[0], 4), np.float32)
    list(batches.draw(into, BANDS["sample"]))
    into.read(texels)
    assert not uploads
    assert texels.tobytes() == drawn_whole(monkeypatch, batches.highs, BANDS["sample"])[0].tobytes()


def test_large_meshes_are_drawn_in_parts_on_any_gpu(monkeypatch):
    highs, band = [random_mesh(7)], BANDS["whole"]
    whole, _ = drawn_whole(monkeypatch, highs, band)
    monkeypatch.setattr(shader, "in_software", lambda: False)
    monkeypatch.setattr(high_meshes, "MOST_WHOLE", 5999)
    monkeypatch.setattr(high_meshes, "PART", 1024)
    uploads = counted(monkeypatch)
    in_parts, shares = drawn(highs, band)
    assert len(uploads) == len(shares) == 6
    assert in_parts.tobytes() == whole.tobytes()


@pytest.mark.parametrize(("in_software", "parts"), [(True, 6), (False, 1)])
def test_dense_meshes_are_drawn_in_parts_only_in_software(monkeypatch, in_software, parts):
    monkeypatch.setattr(shader, "in_software", lambda: in_software)
    monkeypatch.setattr(high_meshes, "PART", 1024)
    assert len(drawn([random_mesh(7)], BANDS["whole"])[1]) == parts


@pytest.mark.parametrize("dense", [0, 10**6], ids=["in parts", "whole"])
def test_what_was_drawn_before_is_cleared(monkeypatch, dense):
    monkeypatch.setattr(high_meshes, "DENSE", dense)
    band = BANDS["whole"]
    small = random_mesh(9, 20)
    alone = drawn([small], band)[0]
    drawn([random_mesh(7)], band)
    assert drawn([small], band)[0].tobytes() == alone.tobytes()


def test_parts_without_a_texel_are_not_uploaded(monkeypatch):
    monkeypatch.setattr(high_meshes, "MOST_WHOLE", 0)
    outside = random_mesh(7)
    outside.uv[:] += 9.0
    uploads = counted(monkeypatch)
    assert not drawn([outside], BANDS["whole"])[0].any()
    assert not uploads


def test_live_keeps_dense_meshes_on_the_gpu(monkeypatch):
    monkeypatch.setattr(shader, "in_software", lambda: True)
    uploads = counted(monkeypatch)
    assert drawn([random_mesh(1)], BANDS["whole"], mesh_upload.UploadCache())[1] == [1.0]
    assert not uploads


@random_cases.seeds(3, fast=2)
def test_probes_of_random_dense_meshes_are_the_same_to_the_bit(monkeypatch, seed):
    low, high = random_mesh(seed + 50, 200), random_mesh(seed)
    probe = separation.flat_probe(low, [high])
    dense = probe((24, 24), (2.0, 2.0, -1.0, -1.0))
    monkeypatch.setattr(separation, "DENSE", 10**6)
    whole = separation.flat_probe(low, [high])((24, 24), (2.0, 2.0, -1.0, -1.0))
    assert (whole[..., 3] > 0.0).any()
    assert dense.tobytes() == whole.tobytes()


@pytest.mark.parametrize("samples", [1, 4])
def test_a_bake_in_parts_is_the_same_to_the_bit(monkeypatch, samples):
    low, high = zoo.plane("lo"), zoo.terrain("hi", 24)

    def bake():
        settings = Settings(method="FLATTEN", width=16, height=16, samples=samples, depth=32, storage="MEMORY")
        report = bake_pair(bpy.context, low, [high], settings)
        return np.array(bpy.data.images[report.image].pixels[:], np.float32)

    with monkeypatch.context() as patch:
        patch.setattr(high_meshes, "DENSE", 10**6)
        whole = bake()
    monkeypatch.setattr(high_meshes, "MOST_WHOLE", 0)
    monkeypatch.setattr(high_meshes, "PART", 300)
    uploads = counted(monkeypatch)
    assert bake().tobytes() == whole.tobytes()
    assert len(uploads) == 4 * samples


# Table bytes


QUADS = 128
TRIANGLES, VERTICES = 2 * QUADS**2, (QUADS + 1) ** 2
TEXEL = 16
"""Bytes: each triangle has one for its numbers, each vertex one for its place, and each normal one."""
ROW = 4096 * TEXEL
"""Bytes: a texture has whole rows."""


def bytes_of(high):
    """The bytes of the tables, without those of the tree."""
    tree_cache.trees.free()
    meshes = reading.read(bpy.context, zoo.plane("low"), [high], None, Settings(method="CAST"))
    tables = tree_cache.trees.ray_scene_of(meshes.highs, Timings()).tables
    found = tables.bytes - data_texture.size_of(tables.tree.nodes)
    tree_cache.trees.free()
    return found


def test_a_tree_takes_16_bytes_a_triangle_where_it_is_full():
    tree = bvh.build(np.zeros((3, 3), np.float32), np.tile(np.arange(3), (4**7, 1)))
    assert tree.nodes.nbytes <= 16 * 4**7


def test_a_smooth_mesh_takes_48_bytes_a_triangle_with_its_tree():
    high = zoo.terrain("high", QUADS)
    high.data.shade_smooth()
    found = bytes_of(high)
    assert found <= TRIANGLES * TEXEL + 2 * VERTICES * TEXEL + 3 * ROW
    assert 2 * VERTICES < TRIANGLES * 1.02  # 32 bytes and a border, beside the tree


def test_a_flat_mesh_has_one_normal_for_each_triangle():
    high = zoo.terrain("high", QUADS)
    high.data.shade_flat()
    assert bytes_of(high) <= (2 * TRIANGLES + VERTICES) * TEXEL + 3 * ROW


def test_normals_that_no_corners_share_take_no_more_than_three_a_triangle_seed_1():
    high = zoo.terrain("high", QUADS)
    normals = np.random.default_rng(1).normal(size=(4 * QUADS**2, 3)) * 0.2 + (0.0, 0.0, 1.0)
    high.data.normals_split_custom_set(normals / np.linalg.norm(normals, axis=1, keepdims=True))
    assert bytes_of(high) <= (4 * TRIANGLES + 2 * VERTICES) * TEXEL + 3 * ROW


# Triangle limits


FITTING = 2_304
"""Of two terrains of 24 x 24 quads together."""


@pytest.fixture
def limited(monkeypatch):
    """A function that limits the GPU's textures to so many texels. Tables must not be built when it says no."""

    def limit(texels):
        tree_cache.trees.free()
        monkeypatch.setattr(data_texture, "limit", lambda: texels)
        monkeypatch.setattr(cast, "upload", pytest.fail if texels < FITTING else cast.upload)

    yield limit
    tree_cache.trees.free()


def layers():
    """A plane, and two crossing terrains above and below it, the second with its back up."""
    low, first, second = zoo.plane("low"), zoo.terrain("first", 24), zoo.terrain("second", 24, waves=3)
    second.location = (0.05, 0.02, 0.04)
    second.scale = (1.0, -1.0, 1.0)
    bpy.context.view_layer.update()
    return low, first, second


@pytest.mark.parametrize("options", [{}, {"maps": ["AO"]}, {"maps": ["BASE_COLOR"]}, {"maps": ["HEIGHT"]}], ids=str)
def test_cast_refuses_more_triangles_than_fit(limited, options):
    low, *highs = layers()
    limited(FITTING - 1)
    with pytest.raises(BakeError, match="Cast takes at most 2,303 triangles"):
        maps.bake_all_maps(low, *highs, method="CAST", **{"maps": [], **options})


def test_flatten_refuses_other_maps_of_more_triangles_than_fit_and_draws_the_normal_map(limited):
    low, *highs = layers()
    wanted = maps.bake(low, *highs, method="FLATTEN")
    limited(FITTING - 1)
    with pytest.raises(BakeError, match="2,304 triangles together; Flatten, for other maps .* takes at most 2,303"):
        maps.bake_all_maps(low, *highs, maps=["HEIGHT"], method="FLATTEN")
    assert np.array_equal(maps.bake(low, *highs, method="FLATTEN"), wanted)


@pytest.mark.parametrize("method", ["CAST", "FLATTEN"])
def test_as_many_triangles_as_fit_are_baked(limited, method):
    low, *highs = layers()
    _, wanted = maps.bake_all_maps(low, *highs, maps=["HEIGHT", "MATERIAL_ID"], method=method)
    limited(FITTING * 4 // 3)  # with all nodes of the tree
    _, found = maps.bake_all_maps(low, *highs, maps=["HEIGHT", "MATERIAL_ID"], method=method)
    for name, texels in wanted.items():
        assert np.array_equal(found[name], texels), name
    assert len(np.unique(wanted["height"])) > 500


def test_more_vertices_than_fit_are_refused(limited):
    low, first, _ = layers()
    split = bmesh.new()
    split.from_mesh(first.data)
    bmesh.ops.split_edges(split, edges=split.edges)  # four vertices a quad
    split.to_mesh(first.data)
    split.free()
    limited(2000)
    with pytest.raises(BakeError, match="Cast takes at most 2,000 triangles"):
        maps.bake(low, first, method="CAST")


def test_normals_that_do_not_fit_are_an_error_seed_3(limited):
    """Each corner has a normal of its own: more than triangles, and than vertices."""
    low, first, _ = layers()
    normals = np.random.default_rng(3).normal(size=(len(first.data.loops), 3)) * 0.2 + (0.0, 0.0, 1.0)
    first.data.normals_split_custom_set(normals / np.linalg.norm(normals, axis=1, keepdims=True))
    limited(FITTING)
    with pytest.raises(BakeError, match="this GPU's textures hold 2,304"):
        maps.bake(low, first, method="CAST")
