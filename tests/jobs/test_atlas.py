# SPDX-License-Identifier: GPL-3.0-or-later
"""Several objects share one map: at one texel density, without overlaps, and later with one more."""

import bpy
import numpy as np
import pytest

from addon.core.errors import BakeError
from addon.core.settings import Settings
from addon.jobs import Job, atlas, bake_jobs
from addon.scene import mesh_reader
from tests.jobs.test_unwrapping import state
from tests.support import raster, zoo

SETTINGS = Settings(width=256, height=256, margin=4, method="CAST", storage="MEMORY", material=False)
SIDE = 1024
TO_CLIP = np.array([(2.0, 0, 0, -1), (0, 2, 0, -1), (0, 0, 1, 0), (0, 0, 0, 1)])


def objects():
    """A sphere, a small one that is scaled up, and a torus of bent sheets."""
    ball, small, sheet = zoo.sphere("ball", n=12), zoo.sphere("small", n=8), zoo.terrain("sheet", 6)
    small.scale = (0.5, 0.5, 0.5)
    small.location = (3.0, 0.0, 0.0)
    sheet.location = (0.0, 4.0, 0.0)
    bpy.context.view_layer.update()
    return [ball, small, sheet]


def uv_of(obj, layer=atlas.LAYER):
    return mesh_reader.uvs(obj.data, layer)


def triangles(obj):
    mesh = mesh_reader.surface(obj.data, atlas.LAYER, obj.name, np.eye(4))
    turned = np.array(obj.matrix_world)[:3, :3]
    return mesh.positions[mesh.vertices[mesh.triangles]] @ turned.T, mesh.uv[mesh.triangles]


def density(obj):
    """Area of the map for an area of the surface."""
    points, uv = triangles(obj)
    edges, sides = points[:, 1:] - points[:, :1], uv[:, 1:] - uv[:, :1]
    surface = np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=1).sum()
    return np.abs(np.linalg.det(sides)).sum() / surface


def covered(obj):
    """The texels (SIDE, SIDE) that the triangles of an object cover."""
    uv = triangles(obj)[1]
    points = np.dstack([uv, np.zeros(uv.shape[:2])])
    owner, *_ = raster.rasterize(points, TO_CLIP, (SIDE, SIDE))
    return owner >= 0


def test_all_have_one_texel_density_and_no_texel_in_common():
    lows, before = objects(), state()
    kept = [uv_of(low, zoo.LAYER) for low in lows]
    said = atlas.pack(lows, SETTINGS)
    assert state() == before
    assert "'Atlas'" in said
    assert all(np.array_equal(uv_of(low, zoo.LAYER), uv) for low, uv in zip(lows, kept, strict=True))
    assert [low.data.uv_layers.active.name for low in lows] == [atlas.LAYER] * 3
    first, *others = map(density, lows)
    assert np.allclose(others, first, rtol=0.02)
    shared = sum(covered(low).astype(int) for low in lows)
    assert shared.max() == 1
    assert shared.mean() > 0.5
    assert min(uv_of(low).min() for low in lows) > 0.0
    assert max(uv_of(low).max() for low in lows) < 1.0


def test_one_more_leaves_the_others_where_they_are():
    *first, more = objects()
    more.scale = (0.2, 0.2, 0.2)
    bpy.context.view_layer.update()
    atlas.pack(first, SETTINGS)
    kept = [uv_of(low) for low in first]
    said = atlas.pack([*first, more], SETTINGS)
    assert "beside 2 that kept their places" in said
    assert all(np.array_equal(uv_of(low), uv) for low, uv in zip(first, kept, strict=True))
    assert density(more) == pytest.approx(density(first[0]), rel=0.02)
    shared = sum(covered(low).astype(int) for low in (*first, more))
    assert shared.max() == 1


def test_one_more_goes_around_the_others_wherever_they_are():
    """Those that are there fill the lower left quarter, from which packing anew would move them."""
    *first, more = objects()
    atlas.pack(first, SETTINGS)
    for low in first:
        uv = 1.0 - 0.45 * (1.0 - uv_of(low)) - 0.5
        low.data.uv_layers[atlas.LAYER].uv.foreach_set("vector", uv.astype(np.float32).ravel())
    atlas.pack([*first, more], SETTINGS)
    assert sum(covered(low).astype(int) for low in (*first, more)).max() == 1


def test_what_does_not_fit_is_refused_and_changes_nothing():
    *first, more = objects()
    more.scale = (5.0, 5.0, 5.0)
    bpy.context.view_layer.update()
    atlas.pack(first, SETTINGS)
    before = state()
    with pytest.raises(BakeError, match="'sheet' do not fit between the islands"):
        atlas.pack([*first, more], SETTINGS)
    assert state() == before
    assert atlas.LAYER not in more.data.uv_layers


@pytest.mark.parametrize("case", ["no faces", "no UV map", "no area", "shared", "Edit Mode"])
def test_wrong_objects_are_named(case):
    low, other = zoo.plane("low"), zoo.plane("other")
    if case == "no faces":
        low.data = bpy.data.meshes.new("empty")
    elif case == "no UV map":
        low.data.uv_layers.remove(low.data.uv_layers[0])
    elif case == "no area":
        low.data.uv_layers[0].uv.foreach_set("vector", np.zeros(2 * len(low.data.loops), np.float32))
    elif case == "shared":
        low.data = other.data
    else:
        bpy.context.view_layer.objects.active = low
        bpy.ops.object.mode_set(mode="EDIT")
    with pytest.raises(BakeError, match="'low'"):
        atlas.pack([low, other], SETTINGS)
    assert atlas.LAYER not in other.data.uv_layers


@pytest.mark.usefixtures("gpu_context")
def test_pairs_are_baked_into_one_image():
    lows = objects()
    atlas.pack(lows, SETTINGS)
    highs = []
    for low in lows:
        high = low.copy()
        high.data = low.data.copy()
        bpy.context.collection.objects.link(high)
        highs.append(high)
    bpy.context.view_layer.update()
    jobs = [Job(low, [high]) for low, high in zip(lows, highs, strict=True)]
    reports = bake_jobs.bake_all(bpy.context, jobs, SETTINGS, share_image=True)
    assert not [text for report in reports for text in report.warnings if "overlap" in text.lower()]
    (margin,) = {report.margin for report in reports}  # of the stored map
    assert margin > 0.01
