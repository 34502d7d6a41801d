# SPDX-License-Identifier: GPL-3.0-or-later
"""Low meshes that lie at one distance from the high mesh everywhere."""

import bpy
import numpy as np
import pytest

from addon.core import progress, udim
from addon.core.settings import Run, Settings
from addon.engine import low_offset, separation
from addon.engine.baking import draw
from addon.engine.method_choice import Choice
from addon.engine.planning import Plan
from addon.scene import reading
from tests.support import angles, maps, scenes, zoo

pytestmark = pytest.mark.usefixtures("gpu_context")


def ring(name, around, along, radius, bump=0.0):
    """A torus whose large circle has the radius 1, with UVs by both angles."""
    quads = zoo.grid_faces(around, along)
    u, v = 2.0 * np.pi * zoo.grid_uv(around, along).T
    far = radius + bump * np.sin(9.0 * u) * np.sin(5.0 * v)
    points = np.stack(
        [(1.0 + far * np.cos(v)) * np.cos(u), (1.0 + far * np.cos(v)) * np.sin(u), far * np.sin(v)], axis=1
    )
    return zoo.build(name, points, quads, zoo.grid_uv(around, along)[quads], smooth=True)


def pushed(share, **settings):
    """The map of a low ring that is pushed along its normals by a share of the diagonal, (64, 64, 3) normals."""
    diagonal = np.linalg.norm((2.2, 2.2, 0.2))
    low, high = ring("lo", 96, 32, 0.1 + share * diagonal), ring("hi", 192, 64, 0.1, 0.004)
    return angles.decode(maps.bake(low, high, method="CAST", space="WORLD", **settings))


@pytest.mark.parametrize("share", [0.01, 0.02, -0.01, -0.02])
def test_a_low_mesh_that_is_pushed_off_shows_what_it_would_show_in_place(share):
    found = angles.degrees(pushed(0.0), pushed(share))
    assert np.percentile(found, 99) < 1.5


def test_a_low_mesh_is_moved_where_more_of_it_fits_then():
    """A tube in a tube: the outer low tube is closer to the inner high one. With the antenna, the high mesh is not larger by
    about the distance on all sides."""
    distance = 0.03
    low, inner = ring("lo", 96, 32, 0.1 - distance), ring("inner", 96, 32, 0.06 - distance)
    scenes.move_uvs(low, (0.3, 1.0))
    scenes.move_uvs(inner, (0.7, 1.0), (0.3, 0.0))
    with bpy.context.temp_override(active_object=low, selected_editable_objects=[low, inner]):
        bpy.ops.object.join()
    antenna = zoo.sphere("antenna", n=8)
    antenna.scale, antenna.location = (0.01, 0.01, 0.01), (1.5, 0.0, 0.0)
    highs = ring("hi", 192, 64, 0.1, 0.004), ring("core", 192, 64, 0.06, 0.004)
    report, found = maps.bake_all_maps(low, *highs, antenna, maps=("POSITION",), space="WORLD", method="CAST")
    assert report.low_offset == pytest.approx(distance, rel=0.05)
    place = found["position"][..., :3]
    far = np.hypot(np.linalg.norm(place[..., :2], axis=2) - 1.0, place[..., 2])
    expected = np.where(maps.texel_uv(64, 64)[..., 0] < 0.3, 0.1, 0.06)
    assert np.percentile(np.abs(far - expected), 99) < 0.01


@pytest.mark.parametrize("frame", [0.02, 0.05, 0.1, 0.2])
@pytest.mark.parametrize("depth", [0.05, 0.15])
def test_a_low_mesh_stays_where_panels_are_deep(frame, depth):
    """Most of the high mesh lies at one distance, but not its frames, which a moved low mesh would lose."""
    across = np.linspace(-1.0, 1.0, 2 * round(2.0 / frame) + 1)
    u, v = (each.ravel() for each in np.meshgrid(across, across))
    w = 1.0 - depth * (np.maximum(np.abs(u), np.abs(v)) < 1.0 - 0.99 * frame)
    quads = zoo.grid_faces(len(across) - 1, len(across) - 1)
    sides = [np.roll(np.stack([u, v, w], axis=1), turn, axis=1) for turn in range(3)]
    points = np.concatenate([*sides, *(-side[:, [1, 0, 2]] for side in sides)])
    faces = np.concatenate([quads + number * len(u) for number in range(6)])
    assert (
        scenes.bake(zoo.cube("lo"), zoo.build("hi", points, faces), method="CAST", width=128, height=128).low_offset
        == 0
    )


def test_distances_that_are_alike_have_an_offset_and_others_do_not_seed_1():
    rng = np.random.default_rng(1)
    alike = rng.normal(0.02, 0.002, 1000)
    assert low_offset.offset(alike, 1.0) == pytest.approx(0.02, abs=0.001)
    assert low_offset.offset(-alike, 1.0) == pytest.approx(-0.02, abs=0.001)
    assert low_offset.offset(alike, 10.0) == 0.0  # too small for such a mesh
    assert low_offset.offset(rng.normal(0.02, 0.03, 1000), 1.0) == 0.0
    assert low_offset.offset(np.empty(0), 1.0) == 0.0


@pytest.mark.parametrize("mirror", [1.0, -1.0])
def test_moving_takes_back_what_moved_the_mesh(mirror):
    """A sphere, also in an object that is scaled and mirrored, where the distance is one in the scene."""
    sphere = zoo.sphere("lo", n=24)
    sphere.scale = (2.0 * mirror, 2.0, 2.0)
    bpy.context.view_layer.update()
    settings = Settings(method="CAST", width=8, height=8)
    meshes = reading.read(bpy.context, sphere, [zoo.sphere("hi")], None, settings)
    moved = low_offset.moved(meshes, 0.3)
    lengths = np.linalg.norm(moved.low.positions @ moved.low.to_world[:3, :3].T, axis=1)
    inner = np.abs(moved.low.positions[:, 2]) < 0.8  # beside the rim, the normals are not those of the sphere
    assert np.abs(lengths[inner] - 2.3).max() < 0.01
    for before, after in ((meshes.smooth_normals, moved.smooth_normals), (meshes.low.normals, moved.low.normals)):
        corners = inner[moved.low.vertices]
        world = [meshes.low.to_world_normals(each)[corners] for each in (before, after)]
        assert angles.degrees(*(each / np.linalg.norm(each, axis=1, keepdims=True) for each in world)).max() < 1.0


def rays_of(low, high):
    settings = Settings(method="CAST", space="WORLD", width=64, height=64)
    meshes = reading.read(bpy.context, low, [high], None, settings)
    plan = Plan(meshes, (udim.FIRST,), Choice("CAST"))
    return meshes, progress.finish(draw(plan, Run(settings))).ray_cast


def test_distances_are_told_from_the_low_mesh_as_it_is():
    share = 0.02 * np.linalg.norm((2.2, 2.2, 0.2))
    meshes, ray_cast = rays_of(ring("lo", 96, 32, 0.1 + share), ring("hi", 192, 64, 0.1))
    assert ray_cast.offset * ray_cast.ray_scene.local_space.size == pytest.approx(-share, rel=0.05)
    far = separation.full_probe(meshes, ray_cast)((64, 64), udim.uv_to_clip())
    assert np.linalg.norm(far[..., :3], axis=2).mean() == pytest.approx(share, rel=0.1)


def test_heights_are_those_above_the_low_mesh_as_it_is():
    share = 0.02 * np.linalg.norm((2.2, 2.2, 0.2))
    low, high = ring("lo", 96, 24, 0.1 + share), ring("hi", 192, 48, 0.1)
    _, found = maps.bake_all_maps(low, high, maps=("HEIGHT",), method="CAST")
    assert np.abs(found["height"][..., 0] + share).mean() < 0.1 * share


@pytest.mark.parametrize(("share", "side"), [(0.02, "outside"), (-0.02, "inside"), (0.0, None)])
def test_the_report_says_how_far_the_low_mesh_is_off(share, side):
    distance = share * np.linalg.norm((2.2, 2.2, 0.2))
    report = scenes.bake(ring("lo", 96, 32, 0.1 + distance), ring("hi", 192, 64, 0.1), method="CAST")
    assert report.low_offset == pytest.approx(-distance, rel=0.05)
    told = [line for line in report.summary() if "the high surface everywhere" in line]
    assert len(told) == (side is not None)
    assert all("'lo' lies" in line and f" {side} the high surface" in line for line in told)


def test_a_low_ring_that_is_inside_out_is_named():
    low, high = ring("lo", 48, 12, 0.1), ring("hi", 192, 48, 0.1, 0.004)
    assert scenes.bake(low, high, method="CAST").warnings == []
    low.data.flip_normals()
    report = scenes.bake(low, high, method="CAST")
    assert any("'lo' is inside out" in warning for warning in report.warnings)
    assert report.mended["turned"] == 0
