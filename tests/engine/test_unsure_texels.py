# SPDX-License-Identifier: GPL-3.0-or-later
"""Unsure texels find those that are wrong, on real pairs of meshes that share their UVs: Flatten is the truth."""

from dataclasses import dataclass, replace

import bpy
import numpy as np
import pytest
from mathutils import Vector
from mathutils.bvhtree import BVHTree

from addon.core import progress, udim
from addon.core.settings import Run, Settings
from addon.engine import separation
from addon.engine.baking import draw
from addon.engine.method_choice import Choice
from addon.engine.planning import Plan
from addon.engine.unsure_texels import Explorer
from addon.mesh.local_space import local_space_of
from addon.passes import audit
from addon.scene import reading
from tests.support import lanes, sheets
from tests.support.real_meshes import open_pair

pytestmark = [pytest.mark.shared, pytest.mark.usefixtures("gpu_context")]

SIZE = 256, 256
VIEW = udim.uv_to_clip()
SAME = 1e-4
"""Share of the diagonal: closer points are the same."""
CLEAN = ["kepler_199712_9079", "sthelens_290088_9079", "shaderball_48048_23378", "shaderball_61644_20517"]


@dataclass(frozen=True)
class Judged:
    """Texels (N,) bool with one truth: which are unsure, and which show another layer than Flatten."""

    unsure: np.ndarray
    wrong: np.ndarray

    @property
    def precision(self):
        return (self.unsure & self.wrong).sum() / max(1, self.unsure.sum())

    @property
    def recall(self):
        return (self.unsure & self.wrong).sum() / max(1, self.wrong.sum())


def push(low, high, share):
    """Move the low mesh along its normals, by a share of the diagonal of both."""
    places = np.concatenate([[obj.matrix_world @ vertex.co for vertex in obj.data.vertices] for obj in (low, high)])
    scale = np.cbrt(abs(np.linalg.det(np.array(low.matrix_world)[:3, :3])))
    points, normals = (np.empty(3 * len(low.data.vertices), np.float32) for _ in range(2))
    low.data.vertices.foreach_get("co", points)
    low.data.vertices.foreach_get("normal", normals)
    points += share * np.linalg.norm(np.ptp(places, axis=0)) / scale * normals
    low.data.vertices.foreach_set("co", points)
    low.data.update()


def single_triangles(mesh):
    """The numbers (height, width) of the triangles on texels that have one, -1 elsewhere."""
    layers = audit.layers_of_triangles(audit.upload_with_ids(mesh.triangles, mesh.uv), SIZE, VIEW, 2)
    top, below = (layer.astype(int) for layer in layers)
    return np.where(below == 0, top, 0) - 1


def explore(low, high, **changes):
    """The meshes, the rays, and the doubts about a bake with the default settings."""
    settings = Settings(method="CAST", space="WORLD", width=SIZE[0], height=SIZE[1], **changes)
    # With Cast, the UVs of high meshes are not read.
    meshes = reading.read(bpy.context, low, [high], None, replace(settings, method="FLATTEN"))
    plan = Plan(meshes, (udim.FIRST,), Choice("CAST"))
    ray_cast = progress.finish(draw(plan, Run(settings))).ray_cast
    return meshes, ray_cast, Explorer(ray_cast, meshes.low).doubts(SIZE, VIEW)


def judge(low, high):
    """Judge the bake of a pair that shares its UVs."""
    meshes, ray_cast, doubts = explore(low, high)
    mesh, space = meshes.highs[0], local_space_of([meshes.low])
    flat = separation.flat_probe(meshes.low, meshes.highs)(SIZE, VIEW)
    cast = separation.full_probe(meshes, ray_cast)(SIZE, VIEW)
    start = separation.draw_points([separation.upload(meshes.low, space)], SIZE, VIEW)[..., :3]
    numbers = single_triangles(mesh)
    is_judged = (single_triangles(meshes.low) >= 0) & (numbers >= 0) & (flat[..., 3] > 0.0) & (cast[..., 3] > 0.0)
    truth, found = (start[is_judged].astype(float) + vectors[is_judged][:, :3] / space.size for vectors in (flat, cast))
    points, triangles = space.points(mesh).astype(float), mesh.vertices[mesh.triangles]
    tree = BVHTree.FromPolygons(points.tolist(), triangles.tolist())
    differs = np.flatnonzero(np.linalg.norm(truth - found, axis=1) > 2.0 * SAME)
    hit = np.array([tree.find_nearest(Vector(point))[2] for point in found[differs]])
    connected = sheets.are_connected(
        points[triangles],
        sheets.across(points, triangles),
        (truth[differs], numbers[is_judged][differs]),
        (found[differs], hit),
    )
    wrong = np.zeros(len(truth), bool)
    wrong[differs] = ~connected
    judged = Judged(doubts.unsure[is_judged], wrong)
    print(f"wrong {wrong.mean():.3%}, unsure {judged.unsure.mean():.3%}", end=", ")
    print(f"precision {judged.precision:.3f}, recall {judged.recall:.3f}")
    return judged


def test_most_texels_on_the_wrong_layer_of_a_pushed_low_mesh_are_unsure(shared_assets):
    low, high = open_pair(shared_assets, "helmet_23358_6117")
    push(low, high, 0.004)
    judged = judge(low, high)
    assert judged.wrong.mean() > 0.01  # otherwise the case tests nothing
    assert judged.recall >= 0.7
    assert judged.precision >= 0.3


def test_half_of_the_texels_on_the_wrong_layer_of_the_helmet_are_unsure(shared_assets):
    judged = judge(*open_pair(shared_assets, "helmet_23358_6117"))
    assert judged.recall >= 0.5
    assert judged.unsure.mean() <= 0.01


@pytest.mark.parametrize("name", lanes.slow_but(CLEAN[1:3], CLEAN))
def test_surfaces_without_layers_are_sure(shared_assets, name):
    _, _, doubts = explore(*open_pair(shared_assets, name))
    assert doubts.unsure.sum() <= 0.001 * doubts.on_low.sum()
    assert doubts.not_owned.sum() <= 0.001 * doubts.on_low.sum()


@pytest.mark.parametrize("name", ["floaters", "box"])
def test_parts_that_stand_off_are_sure(shared_assets, name):
    _, _, doubts = explore(*open_pair(shared_assets, name, "layers"))
    assert doubts.unsure.sum() <= 0.001 * doubts.on_low.sum()


def test_the_first_hit_is_unsure_where_it_is_wrong(shared_assets):
    """On the neck below the collar, the outermost hit is the collar's."""
    _, _, doubts = explore(*open_pair(shared_assets, "collar", "layers"), hit="OUTERMOST")
    assert 0.2 < doubts.unsure.sum() / doubts.on_low.sum() < 0.5
    assert doubts.other_layer.sum() == doubts.unsure.sum()
