# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests of low meshes whose parts share texels: which of them the map is made for."""

import bmesh
import bpy
import numpy as np
import pytest

from addon.core.progress import Pace
from addon.jobs import Job
from addon.jobs.live_session import Session
from tests.support import maps, scenes, zoo

pytestmark = pytest.mark.usefixtures("gpu_context")

SAME = 1e-5
"""Components of normals. The order of triangles decides nothing where one part alone is drawn."""


def half(name, side, *, n=4):
    """The half of a low dome with x above 0 for side 1, or below for -1, with UVs that fill the map: the same for both."""
    obj = zoo.sheet(name, lambda u, v: np.stack([u, 2 * v - 1, dome(u, 2 * v - 1)], axis=1), n, n)
    if side < 0:
        obj.data.transform(np.diag([-1.0, 1.0, 1.0, 1.0]).tolist())
        obj.data.flip_normals()
    return obj


def with_polygons(obj):
    """`obj` with every third edge dissolved, so that faces have many corners."""
    mesh = bmesh.new()
    mesh.from_mesh(obj.data)
    inner = [edge for edge in mesh.edges if len(edge.link_faces) == 2]
    bmesh.ops.dissolve_edges(mesh, edges=inner[::3])
    mesh.to_mesh(obj.data)
    mesh.free()
    return obj


def dome(x, y):
    return -0.2 * (x * x + y * y)


def mirrored(name="low"):
    """The half with x above 0, and its copy by a Mirror modifier, joined along the middle."""
    obj = half(name, 1)
    obj.modifiers.new("Mirror", "MIRROR")
    return obj


def asymmetric(name="high", n=64):
    """A wavy dome over both halves, whose waves are not mirrored."""
    return zoo.sheet(
        name,
        lambda u, v: np.stack(
            [
                2.02 * u - 1.01,
                2.02 * v - 1.01,
                dome(2.02 * u - 1.01, 2.02 * v - 1.01) + 0.02 * np.sin(9 * u + 1) * np.cos(8 * v),
            ],
            axis=1,
        ),
        n,
        n,
    )


def own(side, **settings):
    """The map of a half by itself."""
    return maps.bake(half(f"half {side}", side), bpy.data.objects["high"], image=f"{side}", **cast(settings))


def cast(settings):
    return {"method": "CAST", "extrusion": 0.1, "max_distance": 0.2, **settings}


@pytest.mark.parametrize("space", ["TANGENT", "OBJECT"])
@pytest.mark.parametrize(("stacked", "side"), [("FIRST", 1), ("LAST", -1)])
def test_the_chosen_half_of_a_mirrored_mesh_has_its_own_detail_on_all_texels(stacked, side, space):
    high = asymmetric()
    both = maps.bake(mirrored(), high, **cast({"stacked": stacked, "space": space}))
    alone, other = (own(each, space=space) for each in (side, -side))
    # The seam in the middle is smooth only where both halves are.
    away = np.s_[:, 20:]
    assert np.abs(both - alone)[away].max() < SAME
    assert np.abs(both - other)[away].max() > 1000.0 * SAME


def test_tangents_are_those_of_the_modeled_half_of_faces_with_many_corners():
    """Tangents are read of a mesh in triangles."""
    high, low = asymmetric(), with_polygons(half("low", 1, n=8))
    low.modifiers.new("Mirror", "MIRROR")
    assert max(len(face.vertices) for face in low.data.polygons) > 4
    both = maps.bake(low, high, **cast({}))
    alone = maps.bake(with_polygons(half("half", 1, n=8)), high, image="half", **cast({}))
    assert np.abs(both - alone)[:, 40:].max() < SAME


@pytest.mark.parametrize("stacked", ["FIRST", "LAST"])
def test_one_of_several_plates_wins_everywhere_where_their_faces_are_mixed(stacked):
    slopes = 0.1, -0.2, 0.3
    points, faces, uv = [], [], zoo.grid_uv(8, 8)
    for number in range(len(slopes)):
        points.append(np.column_stack([2 * uv - 1 + (3 * number, 0), np.zeros(len(uv))]))
        faces.append(zoo.grid_faces(8, 8, number * len(uv)))
    order = np.random.default_rng(3).permutation(3 * 64)
    faces = np.concatenate(faces)[order]
    low = zoo.build("low", np.concatenate(points), faces, np.tile(uv, (3, 1))[faces])
    highs = []
    for number, slope in enumerate(slopes):
        highs.append(zoo.plane(f"high {number}", slope=slope))
        highs[-1].location.x = 3 * number
    # Parts come in the order of their first faces.
    by_first_face = sorted(range(3), key=(order // 64).tolist().index)
    plate = by_first_face[0 if stacked == "FIRST" else -1]
    found = 2.0 * maps.bake(low, *highs, **cast({"stacked": stacked, "extrusion": 1.0, "max_distance": 2.0})) - 1.0
    assert np.abs(-found[..., 0] / found[..., 2] - slopes[plate]).max() < 1e-4


@pytest.mark.parametrize("stacked", ["FIRST", "LAST"])
def test_messages_list_high_objects_in_the_order_of_the_artist(stacked):
    low = zoo.plane("low", 2)
    low.modifiers.new("Array", "ARRAY").relative_offset_displace = 0, 0, 0
    highs = [zoo.plane("a", 2), zoo.plane("b", 3)]
    report, _ = maps.bake_all_maps(low, *highs, maps=(), **cast({"stacked": stacked}))
    (flat,) = [each for each in report.warnings if each.startswith("The map is flat")]
    assert flat.startswith("The map is flat: nothing of 'a', 'b' differs from 'low'.")


def test_a_surface_shows_its_modeled_half_on_its_own_base_mesh():
    """The base mesh has no copies: their normals would get its tangents."""
    obj = half("low", 1)
    subdivide = obj.modifiers.new("Subdivide", "SUBSURF")
    subdivide.subdivision_type, subdivide.levels, subdivide.render_levels = "SIMPLE", 4, 4
    clouds = bpy.data.textures.new("Clouds", "CLOUDS")
    displace = obj.modifiers.new("Displace", "DISPLACE")
    displace.texture, displace.strength = clouds, 0.1
    alone = maps.bake(obj, obj, image="alone")
    obj.modifiers.new("Mirror", "MIRROR")
    both = maps.bake(obj, obj, image="both")
    assert np.abs(both - alone)[:, 4:].max() < SAME


def test_live_draws_the_same_also_after_a_change_of_the_high_mesh():
    low, high = mirrored(), half("high", 1, n=32)
    high.modifiers.new("Mirror", "MIRROR")
    session = Session(bpy.context, Job(low, [high]), scenes.settings(), Pace())
    session.run(bpy.context)
    before = session.meshes
    bump(high)
    bpy.context.view_layer.update()
    session.run(bpy.context, changed={high.session_uid})
    assert session.meshes.low is before.low
    np.testing.assert_array_equal(session.texels, maps.bake(low, high))


def bump(obj):
    """Raise some vertices in the middle of `obj`."""
    points = np.empty((len(obj.data.vertices), 3), np.float32)
    obj.data.attributes["position"].data.foreach_get("vector", points.ravel())
    points[:, 2] += 0.05 * (np.linalg.norm(points[:, :2] - 0.5, axis=1) < 0.2)
    obj.data.attributes["position"].data.foreach_set("vector", points.ravel())
    obj.data.update()
