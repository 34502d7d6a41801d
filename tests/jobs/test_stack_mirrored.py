# SPDX-License-Identifier: GPL-3.0-or-later
"""Mirrored halves share their place in the map: it has twice the density, and is right on both of them."""

import bpy
import numpy as np
import pytest

from addon.core.map_types import NORMAL
from addon.core.progress import finish
from addon.core.settings import Settings
from addon.engine import baking
from addon.engine.baking import Run
from addon.jobs import unwrapping
from addon.mesh import uv_islands
from addon.scene import mesh_reader, reading
from tests.support import seen_from_sides

USUAL = {"method": "CAST", "basis": "MIKKTSPACE", "margin": 4, "depth": 32, "storage": "MEMORY", "material": False}
SETTINGS = Settings(**USUAL, width=256, height=256)


def egg(name, n, bumps=0.0):
    """A ball with bumps that are the same on both sides of x = 0, and on no others."""
    bpy.ops.mesh.primitive_uv_sphere_add(segments=2 * n, ring_count=n)
    obj = bpy.context.object
    obj.name = name
    obj.data.shade_smooth()
    points = mesh_reader.points(obj.data).astype(np.float64)
    x, y, z = points.T
    points *= 1.0 + bumps * (np.sin(9.0 * y + 4.0 * np.abs(x)) * np.cos(7.0 * z) + np.sin(5.0 * z + y))[:, None]
    points[:, 2] += 0.2 * y * z + 0.15 * z * z
    obj.data.vertices.foreach_set("co", points.astype(np.float32).reshape(-1))
    obj.data.update()
    while obj.data.uv_layers:
        obj.data.uv_layers.remove(obj.data.uv_layers[0])
    return obj


def unwrapped(*, stacks):
    low = egg("lo", 12)
    return low, finish(unwrapping.work(low, SETTINGS, is_quick=True, stacks=stacks))


def corners_of(low):
    """The points (T, 3, 3), the UVs (T, 3, 2) and the faces (T,) of triangles."""
    mesh = mesh_reader.surface(low.data, unwrapping.NAME, low.name, np.eye(4), with_faces=True)
    return mesh.positions[mesh.vertices[mesh.triangles]].astype(float), mesh.uv[mesh.triangles].astype(float), mesh


def test_mirrored_halves_have_the_same_uvs():
    low, said = unwrapped(stacks=True)
    assert "50% of the faces on others" in said
    points, uv, mesh = corners_of(low)
    side = points[..., 0].mean(axis=1) > 0.0
    corners = np.concatenate([np.abs(points[..., :1]), points[..., 1:], uv], axis=2)
    left, right = (corners[side == which].reshape(-1, 5) for which in (False, True))
    apart = np.abs(left[:, None] - right).max(axis=2)
    assert max(apart.min(axis=0).max(), apart.min(axis=1).max()) < 1e-5 < np.abs(left - right).max()
    signs = np.sign(np.linalg.det(uv[:, 1:] - uv[:, :1]))
    assert (signs == np.sign(points[..., 0].mean(axis=1))).all()  # one half is mirrored
    assert (np.bincount(uv_islands.stacks(mesh)) == 2).all()


def test_the_map_has_twice_the_density():
    areas = [
        0.5 * np.abs(np.linalg.det(np.diff(corners_of(unwrapped(stacks=x)[0])[1], axis=1))).sum() for x in (False, True)
    ]
    assert areas[1] > 1.8 * areas[0]


@pytest.mark.slow
@pytest.mark.usefixtures("gpu_context")
def test_the_normals_are_right_on_both_halves():
    """As seen from many sides, by an oracle: where halves are stacked, each is as right as where they are not, or more so."""
    high, found = egg("hi", 48, 0.02), {}
    for stacks in (False, True):
        low, _ = unwrapped(stacks=stacks)
        bpy.context.view_layer.update()
        meshes = reading.read(bpy.context, low, [high], None, SETTINGS)
        maps = finish(baking.bake(meshes, Run(SETTINGS)))
        texels = next(iter(maps.values()))[NORMAL.name][0]
        held = seen_from_sides.NormalMap(texels, SETTINGS.map.space, SETTINGS.map.basis, SETTINGS.map.channels)
        surfaces = map(seen_from_sides.Surface.of, (meshes.highs[0], meshes.basis or meshes.low))
        degrees, _, _ = seen_from_sides.measured([next(surfaces)], next(surfaces), held, views=6, side=64)
        found[stacks] = float(degrees.mean()), float(np.percentile(degrees, 99))
    assert found[True][0] < 1.05 * found[False][0] < 3.0
    assert found[True][1] < 1.05 * found[False][1]


@pytest.mark.parametrize("scale", [(1.0, 1.0, 1.0), (-2.0, 1.0, 0.5)])
def test_halves_are_found_in_the_axes_of_an_object_that_is_turned(scale):
    low = egg("lo", 6)
    low.rotation_euler, low.scale = (0.3, 0.2, 0.5), scale
    bpy.context.view_layer.update()
    assert "50% of the faces on others" in finish(unwrapping.work(low, SETTINGS, is_quick=True, stacks=True))


def test_a_part_on_one_side_leaves_the_halves_of_the_rest():
    """An antenna moves the middle of the box, not the origin of the object."""
    low = egg("lo", 6)
    bpy.ops.mesh.primitive_cone_add(vertices=3, radius1=0.2, depth=0.4, location=(2.0, 0.2, 0.0))
    with bpy.context.temp_override(selected_editable_objects=[low, bpy.context.object], active_object=low):
        bpy.ops.object.join()
    count = len(low.data.polygons)
    said = finish(unwrapping.work(low, SETTINGS, is_quick=True, stacks=True))
    assert f"{(count - 4) / 2 / count:.0%} of the faces on others" in said


def test_what_has_no_mirror_is_unwrapped_all_the_same():
    low = egg("lo", 12)
    points = mesh_reader.points(low.data)
    low.data.vertices.foreach_set(
        "co", (points + 0.05 * np.sin(9.0 * points[:, 1::-1] + 1.0) @ np.eye(2, 3)).reshape(-1)
    )
    said = finish(unwrapping.work(low, SETTINGS, is_quick=True, stacks=True))
    assert "on others" not in said and len(low.data.uv_layers) == 1


def test_halves_of_two_materials_are_apart():
    low = egg("lo", 12)
    for name in ("one", "two"):
        low.data.materials.append(bpy.data.materials.new(name))
    low.data.polygons.foreach_set(
        "material_index", np.array([face.center.x > 0.0 for face in low.data.polygons], np.int32)
    )
    assert "on others" not in finish(unwrapping.work(low, SETTINGS, is_quick=True, stacks=True))
