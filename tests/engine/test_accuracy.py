# SPDX-License-Identifier: GPL-3.0-or-later
"""Flatten on real meshes, compared with Cycles: its bake of the high mesh, and its normals from the map."""

from dataclasses import replace

import bpy
import mathutils
import numpy as np
import pytest

from addon.core import progress
from addon.core.progress import Timings
from addon.core.settings import Run, Settings
from addon.engine import baking, sources
from addon.engine.margins import for_maps
from addon.engine.normal_space import NormalSpace
from addon.engine.sampling import SampledMaps
from addon.mesh import triangle_mesh
from tests.support import angles, cycles, lanes, maps
from tests.support.real_meshes import open_pair

pytestmark = pytest.mark.shared

SIZE = (1024, 1024)
PAIRS = [
    "kepler_199712_9079",
    "sthelens_290088_9079",
    "spot_control_vs_subd5",
    "shaderball_48048_23378",
    "king_40480_4000",
]
FAST = ["king_40480_4000"]
"""The pairs with the fastest bakes run in the fast lane."""

OBJECT_SPACE_P99 = 0.05
"""Degrees. Rasterizers snap corners to 1/256 texel. On these meshes that rotates a normal by a few hundredths of a degree."""
ROUND_TRIP_P99 = 0.1
"""Degrees. As above, twice: once when the map is drawn, once when Cycles interpolates the low mesh."""
VISIBLY_WRONG = 5.0
"""Degrees."""
UNEXPLAINED = 5e-5
"""Share of texels that may be visibly wrong outside folded slivers: a few at the borders of folds and islands."""


def bake(low, high, image="map", **settings):
    """Texels (H, W, 4) of a float map without margin."""
    return maps.bake(low, high, image=image, size=SIZE, **settings)


@pytest.mark.parametrize("name", lanes.slow_but(FAST, PAIRS))
def test_object_space_map_equals_cycles_bake_of_the_high_mesh(shared_assets, name):
    low, high = open_pair(shared_assets, name)
    texels = bake(low, high, space="OBJECT")
    expected, written = cycles.bake_normals(high, SIZE, space="OBJECT")
    both = angles.eroded(written & (texels[..., 3] > 0), 1)
    error = angles.degrees(angles.decode(texels), angles.decode(expected))[both]
    print(
        f"{name}: median {np.median(error):.4f}, 99th percentile {np.percentile(error, 99):.4f}, max {error.max():.2f}"
    )
    assert both.mean() > 0.3  # most of each layout is compared
    assert np.percentile(error, 99) < OBJECT_SPACE_P99


TURNED = mathutils.Matrix.LocRotScale((2.0, -20.0, 3.0), mathutils.Euler((0.3, 1.1, -0.7)), (1.0, 2.0, 0.5))
MIRRORED = mathutils.Matrix.LocRotScale((0.0, 5.0, 0.0), mathutils.Euler((-0.4, 0.2, 2.0)), (-1.0, 1.5, 1.0))
TRANSFORMS = {"plain": mathutils.Matrix(), "turned_scaled": TURNED, "mirrored": MIRRORED}


PLACED = lanes.in_turn(FAST, [*PAIRS, "helmet_23358_6117"], TRANSFORMS)


@pytest.mark.parametrize("case", lanes.slow_but([(FAST[0], "mirrored")], PLACED), ids=str)
def test_tangent_map_gives_the_high_normals_in_the_normal_map_node(shared_assets, case):
    name, transform = case
    low, high = open_pair(shared_assets, name)
    for obj in (low, high):
        obj.matrix_world = TRANSFORMS[transform] @ obj.matrix_world
    low.data.materials.clear()
    low.data.materials.append(diffuse_material())
    expected = bake(low, high, "expected", space="WORLD")
    bpy.context.scene.render.engine = "CYCLES"  # the map is made for the scene's render engine
    texels = bake(low, high, "tangent", material=True)
    seen, written = cycles.world_normals(low, SIZE)
    both = angles.eroded(written & (texels[..., 3] > 0) & ~cycles.shared(low, SIZE), 2)
    folded = folds(low)[both]
    error = angles.degrees(angles.decode(expected), seen)[both]
    wrong = error > VISIBLY_WRONG
    print(
        f"{name} {transform}: median {np.median(error):.4f}, 99th percentile {np.percentile(error, 99):.4f}, "
        f"without folds {np.percentile(error[~folded], 99):.4f}; over 5 degrees {wrong.mean():.4%}, "
        f"of them in folds {np.count_nonzero(wrong & folded)} of {np.count_nonzero(wrong)}; folds {folded.mean():.3%}"
    )
    assert both.mean() > 0.3
    assert np.percentile(error[~folded], 99) < ROUND_TRIP_P99
    assert wrong[~folded].mean() < UNEXPLAINED


def test_map_is_the_same_ten_kilometers_from_the_origin(shared_assets):
    maps = []
    for offset in (0.0, 10_000.0):
        low, high = open_pair(shared_assets, "king_40480_4000")
        for obj in (low, high):
            obj.matrix_world = mathutils.Matrix.Translation((offset, offset, -offset)) @ obj.matrix_world
        maps.append(bake(low, high))
    assert np.array_equal(*maps)


def diffuse_material():
    """A material whose shader shows the Normal input as it is.

    A glossy shader bends normals that would reflect below the surface, which hides errors of the map.
    """
    material = bpy.data.materials.new("diffuse")
    nodes, links = material.node_tree.nodes, material.node_tree.links
    nodes.clear()
    shader = nodes.new("ShaderNodeBsdfDiffuse")
    links.new(shader.outputs[0], nodes.new("ShaderNodeOutputMaterial").inputs["Surface"])
    return material


def folds(low):
    """Where (H, W) the low mesh has a triangle with a corner normal behind its own face.

    Cycles treats such a texel as a back face and flips the normal: no map is right on a folded sliver.
    """
    mesh = cycles.read(low)
    corners = mesh.positions[mesh.vertices[mesh.triangles]] @ mesh.to_world[:3, :3].T
    face = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    face *= np.sign(np.linalg.det(mesh.to_world[:3, :3]))  # mirroring reverses the winding, not the outside
    world_normals = mesh.normals @ triangle_mesh.normal_matrix(mesh.to_world).T
    behind = ((world_normals[mesh.triangles] * face[:, None]).sum(axis=-1) <= 0.0).any(axis=1)
    # Drawn like any mesh: one normal for the folded triangles, its opposite for the others.
    painted = replace(
        mesh,
        uv=mesh.uv[mesh.triangles.reshape(-1)],
        normals=np.repeat(np.where(behind[:, None], (0.0, 0.0, -1.0), (0.0, 0.0, 1.0)), 3, axis=0).astype(np.float32),
        triangles=np.arange(mesh.triangles.size, dtype=np.int32).reshape(-1, 3),
        to_world=np.eye(4),
    )
    settings = Settings(space="WORLD", width=SIZE[0], height=SIZE[1], margin=0)
    timings = Timings()
    source = sources.Flat(painted, [painted], settings.map, timings)
    run = Run(settings, timings=timings)
    renderer = baking.Renderer(SampledMaps(source, NormalSpace(None, run.settings), [], [], run), run)
    texels, _ = progress.finish(renderer.texels(1001, for_maps([painted], settings)))["NORMAL"]
    return texels[..., 2] < 0.5
