# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests the outline of the shells around a cube, seen nearly from the front."""

from dataclasses import replace

import bpy
import mathutils
import numpy as np
import pytest

from addon.core.settings import Settings
from addon.mesh.local_space import local_space_of
from addon.passes import target
from addon.scene import reading
from addon.ui import cage_overlay
from tests.support import zoo

pytestmark = pytest.mark.usefixtures("gpu_context")

SIZE, REACH = 256, 3.0
"""Pixels of the picture, which shows -REACH..REACH along x and z."""
PIXEL = 2.0 * REACH / SIZE
SHEAR = 0.03
"""How much x and z of the picture grow with y: no face is seen edge-on."""
NEAR = 3.0 * PIXEL
OUT = 0.6


def outline(low, cage=None, *, scale=OUT, offset=0.0, blend_width=0.0, **settings):
    """Which pixels (SIZE, SIZE) the shell covers; rows go up along z."""
    bpy.context.view_layer.update()
    depsgraph = bpy.context.evaluated_depsgraph_get()
    batch = cage_overlay.upload_shells(
        low, cage, depsgraph, Settings(method="CAST", **settings), blend_width=blend_width, is_own_base=False
    )
    front = mathutils.Matrix(((1, SHEAR, 0, 0), (0, SHEAR, 1, 0), (0, 0.1, 0, 0), (0, 0, 0, REACH))) * (1.0 / REACH)
    picture = target.Target(SIZE, SIZE, ("RGBA32F",))
    with picture.bound() as framebuffer:
        framebuffer.clear(color=(0.0, 0.0, 0.0, 0.0))
        cage_overlay.draw_cage_shell(batch, front, (1.0, 1.0, 1.0, 1.0), scale=scale, offset=offset)
    texels = np.empty((SIZE, SIZE, 4), np.float32)
    picture.read(texels)
    return texels[..., 0] > 0.0


def box(mask):
    """The extents of the covered pixels: -x, x, -z, z."""
    found = []
    for axis in (0, 1):
        covered = np.flatnonzero(mask.any(axis=axis))
        found += [(covered[0]) * PIXEL - REACH, (covered[-1] + 1) * PIXEL - REACH]
    return np.array(found)


def is_covered(mask, x, z):
    return mask[int((z + REACH) / PIXEL), int((x + REACH) / PIXEL)]


def square(half):
    return np.array([-half, half, -half, half])


def test_smooth_directions_fan_out():
    """A ray from a corner goes along the diagonal, and one from the middle of a face straight out."""
    mask = outline(zoo.cube("lo"), directions="SMOOTH")
    assert np.allclose(box(mask), square(1.0 + OUT), atol=NEAR)
    assert is_covered(mask, 1.3, 1.3)
    assert not is_covered(mask, 1.5, 1.3)
    assert not is_covered(mask, 1.0 + OUT - PIXEL, 0.75)


def test_straight_directions_move_the_faces_out():
    mask = outline(zoo.cube("lo"), directions="SPLIT")
    assert np.allclose(box(mask), square(1.0 + OUT), atol=NEAR)
    assert is_covered(mask, 1.0 + OUT, 0.9)
    assert not is_covered(mask, 1.3, 1.3)


def test_blended_directions_fan_out_at_edges_alone():
    mask = outline(zoo.cube("lo"), directions="BLENDED", blend_width=0.2)
    assert np.allclose(box(mask), square(1.0 + OUT), atol=NEAR)
    assert is_covered(mask, 1.3, 1.3)
    assert not is_covered(mask, 1.5, 1.3)
    assert is_covered(mask, 1.0 + OUT - PIXEL, 0.75)


def test_the_inner_shell_does_not_follow_paint():
    low = zoo.cube("lo")
    low.vertex_groups.new(name="far").add(range(8), 1.0, "REPLACE")
    settings = {"directions": "SMOOTH", "offset_group": "far"}
    assert np.allclose(box(outline(low, **settings)), square(1.0 + 2.0 * OUT), atol=NEAR)
    inner = outline(low, scale=0.0, offset=-0.3, **settings)
    assert np.allclose(box(inner), square(1.0 - 0.3 / np.sqrt(3.0)), atol=NEAR)  # where corners end


def test_painted_sides_start_elsewhere():
    low = zoo.cube("lo")
    group = low.vertex_groups.new(name="far")
    for vertex in low.data.vertices:
        group.add([vertex.index], 0.5 + 0.5 * vertex.co.x, "REPLACE")
    extents = box(outline(low, directions="SPLIT", offset_group="far"))
    assert np.allclose(extents[:2], (-1.0, 1.0 + 2.0 * OUT), atol=NEAR)


@pytest.mark.parametrize(("directions", "weight", "is_straight"), [("SMOOTH", 1.0, True), ("SPLIT", 0.0, False)])
def test_a_painted_straight_group_turns_directions(directions, weight, is_straight):
    low = zoo.cube("lo")
    low.vertex_groups.new(name="turned").add(range(8), weight, "REPLACE")
    mask = outline(low, directions=directions, straight_group="turned")
    assert is_covered(mask, 1.0 + OUT - PIXEL, 0.9) == is_straight
    assert is_covered(mask, 1.3, 1.3) != is_straight
    assert np.allclose(box(mask), square(1.0 + OUT), atol=NEAR)


def test_flat_triangles_are_not_divided():
    low = zoo.cube("lo")
    meshes = reading.read_low(
        bpy.context.evaluated_depsgraph_get(), low, None, Settings(), is_own_base=False, with_uv=False
    )
    flat = replace(meshes, smooth_normals=meshes.low.normals)
    space = local_space_of([meshes.low])
    assert (cage_overlay.parts(flat, space, 0.1) == 1).all()
    assert (cage_overlay.parts(meshes, space, 0.1) == cage_overlay.MOST_PARTS).all()
    many = replace(meshes.low, triangles=np.tile(meshes.low.triangles, (1000, 1)))
    assert (cage_overlay.parts(replace(meshes, low=many), space, 0.1) ** 2).sum() <= cage_overlay.MOST_PIECES


def test_a_group_that_is_missing_counts_as_unpainted():
    low = zoo.cube("lo")
    plain = outline(low, directions="SPLIT")
    assert np.array_equal(outline(low, directions="SPLIT", offset_group="far"), plain)


@pytest.mark.parametrize("where", [(0.0, 0.0, 0.0), (0.0, 0.0, 1.0)])
def test_with_a_cage_rays_start_on_it(where):
    low, cage = zoo.cube("lo"), zoo.cube("cage")
    low.location = cage.location = where
    cage.scale = (1.5, 1.5, 1.5)
    z = where[2]
    extents = np.array([-1.5, 1.5, z - 1.5, z + 1.5])
    assert np.allclose(box(outline(low, cage, scale=1.0)), extents, atol=NEAR)
    # Rays that are as long as the distance to the cage's corners end on the low mesh, elsewhere inside it.
    inner = outline(low, cage, scale=1.0, offset=-0.5 * np.sqrt(3.0))
    assert np.allclose(box(inner), np.array([-1.0, 1.0, z - 1.0, z + 1.0]), atol=NEAR)


def test_the_low_object_needs_no_uvs():
    low = zoo.cube("lo")
    low.data.uv_layers.remove(low.data.uv_layers[0])
    assert np.allclose(box(outline(low, directions="SPLIT")), square(1.0 + OUT), atol=NEAR)
