# SPDX-License-Identifier: GPL-3.0-or-later
"""Maps whose texels are known in closed form."""

import bpy
import mathutils
import numpy as np
import pytest

from addon.core import progress
from addon.core.settings import Settings
from addon.engine import bands
from addon.jobs import Job, bake_pair, live_session
from tests.support import angles, zoo
from tests.support.maps import bake, texel_uv

pytestmark = pytest.mark.usefixtures("gpu_context")

SNAP = 0.03
"""Degrees. A corner may be up to 1/512 texel off, on meshes whose normals change by less than 10 degrees per texel."""
CHORD = 0.12
"""Degrees. The most between the interpolated normals of a 128-sided sphere and those of the sphere."""


@pytest.mark.parametrize("space", ["TANGENT", "OBJECT", "WORLD"])
@pytest.mark.parametrize("size", [(16, 16), (64, 32), (33, 57)])
def test_a_plane_gives_the_flat_normal_exactly(space, size):
    texels = bake(zoo.plane("low"), zoo.plane("high", n=3), space=space, size=size)
    assert texels.shape == (size[1], size[0], 4)
    assert (texels == np.float32((0.5, 0.5, 1.0, 1.0))).all()


def test_a_tilted_plane_is_constant():
    slope = 0.75  # 3-4-5: the normal is (-0.6, 0, 0.8)
    texels = bake(zoo.plane("low"), zoo.plane("high", slope=slope))
    assert np.abs(texels - np.float32((0.2, 0.5, 0.9, 1.0))).max() < 1e-6
    assert (texels == texels[0, 0]).all()


def test_green_down_mirrors_the_green_channel():
    high = zoo.plane("high")
    high.rotation_euler.x = 0.3
    low = zoo.plane("low")
    up, down = (bake(low, high, green=green) for green in ("+Y", "-Y"))
    assert up[0, 0, 1] < 0.4  # rotated about +X, the normal leans towards -Y
    assert np.allclose(up[..., 1] + down[..., 1], 1.0, atol=1e-6)
    assert np.array_equal(up[..., [0, 2, 3]], down[..., [0, 2, 3]])


def test_object_space_map_of_a_sphere_is_its_normal():
    sphere = zoo.sphere("high", n=64)
    texels = bake(zoo.sphere("low", n=8), sphere, space="OBJECT", size=(256, 128))
    u, v = np.moveaxis(texel_uv(256, 128), -1, 0)
    longitude, latitude = 2 * np.pi * u, np.radians(75.0) * (2 * v - 1)
    expected = np.stack(
        [np.cos(longitude) * np.cos(latitude), np.sin(longitude) * np.cos(latitude), np.sin(latitude)], axis=-1
    )
    assert angles.degrees(angles.decode(texels), expected).max() < CHORD


def test_map_of_a_terrain_is_the_derivative_of_its_height():
    """On a plane the tangent-space normal of z = f(x, y) is (-df/dx, -df/dy, 1), normalized."""
    height, waves = 0.05, 1
    texels = bake(zoo.plane("low"), zoo.terrain("high", n=512, height=height, waves=waves), size=(128, 128))
    u, v = np.moveaxis(texel_uv(128, 128), -1, 0)
    step = 2 * np.pi * waves
    dx = 0.5 * step * height * np.cos(step * u) * np.sin(step * v)  # x = 2 u - 1
    dy = 0.5 * step * height * np.sin(step * u) * np.cos(step * v)
    expected = np.stack([-dx, -dy, np.ones_like(dx)], axis=-1)
    expected /= np.linalg.norm(expected, axis=-1, keepdims=True)
    inner = angles.eroded(np.ones(u.shape, bool), 1)  # Blender's normals are one-sided at the border
    assert angles.degrees(angles.decode(texels), expected)[inner].max() < SNAP


def test_a_low_mesh_like_the_high_one_gives_a_flat_tangent_map():
    """Also where UVs are mirrored, rotated and stretched: the low mesh has its own tangent space."""
    low, high = zoo.sphere("low", n=16), zoo.sphere("high", n=16)
    texels = bake(low, high, size=(128, 128))
    flat = np.float64((0.0, 0.0, 1.0))
    assert angles.degrees(angles.decode(texels), flat).max() < 1e-3


@pytest.mark.parametrize("scale", [(1, 1, 1), (1, 2, 0.5), (-1, 1, 1), (-2, -1, -1)])
def test_the_plane_of_a_moved_object_has_the_moved_normal(scale):
    """In world space, compared with the cross product of the transformed edges, which needs no inverse transpose."""
    low, high = zoo.plane("low"), zoo.plane("high", slope=0.4)
    high.matrix_world = mathutils.Matrix.LocRotScale((1, 2, 3), mathutils.Euler((0.5, -0.3, 2.0)), scale)
    bpy.context.view_layer.update()
    texels = bake(low, high, space="WORLD")
    a, b, c = (np.array(high.matrix_world @ mathutils.Vector(p)) for p in ((0, 0, 0), (1, 0, 0.4), (0, 1, 0)))
    expected = np.cross(b - a, c - a) * np.sign(np.prod(scale))
    expected /= np.linalg.norm(expected)
    assert angles.degrees(angles.decode(texels), expected).max() < 1e-3


def test_map_does_not_change_when_both_objects_rotate_together():
    low, high = zoo.sphere("low", n=12), zoo.terrain("high")
    before = bake(low, high)
    for obj in (low, high):
        obj.matrix_world = mathutils.Matrix.Rotation(1.0, 4, "X") @ mathutils.Matrix.Translation((1e4, 0, 0))
    after = bake(low, high)
    assert angles.degrees(angles.decode(before), angles.decode(after)).max() < 1e-3


def test_the_high_mesh_may_be_in_several_objects():
    left = zoo.build(
        "left", [(-1, -1, 0), (0, -1, 0), (0, 1, 0), (-1, 1, 0)], [(0, 1, 2, 3)], [[(0, 0), (0.5, 0), (0.5, 1), (0, 1)]]
    )
    right = zoo.build(
        "right", [(0, -1, 0), (1, -1, 1), (1, 1, 1), (0, 1, 0)], [(0, 1, 2, 3)], [[(0.5, 0), (1, 0), (1, 1), (0.5, 1)]]
    )
    texels = bake(zoo.plane("low"), left, right, size=(32, 32))
    assert (texels[:, :16] == np.float32((0.5, 0.5, 1.0, 1.0))).all()
    assert np.allclose(angles.decode(texels[:, 16:]), np.float64((-1, 0, 1)) / np.sqrt(2), atol=1e-6)


def test_flat_faces_stay_flat():
    high = zoo.terrain("high", n=4, height=0.5, smooth=False)
    texels = bake(zoo.plane("low"), high, size=(64, 64))
    # Two triangles per quad, each with only one color.
    assert len(np.unique(texels.reshape(-1, 4).round(5), axis=0)) <= 32


def test_order_of_vertices_and_faces_does_not_matter_seed_7():
    rng = np.random.default_rng(7)
    n = 24
    u, v = zoo.grid_uv(n, n).T
    points = np.stack([2 * u - 1, 2 * v - 1, 0.2 * np.sin(9 * u) * np.cos(7 * v)], axis=1)
    faces, uv = zoo.grid_faces(n, n), np.stack([u, v], axis=1)
    before = bake(zoo.plane("low"), zoo.build("high", points, faces, uv[faces]))
    new_place = rng.permutation(len(points))
    shuffled = np.empty_like(points)
    shuffled[new_place] = points
    order = rng.permutation(len(faces))
    after = bake(
        bpy.data.objects["low"],
        zoo.build("shuffled", shuffled, new_place[faces][order], uv[faces][order]),
        image="after",
    )
    # Face normals are added in another order: the last bits of a float may differ.
    assert np.abs(before - after).max() < 1e-6


def test_triangulated_input_gives_the_same_map():
    """The corner normals must be the same: those that Blender computes depend on the faces."""
    low, high = zoo.plane("low"), zoo.sphere("high", n=16)
    quads = bake(low, high)
    triangulate = high.modifiers.new("Triangulate", "TRIANGULATE")
    triangulate.quad_method, triangulate.keep_custom_normals = "FIXED", True
    assert np.abs(quads - bake(low, high)).max() < 1e-6


def test_low_meshes_with_ngons_work():
    """A hexagon, with tangents from its triangles. The map of a plane must be flat."""
    angle = np.arange(6) * np.pi / 3
    points = np.stack([np.cos(angle), np.sin(angle), np.zeros(6)], axis=1)
    uv = 0.5 + 0.45 * points[:, :2]
    low, high = (zoo.build(name, points, [range(6)], [uv]) for name in ("low", "high"))
    texels = bake(low, high)
    covered = texels[..., 3] > 0
    assert 0.4 < covered.mean() < 0.6  # the hexagon's area is 2.598 * 0.45**2 = 0.526
    assert np.abs(texels[covered] - np.float32((0.5, 0.5, 1.0, 1.0))).max() < 1e-6


def test_both_bases_agree_on_a_plane_and_differ_on_a_bent_mesh():
    high = zoo.sphere("high", n=48)
    low = zoo.sphere("low", n=4)
    blender, reference = (
        bake(low, high, basis=basis, image=basis, size=(128, 128)) for basis in ("CYCLES", "MIKKTSPACE")
    )
    assert angles.degrees(angles.decode(blender), angles.decode(reference)).max() > 0.05
    plane = zoo.plane("plane")
    assert np.array_equal(bake(plane, high, basis="CYCLES"), bake(plane, high, basis="MIKKTSPACE"))


@pytest.mark.parametrize(
    ("engine", "basis", "target"),
    [("CYCLES", "CYCLES", "Basis: Cycles"), ("BLENDER_EEVEE", "MIKKTSPACE", "Basis: MikkTSpace")],
)
def test_a_map_is_made_for_the_render_engine_of_the_scene(engine, basis, target):
    low, high = zoo.sphere("low", n=4), zoo.sphere("high", n=48)
    chosen = bake(low, high, basis=basis)
    bpy.context.scene.render.engine = engine
    assert np.array_equal(bake(low, high), chosen)
    settings = Settings(width=64, height=64, material=False)
    report = bake_pair(bpy.context, low, [high], settings)
    assert report.settings["basis"] == basis
    assert any(line.startswith(target) for line in report.summary())
    assert live_session.Session(bpy.context, Job(low, [high]), settings, progress.Pace()).settings.map.basis == basis


@pytest.mark.parametrize("margin", [0, 5])
def test_a_map_drawn_in_bands_is_the_same(monkeypatch, margin):
    low, high = zoo.sphere("low", n=8), zoo.sphere("high", n=32)
    for obj in (low, high):  # leave background for the margin
        layer = obj.data.uv_layers[0].uv
        uv = np.empty(len(layer) * 2, np.float32)
        layer.foreach_get("vector", uv)
        layer.foreach_set("vector", 0.1 + 0.6 * uv)
    whole = bake(low, high, size=(64, 60), margin=margin, image="whole")
    monkeypatch.setattr(bands, "BAND_TEXELS", 64 * 16)
    found = list(bands.bands(64, 60, margin))
    assert [part.stop - part.start for part in found] == [16, 16, 16, 12]
    banded = bake(low, high, size=(64, 60), margin=margin, image="banded")
    assert np.array_equal(whole[..., 3], banded[..., 3])
    # Corners are snapped to the texel grid of the band, which may differ from that of the whole map.
    assert angles.degrees(angles.decode(whole), angles.decode(banded)).max() < SNAP
