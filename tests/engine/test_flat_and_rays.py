# SPDX-License-Identifier: GPL-3.0-or-later
"""Auto draws one map by Flatten and by rays where the UV layouts agree on most texels: nothing is empty or out of place.

The truth is the map by Flatten before the high mesh lost some of its UVs. The low mesh is a plane, and so rays and Flatten find
the same points.
"""

import bpy
import numpy as np
import pytest

from addon.core import progress
from addon.core.settings import Settings
from addon.engine import bands, tree_cache
from addon.jobs import Job, bake_pair, masks
from addon.jobs.live_session import Session
from tests.support import angles, zoo
from tests.support.maps import bake_all_maps, pixels, raw_maps
from tests.support.real_meshes import open_pair

pytestmark = pytest.mark.usefixtures("gpu_context")

N = 64
"""Faces a side of the high mesh."""
SIZE = 128
MAPS = ("POSITION", "HEIGHT", "AO", "BASE_COLOR", "MATERIAL_ID")
SHARE = (N + 36 * 1) / N**2
"""Of the texels: those of the band and of the hole."""


def faces(columns, rows):
    column, row = np.meshgrid(np.arange(N), np.arange(N))
    return (np.isin(column, columns) & np.isin(row, rows)).ravel()


BAND, HOLE = faces([20], range(N)), faces(range(40, 46), range(40, 46))


def pair(is_harmed=True):
    """A plane and a terrain in two materials. In a band v runs the other way, and a part lies outside of the map."""
    low, high = zoo.plane("lo"), zoo.terrain("hi", N)
    for name, color in (("red", (0.8, 0.1, 0.1, 1.0)), ("blue", (0.1, 0.2, 0.9, 1.0))):
        material = bpy.data.materials.new(name)
        material.node_tree.nodes["Principled BSDF"].inputs["Base Color"].default_value = color
        high.data.materials.append(material)
    high.data.polygons.foreach_set("material_index", faces(range(N), range(N // 2)).astype(np.int32))
    if is_harmed:
        change_uvs(high, BAND, (1.0, -1.0), (0.0, 1.0))
        change_uvs(high, HOLE, (1.0, 1.0), (5.0, 0.0))
    return low, high


def change_uvs(obj, which, scale, offset):
    layer = obj.data.uv_layers[0].uv
    uv = np.empty((len(which), 4, 2), np.float32)
    layer.foreach_get("vector", uv.reshape(-1))
    uv[which] = uv[which] * np.float32(scale) + np.float32(offset)
    layer.foreach_set("vector", uv.ravel())
    obj.data.update()


def bake(low, high, method="AUTO", **settings):
    return bake_all_maps(low, high, maps=(), size=SIZE, method=method, **settings)[0], pixels(bpy.data.images["map"])


def off(texels, truth):
    """The angles in degrees between two normal maps, both without an empty texel."""
    assert (texels[..., 3] == 1.0).all()
    assert (truth[..., 3] == 1.0).all()
    return angles.degrees(angles.decode(texels), angles.decode(truth))


def near_faces(which):
    """The texels of some faces of the high mesh, and those around them."""
    texels = which.reshape(N, N).repeat(SIZE // N, axis=0).repeat(SIZE // N, axis=1)
    return ~angles.eroded(~texels, 2)


def test_nothing_is_empty_or_out_of_place():
    _, truth = bake(*pair(is_harmed=False), "FLATTEN")
    low, high = pair()
    _, flat = bake(low, high, "FLATTEN")
    report, texels = bake(low, high)
    assert (flat[..., 3] == 0.0).mean() > 0.005
    assert off(texels, truth).max() < 0.05
    far = ~near_faces(BAND | HOLE)
    assert off(flat[far][None], truth[far][None]).max() < 0.05
    assert report.method == "FLATTEN"
    assert report.rays == pytest.approx(SHARE, abs=0.003)
    assert f"Flatten on {1 - report.rays:.1%} of the texels, rays on {report.rays:.1%}" in report.summary()
    assert report.warnings == []
    assert report.checks["far"]["maximum"] < 0.11  # the height of the terrain
    assert report.checks["unsure"]["count"] == 0


@pytest.mark.parametrize("name", MAPS)
def test_all_maps_come_from_the_same_hits(name):
    _, truth = bake_all_maps(*pair(is_harmed=False), maps=[name], size=SIZE, samples=4, rays=32)
    report, found = bake_all_maps(*pair(), maps=[name], size=SIZE, samples=4, rays=32, method="AUTO")
    assert 0.0 < report.rays < 2.0 * SHARE
    (expected,), (texels,) = truth.values(), found.values()
    difference = np.abs(texels - expected).max(axis=-1)
    # At the border of two materials, and for rays that pass an edge of the surface, rounding decides.
    assert np.quantile(difference, 0.99) < 1e-3
    assert (difference > 0.05).mean() < 1e-3


@pytest.mark.parametrize(
    "options",
    [{"samples": 4, "adaptive": False}, {"samples": 4}, {"samples": 64}, {"space": "OBJECT"}, {"space": "WORLD"}],
    ids=str,
)
def test_with_samples_and_in_all_spaces(options):
    _, truth = bake(*pair(is_harmed=False), "FLATTEN", **options)
    report, texels = bake(*pair(), **options)
    assert report.rays == pytest.approx(SHARE, abs=0.003)
    assert np.quantile(off(texels, truth), 0.999) < 0.05
    assert off(texels, truth).max() < 2.0  # where adaptive samples stop early


@pytest.mark.slow
def test_in_bands(monkeypatch):
    whole_report, whole = bake(*pair(), samples=4)
    monkeypatch.setattr(bands, "BAND_TEXELS", 24 * SIZE)
    report, texels = bake(*pair(), samples=4, margin=4)
    assert report.rays == whole_report.rays
    assert off(texels, whole).max() < 0.05


def test_on_udim_tiles():
    """Each tile shows half of the terrain."""
    expected = raw_maps(*pair(is_harmed=False), maps=(), size=SIZE)[1001]["NORMAL"]
    low, high = pair()
    for obj in (low, high):
        change_uvs(obj, np.ones(len(obj.data.polygons), bool), (2.0, 1.0), (0.0, 0.0))
    change_uvs(high, HOLE, (1.0, 1.0), (0.0, 5.0))
    found = raw_maps(low, high, maps=(), size=SIZE, udim=True, tiles=(1001, 1002), method="AUTO")
    joined = np.concatenate([found[tile]["NORMAL"][:, ::2] for tile in (1001, 1002)], axis=1)
    assert (joined[..., 3] == 1.0).all()
    wide = raw_maps(*pair(is_harmed=False), maps=(), size=2 * SIZE)[1001]["NORMAL"]
    assert expected.shape == joined.shape
    # A texel of the tiles is half as wide: its center is a quarter of a texel of the single map aside.
    assert angles.degrees(joined[..., :3], wide[::2, ::2, :3]).mean() < 1.0


def test_layouts_that_agree_need_no_tree():
    low, high = pair(is_harmed=False)
    _, flat = bake(low, high, "FLATTEN")
    tree_cache.trees.free()
    built = tree_cache.trees.built
    report, texels = bake(low, high)
    assert (report.method, report.rays, tree_cache.trees.built) == ("FLATTEN", 0.0, built)
    assert np.array_equal(texels, flat)


def test_layouts_that_agree_on_a_half_are_cast():
    low, high = pair(is_harmed=False)
    change_uvs(high, faces(range(N // 2), range(N)), (1.0, -1.0), (0.0, 1.0))
    _, cast = bake(low, high, "CAST")
    report, texels = bake(low, high)
    assert (report.method, report.rays) == ("CAST", 0.0)
    assert np.array_equal(texels, cast)


def test_a_high_mesh_beside_the_low_one_leaves_texels_empty_and_auto_does_not_advise_another_method():
    low, high = pair()
    change_uvs(high, faces(range(46, 52), range(40, 46)), (1.0, 1.0), (5.0, 0.0))
    high.location.x = 5.0
    report, texels = bake(low, high)
    assert (report.method, report.rays) == ("FLATTEN", 0.0)
    assert (texels[..., 3] == 0.0).mean() > 0.01
    (warning,) = [warning for warning in report.warnings if "stay empty" in warning]
    assert "Try the method" not in warning
    assert "two objects in the same place" in warning


def test_what_rays_miss_as_well_stays_empty_and_is_counted():
    """Faces that the high mesh lacks."""
    low, high = zoo.plane("lo"), zoo.terrain("hi", N)
    points = [vertex.co[:] for vertex in high.data.vertices]
    kept = np.array([face.vertices[:] for face in high.data.polygons])[~HOLE]
    uv = zoo.grid_uv(N, N)[kept]
    bpy.data.objects.remove(high)
    report, texels = bake(low, zoo.build("hi", points, kept, uv))
    empty = texels[..., 3] == 0.0
    assert empty.mean() == pytest.approx(HOLE.mean(), abs=0.001)
    assert report.missed == pytest.approx(empty.mean())
    assert report.checks["uncovered"]["severity"] == "WRONG"
    (warning,) = report.warnings
    assert "hit nothing" in warning


def test_where_a_ray_misses_what_flatten_drew_stays():
    """Rays are shorter than the terrain is high."""
    low, high = pair()
    report, texels = bake(low, high, extrusion=0.01, max_distance=0.02)
    empty = texels[..., 3] == 0.0
    assert empty.any()
    assert not (empty & ~near_faces(HOLE)).any()
    assert report.missed == pytest.approx(empty.mean())


def test_faces_of_a_check_are_found_by_the_same_method():
    """None is uncovered, as in the map."""
    low, high = pair()
    report, _ = bake(low, high)
    assert report.checks["uncovered"]["count"] == 0
    assert len(masks.find(bpy.context, report, "uncovered")) == 0


def test_live_draws_what_a_bake_draws():
    low, high = pair()
    settings = Settings(
        method="AUTO", width=SIZE, height=SIZE, storage="MEMORY", modifiers="VIEWPORT", margin=0, depth=32
    )

    def texels(session, changed=None):
        session.run(bpy.context, changed)
        return session.texels.copy()

    session = Session(bpy.context, Job(low, [high]), settings, progress.Pace())
    before = texels(session)
    assert (before[..., 3] == 1.0).all()
    assert session.plan.has_rays
    coords = np.array([vertex.co[:] for vertex in high.data.vertices], np.float32)
    coords[coords[:, 0] < -0.8, 2] *= -1.0  # few faces, so that a map by Flatten alone is drawn in parts
    high.data.vertices.foreach_set("co", coords.ravel())
    high.data.update()
    after = texels(session, {high.session_uid})
    assert not np.array_equal(before, after)
    fresh = Session(bpy.context, Job(low, [high]), settings, progress.Pace())
    assert np.array_equal(after, texels(fresh))
    for one in (session, fresh):
        one.free()


@pytest.mark.slow
@pytest.mark.shared
def test_the_helmet_has_no_holes_and_looks_as_by_cast(shared_assets):
    low, high = open_pair(shared_assets, "helmet_23358_6117")
    found = {
        method: raw_maps(low, high, maps=(), size=512, method=method)[1001]["NORMAL"] for method in ("AUTO", "CAST")
    }
    hit = found["CAST"][..., 3] == 1.0
    assert (found["AUTO"][hit][:, 3] == 1.0).all()
    degrees = angles.degrees(found["AUTO"][hit][:, :3], found["CAST"][hit][:, :3])
    assert (degrees > 30.0).mean() < 0.0005
    flat = raw_maps(low, high, maps=(), size=512, method="FLATTEN")[1001]["NORMAL"][hit]
    assert (flat[:, 3] != 1.0).mean() > 0.01
    report = bake_pair(
        bpy.context, low, [high], Settings(method="AUTO", width=512, height=512, storage="MEMORY", material=False)
    )
    assert not any("Cast" in warning for warning in report.warnings)
