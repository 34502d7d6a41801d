# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests vector displacement in tangent space: by closed form, by moving the low surface, and by Cycles' own node."""

import bpy
import numpy as np
import pytest
from mathutils import Euler, Matrix

from tests.support import maps, zoo

pytestmark = pytest.mark.usefixtures("gpu_context")

SIDE = 32
OFFSET = (0.03, -0.05, 0.2)
"""From the low plane to the high one, in their own space."""
TURNED = Matrix.LocRotScale((1.0, 2.0, 3.0), Euler((0.3, 0.5, 0.7)), None)


def plane(name, *, mirrored=False, matrix=TURNED, bend=0.0, sides=1):
    """A plane from -1 to 1 of `sides` x `sides` quads. mirrored: in u. bend: how high its middle is."""
    at = np.linspace(0.0, 1.0, sides + 1)
    u, v = (each.reshape(-1) for each in np.meshgrid(at, at))
    points = np.stack([2 * u - 1, 2 * v - 1, bend * 16 * u * (1 - u) * v * (1 - v)], axis=1)
    first = [row * (sides + 1) + column for row in range(sides) for column in range(sides)]
    faces = np.array([[each, each + 1, each + sides + 2, each + sides + 1] for each in first])
    uv = np.stack([1 - u if mirrored else u, v], axis=1)[faces]
    made = zoo.build(name, points, faces.tolist(), uv)
    for face in made.data.polygons:
        face.use_smooth = True
    made.matrix_world = matrix
    return made


def baked(low, high, **settings):
    """The report of a bake and its vectors (SIDE, SIDE, 3), all known."""
    more = {"method": "CAST", "extrusion": 1.0, "max_distance": 3.0, "tangent_displacement": True, **settings}
    report, found = maps.bake_all_maps(low, high, maps=["DISPLACEMENT"], size=SIDE, **more)
    assert (found["displacement"][..., 3] > 0).all()
    return report, found["displacement"][..., :3]


MATRICES = {
    "turned": TURNED,
    "large": TURNED @ Matrix.Scale(2.0, 4),
    "mirrored object": TURNED @ Matrix.Diagonal((-1.0, 1.0, 1.0, 1.0)),
    "uneven": TURNED @ Matrix.Diagonal((1.0, 2.0, 0.5, 1.0)),
}


@pytest.mark.parametrize("basis", ["MIKKTSPACE", "CYCLES", "NORMALIZED"])
@pytest.mark.parametrize("mirrored", [False, True], ids=["", "mirrored UVs"])
@pytest.mark.parametrize("matrix", MATRICES.values(), ids=MATRICES)
def test_components_are_tangent_normal_and_bitangent(matrix, mirrored, basis):
    """On a plane: the ray runs along z of the low object, and the tangent along its x, or against it."""
    low = plane("lo", mirrored=mirrored, matrix=matrix)
    high = plane("hi", mirrored=mirrored, matrix=matrix @ Matrix.Translation((0.0, 0.0, 0.25)))
    report, found = baked(low, high, basis=basis)
    # Rays on a surface that is scaled unevenly follow its world normals, which are z of the plane in each case.
    assert np.abs(found - (0.0, 0.25, 0.0)).max() < 1e-5
    assert report.maps["displacement"]["space"] == "TANGENT"


@pytest.mark.parametrize("mirrored", [False, True], ids=["", "mirrored UVs"])
@pytest.mark.parametrize("samples", [1, 16])
def test_flattened_vectors_run_along_the_surface_too(samples, mirrored):
    low, high = plane("lo", mirrored=mirrored), plane("hi", mirrored=mirrored)
    high.matrix_world = TURNED @ Matrix.Translation(OFFSET)
    _, found = baked(low, high, method="FLATTEN", samples=samples)
    x, y, z = OFFSET
    assert np.abs(found - (-x if mirrored else x, z, y)).max() < 1e-5


def test_the_low_surface_moves_onto_the_high_one():
    """On curved triangles, with the basis that Cycles' node makes at each point."""
    low, high = plane("lo", bend=0.4, sides=4), plane("hi", bend=0.7, sides=16)
    high.matrix_world = TURNED @ Matrix.Translation(OFFSET) @ Matrix.Diagonal((1.5, 1.5, 1.0, 1.0))
    _, found = baked(low, high)
    _, plain = baked(low, high, tangent_displacement=False)
    moved = in_object_space(low, found)
    assert np.abs(moved - plain).max() < 1e-3 * np.linalg.norm(high.dimensions)
    assert np.abs(moved - plain).max() < 1e-5


def in_object_space(low, vectors):
    """Vectors (SIDE, SIDE, 3) in tangent space by the rules of Cycles, in the object's space."""
    data = low.data
    data.calc_tangents(uvmap=data.uv_layers.active.name)
    data.calc_loop_triangles()
    uv = np.array([tuple(each.uv) for each in data.uv_layers.active.data])
    points = maps.texel_uv(SIDE, SIDE)
    moved = np.full_like(vectors, np.nan)
    for triangle in data.loop_triangles:
        corners = [data.loops[loop] for loop in triangle.loops]
        edges = np.append(uv[list(triangle.loops)].T, np.ones((1, 3)), axis=0)
        weights = np.dstack([points, np.ones((SIDE, SIDE))]) @ np.linalg.inv(edges).T
        inside = (weights > -1e-6).all(axis=-1)
        normal = weights[inside] @ np.array([each.normal for each in corners])
        tangent = weights[inside] @ np.array([each.tangent for each in corners])
        normal /= np.linalg.norm(normal, axis=1, keepdims=True)
        across = np.cross(normal, tangent) * corners[0].bitangent_sign
        across /= np.linalg.norm(across, axis=1, keepdims=True)
        basis = np.stack([tangent, normal, across], axis=1)
        moved[inside] = np.einsum("ni,nij->nj", vectors[inside], basis)
    assert np.isfinite(moved).all()
    return moved


@pytest.mark.parametrize("mirrored", [False, True], ids=["", "mirrored UVs"])
def test_cycles_moves_the_surface_by_the_vectors(mirrored):
    """The node has the order and the signs of the map: Cycles bakes the positions of the moved surface."""
    matrix = TURNED @ Matrix.Diagonal((-1.0, 2.0, 0.5, 1.0))
    low, high = plane("lo", mirrored=mirrored, matrix=matrix), plane("hi", mirrored=mirrored)
    high.matrix_world = matrix @ Matrix.Translation(OFFSET)
    _, found = baked(low, high, method="FLATTEN", material=True, connect_maps=True)
    material = low.data.materials[0]
    material.displacement_method = "DISPLACEMENT"
    tree = material.node_tree
    texture = tree.nodes.new("ShaderNodeTexImage")
    texture.image = bpy.data.images.new("positions", SIDE, SIDE, float_buffer=True)
    texture.image.colorspace_settings.name = "Non-Color"
    tree.nodes.active = texture
    scene = bpy.context.scene
    scene.render.engine, scene.cycles.samples, scene.render.bake.margin = "CYCLES", 1, 0
    bpy.context.view_layer.objects.active = low
    for each in bpy.context.scene.objects:
        each.select_set(each == low)
    bpy.ops.object.bake(type="POSITION")
    positions = maps.pixels(texture.image)[..., :3]
    uv = maps.texel_uv(SIDE, SIDE) * (-1 if mirrored else 1, 1) + (1 if mirrored else 0, 0)
    points = np.dstack([2 * uv - 1, np.zeros((SIDE, SIDE))]) + OFFSET
    expected = points @ np.array(matrix)[:3, :3].T + np.array(matrix)[:3, 3]
    assert np.abs(positions - expected)[2:-2, 2:-2].max() < 1e-3 * np.linalg.norm(low.dimensions)


def test_normals_in_object_space_leave_vectors_there():
    low, high = plane("lo"), plane("hi")
    high.matrix_world = TURNED @ Matrix.Translation(OFFSET)
    report, found = baked(low, high, method="FLATTEN", space="OBJECT")
    assert np.abs(found - OFFSET).max() < 1e-5
    assert "space" not in report.maps["displacement"]
