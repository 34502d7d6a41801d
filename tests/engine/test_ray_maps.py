# SPDX-License-Identifier: GPL-3.0-or-later
"""Whole bakes of ambient occlusion, bent normals, thickness and curvature, compared with closed forms."""

from types import SimpleNamespace

import bmesh
import bpy
import mathutils
import numpy as np
import pytest

from addon.core.progress import Timings
from addon.core.settings import Settings
from addon.engine import bands, ray_maps, tree_cache
from addon.jobs import Job, bake_all, bake_jobs
from addon.mesh.local_space import LocalSpace
from addon.mesh.triangle_mesh import Mesh
from addon.scene import evaluation
from tests.support import angles, lanes, layouts, zoo
from tests.support.hemisphere import form_factor
from tests.support.layouts import Layout
from tests.support.maps import bake_all_maps, pixels, raw_maps, texel_uv

pytestmark = pytest.mark.usefixtures("gpu_context")


SIZE = 64
METHODS = ("FLATTEN", "CAST")
MEAN = 0.5 / 255
"""The largest mean error at 128 rays: half of a step of 8 bits."""
RMS = 2.5 / 255
"""The largest root mean square error at 128 rays."""
DIRECTION = 1.0
"""Degrees. The largest median error of bent normals at 128 rays."""
LOW = Layout(degrees=24.0, scale=0.34)
OUTSIDE = Layout(scale=0.1, center=(5.5, 5.5))
UP = np.array((0.0, 0.0, 1.0))
WALL = np.array([(1.1, -1.0, 0.0), (1.1, 1.0, 0.0), (1.1, 1.0, 1.2), (1.1, -1.0, 1.2)])
"""The corners of a wall beside the square; its front looks at the square."""


def check(found, truth):
    error = found.astype(np.float64) - truth
    rms = np.sqrt((error**2).mean())
    print(f"truth {np.mean(truth):.3f}, mean {error.mean() * 255:+.3f}/255, RMS {rms * 255:.3f}/255")
    assert abs(error.mean()) < MEAN
    assert rms < RMS


def wall(name="wall", *, is_turned=False):
    uv = OUTSIDE.uv(np.array([(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)]))
    face = range(4)[::-1] if not is_turned else range(4)
    return zoo.build(name, WALL, [face], uv[None], smooth=False)


def beside_a_wall(**options):
    """A low square, and as high ones a square on it and the wall."""
    return layouts.square("lo", {zoo.LAYER: LOW}), layouts.square("hi", {zoo.LAYER: LOW}), wall(**options)


def open_sky(size=SIZE):
    """What each texel of the square sees (size, size) beside the wall, and where the square is."""
    points, inside = LOW.texels(size)
    on_floor = np.concatenate([points, np.zeros((*points.shape[:2], 1))], axis=-1).reshape(-1, 3)
    hidden = form_factor(on_floor, UP, WALL).reshape(points.shape[:2])
    return 1.0 - hidden, inside


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("samples", [1, 4, 16])
def test_occlusion_beside_a_wall(method, samples):
    _, maps = bake_all_maps(*beside_a_wall(), maps=["AO"], size=SIZE, method=method, samples=samples)
    truth, inside = open_sky()
    check(maps["ao"][inside, 0], truth[inside])
    assert truth[inside].min() < 0.65
    assert (maps["ao"][inside, 3] == 1.0).all()


@pytest.mark.parametrize("two_sided", [False, True])
def test_backs_block_if_they_should(two_sided):
    pair = beside_a_wall(is_turned=True)
    _, maps = bake_all_maps(*pair, maps=["AO"], size=SIZE, two_sided=two_sided)
    truth, inside = open_sky()
    check(maps["ao"][inside, 0], truth[inside] if two_sided else np.ones(inside.sum()))


@pytest.mark.parametrize("unit", ["SCENE", "DIAGONAL"])
@pytest.mark.parametrize(("fade", "reaches"), [("NONE", 1.0), ("LINEAR", None)])
def test_a_distance_in_both_units(unit, fade, reaches):
    """Beyond the distance from the wall nothing is hidden; within it, a fade hides less."""
    low, *highs = beside_a_wall()
    distance, diagonal = 0.8, np.linalg.norm((2.1, 2.0, 1.2))
    limit = distance if unit == "SCENE" else distance / diagonal
    _, maps = bake_all_maps(
        low, *highs, maps=["AO"], size=SIZE, rays=512, distance_unit=unit, ao_distance=limit, ao_fade=fade
    )
    points, inside = LOW.texels(SIZE)
    found = maps["ao"][..., 0]
    assert (found[inside & (points[..., 0] < 1.1 - distance)] == 1.0).all()
    near = inside & (points[..., 0] > 1.1 - 0.7 * distance)
    assert (found[near & (np.abs(points[..., 1]) < 0.8)] < 1.0).all()
    truth = limited_sky(points[near], distance, fade)
    check(found[near], truth)


def limited_sky(points, distance, fade):
    """What points (N, 2) of the square see, where the wall counts up to a distance: many cosine directions."""
    seen = np.zeros(len(points))
    count = 4096
    turn, height = np.pi * (3.0 - np.sqrt(5.0)) * np.arange(count), (np.arange(count) + 0.5) / count
    sine = np.sqrt(height)
    for x, y, z in zip(sine * np.cos(turn), sine * np.sin(turn), np.sqrt(1.0 - height), strict=True):
        length = (WALL[0, 0] - points[:, 0]) / max(x, 1e-9)
        hit = (np.abs(points[:, 1] + length * y) < 1.0) & (length * z < 1.2) & (length < distance)
        seen += np.where(hit, length / distance if fade == "LINEAR" else 0.0, 1.0)
    return seen / count


@pytest.mark.parametrize("occluders", ["OWN", "ALL", "SCENE"])
def test_occluders_of_other_pairs(occluders):
    """The wall belongs to another pair."""
    low, high, other = beside_a_wall()
    uv = np.array([(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)])
    second = zoo.build("low wall", WALL, [range(4)[::-1]], uv[None], smooth=False)
    settings = Settings(
        method="CAST", maps=("AO",), width=SIZE, height=SIZE, occluders=occluders, depth=32, storage="MEMORY", margin=0
    )
    tree_cache.trees.free()
    built = tree_cache.trees.built
    reports = bake_all(bpy.context, [Job(low, [high]), Job(second, [other])], settings)
    assert tree_cache.trees.built - built == (2 if occluders == "OWN" else 3)  # one each, and one of all
    truth, inside = open_sky()
    found, on_wall = (pixels(bpy.data.images[report.maps["ao"]["image"]])[..., 0] for report in reports)
    check(found[inside], np.ones(inside.sum()) if occluders == "OWN" else truth[inside])
    u, v = np.moveaxis(texel_uv(SIZE, SIZE).reshape(-1, 2), -1, 0)
    places = np.stack([np.full(len(u), WALL[0, 0]), 2.0 * u - 1.0, WALL[2, 2] * (1.0 - v)], axis=1)
    square = np.array([(-1.0, -1.0, 0.0), (1.0, -1.0, 0.0), (1.0, 1.0, 0.0), (-1.0, 1.0, 0.0)])
    hidden = form_factor(places, np.array((-1.0, 0.0, 0.0)), square)
    check(on_wall.ravel(), np.ones(len(u)) if occluders == "OWN" else 1.0 - hidden)


@pytest.mark.parametrize("hidden", ["", "eye", "render", "collection"])
def test_what_the_scene_shows_blocks_rays_of_a_mesh_baked_onto_itself(hidden):
    """The wall is not baked. An empty mesh and one without scale are no occluders."""
    low, high, wall = beside_a_wall()
    high.hide_render = True
    for name in ("nothing", "flat"):
        bpy.context.scene.collection.objects.link(bpy.data.objects.new(name, bpy.data.meshes.new(name)))
    flat = zoo.cube("no scale")
    flat.scale = (0.0, 0.0, 0.0)
    bpy.context.view_layer.update()
    if hidden == "eye":
        wall.hide_set(True)
    elif hidden == "render":
        wall.hide_render = True
    elif hidden == "collection":
        shelf(wall).hide_render = True
    truth, inside = open_sky()
    for occluders in ("OWN", "SCENE"):
        _, maps = bake_all_maps(low, low, maps=["AO"], size=(SIZE, SIZE), occluders=occluders)
        is_open = hidden or occluders == "OWN"
        check(maps["ao"][..., 0][inside], np.ones(inside.sum()) if is_open else truth[inside])


def test_low_objects_and_cages_of_a_bake_are_no_occluders():
    """They are in the place of high ones. One that is its own high object is."""
    low, high, wall = beside_a_wall()
    cage, alone = zoo.plane("cage"), zoo.cube("alone")
    jobs = [Job(low, [high], cage), Job(alone, [alone])]
    found = {}
    for choice in ("OWN", "ALL", "SCENE"):
        tracing = Settings(occluders=choice, storage="MEMORY").tracing
        refs = [bake_jobs.occluders(bpy.context, job, jobs, tracing) for job in jobs]
        found[choice] = [{ref.name for ref in each} for each in refs]
    assert found["OWN"] == [set(), set()]
    assert found["ALL"] == [{alone.name}, {high.name}]
    assert found["SCENE"] == [{alone.name, wall.name}, {high.name, wall.name}]


def test_renders_show_what_one_collection_shows_with_those_that_it_is_in():
    """Collections in a hidden one are hidden. What is a holdout, or for indirect light alone, shades the rest."""
    ways = ("plain", "in hidden", "hidden and shown", "in excluded", "holdout", "indirect")
    above = {way: bpy.data.collections.new(f"above {way}") for way in ways}
    for way, outer in above.items():
        obj, inner = zoo.cube(way), shelf(bpy.data.objects[way])
        bpy.context.scene.collection.children.unlink(inner)
        outer.children.link(inner)
        bpy.context.scene.collection.children.link(outer)
        instance = bpy.data.objects.new(f"instance of {way}", None)
        instance.instance_type, instance.instance_collection = "COLLECTION", inner
        outer.objects.link(instance)
        if way == "hidden and shown":
            above["plain"].objects.link(obj)
    above["in hidden"].hide_render = above["hidden and shown"].hide_render = True
    layers = bpy.context.view_layer.layer_collection.children
    layers["above in excluded"].exclude = True
    layers["above holdout"].holdout = layers["above indirect"].indirect_only = True
    alone = {"plain", "holdout", "indirect"}
    shown = {obj.name for obj in evaluation.shown_surfaces(bpy.context)}
    assert shown == alone | {f"instance of {way}" for way in alone} | {"hidden and shown"}


def shelf(obj):
    """A new collection, which has the object alone."""
    collection = bpy.data.collections.new("Shelf")
    bpy.context.scene.collection.children.link(collection)
    bpy.context.scene.collection.objects.unlink(obj)
    collection.objects.link(obj)
    return collection


def test_a_floor_blocks_the_lower_half_of_walls():
    """The sides of a cube see half of the sky above a floor, its top all of it."""
    low, high = zoo.cube("lo"), zoo.cube("hi")
    high.scale = (1.01,) * 3
    for has_floor in (False, True):
        _, maps = bake_all_maps(low, high, maps=["AO", "OBJECT_ID"], size=(96, 64), method="CAST", floor=has_floor)
        found, known = maps["ao"][..., 0], angles.eroded(maps["ao"][..., 3] > 0, 1)
        faces = [(slice(32 * j, 32 * j + 32), slice(32 * i, 32 * i + 32)) for j in range(2) for i in range(3)]
        for number, face in enumerate(faces[1:], start=1):  # the first is the bottom, which lies on the floor
            expected = 0.5 if has_floor and number > 1 else 1.0
            check(found[face][known[face]], expected)


def rays_over(points, count=4096):
    """The mean unblocked cosine directions (N, 3) over points (N, 2) of the square, not normalized."""
    total = np.zeros((len(points), 3))
    turn, height = np.pi * (3.0 - np.sqrt(5.0)) * np.arange(count), (np.arange(count) + 0.5) / count
    for x, y, z in zip(
        np.sqrt(height) * np.cos(turn), np.sqrt(height) * np.sin(turn), np.sqrt(1.0 - height), strict=True
    ):
        length = (WALL[0, 0] - points[:, 0]) / max(x, 1e-9)
        hit = (np.abs(points[:, 1] + length * y) < 1.0) & (length * z < 1.2)
        total[~hit] += (x, y, z)
    return total / count


@pytest.mark.parametrize(("method", "samples"), [("FLATTEN", 4), ("CAST", 1)])
def test_bent_normals_beside_a_wall_in_each_space(method, samples):
    """Decoded, all spaces give the same directions; the objects are turned together."""
    low, *highs = beside_a_wall()
    turn = mathutils.Matrix.Rotation(0.7, 4, (0.3, -0.5, 0.8))
    for obj in (low, *highs):
        obj.matrix_world = turn @ obj.matrix_world
    points, inside = LOW.texels(SIZE)
    expected = rays_over(points[inside])
    expected /= np.linalg.norm(expected, axis=1, keepdims=True)
    assert np.degrees(np.arccos(expected[:, 2])).max() > 15.0
    matrix = np.array(turn)[:3, :3]
    to_object = {"TANGENT": LOW.frame(), "OBJECT": np.eye(3), "WORLD": matrix.T}
    for space, back in to_object.items():
        _, maps = bake_all_maps(
            low, *highs, maps=["BENT_NORMAL"], size=SIZE, method=method, samples=samples, space=space
        )
        found = angles.decode(maps["bent_normal"][inside]) @ back.T
        error = angles.degrees(found, expected)
        print(f"{space}: median {np.median(error):.3f}, max {error.max():.2f}")
        assert np.median(error) < DIRECTION
        assert np.percentile(error, 99) < 4.0 * DIRECTION


RADIUS = 2.0
POLES = [0, 1, -2, -1]
"""The rows of a map with the triangles at the poles of a ball."""


def ball():
    """A low belt of a sphere, and a closed fine one."""
    data = bpy.data.meshes.new("ball")
    mesh = bmesh.new()
    bmesh.ops.create_icosphere(mesh, subdivisions=6, radius=1.0)
    mesh.to_mesh(data)
    mesh.free()
    data.polygons.foreach_set("use_smooth", np.ones(len(data.polygons), bool))
    high = bpy.data.objects.new("ball", data)
    bpy.context.scene.collection.objects.link(high)
    low = zoo.sphere("lo", 16)
    for obj in (low, high):
        obj.scale, obj.location = (RADIUS,) * 3, (3.0, -1.0, 7.0)
    return low, high


@pytest.mark.parametrize(("place", "smooth"), [((0.0, 0.0, 0.0), True), ((3.0, -1.0, 7.0), False)])
def test_the_poles_of_a_ball_of_quads(place, smooth):
    """Half of each quad at a pole has no area in space, and a place in the UVs. Flatten shows what is beside it in space."""
    high = zoo.sphere("hi", 32, latitude=90.0)
    for polygon in high.data.polygons:
        polygon.use_smooth = smooth
    if not smooth:
        high.data.attributes.remove(high.data.attributes["custom_normal"])
    low = zoo.sphere("lo", 32, latitude=90.0)
    for obj in (low, high):
        obj.scale, obj.location = (RADIUS,) * 3, place
    length, radius = 0.5 * RADIUS, 0.4 * RADIUS
    _, maps = bake_all_maps(
        low,
        high,
        maps=["AO", "THICKNESS", "CURVATURE"],
        size=SIZE,
        method="FLATTEN",
        space="OBJECT",
        distance_unit="SCENE",
        thickness_distance=length,
        curvature_radius=radius,
    )
    curved = 0.5 + 3.0 * radius / (8.0 * RADIUS)
    for name, truth in (("ao", 1.0), ("thickness", 1.0 - (length / RADIUS) ** 2 / 12.0), ("curvature", curved)):
        error = np.abs(maps[name][..., 0] - truth)
        print(name, error.mean() * 255, error.max() * 255)
        assert error[POLES].max() < 10 / 255, name
        assert error.mean() < 2 / 255, name


@pytest.mark.parametrize("samples", lanes.slow_but([1], [1, 4]))
def test_the_maps_of_a_ball(samples):
    """Mean exits 2 cos t under the cosine; f = 1/2 - 3 R / (16 rho); nothing hides the sky."""
    length, radius = 0.5 * RADIUS, 0.4 * RADIUS
    report, maps = bake_all_maps(
        *ball(),
        maps=["AO", "BENT_NORMAL", "THICKNESS", "CURVATURE", "CONVEXITY", "CAVITY"],
        size=SIZE,
        method="CAST",
        samples=samples,
        distance_unit="SCENE",
        thickness_distance=length,
        curvature_radius=radius,
    )
    inner = slice(2, -2), slice(2, -2)
    found = {name: texels[inner] for name, texels in maps.items()}
    curved = 0.5 + 3.0 * radius / (8.0 * RADIUS)
    check(found["ao"][..., 0], 1.0)
    check(found["thickness"][..., 0], 1.0 - (length / RADIUS) ** 2 / 12.0)
    check(found["curvature"][..., 0], curved)
    check(found["convexity"][..., 0], 2.0 * curved - 1.0)
    check(found["cavity"][..., 0], 0.0)
    how = report.maps["curvature"]
    mean_curvature = (found["curvature"][..., 0].mean() - how["midlevel"]) * how["scale"]
    assert abs(mean_curvature * RADIUS - 1.0) < 0.02
    how = report.maps["convexity"]
    assert abs((found["convexity"][..., 0].mean() - how["midlevel"]) * how["scale"] * RADIUS - 1.0) < 0.02
    how = report.maps["thickness"]
    assert abs((found["thickness"][..., 0].mean() - how["midlevel"]) * how["scale"] - 0.9792 * length) < 0.01 * length
    tilt = angles.degrees(angles.decode(found["bent_normal"]), angles.decode(pixels(bpy.data.images["map"])[inner]))
    assert np.median(tilt) < DIRECTION


def test_distances_without_a_setting_are_shares_of_the_diagonal():
    """10 % for thickness and 0.5 % for curvature."""
    report, maps = bake_all_maps(*ball(), maps=["THICKNESS", "CURVATURE"], size=SIZE, method="CAST")
    diagonal = 2.0 * np.sqrt(3.0) * RADIUS
    assert report.maps["thickness"]["scale"] == pytest.approx(0.1 * diagonal, rel=1e-3)
    inner = slice(2, -2), slice(2, -2)
    check(maps["thickness"][inner][..., 0], 1.0 - (0.1 * diagonal / RADIUS) ** 2 / 12.0)
    check(maps["curvature"][inner][..., 0], 0.5 + 3.0 * 0.005 * diagonal / (8.0 * RADIUS))


def test_bolts_are_not_white_all_over():
    """Of hexagonal bolts as wide as 1 % of the diagonal, half of the top is gray at least, and nearly all of those of 2 %."""
    low = zoo.plane("low")
    points, faces = [(-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0)], []
    reach = np.ptp([vertex.co for vertex in low.data.vertices], axis=0)[0]
    diagonal, middle = np.sqrt(2.0) * reach, np.mean([vertex.co for vertex in low.data.vertices], axis=0)
    around = np.arange(6) * np.pi / 3.0
    widths, bolts = (0.01, 0.02), []
    size = 512
    rows, columns = (np.mgrid[:size, :size] + 0.5) / size
    for width, place in zip(widths, (0.3, 0.7), strict=True):
        radius = width * diagonal / 2.0
        ring = (
            np.stack([radius * np.cos(around), radius * np.sin(around)], axis=1)
            + (np.array([place, 0.5]) - 0.5) * reach
        )
        bolts.append(np.hypot(columns - place, rows - 0.5) * reach < 0.85 * radius)
        first = len(points)
        points += [(*point, height) for height in (-0.1 * radius, 0.8 * radius) for point in ring]
        faces += [(first + i, first + (i + 1) % 6, first + 6 + (i + 1) % 6, first + 6 + i) for i in range(6)]
        faces += [(first + 6, first + 7, first + 8, first + 9), (first + 6, first + 9, first + 10, first + 11)]
    points = np.array(points, float)
    points[:4, :2] *= reach / 2.0
    high = zoo.build("high", points + middle, [(0, 1, 2, 3), *faces], smooth=False)
    _, maps = bake_all_maps(low, high, maps=["CURVATURE"], size=size, method="CAST", rays=64)
    white = [(maps["curvature"][bolt][..., 0] > 0.95).mean() for bolt in bolts]
    assert white[0] < 0.5
    assert white[1] < 0.1


def test_the_floor_is_below_the_lowest_of_all_high_meshes():
    space = LocalSpace(np.zeros(3), 2.0)
    highs = [triangle_at(z) for z in (0.5, -0.75, 0.25)]
    surface = SimpleNamespace(highs=highs, local_space=space, ray_scene=SimpleNamespace(repeat=None))
    found = ray_maps.occluders(surface, [], Settings(floor=True).tracing, Timings())
    assert found.floor == pytest.approx(-0.75 / space.size)
    assert ray_maps.occluders(surface, [], Settings().tracing, Timings()).floor is None


def triangle_at(z):
    """A triangle at this height."""
    corners = np.array([(0, 0, z), (1, 0, z), (0, 1, z)], np.float32)
    numbers = np.arange(3, dtype=np.int32)
    return Mesh("high", corners, numbers, np.zeros((3, 3), np.float32), numbers[None], np.eye(4))


# Facets


SIDES = 8
LEAN = 180.0 / (2 * SIDES)
"""Degrees between faces and normals at the corners of a ball, roughly."""
STEP = 1.0 / 255


def occlusion(bias_angle):
    """The values of a coarse ball, which nothing hides: rays are blocked only below the face that they start from."""
    _, maps = bake_all_maps(zoo.sphere("lo", SIDES), zoo.sphere("hi", SIDES), maps=["AO"], bias_angle=bias_angle)
    return maps["ao"][maps["ao"][..., 3] == 1.0, 0]


def test_a_coarse_mesh_shows_its_facets():
    assert 1.0 - occlusion(0).min() > STEP
    assert occlusion(0).max() > 1.0 - STEP / 2


def test_a_bias_angle_hides_facets():
    assert (occlusion(int(2 * LEAN)) == 1.0).all()


# Ray map invariances


MAPS = ("AO", "BENT_NORMAL", "THICKNESS", "CURVATURE", "CONVEXITY", "CAVITY")
HALVES = ("convexity", "cavity")
SCALARS = ("ao", "thickness", "curvature", *HALVES)
SAME, OTHER, FEW = "the same rays", "other rays", "few rays"
RMS_BY_RAYS = {SAME: 0.25 / 255, OTHER: 3.6 / 255, FEW: 6.0 / 255}
"""The largest root mean square difference of ambient occlusion, thickness and curvature.

The same rays start at points that differ in the last bits; a few pass an edge on the other side. Of other rays, 128 a texel,
both maps have an error of 2.5/255. Few rays are 64 a texel."""
BENT = {SAME: 0.3, OTHER: 3.0, FEW: 5.0}
"""Degrees at the 95th percentile."""


def pair(n=47):
    """A plane and a terrain with the same UVs; rays from the plane go straight up."""
    return zoo.plane("lo", 2), zoo.terrain("hi", n, height=0.12, waves=3)


def bake(low, *highs, maps=MAPS, **settings):
    return bake_all_maps(
        low, *highs, maps=maps, size=SIZE, **{"curvature_radius": 0.05, "thickness_distance": 0.2} | settings
    )[1]


def compare(found, expected, rays=OTHER, *, where=slice(None)):
    """Compare maps by name in lower case. Convexity and cavity have twice the scale of the curvature."""
    for name in SCALARS:
        mine, other = (maps[name][where] for maps in (found, expected))
        assert np.array_equal(mine[..., 3], other[..., 3])
        difference = (mine - other)[..., 0].astype(np.float64)
        rms = np.sqrt((difference**2).mean())
        print(
            f"{name}: spread {other[..., 0].std():.4f}, mean {difference.mean() * 255:+.3f}/255, RMS {rms * 255:.3f}/255"
        )
        assert abs(difference.mean()) < MEAN
        assert rms < RMS_BY_RAYS[rays] * (2.0 if name in HALVES else 1.0)
        assert other[..., 0].std() > 4.0 / 255  # otherwise the map shows nothing
    degrees = angles.degrees(*(angles.decode(maps["bent_normal"][where]) for maps in (found, expected)))
    print(f"bent: 95th percentile {np.percentile(degrees, 95):.3f}")
    assert np.percentile(degrees, 95) < BENT[rays]


@pytest.mark.parametrize("samples", lanes.slow_but([4], [1, 4]))
def test_flatten_equals_cast_on_shared_uvs(samples):
    on_edges = np.eye(SIZE, dtype=bool)  # the texels in the diagonals of quads; either triangle is right
    flat, cast = bake(*pair(), samples=samples), bake(*pair(), samples=samples, method="CAST")
    compare(flat, cast, SAME, where=~(on_edges | on_edges[::-1]))


@pytest.mark.slow
@pytest.mark.parametrize(("method", "samples"), [("FLATTEN", 16), ("CAST", 4)])
def test_more_samples_only_average(method, samples):
    """On a fine surface: within a texel, the curvature of facets varies."""
    compare(bake(*pair(150), method=method, samples=samples), bake(*pair(150), method=method))


@pytest.mark.slow
def test_more_samples_than_rays_cast_one_each():
    compare(bake(*pair(), samples=64, rays=16), bake(*pair(), samples=4), FEW)


@pytest.mark.parametrize(
    ("method", "samples", "space"),
    [("FLATTEN", 1, "WORLD"), ("FLATTEN", 16, "TANGENT"), ("CAST", 4, "TANGENT"), ("CAST", 16, "WORLD")],
)
def test_all_maps_cover_the_same_texels(method, samples, space):
    """Also at borders, where the low mesh covers samples but not the center of the texel."""
    layout = layouts.Layout(degrees=24.0, scale=0.34)
    low, high = (layouts.square(name, {zoo.LAYER: layout}) for name in ("lo", "hi"))
    maps = raw_maps(low, high, maps=MAPS, method=method, samples=samples, space=space, rays=16)[1001]
    for name in MAPS:
        assert np.array_equal(maps[name][..., 3], maps["NORMAL"][..., 3]), name


@pytest.mark.parametrize("method", lanes.slow_but(["CAST"], ["FLATTEN", "CAST"]))
def test_bands_have_no_seams(method, monkeypatch):
    whole = bake(*pair(), method=method, margin=5)
    monkeypatch.setattr(bands, "BAND_TEXELS", 24 * SIZE)
    parts = bake(*pair(), method=method, margin=5)
    compare(parts, whole)
    for name in SCALARS:
        for row in (24, 48):
            steps = [np.diff(maps[name][..., 0], axis=0)[row - 1].mean() for maps in (parts, whole)]
            assert abs(steps[0] - steps[1]) < 2.0 / 255, name


@pytest.mark.slow
@pytest.mark.parametrize("method", ["FLATTEN", "CAST"])
def test_tiles_have_no_seams(method):
    """Nothing is scaled a tile: the two halves of a surface on two tiles are those of one map twice as wide."""
    whole = bake_all_maps(*wide_pair(0.5), maps=MAPS, size=(2 * SIZE, SIZE), method=method, **RADII)[1]
    tiles = raw_maps(*wide_pair(1.0), maps=MAPS, size=SIZE, method=method, udim=True, storage="PACK", **RADII)
    both = {name.lower(): np.concatenate([tiles[tile][name] for tile in (1001, 1002)], axis=1) for name in MAPS}
    both["bent_normal"][..., :3] = both["bent_normal"][..., :3] * 0.5 + 0.5
    compare(both, whole, where=(slice(1, -1), slice(1, -1)))


RADII = {"curvature_radius": 0.05, "thickness_distance": 0.2}


def wide_pair(width):
    """The pair with u scaled, so that it fills a part of a tile, or two tiles."""
    objects = pair()
    for obj in objects:
        uv = obj.data.uv_layers[0].uv
        uv.foreach_set("vector", [part.vector[axis] * (2.0 * width, 1.0)[axis] for part in uv for axis in range(2)])
    return objects


def matrix(case):
    turn = mathutils.Matrix.Rotation(0.8, 4, (0.5, -0.3, 0.7))
    return {
        "turned and tiny": turn @ mathutils.Matrix.Scale(1e-4, 4),
        "far": mathutils.Matrix.Translation((1e5, -2e5, 3e5)),
        "turned and mirrored": turn @ mathutils.Matrix.Diagonal((-1.0, 1.0, 1.0, 1.0)),
    }[case]


@pytest.mark.parametrize("method", lanes.slow_but(["CAST"], ["FLATTEN", "CAST"]))
def test_objects_may_be_anywhere(method):
    """Distances are shares of the diagonal of the bounding box, which a turn changes: they are set in scene units."""
    low, high = pair()
    diagonal = 2.0 * np.sqrt(2.0)

    def settings(scale):
        return {
            "method": method,
            "distance_unit": "SCENE",
            "ao_distance": 0.5 * diagonal * scale,
            "curvature_radius": 0.05 * diagonal * scale,
            "thickness_distance": 0.2 * diagonal * scale,
        }

    still = bake(low, high, **settings(1.0))
    for case in ("turned and tiny", "far", "turned and mirrored"):
        placed = matrix(case)
        for obj in (low, high):
            obj.matrix_world = placed
        moved = bake(low, high, **settings(abs(placed.determinant()) ** (1.0 / 3.0)))
        if case == "turned and mirrored":  # the tangent space is mirrored as well
            assert np.abs(moved["bent_normal"] - still["bent_normal"]).mean() < 0.02
        compare(moved, still)
