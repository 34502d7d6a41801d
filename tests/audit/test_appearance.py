# SPDX-License-Identifier: GPL-3.0-or-later
"""The shading error: what a viewer sees of high meshes, and of a low mesh with its map, against rays in float64 and known
angles; and what raises it."""

from dataclasses import replace

import bpy
import numpy as np
import pytest
from mathutils import Euler, Matrix

from addon.audit import appearance
from addon.audit.appearance import Detail, SeenHighs, ShownMap, measure
from addon.cli import limits
from addon.core.asset_limits import Wanted
from addon.core.map_types import NORMAL
from addon.core.naming import Suffixes
from addon.core.progress import Pace, finish
from addon.core.settings import Run, Settings
from addon.engine import baking, normal_space
from addon.jobs import Job, Wants, asset, bake_jobs
from addon.mesh.fitting import Samples
from addon.scene import reading
from tests.support import lanes, quick_assets, seen_from_sides, zoo
from tests.support.real_meshes import PAIRS, open_pair

pytestmark = pytest.mark.usefixtures("gpu_context")

SMALL = Detail(4, 80)
PLACES = (0.4, 0.0), (-0.6, 0.0), (0.4, -0.3)
"""The x and z of places on the right, on the left, and beneath the right."""
CLOSE = 0.02
"""The relative error of means and percentiles that rasterizers may make: corners are rounded to 1/256 pixel, and at outlines
either pixel may be covered."""
ASLANT = Matrix.LocRotScale((3.0, -2.0, 5.0), Euler((0.4, -0.3, 0.8)), (1.0, 1.0, 1.0))
UNEVEN = Matrix.LocRotScale((0.0, 0.0, 0.0), Euler((0.2, 0.3, 0.1)), (1.5, 0.6, 1.1))
MIRRORED = Matrix.LocRotScale((1.0, 0.0, 0.0), Euler((0.0, 0.0, 0.5)), (-1.2, 0.8, 1.0))


def settings(**values):
    usual = {"method": "CAST", "basis": "MIKKTSPACE", "margin": 4, "depth": 32, "storage": "MEMORY", "material": False}
    return Settings(**{**usual, "width": 128, "height": 128, **values})


def read_and_baked(low, highs, chosen):
    """The meshes of a bake, and its map as programs read it."""
    bpy.context.view_layer.update()
    meshes = reading.read(bpy.context, low, highs, None, chosen)
    maps = finish(baking.bake(meshes, Run(chosen)))
    tiles = {tile: each[NORMAL.name][0] for tile, each in maps.items()}
    return meshes, ShownMap(tiles, normal_space.reading(chosen.map), chosen.sampling.udim)


def seen(meshes, shown, detail=SMALL):
    return finish(measure(meshes.highs, meshes.basis or meshes.low, shown, detail=detail))


def check_against_rays(meshes, shown, chosen, detail=SMALL):
    """Compare a measurement with the oracle. Returns the measurement."""
    found = seen(meshes, shown, detail)
    texels = next(iter(shown.tiles.values()))
    held = seen_from_sides.NormalMap(texels, chosen.map.space, chosen.map.basis, chosen.map.channels)
    low, *highs = map(seen_from_sides.Surface.of, (meshes.basis or meshes.low, *meshes.highs))
    degrees, alone, distances = seen_from_sides.measured(highs, low, held, views=detail.views, side=detail.side)
    assert found.pixels == pytest.approx(len(degrees), rel=0.002)
    assert found.mean == pytest.approx(degrees.mean(), rel=CLOSE, abs=0.02)
    for name, share in (("median", 50), ("percentile_95", 95), ("percentile_99", 99)):
        assert getattr(found, name) == pytest.approx(np.percentile(degrees, share), rel=CLOSE, abs=0.03), name
    assert found.silhouette == pytest.approx(alone, rel=0.1, abs=0.002)
    backs = seen_from_sides.backs(highs, low, views=detail.views, side=detail.side)
    assert found.backs == pytest.approx(backs, rel=CLOSE, abs=0.002)
    assert found.distance == pytest.approx(np.percentile(distances, 99), rel=CLOSE, abs=1e-4)
    return found


# Against rays


MATRICES = {"plain": Matrix(), "aslant": ASLANT, "uneven": UNEVEN, "mirrored": MIRRORED}
IN_TANGENT_SPACE = [(name, "TANGENT") for name in MATRICES]
OTHERWISE = [(name, space) for name in MATRICES for space in ("OBJECT", "WORLD")]
FAST = [*IN_TANGENT_SPACE, ("aslant", "OBJECT"), ("mirrored", "WORLD")]


@pytest.mark.parametrize("where", lanes.slow_but(FAST, [*IN_TANGENT_SPACE, *OTHERWISE]), ids="-".join)
def test_objects_anywhere_are_measured_as_rays_see_them(where):
    name, space = where
    low, high = zoo.terrain("low", 6, height=0.3), zoo.terrain("high", 16, height=0.3)
    for obj in (low, high):
        obj.matrix_world = MATRICES[name]
    chosen = settings(space=space, basis="CYCLES")
    found = check_against_rays(*read_and_baked(low, [high], chosen), chosen)
    assert found.mean > 0.3


@pytest.mark.parametrize("basis", ["CYCLES", "MIKKTSPACE", "MIKKTSPACE_VERTEX", "NORMALIZED"])
def test_each_basis_is_read_by_its_own_rules(basis):
    low, high = zoo.sphere("low", 10), zoo.sphere("high", 24)
    chosen = settings(basis=basis, green="-Y")
    check_against_rays(*read_and_baked(low, [high], chosen), chosen)


@pytest.mark.slow
@pytest.mark.shared
@pytest.mark.parametrize("name", [*PAIRS, "collar", "fingers"])
def test_real_meshes_are_measured_as_rays_see_them(shared_assets, name):
    low, high = open_pair(shared_assets, name, "pairs" if name in PAIRS else "layers")
    for obj, most in ((low, 800), (high, 6000)):
        decimate = obj.modifiers.new("fewer", "DECIMATE")
        decimate.ratio = min(1.0, most / sum(len(polygon.vertices) - 2 for polygon in obj.data.polygons))
    chosen = settings(width=256, height=256)
    found = check_against_rays(*read_and_baked(low, [high], chosen), chosen, Detail(5, 128))
    print(name, found)


HIGHS = {
    "ball": lambda: zoo.ball("high", 24),
    "coarse ball": lambda: zoo.ball("high", 8),
    "cube": lambda: zoo.cube("high"),
    "plane": lambda: zoo.plane("high", 8, slope=0.4),
    "hills": lambda: zoo.terrain("high", 32, height=0.2),
    "flat hills": lambda: zoo.terrain("high", 24, height=0.05, waves=3),
    "steep hills": lambda: zoo.terrain("high", 32, height=0.5),
    "belt": lambda: zoo.sphere("high", 20),
    "flat faces": lambda: zoo.ball("high", 10, smooth=False),
    "roof": lambda: zoo.mirrored("high", 6, slope=0.7),
}


@pytest.mark.parametrize("name", lanes.slow_but(["ball"], HIGHS))
def test_assets_are_measured_as_rays_see_them(name, monkeypatch):
    quick_assets.quicken(monkeypatch)
    high = HIGHS[name]()
    high.matrix_world = ASLANT
    chosen = settings()
    job = Job(high, [high])
    task = asset.work(bpy.context, job, Wanted(triangles=200), chosen, Pace(0.0), suffixes=Suffixes())
    (report,) = finish(task)
    low = bpy.data.objects[report.low]
    found = check_against_rays(*read_and_baked(low, [high], chosen), chosen, Detail(6, 240))
    print(name, found)


def turned(obj, share):
    """`obj` with a share of its faces turned over, from the last one."""
    count = round(share * len(obj.data.polygons))
    for polygon in list(obj.data.polygons)[len(obj.data.polygons) - count :]:
        polygon.flip()
    obj.data.update()
    return obj


@pytest.mark.parametrize(("low", "high", "backs"), [(0.0, 0.0, 0.0), (1.0, 0.0, 1.0), (1.0, 1.0, 0.0), (0.0, 1.0, 0.0)])
def test_back_faces_that_the_high_mesh_does_not_show_are_counted(low, high, backs):
    chosen = settings(space="OBJECT")
    meshes = reading.read(bpy.context, turned(zoo.cube("low"), low), [turned(zoo.cube("high"), high)], None, chosen)
    found = seen(meshes, None)
    assert found.backs == pytest.approx(backs, abs=0.002) and found.silhouette == 0.0
    assert found.distance < 1e-5


@pytest.mark.parametrize("name", ["ball", "roof"])
def test_some_back_faces_are_counted_as_rays_see_them(name):
    high = HIGHS[name]()
    low = turned(zoo.sphere("low", 7) if name == "ball" else zoo.mirrored("low", 4, slope=0.5), 0.4)
    low.location.x += 0.3
    bpy.context.view_layer.update()
    meshes = reading.read(bpy.context, low, [high], None, settings(space="OBJECT"))
    found = seen(meshes, None, Detail(6, 160))
    surfaces = [seen_from_sides.Surface.of(mesh) for mesh in (*meshes.highs, meshes.low)]
    expected = seen_from_sides.backs(surfaces[:-1], surfaces[-1], views=6, side=160)
    assert expected > 0.1 and found.backs == pytest.approx(expected, rel=CLOSE)


@pytest.mark.parametrize(("beyond", "counted"), [(-5, 0), (1, 0), (5, 4)])
def test_backs_a_pixel_beside_those_of_the_high_mesh_are_outlines(beyond, counted):
    """A viewer sees a wall, and beside it the back of one behind it. The wall of the low mesh ends so many pixels earlier."""
    side = 100
    pixel = 2.0 * np.sqrt(3.0) / 0.98 / side

    def walls(name, end):
        points = [(x, y, z) for x, top in ((-1.0, 1.0), (1.0, end)) for y in (-1.0, top) for z in (-1.0, 1.0)]
        return zoo.build(name, points, [(0, 1, 3, 2), (4, 6, 7, 5)], np.zeros((2, 4, 2)))

    low, high = walls("low", -beyond * pixel), walls("high", 0.0)
    found = seen(reading.read(bpy.context, low, [high], None, settings(space="OBJECT")), None, Detail(1, side))
    across = 2 * round(1.0 / pixel)
    assert found.silhouette == 0.0 and found.pixels == across**2
    assert round(found.backs * found.pixels) == counted * across


def test_backs_beyond_the_outline_are_no_backs():
    """Half of the viewers see the backs of both sheets, of which one is a fifth wider."""
    low, high = zoo.plane("low"), zoo.plane("high")
    low.scale.x = 1.2
    meshes = reading.read(bpy.context, low, [high], None, settings(space="OBJECT"))
    found = seen(meshes, None, Detail(4, 240))
    assert found.backs == 0.0 and found.silhouette == pytest.approx(1.0 / 6.0, rel=0.05)


# What raises it


def report_of(low, highs, **values):
    bpy.context.view_layer.update()
    (report,) = bake_jobs.bake_all(bpy.context, [Job(low, highs)], settings(**values), wants=Wants(measured=True))
    return report


def moved(low, amount, seed=3):
    """Move the vertices of `low` by a smooth field, by at most about `amount` of its diagonal."""
    points = np.empty((len(low.data.vertices), 3), np.float32)
    low.data.vertices.foreach_get("co", points.reshape(-1))
    size = np.linalg.norm(np.ptp(points, axis=0))
    rng = np.random.default_rng(seed)
    waves = sum(
        np.outer(np.sin(points @ rng.normal(0.0, 9.0 / size, 3) + rng.uniform(0.0, 6.3)), rng.normal(0.0, 0.25, 3))
        for _ in range(8)
    )
    low.data.vertices.foreach_set("co", (points + amount * size * waves).astype(np.float32).reshape(-1))
    low.data.update()


def shells():
    """A low sphere around an outer high sphere, and an inner one, which is hidden and has another relief."""
    outer, inner = zoo.sphere("outer", 64), zoo.sphere("inner", 64)
    points = np.empty((len(inner.data.vertices), 3), np.float32)
    inner.data.vertices.foreach_get("co", points.reshape(-1))
    relief = 0.93 + 0.015 * np.sin(14.0 * points).sum(axis=1, keepdims=True)
    inner.data.vertices.foreach_set("co", (points * relief).astype(np.float32).reshape(-1))
    inner.data.update()
    return zoo.sphere("low", 24), [outer, inner]


def test_it_rises_with_each_step_by_which_a_low_mesh_is_moved(monkeypatch):
    monkeypatch.setattr(appearance, "USUAL", Detail(24, 256))
    found = []
    for amount in (0.0, 0.01, 0.02, 0.04):
        bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
        low, highs = shells()
        moved(low, amount)
        found.append(report_of(low, highs, appearance=True).appearance)
    means, most, wrong = ([each[name] for each in found] for name in ("mean", "percentile_99", "wrong"))
    assert means == sorted(means) and means[-1] > 3.0 * means[0]
    assert most == sorted(most)
    assert wrong[0] < 1e-3 and wrong[-1] > 0.02


def ridged(share):
    """A plane with steep ridges close above and below a part of it. Rays that start below the ridges show the plane."""
    low, high = zoo.plane("low", 8), zoo.plane("high", 32)
    ridges = [zoo.terrain(name, 64, height=0.2, waves=4) for name in ("above", "below")]
    for obj, z in zip(ridges, (0.02, -0.02), strict=True):
        obj.matrix_world = Matrix.LocRotScale((0.1, 0.1, z), None, (share**0.5, share**0.5, share**0.5))
    return low, [high, *ridges]


def test_a_wrong_layer_that_the_map_shows_exactly_is_seen_where_half_a_percent_is_wrong():
    low, highs = ridged(0.005)
    chosen = {"extrusion": 0.002, "max_distance": 0.004, "width": 256, "height": 256, "keep_faces": True}
    report = report_of(low, highs, appearance=True, **chosen)
    assert report.missed == 0.0
    assert 0.003 < report.appearance["wrong"] < 0.008
    assert report.appearance["maximum"] > 40.0
    over = [
        limits.over(limits.parse(each), [report.to_dict()]) for each in ("deviation.p99<2deg", "appearance.wrong<0.1%")
    ]
    assert over[0] == []
    assert over[1][0].startswith("appearance.wrong is 0.")


def test_a_map_that_is_right_has_no_wrong_texels():
    low, high = zoo.terrain("low", 12, height=0.1), zoo.terrain("high", 64, height=0.1)
    assert report_of(low, [high], appearance=True).appearance["wrong"] == 0.0


def test_a_map_that_is_read_wrong_is_seen():
    chosen = settings()
    meshes, shown = read_and_baked(zoo.terrain("low", 12, height=0.3), [zoo.terrain("high", 64, height=0.3)], chosen)
    right = seen(meshes, shown)
    flipped = replace(
        shown, tiles={tile: texels * (1, -1, 1, 1) + (0, 1, 0, 0) for tile, texels in shown.tiles.items()}
    )
    assert seen(meshes, flipped).mean > 3.0 * right.mean


def test_several_low_meshes_are_compared_with_the_same_pictures():
    chosen = settings()
    meshes, shown = read_and_baked(zoo.terrain("low", 12, height=0.3), [zoo.terrain("high", 64, height=0.3)], chosen)
    low = meshes.basis or meshes.low
    pictures = SeenHighs(meshes.highs, [*meshes.highs, low], SMALL)
    finish(pictures.draw())
    with_map, without = (finish(pictures.compare(low, each)) for each in (shown, None))
    assert with_map == seen(meshes, shown)
    assert without.mean > 2.0 * with_map.mean


def test_pictures_that_are_kept_serve_low_meshes_that_have_room_in_them(monkeypatch):
    meshes, _ = read_and_baked(zoo.terrain("low", 12, height=0.3), [zoo.terrain("high", 64, height=0.3)], settings())
    grown, moved = np.diag([1.0, 1.0, 1.5, 1.0]), np.eye(4)
    moved[0, 3] = 1.0
    beyond = replace(meshes.low, to_world=moved @ meshes.low.to_world)
    higher = [replace(high, to_world=grown @ high.to_world) for high in meshes.highs]
    drawn, draw = [], SeenHighs.draw
    monkeypatch.setattr(SeenHighs, "draw", lambda self: [drawn.append(self), draw(self)][1])
    pairs = [(meshes.highs, meshes.low)] * 2 + [(meshes.highs, beyond), (higher, meshes.low)]

    def measured() -> list:
        return [finish(measure(highs, low, None, detail=SMALL)) for highs, low in pairs]

    with appearance.kept_pictures():
        kept = measured()
    assert len(drawn) == 3
    drawn.clear()
    assert measured() == kept
    assert len(drawn) == 4


def test_the_order_of_stacked_parts_draws_no_picture_anew(monkeypatch):
    """It reverses the order of high triangles, which nobody sees."""
    lows, high = [zoo.terrain("low", 12, height=0.3), zoo.terrain("stacked", 12, height=0.3)], zoo.terrain("high", 64)
    uv = lows[1].data.uv_layers[0].uv  # all faces on one place
    uv.foreach_set("vector", np.tile(np.array([(0, 0), (1, 0), (1, 1), (0, 1)], np.float32).reshape(-1), len(uv) // 4))
    bpy.context.view_layer.update()
    drawn, draw = [], SeenHighs.draw
    monkeypatch.setattr(SeenHighs, "draw", lambda self: [drawn.append(self), draw(self)][1])
    with appearance.kept_pictures():
        for low in lows:
            finish(bake_jobs.work(bpy.context, [Job(low, [high])], settings(), Pace(), wants=Wants(seen=True)))
    assert len(drawn) == 1


@pytest.mark.parametrize("place", [Matrix.Identity(4), UNEVEN, MIRRORED])
def test_pictures_of_dense_meshes_lack_no_pixel(monkeypatch, place):
    """Where a driver draws on the CPU, it gets only the triangles that can show: the pictures are the same to the bit."""
    low, highs = zoo.terrain("low", 12), [zoo.terrain("high", 64, height=0.3), zoo.sphere("other", 48)]
    for obj in (low, *highs):
        obj.matrix_world = place
    meshes, _ = read_and_baked(low, highs, settings())
    speck = replace(meshes.highs[0], positions=1e-6 * meshes.highs[0].positions)  # on no pixel's middle
    pictures = []
    for dense, is_software in ((np.inf, True), (0.0, True), (0.0, False)):
        monkeypatch.setattr(appearance, "DENSE", dense)
        monkeypatch.setattr(appearance.shader, "in_software", lambda is_software=is_software: is_software)
        seen_highs = SeenHighs([*meshes.highs, speck], meshes.highs, Detail(6, 40))
        finish(seen_highs.draw())
        pictures.append([each.read() for each in seen_highs._pictures])
    assert np.array_equal(pictures[0], pictures[1])
    assert np.array_equal(pictures[0], pictures[2])


def test_half_of_the_pixels_show_the_same():
    """Those of the pictures that were drawn, so that a picture of half the side differs by what it leaves out alone."""
    meshes, _ = read_and_baked(zoo.terrain("low", 12, height=0.3), [zoo.terrain("high", 64, height=0.3)], settings())
    pictures = SeenHighs(meshes.highs, [*meshes.highs, meshes.low], Detail(16, 512))
    finish(pictures.draw())
    whole, half, alike = (
        finish(each.compare(low, None))
        for each, low in ((pictures, meshes.low), (pictures.half, meshes.low), (pictures.half, meshes.highs[0]))
    )
    assert half.mean == pytest.approx(whole.mean, rel=0.01)
    assert half.silhouette == pytest.approx(whole.silhouette, rel=0.1)
    assert half.pixels == pytest.approx(whole.pixels / 4.0, rel=0.01)
    assert alike.distance < 1e-6 and alike.silhouette < 1e-3 and alike.percentile_99 < 0.05  # some pixels are rounded
    points = meshes.highs[0].positions.astype(np.float64)
    across = np.abs(points[:, :2] - points[:, :2].mean(axis=0)).max(axis=1)
    points = points[across < 0.9 * across.max()][::50]  # at the border, pixels show one mesh alone
    spots = Samples(
        points, np.tile([0.0, 0.0, 1.0], (len(points), 1)), np.zeros(len(points), int), np.ones(len(points))
    )
    found = finish(pictures.half.compare(meshes.low, None, places=pictures.half.places(spots)))
    exact = finish(pictures.compare(meshes.low, None, places=pictures.places(spots)))
    assert found.places.mean() == pytest.approx(exact.places.mean(), rel=0.05)
    assert np.corrcoef(found.places, exact.places)[0, 1] > 0.7  # 0.81 for pictures of 520 pixels against 512


# In reports


def test_places_have_the_errors_that_viewers_see_there():
    """The right half of the low square is turned by 20 degrees. Both sides are seen, and half of the viewers do not see what is
    beneath the high square."""
    square = np.array([[0, -1, 0], [1, -1, 0], [1, 1, 0], [0, 1, 0]], float)
    quads, turned = [[0, 1, 2], [0, 2, 3], [4, 5, 6], [4, 6, 7]], np.radians(20.0)
    left, right = square - [1, 0, 0], square * [np.cos(turned), 1, 0] + square[:, :1] * [0, 0, np.sin(turned)]
    high = zoo.build("high", np.concatenate([left, square]), quads)
    low = zoo.build("low", np.concatenate([left, right]), quads)
    low.data.uv_layers.new()
    bpy.context.view_layer.update()
    meshes = reading.read(bpy.context, low, [high], None, settings())
    y = np.linspace(-0.5, 0.5, 21)
    points = np.concatenate([np.stack([np.full(21, x), y, np.full(21, z)], axis=1) for x, z in PLACES])
    normals = np.tile([0.0, 0.0, 1.0], (len(points), 1))
    places = Samples(points, normals, np.zeros(len(points), int), np.ones(len(points)))
    pictures = SeenHighs(meshes.highs, [*meshes.highs, meshes.low], Detail(16, 200))
    finish(pictures.draw())
    found = finish(pictures.compare(meshes.low, None, places=pictures.places(places)))
    facing = np.abs(appearance.directions(16)[:, 2]).sum()
    right, left, beneath = np.median(found.places.reshape(3, 21), axis=1)
    assert right == pytest.approx(20.0 * facing, rel=0.1)
    assert left < 0.1 * right
    assert beneath == pytest.approx(0.5 * right, rel=0.1)
    assert "places" not in found.to_dict()


def test_a_bake_that_is_not_asked_measures_nothing(monkeypatch):
    monkeypatch.setattr(appearance, "SeenHighs", None)
    monkeypatch.setattr(appearance, "square_means", None)
    report = report_of(zoo.terrain("low", 6), [zoo.terrain("high", 16)])
    assert report.appearance == {}
    assert not any("Shading" in line for line in report.summary())


def test_a_report_has_what_the_map_shows():
    low, high = zoo.terrain("low", 6, height=0.3), zoo.terrain("high", 32, height=0.3)
    report = report_of(low, [high], appearance=True)
    measured = seen(*read_and_baked(low, [high], settings()), Detail())
    assert report.appearance["mean"] == pytest.approx(measured.mean, rel=0.01)
    assert report.appearance["pixels"] == measured.pixels
    (line,) = (line for line in report.summary() if line.startswith("Shading error"))
    assert f"{measured.mean:.2f} degrees" in line


def test_the_parts_of_a_flattened_pair_are_compared_in_one_place():
    low, high = zoo.terrain("low", 12, height=0.3), zoo.terrain("high", 64, height=0.3)
    near = report_of(low, [high], appearance=True, method="FLATTEN").appearance
    high.location.x = 4.0
    apart = report_of(low, [high], appearance=True, method="FLATTEN").appearance
    assert apart["mean"] == pytest.approx(near["mean"], rel=0.05)


def test_without_a_normal_map_a_warning_says_that_nothing_is_measured():
    report = report_of(
        zoo.terrain("low", 6), [zoo.terrain("high", 16)], appearance=True, normal=False, maps=("HEIGHT",)
    )
    assert report.appearance == {}
    assert "The shading error was not measured: there is no normal map." in report.warnings
