# SPDX-License-Identifier: GPL-3.0-or-later
"""Several objects share one map: at one texel density, without overlaps, and later with one more."""

import itertools
from dataclasses import replace

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


def test_several_islands_keep_the_margin_to_what_stays():
    first = [squares(str(number), [1.0] * 3, [(0.0, 0.0, 1.0)] * 3, 9.0 * number) for number in range(2)]
    for low in first:
        parts = [(0.1, 0.1, 0.2), (0.4, 0.1, 0.2), (0.1, 0.4, 0.2)]
        uv = [
            (u + 0.3 * int(low.name) + w * a, v + 0.3 * int(low.name) + w * b) for u, v, w in parts for a, b in CORNERS
        ]
        low.data.uv_layers.new(name=atlas.LAYER).uv.foreach_set("vector", np.array(uv, np.float32).ravel())
    first[1].data.uv_layers[atlas.LAYER].uv.foreach_set(
        "vector", (uv_of(first[1]) + (0.0, 0.3)).astype(np.float32).ravel()
    )
    more = squares("more", [1.0, 0.7, 0.7], [(0.0, 0.0, 1.0), (2.0, 0.0, 0.7), (4.0, 0.0, 0.7)], 27.0)
    atlas.pack([*first, more], SETTINGS, is_done_once=True)
    np.testing.assert_allclose(np.diff(boxes(more), axis=1)[:, 0, 0], [0.2, 0.14, 0.14], rtol=1e-4)
    low, high = np.moveaxis(np.concatenate([boxes(each) for each in (more, *first)]), 1, 0)
    apart = np.maximum(low[:3, None] - high, low - high[:3, None]).max(axis=2)
    assert apart[~np.eye(3, 9, dtype=bool)].min() >= 2.0 * MARGIN * (1.0 - 1e-5)
    assert low[:3].min() >= MARGIN * (1.0 - 1e-5) and high[:3].max() <= 1.0 - MARGIN * (1.0 - 1e-5)


def test_margins_that_take_the_whole_map_are_refused():
    low = squares("low", [1.0] * 40, [(1.01 * number, 0.0, 1.0) for number in range(40)])
    before = state()
    with pytest.raises(BakeError, match="'low' do not fit into a map with their margins: take a larger one"):
        atlas.pack([low], replace(SETTINGS, width=32, height=32))
    assert state() == before


@pytest.mark.parametrize("is_more", [False, True])
def test_packing_is_left_at_each_step(is_more):
    """Packing itself has several; nothing has changed then."""
    lows = objects()
    if is_more:
        atlas.pack(lows[:2], SETTINGS)
        lows[2].scale = (0.2, 0.2, 0.2)
        bpy.context.view_layer.update()
    before = state()
    for stop in (1, 2, 3):
        work = atlas.work(lows, SETTINGS)
        steps = [step.what for step in itertools.islice(work, stop)]
        work.close()
        assert steps == ["Reading UV maps", "Packing UV islands", "Packing UV islands"][:stop]
        assert state() == before
        assert atlas.LAYER not in lows[2].data.uv_layers


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


CORNERS = ((0, 0), (1, 0), (1, 1), (0, 1))
MARGIN = 8 / 2 / 256
"""Around each island, for the clean mip levels of SETTINGS."""


def squares(name, sides, uv, x=0.0):
    """An object of squares in a row, of these sides. uv: left, bottom and side of the UVs of each, negative if mirrored."""
    points, corners = [], []
    for number, (side, (left, bottom, wide)) in enumerate(zip(sides, uv, strict=True)):
        points += [(3.0 * number + side * a, side * b, 0.0) for a, b in CORNERS]
        start = left if wide > 0.0 else left - wide
        corners.append([(start + wide * a, bottom + abs(wide) * b) for a, b in CORNERS])
    faces = np.arange(len(points)).reshape(-1, 4)
    low = zoo.build(name, np.array(points), faces, np.array(corners))
    low.location.x = x
    bpy.context.view_layer.update()
    return low


def boxes(low):
    """The lowest and highest UVs (F, 2, 2) of each face."""
    uv = uv_of(low).reshape(-1, 4, 2)
    return np.stack([uv.min(axis=1), uv.max(axis=1)], axis=1)


def test_four_squares_fill_the_map():
    """Two rows of two, with a margin around each."""
    lows = [squares(str(number), [1.0], [(0.0, 0.0, 1.0)], 3.0 * number) for number in range(4)]
    atlas.pack(lows, SETTINGS)
    sides = np.concatenate([np.diff(boxes(low), axis=1)[:, 0] for low in lows])
    np.testing.assert_allclose(sides, (1.0 - 4 * MARGIN) / 2.0, rtol=0.02)


@pytest.mark.parametrize("wide", [0.5, -0.5], ids=["copied", "mirrored"])
def test_islands_on_each_other_stay_so(wide):
    """As one island, which is as large as that with the larger surface needs. Others that only overlap are put apart."""
    low = squares("low", [1.0, 2.0, 1.0], [(0.1, 0.1, 0.5), (0.1, 0.1, wide), (0.3, 0.3, 0.25)])
    said = atlas.pack([low], SETTINGS)
    uv, place = uv_of(low).reshape(-1, 4, 2), boxes(low)
    assert f"{np.diff(place, axis=1)[[0, 2]].prod(axis=-1).sum():.0%} of the map used" in said
    mirrored = [1, 0, 3, 2] if wide < 0.0 else [0, 1, 2, 3]
    np.testing.assert_array_equal(uv[1], uv[0][mirrored])
    assert (np.diff(place, axis=1)[0] / np.diff(place, axis=1)[2])[0] == pytest.approx([2.0, 2.0], rel=1e-4)
    assert (place[2, 0] > place[0, 1]).any() or (place[2, 1] < place[0, 0]).any()


def test_copies_that_were_moved_by_a_tile_stay_there():
    low = squares("low", [1.0, 1.0, 1.0], [(0.1, 0.1, 0.5), (2.1, 1.1, 0.5), (0.7, 0.7, 0.2)])
    atlas.pack([low], SETTINGS)
    uv = uv_of(low).reshape(-1, 4, 2)
    np.testing.assert_allclose(uv[1] - uv[0], np.broadcast_to((2.0, 1.0), (4, 2)), atol=1e-6)
    assert uv[[0, 2]].max() < 1.0


@pytest.mark.parametrize("tile", [0.0, 2.0])
def test_islands_of_other_materials_are_put_apart(tile):
    """One texture of all shows one of them: the first and the third have the same material, in two slots."""
    low = squares("low", [1.0, 1.0, 1.0], [(0.1, 0.1, 0.5), (0.1 + tile, 0.1, 0.5), (0.1 + tile, 0.1, 0.5)])
    skin, eyes = (bpy.data.materials.new(name) for name in ("skin", "eyes"))
    for number, material in enumerate((skin, eyes, skin)):
        low.data.materials.append(material)
        low.data.polygons[number].material_index = number
    atlas.pack([low], SETTINGS)
    uv, place = uv_of(low).reshape(-1, 4, 2), boxes(low)
    np.testing.assert_allclose(uv[2] - uv[0], np.broadcast_to((tile, 0.0), (4, 2)), atol=1e-6)
    assert place[1].min() > 0.0
    assert place[1].max() < 1.0
    assert (place[1, 0] > place[0, 1]).any() or (place[1, 1] < place[0, 0]).any()
    assert "have the UV map 'Atlas' already" in atlas.pack([low], SETTINGS)


def test_packing_again_moves_nothing_but_what_is_wrong():
    *first, more = objects()
    more.scale = (0.2, 0.2, 0.2)
    bpy.context.view_layer.update()
    for lows in (first, [*first, more]):
        atlas.pack(lows, SETTINGS)
        packed = [uv_of(low) for low in lows]
        assert "have the UV map 'Atlas' already" in atlas.pack(lows, SETTINGS)
        assert all(np.array_equal(uv_of(low), uv) for low, uv in zip(lows, packed, strict=True))
    atlas.pack(lows, SETTINGS, is_anew=True)
    assert not np.array_equal(uv_of(first[0]), packed[0])
    packed = [uv_of(low) for low in lows]
    layer = more.data.uv_layers[atlas.LAYER].uv
    onto_another = packed[2] - packed[2].mean(axis=0) + packed[0].mean(axis=0)
    for wrong in (packed[2] * 0.9, packed[2] + (0.5, 0.0), onto_another):
        layer.foreach_set("vector", wrong.astype(np.float32).ravel())
        assert "already" not in atlas.pack(lows, SETTINGS)
        assert sum(covered(low).astype(int) for low in lows).max() == 1


def test_only_some_are_packed_between_the_others():
    """Also those that have the UV map, and others that have another one."""
    lows = objects()
    lows[2].scale = (0.2, 0.2, 0.2)
    bpy.context.view_layer.update()
    atlas.pack(lows, SETTINGS)
    packed = [uv_of(low) for low in lows]
    lows[2].data.uv_layers[atlas.LAYER].uv.foreach_set("vector", (packed[2] * 0.5).astype(np.float32).ravel())
    lows[1].data.uv_layers[atlas.LAYER].name = "mine"
    said = atlas.pack(lows, SETTINGS, only=[lows[2]])
    assert said.startswith("'sheet' have the UV map 'Atlas', beside 2 that kept their places")
    assert np.array_equal(uv_of(lows[0]), packed[0])
    assert np.array_equal(uv_of(lows[1], "mine"), packed[1])
    assert atlas.LAYER not in lows[1].data.uv_layers
    assert density(lows[2]) == pytest.approx(density(lows[0]), rel=0.02)
    lows[1].data.uv_layers["mine"].name = atlas.LAYER
    assert sum(covered(low).astype(int) for low in lows).max() == 1


def test_each_material_has_a_map_of_its_own():
    """Its islands fill that map, as those of a material alone do; what stays in one is no matter in the other."""
    wood, metal = map(bpy.data.materials.new, ("Wood", "Metal"))
    lows = [squares(name, [1.0] * 4, [(0.0, 0.0, 1.0)] * 4) for name in ("a", "b")]
    for low, materials in zip(lows, ((wood, metal), (metal, wood)), strict=True):
        for material in materials:
            low.data.materials.append(material)
        low.data.polygons.foreach_set("material_index", [0, 1, 1, 1])
        uv = np.tile(uv_of(low, zoo.LAYER).reshape(-1, 4, 2)[:1], (4, 1, 1)) + np.arange(4)[:, None, None] * (2.0, 0.5)
        low.data.uv_layers[zoo.LAYER].uv.foreach_set("vector", uv.astype(np.float32).ravel())
    settings = SETTINGS.mapped(texture_sets=True)
    assert "of 2 maps used" in atlas.pack(lows, settings)
    for of_a, of_b in (([0], [1, 2, 3]), ([1, 2, 3], [0])):
        places = np.concatenate([boxes(lows[0])[of_a], boxes(lows[1])[of_b]])
        np.testing.assert_allclose(np.diff(places, axis=1), (1.0 - 4 * MARGIN) / 2.0, rtol=0.02)
        middles = places.mean(axis=1)
        assert {tuple(middle) for middle in (middles > 0.5).tolist()} == {
            (a, b) for a in (False, True) for b in (False, True)
        }
    assert "already" in atlas.pack(lows, settings)
    glass = squares("c", [1.0], [(0.0, 0.0, 1.0)])
    glass.data.materials.append(bpy.data.materials.new("Glass"))
    assert "'c' have the UV map 'Atlas', beside 2 that kept" in atlas.pack([*lows, glass], settings)
    np.testing.assert_allclose(np.diff(boxes(glass), axis=1), 1.0 - 2 * MARGIN, rtol=0.02)


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
