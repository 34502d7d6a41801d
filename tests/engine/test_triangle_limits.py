# SPDX-License-Identifier: GPL-3.0-or-later
"""High meshes with more triangles than the GPU's textures hold. test_dense_meshes.py has those that Flatten draws in parts."""

import bmesh
import bpy
import numpy as np
import pytest

from addon.core.errors import BakeError
from addon.engine import tree_cache
from addon.passes import cast, data_texture
from tests.support import maps, zoo

pytestmark = pytest.mark.usefixtures("gpu_context")

TRIANGLES = 2_304
"""Of two terrains of 24 x 24 quads together."""


@pytest.fixture
def limited(monkeypatch):
    """A function that limits the GPU's textures to so many texels. Tables must not be built when it says no."""

    def limit(texels):
        tree_cache.trees.free()
        monkeypatch.setattr(data_texture, "limit", lambda: texels)
        monkeypatch.setattr(cast, "upload", pytest.fail if texels < TRIANGLES else cast.upload)

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
    limited(TRIANGLES - 1)
    with pytest.raises(
        BakeError, match="have 2,304 triangles together; Cast takes at most 2,303 triangles, and as many"
    ):
        maps.bake_all_maps(low, *highs, method="CAST", **{"maps": [], **options})


def test_flatten_refuses_other_maps_of_more_triangles_than_fit_and_draws_the_normal_map(limited):
    low, *highs = layers()
    wanted = maps.bake(low, *highs, method="FLATTEN")
    limited(TRIANGLES - 1)
    with pytest.raises(BakeError, match="2,304 triangles together; Flatten, for other maps .* takes at most 2,303"):
        maps.bake_all_maps(low, *highs, maps=["HEIGHT"], method="FLATTEN")
    assert np.array_equal(maps.bake(low, *highs, method="FLATTEN"), wanted)


@pytest.mark.parametrize("method", ["CAST", "FLATTEN"])
def test_as_many_triangles_as_fit_are_baked(limited, method):
    low, *highs = layers()
    _, wanted = maps.bake_all_maps(low, *highs, maps=["HEIGHT", "MATERIAL_ID"], method=method)
    limited(TRIANGLES * 4 // 3)  # with all nodes of the tree
    _, found = maps.bake_all_maps(low, *highs, maps=["HEIGHT", "MATERIAL_ID"], method=method)
    for name, texels in wanted.items():
        assert np.array_equal(found[name], texels), name
    assert len(np.unique(wanted["height"])) > 1000


def test_more_vertices_than_fit_are_refused(limited):
    low, first, _ = layers()
    split = bmesh.new()
    split.from_mesh(first.data)
    bmesh.ops.split_edges(split, edges=split.edges)  # four vertices a quad
    split.to_mesh(first.data)
    split.free()
    limited(2000)
    with pytest.raises(
        BakeError, match="have 1,152 triangles together; Cast takes at most 2,000 triangles, and as many"
    ):
        maps.bake(low, first, method="CAST")


def test_normals_that_do_not_fit_are_an_error_seed_3(limited):
    """Each corner has a normal of its own: more than triangles, and than vertices."""
    low, first, _ = layers()
    normals = np.random.default_rng(3).normal(size=(len(first.data.loops), 3)) * 0.2 + (0.0, 0.0, 1.0)
    first.data.normals_split_custom_set(normals / np.linalg.norm(normals, axis=1, keepdims=True))
    limited(TRIANGLES)
    with pytest.raises(BakeError, match="different values in a table; this GPU's textures hold 2,304"):
        maps.bake(low, first, method="CAST")
