# SPDX-License-Identifier: GPL-3.0-or-later
"""Rays on real meshes, compared with Cycles' selected-to-active bake and a published map; distances, misses, cages."""

import weakref

import bpy
import gpu
import mathutils
import numpy as np
import pytest
from mathutils import Matrix

from addon.core.errors import BakeError
from addon.core.progress import Pace
from addon.core.settings import Settings
from addon.engine import tree_cache
from addon.jobs import Job, bake, bake_all
from addon.jobs.live_session import Session
from tests.support import angles, cycles, lanes, maps, oracle, scenes, zoo
from tests.support.real_meshes import FAST, PAIRS, open_pair

pytestmark = pytest.mark.usefixtures("gpu_context")

SIZE = (1024, 1024)
MEDIAN, P99 = 0.01, 0.1
"""Degrees from Cycles, which casts the same rays from positions that differ in the last bits."""
NEAR_AN_EDGE = 8
"""Texels of a million, inside low triangles, that only Cycles hits. In double precision their rays pass an edge of the high
mesh by less than 1e-4 of a triangle, or end less than 1e-4 of their length before it."""
OTHER_LAYER = 5e-4
"""Share of texels where the two may hit different layers: rays along an edge or between two layers."""
SNAP = 1 / 128
"""Texels. Rasterizers snap corners to 1/256 of a texel: an edge this close to a center may pass on either side of it."""


def pair_and_distances(folder, name):
    low, high = open_pair(folder, name)
    if name.startswith("normaltangenttest"):
        return low, high, 0.12, 0.3
    extrusion = 0.02 * max(low.dimensions)
    return low, high, extrusion, 2.0 * extrusion


def cast(low, *highs, cage=None, **settings):
    """Texels and the report."""
    report = scenes.bake(low, *highs, cage=cage, **{"method": "CAST", "image": "cast"} | settings)
    return maps.pixels(bpy.data.images[report.image]), report


@pytest.mark.shared
@pytest.mark.parametrize("name", lanes.slow_but(FAST, PAIRS))
def test_rays_hit_what_cycles_hits(shared_assets, name):
    low, high, extrusion, reach = pair_and_distances(shared_assets, name)
    texels, _ = cast(low, high, space="OBJECT", size=SIZE, extrusion=extrusion, max_distance=reach, hit="OUTERMOST")
    expected, written = cycles.bake_normals(
        low, SIZE, space="OBJECT", highs=[high], extrusion=extrusion, max_distance=reach
    )
    ours = texels[..., 3] > 0
    both = ours & written & ~cycles.shared(low, SIZE)
    error = angles.degrees(angles.decode(texels), angles.decode(expected))[both]
    print(
        f"{name}: median {np.median(error):.4f}, 99th percentile {np.percentile(error, 99):.4f}, over 5 degrees "
        f"{(error > 5).mean():.4%}; hit only by Cycles {np.count_nonzero(written & ~ours)}, only by Imprint "
        f"{np.count_nonzero(ours & ~written)}"
    )
    assert both.mean() > 0.15
    assert np.median(error) < MEDIAN
    assert np.percentile(error, 99) < P99
    assert (error > 5.0).mean() < OTHER_LAYER
    # Texels that only Cycles hits are at borders, except for a few rays that barely pass an edge.
    row, column = np.nonzero(written & ~ours)
    centers = (np.stack([column, row], axis=1) + 0.5) / SIZE
    layer = low.data.uv_layers.active.uv
    uv = np.empty((len(layer), 2), np.float32)
    layer.foreach_get("vector", uv.reshape(-1))
    triangles = np.empty((len(low.data.loop_triangles), 3), np.int32)
    low.data.loop_triangles.foreach_get("loops", triangles.reshape(-1))
    inside = oracle.depth_inside(centers, uv[triangles]) * SIZE[0] > SNAP
    assert np.count_nonzero(inside) <= NEAR_AN_EDGE


@pytest.mark.slow
@pytest.mark.shared
def test_the_published_map_of_the_normal_tangent_test(shared_assets):
    """The map comes from another tool: it checks +Y, MikkTSpace with rotated UVs, and the positions of texels."""
    low, high, extrusion, reach = pair_and_distances(shared_assets, "normaltangenttest_published")
    size = (2048, 2048)
    texels, _ = cast(low, high, size=size, extrusion=extrusion, max_distance=reach)
    published = bpy.data.images.load(str(shared_assets / "pairs" / "normaltangenttest_published_normal.png"))
    published.colorspace_settings.is_data = True
    inside = angles.eroded(texels[..., 3] > 0, 2)
    error = angles.degrees(angles.decode(texels), angles.decode(maps.pixels(published)))[inside]
    print(f"mean {error.mean():.3f}, 95th percentile {np.percentile(error, 95):.3f}")
    assert inside.mean() > 0.15
    assert error.mean() <= 0.30
    assert np.percentile(error, 95) <= 0.40


@pytest.mark.shared
@pytest.mark.parametrize("name", lanes.slow_but(FAST, PAIRS))
def test_measured_distances_reach_the_high_mesh(shared_assets, name):
    low, high, extrusion, reach = pair_and_distances(shared_assets, name)
    texels, report = cast(low, high, space="OBJECT", size=SIZE)
    by_hand, _ = cast(low, high, space="OBJECT", size=SIZE, extrusion=extrusion, max_distance=reach, image="by hand")
    both = (texels[..., 3] > 0) & (by_hand[..., 3] > 0)
    differs = (angles.degrees(angles.decode(texels), angles.decode(by_hand))[both] > 5.0).mean()
    print(f"{name}: {report.distances}, missed {report.missed:.4%}, over 5 degrees from 2 % by hand {differs:.4%}")
    assert report.missed < 1e-3
    if name not in {"spot_control_vs_subd5", "king_40480_4000", "helmet_23358_6117"}:
        # These three have other layers within 2 % of the surface, which rays from that distance hit first.
        assert differs < 1e-3


@pytest.mark.parametrize(("scale", "offset"), [(1.0, 10_000.0), (1e-3, 0.0), (1e-3, 10.0)])
def test_far_away_and_tiny_objects_give_the_same_map(scale, offset):
    low, high = zoo.sphere("low", n=8), zoo.sphere("high", n=48)
    high.scale = (1.05, 1.05, 1.05)
    bpy.context.view_layer.update()
    before, near = cast(low, high)
    for obj in (low, high):
        obj.matrix_world = (
            mathutils.Matrix.Translation((offset, -offset, offset))
            @ mathutils.Matrix.Scale(scale, 4)
            @ obj.matrix_world
        )
    after, far = cast(low, high)
    assert near.missed == far.missed == 0.0
    assert np.array_equal(before[..., 3], after[..., 3])
    assert angles.degrees(angles.decode(before), angles.decode(after)).max() < 0.05


def test_rays_find_all_of_a_sphere_inside_a_sphere():
    """On concentric spheres, rays must give the map that Flatten gives."""
    low, high = zoo.sphere("low", n=24), zoo.sphere("high", n=96)
    high.scale = (0.9, 0.9, 0.9)
    bpy.context.view_layer.update()
    texels, report = cast(low, high, space="OBJECT", size=(256, 128))
    flat = maps.bake(low, high, space="OBJECT", size=(256, 128), image="flat")
    assert report.missed < 0.02  # without the belt's borders: rays from the outer one pass above the inner one
    both = (texels[..., 3] > 0) & (flat[..., 3] > 0)
    assert angles.degrees(angles.decode(texels), angles.decode(flat))[both].max() < 0.5


def test_misses_are_counted_and_keep_alpha_0():
    low, high = zoo.plane("low"), zoo.plane("high")
    high.scale = (0.5, 1.0, 1.0)  # covers the middle half
    bpy.context.view_layer.update()
    texels, report = cast(low, high, margin=4, missed=(1.0, 0.0, 1.0))
    assert report.missed == pytest.approx(0.5, abs=0.01)
    assert any("hit nothing" in warning for warning in report.warnings)
    holes = texels[..., 3] == 0.0
    assert holes.mean() == pytest.approx(report.missed)
    assert (texels[holes] == np.float32((1.0, 0.0, 1.0, 0.0))).all()


def test_rays_hit_all_of_several_high_objects():
    left, right = (zoo.plane(name) for name in ("left", "right"))
    for side, obj in ((-0.5, left), (0.5, right)):
        obj.matrix_world = mathutils.Matrix.LocRotScale((side, 0, 0.01), None, (0.5, 1, 1))
    right.data.transform(mathutils.Matrix.Rotation(0.2, 4, "X"))
    bpy.context.view_layer.update()
    texels, report = cast(zoo.plane("low"), left, right, extrusion=0.3, max_distance=0.6)
    assert report.missed < 0.02  # the rotated one is a little shorter
    assert np.allclose(texels[20:44, :30], np.float32((0.5, 0.5, 1, 1)), atol=1e-5)
    turned = angles.decode(texels[20:44, 34:])
    assert angles.degrees(turned, np.float64((0, -np.sin(0.2), np.cos(0.2)))).max() < 0.01


def test_smooth_directions_leave_no_gaps_at_hard_edges():
    """Rays along a cube's split normals diverge at its edges and miss the surface in front of them."""
    low, high = zoo.cube("low", smooth=False), zoo.cube("high", smooth=False)
    high.scale = (1.1, 1.1, 1.1)
    bpy.context.view_layer.update()
    distances = {"extrusion": 0.4, "max_distance": 0.8}
    _, smooth = cast(low, high, **distances)
    assert smooth.missed == 0.0


def test_rays_start_on_the_cage():
    """Half of the high plane, at x > 0, is above the cage. Rays do not hit it there."""
    low = zoo.plane("low", n=2)
    cage = zoo.plane("cage", n=2)
    cage.location.z = 0.5
    high = zoo.plane("high")
    high.location.z = 0.4
    lid = zoo.plane("lid", slope=0.3)
    lid.location.z = 1.5
    bpy.context.view_layer.update()
    texels, report = cast(low, high, lid, cage=cage)
    assert report.missed == 0.0
    assert (texels == np.float32((0.5, 0.5, 1, 1))).all()
    cage.location.z = 3.0
    bpy.context.view_layer.update()
    texels, _ = cast(low, high, lid, cage=cage)
    assert (texels[..., 0] < 0.45).all()  # the lid's slope


def test_a_cage_with_another_topology_is_refused_with_both_face_counts():
    with pytest.raises(BakeError, match=r"'cage' has 9 faces and 'low' has 4"):
        cast(zoo.plane("low", n=2), zoo.plane("high"), cage=zoo.plane("cage", n=3))


def test_objects_that_do_not_overlap_are_refused_with_the_distance():
    high = zoo.plane("high")
    high.location.x = 12.0
    bpy.context.view_layer.update()
    low, settings = zoo.plane("low"), Settings(method="CAST", width=16, height=16, storage="MEMORY")
    live = Session(bpy.context, Job(low, [high]), settings, Pace())
    for refused in (
        lambda: cast(low, high),
        lambda: live.run(bpy.context),
        lambda: bake.measure_rays(bpy.context, low, [high], settings),
    ):
        with pytest.raises(BakeError, match="do not overlap: they are 10 m apart"):
            refused()


@pytest.mark.parametrize("value", [-0.1, float("nan"), float("inf")])
@pytest.mark.parametrize("name", ["extrusion", "max_distance"])
def test_invalid_distances_are_refused(name, value):
    with pytest.raises(BakeError, match="not a distance"):
        cast(zoo.plane("low"), zoo.plane("high"), **{name: value})


@pytest.mark.parametrize("hit", ["OWN", "OUTERMOST"])
def test_rays_of_a_set_length_alone_reach_the_surface(hit):
    """Where hits have owners, rays search farther than was measured, but not by so much that short ones end outside."""
    low, high = zoo.plane("low"), zoo.terrain("high")
    high.scale.z = 0.02
    bpy.context.view_layer.update()
    _, report = cast(low, high, max_distance=0.03, hit=hit)
    assert report.missed == 0.0
    assert report.distances["max_distance"] == 0.03
    _, report = cast(low, high, max_distance=1.0, hit=hit)
    assert (report.distances["extrusion"] > 0.05) == (hit == "OWN")


def test_the_tree_is_cached_until_the_high_mesh_changes():
    trees = tree_cache.trees
    trees.free()
    before = trees.built
    low, high = zoo.plane("low"), zoo.terrain("high")
    cast(low, high)
    cast(low, high, extrusion=0.2, max_distance=0.5, space="WORLD", size=(32, 32))
    assert trees.built == before + 1
    high.data.vertices[40].co.z += 0.1
    high.data.update()
    changed, _ = cast(low, high)
    assert trees.built == before + 2
    high.rotation_euler.z = 0.1
    cast(low, high)
    assert trees.built == before + 3
    assert changed[..., 3].all()


@pytest.mark.parametrize("change", ["flat", "custom normals"])
def test_rays_return_changed_normals_on_the_same_surface(change):
    low, high = zoo.plane("low"), zoo.terrain("high", n=8)
    smooth, _ = cast(low, high, space="OBJECT")
    if change == "flat":
        high.data.shade_flat()
    else:
        high.data.normals_split_custom_set([(0.6, 0.0, 0.8)] * len(high.data.loops))
    high.data.update()
    changed, _ = cast(low, high, space="OBJECT")
    assert np.abs(changed - smooth).max() > 0.05
    tree_cache.trees.free()
    assert np.array_equal(changed, cast(low, high, space="OBJECT")[0])


@pytest.mark.parametrize("order", [(0, 1), (1, 0)], ids=["misses above", "hits above"])
def test_misses_of_one_object_in_an_atlas_do_not_replace_texels_of_another(order):
    """Two low meshes on the same texels. The high mesh covers all of one, and half of the other."""
    lows, highs = (
        [zoo.plane(name) for name in ("a", "b")],
        [zoo.plane("whole", slope=0.3), zoo.plane("half", slope=-0.3)],
    )
    lows[1].location.y = highs[1].location.y = 10.0
    highs[1].data.transform(Matrix.Diagonal((0.5, 1.0, 1.0, 1.0)))
    jobs = [Job(lows[number], [highs[number]]) for number in order]
    settings = Settings(
        method="CAST",
        space="OBJECT",
        width=32,
        height=16,
        extrusion=1.0,
        max_distance=2.0,
        margin=0,
        maps=("OBJECT_ID",),
        image="atlas",
        storage="MEMORY",
        depth=32,
        material=False,
    )
    reports = bake_all(bpy.context, jobs, settings, share_image=True)
    texels, owner = (maps.pixels(bpy.data.images[name]) for name in ("atlas", "atlas_object_id"))
    assert (texels[..., 3] == 1.0).all()
    whole = 0.5 - 0.5 * 0.3 / np.hypot(0.3, 1.0)
    outer = np.r_[0:8, 24:32]
    assert np.allclose(texels[:, outer, 0], whole, atol=1e-5)
    colors = reports[0].maps["object_id"]["colours"]
    assert np.allclose(owner[:, outer, :3], colors["whole"], atol=2 / 255)
    above = ("whole", "half")[order[-1]]
    assert np.allclose(owner[:, 8:24, :3], colors[above], atol=2 / 255)


def test_auto_measures_whether_uvs_are_shared():
    low, shared, other = zoo.plane("low"), zoo.terrain("shared"), zoo.terrain("other")
    layer = other.data.uv_layers[0].uv
    uv = np.empty(len(layer) * 2, np.float32)
    layer.foreach_get("vector", uv)
    layer.foreach_set("vector", uv.reshape(-1, 2)[:, ::-1].ravel())  # upside down
    _, report = cast(low, shared, method="AUTO")
    assert (report.method, "agree" in report.why) == ("FLATTEN", True)
    shared.location = (3.0, 1.0, 0.0)  # moved aside
    _, report = cast(low, shared, method="AUTO")
    assert report.method == "FLATTEN"
    shared.location = (0.0, 0.0, 0.0)
    _, report = cast(low, shared, method="AUTO", cage=zoo.plane("cage"))
    assert (report.method, "cage" in report.why) == ("CAST", True)
    _, report = cast(low, other, method="AUTO")
    assert (report.method, "differ" in report.why) == ("CAST", True)
    other.data.uv_layers.remove(other.data.uv_layers[0])
    other.data.update()
    _, report = cast(low, other, method="AUTO")
    assert (report.method, "no UV layer" in report.why) == ("CAST", True)


def test_trees_of_finished_jobs_are_freed(monkeypatch):
    """The jobs themselves stay until the end of their batch, for their reports."""
    tree_cache.trees.free()
    monkeypatch.setattr(tree_cache.trees, "most_trees", 1)
    jobs = [
        Job(zoo.plane(f"low {number}"), [zoo.terrain(f"high {number}", height=0.02 * (number + 1))])
        for number in range(5)
    ]
    made, alive, real = [], [], tree_cache.RayScene

    def make(*arguments, **more):
        scene = real(*arguments, **more)
        made.append(weakref.ref(scene))
        return scene

    def count(_step):
        alive.append(sum(scene() is not None for scene in made))

    monkeypatch.setattr(tree_cache, "RayScene", make)

    settings = Settings(method="CAST", width=16, height=16, storage="MEMORY", extrusion=0.5, max_distance=1.0)
    bake_all(bpy.context, jobs, settings, on_progress=count)
    assert len(made) == len(jobs)
    assert max(alive) <= 2  # the cached one and the one in use


def test_cached_trees_are_limited_and_the_oldest_is_freed_first(monkeypatch):
    trees = tree_cache.trees
    trees.free()
    low = zoo.plane("low")
    cast(low, zoo.terrain("a"))
    (first,) = trees.scenes
    assert trees.bytes > first.tables.bytes  # with the tree over the low mesh
    monkeypatch.setattr(trees, "most_bytes", 2 * trees.bytes)
    cast(low, zoo.terrain("b", height=0.2))
    cast(low, zoo.terrain("c", height=0.3))
    assert len(trees) == 2
    assert not any(scene is first for scene in trees.scenes)
    monkeypatch.undo()
    monkeypatch.setattr(trees, "most_trees", 3)
    for height in (0.5, 0.6, 0.7):
        cast(low, zoo.terrain("e", height=height))
    assert len(trees) == 3
    monkeypatch.setattr(trees, "most_bytes", 0)
    cast(low, zoo.terrain("d", height=0.4))
    assert not trees


def test_ignore_backfaces_passes_through_a_lid_that_faces_away():
    low, high, lid = zoo.plane("low"), zoo.plane("high"), zoo.plane("lid", slope=0.2)
    lid.data.flip_normals()
    lid.location.z = 0.3
    high.location.z = 0.01
    bpy.context.view_layer.update()
    distances = {"extrusion": 1.0, "max_distance": 2.0, "hit": "OUTERMOST", "keep_faces": True}
    first, _ = cast(low, high, lid, **distances)
    facing, _ = cast(low, high, lid, facing_only=True, **distances)
    assert (first[..., 2] < 0.5).all()  # the lid's back
    assert (facing == np.float32((0.5, 0.5, 1, 1))).all()


def test_split_directions_leave_gaps_at_hard_edges():
    """Ray Directions set to split normals: rays of a cube never reach the surface beyond its edges."""
    low, high = zoo.cube("low", smooth=False), zoo.sphere("high", n=48)
    high.scale = (1.9, 1.9, 1.9)
    bpy.context.view_layer.update()
    distances = {"extrusion": 1.2, "max_distance": 2.4}
    smooth, _ = cast(low, high, directions="SMOOTH", space="OBJECT", **distances)
    split, _ = cast(low, high, directions="SPLIT", space="OBJECT", **distances)
    both = (smooth[..., 3] > 0) & (split[..., 3] > 0)
    assert angles.degrees(angles.decode(smooth), angles.decode(split))[both].max() > 5.0


# Special cases


def test_ignore_backfaces_distinguishes_front_and_back_on_a_mirrored_object():
    low, high = zoo.plane("low"), zoo.plane("high", slope=0.2)
    high.scale.x = -1.0
    bpy.context.view_layer.update()
    distances = {"extrusion": 1.0, "max_distance": 2.0}
    plain, _ = cast(low, high, **distances)
    facing, report = cast(low, high, facing_only=True, **distances)
    assert report.missed == 0.0
    assert np.array_equal(plain, facing)


def turned_uvs(obj, degrees, scale=1.0):
    layer = obj.data.uv_layers[0].uv
    uv = np.empty(len(layer) * 2, np.float32)
    layer.foreach_get("vector", uv)
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    turned = (uv.reshape(-1, 2) - 0.5) @ np.array([(c, s), (-s, c)]) * scale + 0.5
    layer.foreach_set("vector", turned.astype(np.float32).ravel())


@pytest.mark.parametrize(
    ("degrees", "scale", "height", "method"),
    [
        (0, 1.0, 0.05, "FLATTEN"),
        (0, 1.0, 0.8, "FLATTEN"),
        (10, 1.0, 0.05, "CAST"),
        (90, 1.0, 0.05, "CAST"),
        (0, 0.8, 0.05, "CAST"),
    ],
)
def test_auto_compares_points_along_the_surface(degrees, scale, height, method):
    """Detail of any height agrees with the layout. A rotated or smaller layout does not."""
    high = zoo.terrain("high", height=height)
    turned_uvs(high, degrees, scale)
    _, report = cast(zoo.plane("low"), high, method="AUTO")
    assert (report.method, report.why) == (method, report.why)


def add_loose_vertex(obj, place):
    obj.data.vertices.add(1)
    obj.data.vertices[-1].co = place
    obj.data.update()


@pytest.mark.parametrize("place", [(np.nan, 0, 0), (1e6, 0, 0)])
@pytest.mark.parametrize("name", ["low", "high"])
@pytest.mark.parametrize("method", ["CAST", "AUTO"])
def test_loose_vertices_change_nothing(name, place, method):
    low, high = zoo.plane("low"), zoo.terrain("high")
    before, first = cast(low, high, method=method)
    add_loose_vertex(bpy.data.objects[name], place)
    after, second = cast(low, high, method=method)
    assert first.method == second.method
    assert first.distances == pytest.approx(second.distances)
    assert np.abs(before - after).max() < 1e-5


def test_uvs_of_the_high_mesh_do_not_matter_to_rays():
    low, high = zoo.plane("low"), zoo.terrain("high")
    layer = high.data.uv_layers[0].uv
    uv = np.random.default_rng(9).random(len(layer) * 2).astype(np.float32)
    uv[::7] = np.nan
    layer.foreach_set("vector", uv)
    texels, report = cast(low, high, method="AUTO")
    assert report.method == "CAST"
    assert report.missed == 0.0
    high.data.uv_layers.remove(high.data.uv_layers[0])
    high.data.update()
    assert np.array_equal(texels, cast(low, high)[0])


def test_high_objects_out_of_reach_do_not_make_the_tree_less_precise():
    low, high, far = zoo.plane("low"), zoo.terrain("high"), zoo.plane("far")
    alone, _ = cast(low, high)
    far.location.x = 10_000.0
    bpy.context.view_layer.update()
    together, report = cast(low, high, far)
    assert report.missed == 0.0
    assert report.warnings == ["'far' lies out of reach of the rays and was left out."]
    assert np.array_equal(alone, together)


def test_a_cage_replaces_the_extrusion():
    low, cage, high, lid = zoo.plane("low", n=2), zoo.plane("cage", n=2), zoo.plane("high"), zoo.plane("lid", slope=0.3)
    cage.location.z, high.location.z, lid.location.z = 0.5, 0.4, 1.5
    bpy.context.view_layer.update()
    texels, report = cast(low, high, lid, cage=cage, extrusion=2.0, max_distance=4.0)
    assert report.distances["extrusion"] == 0.0
    assert (texels == np.float32((0.5, 0.5, 1, 1))).all()


def test_margin_of_a_neighbor_does_not_hide_misses_in_an_atlas():
    def strip(name, start, stop):
        """A strip of the plane from x = start to x = stop, with the plane's UVs."""
        x = 2.0 * np.array((start, stop)) - 1.0
        points = [(x[0], -1, 0), (x[1], -1, 0), (x[1], 1, 0), (x[0], 1, 0)]
        return zoo.build(name, points, [(0, 1, 2, 3)], [[(start, 0), (stop, 0), (stop, 1), (start, 1)]])

    jobs = [
        Job(strip("a", 0.0, 0.5), [strip("a high", 0.0, 0.25)]),  # its right half is missed
        Job(strip("b", 0.5, 1.0), [strip("b high", 0.5, 1.0)]),
    ]
    settings = Settings(
        method="CAST", width=64, height=16, margin=8, depth=32, storage="MEMORY", material=False, image="atlas"
    )
    reports = bake_all(bpy.context, jobs, settings, share_image=True)
    alpha = maps.pixels(bpy.data.images["atlas"])[..., 3]
    assert (alpha[:, 16:32] == 0.0).all()
    assert (alpha[:, 32:] == 1.0).all()
    assert reports[0].missed == pytest.approx(0.5, abs=0.02)


def test_maps_of_several_pairs_never_overwrite_the_same_file(tmp_path):
    jobs = [Job(zoo.plane(name), [zoo.plane(name + " high")]) for name in ("a", "b")]
    settings = Settings(width=16, height=16, storage="FILE", output=str(tmp_path / "m.png"), material=False)
    with pytest.raises(BakeError, match="would both"):
        bake_all(bpy.context, jobs, settings)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("missed", [(float("nan"), 0, 0), (2.0, 0, 0), (-0.1, 0, 0)])
def test_an_invalid_color_is_refused(missed):
    with pytest.raises(BakeError, match="Miss Color"):
        Settings(missed=missed).check()


def test_a_map_too_large_for_the_gpu_is_refused_with_the_limit(monkeypatch):
    monkeypatch.setattr(gpu.capabilities, "max_texture_size_get", lambda: 64)
    with pytest.raises(BakeError, match="whose textures have at most 64"):
        maps.bake(zoo.plane("low"), zoo.plane("high"), size=(65, 64))


def test_a_dense_closed_mesh_has_no_pinhole():
    """In a whole bake: half a million triangles, each smaller than a texel, and rays from far away."""
    low, high = zoo.plane("low"), zoo.terrain("high", n=512, height=0.05)
    for obj in (low, high):
        obj.rotation_euler = (0.4, 1.1, -0.3)
    bpy.context.view_layer.update()
    for extrusion in (0.1, 0.5):
        _, report = cast(low, high, size=(512, 512), extrusion=extrusion, max_distance=2.0 * extrusion)
        assert report.missed == 0.0


# Messages


def test_overlapping_uvs_in_an_atlas_raise_a_warning():
    jobs = [Job(zoo.plane(name), [zoo.terrain(name + " high")]) for name in ("a", "b")]
    settings = Settings(width=16, height=16, storage="MEMORY", image="atlas", material=False)
    reports = bake_all(bpy.context, jobs, settings, share_image=True)
    assert reports[0].warnings == []
    assert "256 texels of 'b' overlap texels of other objects" in reports[1].warnings[0]


def test_a_mesh_with_flipped_normals_raises_a_warning():
    low, high = zoo.plane("low"), zoo.terrain("high")
    _, report = cast(low, high)
    assert report.warnings == []
    high.data.flip_normals()
    _, report = cast(low, high)
    (warning,) = report.warnings
    assert warning.startswith("The faces of 'low' point to the other side")


@pytest.mark.parametrize("offset", [3.0, 6.0])
def test_separate_objects_are_refused_even_if_a_few_rays_hit(offset):
    low, high = zoo.sphere("low", n=8), zoo.sphere("high", n=16)
    high.location.x = offset + 1.0
    bpy.context.view_layer.update()
    with pytest.raises(BakeError, match=r"do not overlap: they are \d"):
        cast(low, high)


@pytest.mark.parametrize("name", ["{Low}.png", "{object}.png", "map_{}.png"])
def test_unknown_placeholders_are_refused(tmp_path, name):
    with pytest.raises(BakeError, match="Unknown placeholder"):
        cast(zoo.plane("low"), zoo.plane("high"), storage="FILE", output=str(tmp_path / name), depth=16)
