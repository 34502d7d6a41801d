# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests the views: pictures against a float64 rasterizer, and deviations against known angles."""

import math

import bpy
import gpu
import numpy as np
import pytest
from mathutils import Euler, Matrix

from addon.core import progress
from addon.core.errors import BakeError
from addon.core.settings import Settings
from addon.engine import bands
from addon.jobs import Job, live_session
from addon.output import value_encoding
from addon.passes import lit, mesh_upload, target
from addon.ui import view_scene, view_shading
from addon.ui.view_shading import SHOWN, Mode
from tests.support import decoders, oracle, raster, zoo
from tests.support.real_meshes import open_pair

pytestmark = pytest.mark.usefixtures("gpu_context")

SIZE = (256, 192)
DIFFUSE, AMBIENT, FILL = 0.5, 0.04, 0.12
TOLERANCE = 5e-4
"""Tolerance of a color: GPUs round positions to 1/256 of a pixel before they interpolate. 2/255 is not visible."""
SHARE = 0.995
"""Share of pixels that may differ: along edges, either triangle may be in front."""

ASLANT = Matrix.LocRotScale((3.0, -2.0, 5.0), Euler((0.4, -0.3, 0.8)), (1.0, 1.0, 1.0))
UNEVEN = Matrix.LocRotScale((0.0, 0.0, 0.0), Euler((0.2, 0.3, 0.1)), (1.5, 0.6, 1.1))
MIRRORED = Matrix.LocRotScale((1.0, 0.0, 0.0), Euler((0.0, 0.0, 0.5)), (-1.2, 0.8, 1.0))


def session_of(low, highs, **settings):
    """A live session that has rendered its map."""
    values = {"method": "FLATTEN", "width": 128, "height": 128, "depth": 32, "material": False, **settings}
    bpy.context.view_layer.update()
    following = live_session.Session(bpy.context, Job(low, highs), Settings(**values), progress.Pace())
    following.run(bpy.context)
    return following


def picture(draw):
    """The picture that `draw` draws, (H, W, 4) float32."""
    into = target.Target(*SIZE, ("RGBA32F", "DEPTH_COMPONENT32F"))
    with target.drawing(into):
        into.framebuffer.clear(depth=1.0)
        draw()
    pixels = np.empty((SIZE[1], SIZE[0], 4), np.float32)
    into.read(pixels)
    return pixels


def eye_on(low, light=(0.3, -0.4, 0.8, 0.0), *, is_parallel=False):
    """An eye above the object that sees all of it."""
    points = np.array([low.matrix_world @ vertex.co for vertex in low.data.vertices])
    center, radius = points.mean(axis=0), np.linalg.norm(points - points.mean(axis=0), axis=1).max()
    view = raster.look_at(center + np.array((0.9, -1.6, 1.9)) * 1.3 * radius, center)
    aspect = SIZE[0] / SIZE[1]
    lens = (
        raster.parallel(2.1 * radius, 0.1, 100.0, aspect) if is_parallel else raster.perspective(40, 0.1, 100, aspect)
    )
    return view_scene.Eye(view, lens, np.array(light, np.float64))


def brightness(normals, points, light):
    """The shading of unit normals (N, 3) at points (N, 3) of the world."""
    towards = raster.unit(light[:3] - points * light[3])
    facing = (normals * towards).sum(axis=1)
    return AMBIENT + DIFFUSE * np.maximum(0.0, facing) + FILL * (0.5 - 0.5 * facing)


def shown(low, texels, settings):
    """A function from an eye to the expected colors and world normals of `low`, pixel by pixel."""
    mesh = raster.corners(low, with_tangents=settings.map.space == "TANGENT")
    points = mesh.position @ mesh.matrix[:3, :3].T + mesh.matrix[:3, 3]
    if settings.storing.depth == 8:
        texels = np.round(texels.astype(np.float64) * 255.0) / 255.0

    def seen(eye):
        owner, weights = raster.rasterize(points, eye.projection @ eye.view, SIZE)
        colors = raster.bilinear(texels[..., :3], raster.interpolate(mesh.uv, owner, weights))
        normals = raster.decode(colors, settings.map.channels)
        if settings.map.space == "TANGENT":
            normal, tangent = in_the_scene(mesh, settings.map.basis)
            vectors = normal, tangent, decoders.bitangents(normal, tangent)
            own = (raster.interpolate(values, owner, weights) for values in vectors)
            normals = decoders.decoded(normals, settings.map.basis, *own)
        if settings.map.space == "OBJECT" or (settings.map.space == "TANGENT" and settings.map.basis == "CYCLES"):
            normals = normals @ mesh.to_world_normals.T
        return owner >= 0, brightness(raster.unit(normals), raster.interpolate(points, owner, weights), eye.light)

    return seen


def in_the_scene(mesh, basis):
    """Unit normals and tangents of the corners in the scene, as programs with a basis transform them."""
    if basis == "CYCLES":  # it transforms the finished normal: in object space until then
        return mesh.normal, mesh.tangent
    to_world = mesh.matrix[:3, :3]
    of_tangents = mesh.to_world_normals if basis == "MIKKTSPACE" else to_world  # EEVEE takes them for normals
    normals = raster.unit(mesh.normal @ mesh.to_world_normals.T)
    along = raster.unit(mesh.tangent[..., :3] @ of_tangents.T)
    signs = mesh.tangent[..., 3:] * np.sign(np.linalg.det(to_world))
    return normals, np.concatenate([along, signs], axis=-1)


def check(pixels, mask, expected):
    """Assert that nearly all pixels are as expected, and drawn where expected."""
    assert mask.mean() > 0.1
    assert (np.abs(pixels[mask][:, :3] - expected[:, None]).max(axis=1) <= TOLERANCE).mean() >= SHARE
    assert ((pixels[..., 3] == 1.0) == mask).mean() >= SHARE
    assert expected.std() > 0.02  # a picture of one color would test nothing


def pair(matrix, n=60):
    low, high = zoo.sphere("lo", n=10, latitude=60.0), wavy("hi", n)
    for obj in (low, high):
        obj.matrix_world = matrix
    return low, high


def wavy(name, n):
    """The belt of a sphere with waves, in 2 n x n quads."""

    def surface(u, v):
        longitude, latitude = 2 * np.pi * u, np.radians(60.0) * (2 * v - 1)
        radius = 1.0 + 0.02 * np.sin(10 * longitude) * np.sin(8 * latitude)
        belt = [np.cos(longitude) * np.cos(latitude), np.sin(longitude) * np.cos(latitude), np.sin(latitude)]
        return radius[:, None] * np.stack(belt, axis=1)

    return zoo.sheet(name, surface, 2 * n, n)


@pytest.mark.parametrize("matrix", [ASLANT, UNEVEN, MIRRORED], ids=["aslant", "uneven", "mirrored"])
@pytest.mark.parametrize("space", ["TANGENT", "OBJECT", "WORLD"])
def test_the_lit_map_equals_the_float64_picture(space, matrix):
    low, high = pair(matrix)
    session = session_of(low, [high], space=space)
    eye = eye_on(low)
    pixels = picture(lambda: view_shading.Shading(session).draw("MAP", eye))
    check(pixels, *shown(low, session.texels, session.settings)(eye))


@pytest.mark.parametrize(
    "settings",
    [
        {"green": "-Y"},
        {"red": "+Z", "green": "-X", "blue": "+Y"},
        {"red": "-Y", "green": "+Z", "blue": "-X", "space": "OBJECT"},
        *({"basis": basis} for basis in decoders.DECODERS),
        {"depth": 8, "width": 64, "height": 32},
    ],
    ids=lambda settings: " ".join(map(str, settings.values())),
)
def test_the_map_is_read_as_it_was_written(settings):
    low, high = pair(UNEVEN)
    session = session_of(low, [high], **settings)
    eye = eye_on(low)
    pixels = picture(lambda: view_shading.Shading(session).draw("MAP", eye))
    check(pixels, *shown(low, session.texels, session.settings)(eye))


def test_a_point_light_shines_from_its_position():
    low, high = pair(ASLANT)
    session = session_of(low, [high])
    eye = eye_on(low, light=(*(ASLANT @ Matrix.Translation((0.5, -1.2, 1.0))).translation, 1.0))
    pixels = picture(lambda: view_shading.Shading(session).draw("MAP", eye))
    check(pixels, *shown(low, session.texels, session.settings)(eye))


def test_an_orthographic_view():
    low, high = pair(ASLANT)
    session = session_of(low, [high])
    eye = eye_on(low, is_parallel=True)
    pixels = picture(lambda: view_shading.Shading(session).draw("MAP", eye))
    check(pixels, *shown(low, session.texels, session.settings)(eye))


@pytest.mark.shared
@pytest.mark.parametrize("space", ["TANGENT", "OBJECT", "WORLD"])
def test_a_real_pair_equals_the_float64_picture(space, shared_assets):
    low, high = open_pair(shared_assets, "spot_1696_536")
    session = session_of(low, [high], space=space, width=512, height=512)
    eye = eye_on(low)
    pixels = picture(lambda: view_shading.Shading(session).draw("MAP", eye))
    check(pixels, *shown(low, session.texels, session.settings)(eye))


def bare(obj, eye, *, has_tangents=False):
    """The mask of `obj` in the picture, and its colors without a map."""
    mesh = raster.corners(obj, with_tangents=False)
    points = mesh.position @ mesh.matrix[:3, :3].T + mesh.matrix[:3, 3]
    owner, weights = raster.rasterize(points, eye.projection @ eye.view, SIZE)
    normals = mesh.normal @ mesh.to_world_normals.T
    if has_tangents:  # then normals have length one in the scene before they are interpolated
        normals = raster.unit(normals)
    normals = raster.interpolate(normals, owner, weights)
    return owner >= 0, brightness(raster.unit(normals), raster.interpolate(points, owner, weights), eye.light)


@pytest.mark.parametrize("split", [0.0, 1.0])
def test_no_part_without_pixels_is_drawn(monkeypatch, split):
    """Vulkan's and Metal's checks abort on such a rectangle at the edge of a view."""
    widths, scissor = [], gpu.state.scissor_set
    monkeypatch.setattr(
        gpu.state, "scissor_set", lambda x, y, width, height: (widths.append(width), scissor(x, y, width, height))
    )
    low, high = pair(UNEVEN, n=4)
    shading, eye = view_shading.Shading(session_of(low, [high])), eye_on(low)
    widths.clear()
    picture(lambda: view_shading.draw([shading], Mode.SPLIT, eye, split=split))
    assert widths
    assert min(widths) > 0
    assert sum(widths) == SIZE[0]


@pytest.mark.parametrize("split", [0.4, 0.95])
def test_split_shows_the_high_mesh_and_the_low_mesh_with_the_map(split):
    low, high = pair(UNEVEN, n=20)
    # The oracle takes the mesh as it is, where vertices of the high mesh are not joined.
    session = session_of(low, [high], keep_faces=True)
    eye = eye_on(low)
    pixels = picture(lambda: view_shading.draw([view_shading.Shading(session)], Mode.SPLIT, eye, split=split))
    zones = [pane.columns for pane in view_shading.panes(Mode.SPLIT, SIZE, split)]
    assert [column for zone in zones for column in zone] == list(range(SIZE[0]))
    for zone, (mask, colors) in zip(
        zones,
        (bare(high, eye), shown(low, session.texels, session.settings)(eye)),
        strict=True,
    ):
        expected = np.zeros(mask.shape)
        expected[mask] = colors
        wrong = np.abs(pixels[..., :3] - expected[..., None]).max(axis=-1) > TOLERANCE
        assert wrong[:, zone.start : zone.stop].sum() <= (1.0 - SHARE) * mask.sum()


@pytest.mark.parametrize("is_parallel", [False, True])
def test_the_view_covers_the_object_and_not_what_is_in_front(is_parallel):
    """The high object protrudes from the low one, and is visible as well."""
    low, high = pair(ASLANT)
    drawn = view_shading.Shading(session_of(low, [high]))
    eye = eye_on(low, is_parallel=is_parallel)
    around = raster.corners(high, with_tangents=False).position

    def over(corners):
        points = np.asarray(corners, np.float32).reshape(-1, 3)
        triangles = np.arange(len(points), dtype=np.int32).reshape(-1, 3)
        in_scene = mesh_upload.upload(triangles, position=points, normal=np.zeros_like(points))
        gpu.state.depth_test_set("LESS_EQUAL")
        gpu.state.depth_mask_set(True)
        lit.draw_bare(in_scene, eye.projection @ eye.view @ np.array(ASLANT), lit.shading(np.eye(3), eye.light))
        drawn.draw("MAP", eye)
        gpu.state.depth_mask_set(False)
        gpu.state.depth_test_set("NONE")

    alone, over_high, hidden = (
        picture(draw)
        for draw in (lambda: drawn.draw("MAP", eye), lambda: over(around), lambda: over(oracle.icosphere(3) * 1.3))
    )
    mask = alone[..., 3] == 1.0
    assert (alone[mask] == over_high[mask]).mean() > 0.98  # the rim sees the high one from the side
    assert np.abs(hidden[mask][:, :3] - AMBIENT - FILL / 2).max() < 1e-6  # without normals


POKING = {True: 0.01, False: 0.02}
"""Share of pixels where bumps may poke through: a camera with perspective looks at them from the side at the rim."""


@pytest.mark.parametrize("mode", [Mode.MAP, Mode.SPLIT])
@pytest.mark.parametrize("is_parallel", [False, True])
def test_bumps_of_the_high_object_do_not_poke_through(is_parallel, mode):
    """The bumps are higher than the distance by which the low object is pulled forward, and the high object is visible. If
    the high object is not in the view, an object this far in front is another one, and stays in front."""
    low, high = zoo.sphere("lo", n=10, latitude=60.0), zoo.sphere("hi", n=40, latitude=60.0)
    points = np.array([vertex.co for vertex in high.data.vertices])
    bumps = 1.0 + 0.3 * (np.sin(9.0 * points[:, :1]) * np.sin(9.0 * points[:, 2:]) > 0.5)
    high.data.vertices.foreach_set("co", (points * bumps).astype(np.float32).ravel())
    drawn = view_shading.Shading(session_of(low, [high]))
    eye = eye_on(low, is_parallel=is_parallel)
    corners = raster.corners(high, with_tangents=False).position.reshape(-1, 3).astype(np.float32)
    seen = mesh_upload.upload(
        np.arange(len(corners), dtype=np.int32).reshape(-1, 3), position=corners, normal=np.zeros_like(corners)
    )

    def over(**known):
        gpu.state.depth_test_set("LESS_EQUAL")
        gpu.state.depth_mask_set(True)
        lit.draw_bare(seen, eye.projection @ eye.view, lit.shading(np.eye(3), eye.light))
        view_shading.draw([drawn], mode, eye, split=0.1, **known)
        gpu.state.depth_mask_set(False)
        gpu.state.depth_test_set("NONE")

    alone, over_high = picture(lambda: view_shading.draw([drawn], mode, eye, split=0.1)), picture(over)
    mask = alone[..., 3] == 1.0
    pokes = (alone[mask] != over_high[mask]).any(axis=1)
    assert pokes.mean() < POKING[is_parallel]
    behind = picture(lambda: over(is_alone=True))
    assert (alone[mask] == behind[mask]).all(axis=1).mean() < 0.9


def test_a_map_rendered_in_bands_is_not_shown(monkeypatch):
    """The texture holds only the last band."""
    monkeypatch.setattr(bands, "BAND_TEXELS", 128 * 64)
    low, high = pair(ASLANT)
    session = session_of(low, [high])
    assert session.texels.shape == (128, 128, 4)
    assert session.map is None
    with pytest.raises(BakeError, match="128 x 128 texels is drawn in bands"):
        view_shading.Shading(session)


def test_a_high_object_moved_aside_is_drawn_over_the_low_one():
    low, high = pair(UNEVEN)
    eye = eye_on(low)
    pictures = []
    for aside in (0.0, 10.0):
        high.location.x = aside
        session = session_of(low, [high])
        drawn = view_shading.Shading(session)
        pictures.append(picture(lambda drawn=drawn: view_shading.draw([drawn], Mode.SPLIT, eye, split=0.9)))
    mask = pictures[0][..., 3] == 1.0
    assert (mask == (pictures[1][..., 3] == 1.0)).mean() >= SHARE
    # The centers of their boxes differ slightly.
    assert np.percentile(np.abs(pictures[0] - pictures[1])[mask].max(axis=1), 90) < 0.02


def test_moved_objects_are_drawn_at_their_new_position():
    low, high = pair(Matrix())
    session = session_of(low, [high])
    drawn = view_shading.Shading(session)
    for matrix in (Matrix(), Matrix.LocRotScale((1.0, 0.0, 0.0), Euler((0.0, 0.0, 0.5)), (-1.2, 1.2, 1.2))):
        low.matrix_world = matrix
        bpy.context.view_layer.update()
        eye = eye_on(low)
        pixels = picture(lambda eye=eye: drawn.draw("MAP", eye))
        check(pixels, *shown(low, session.texels, session.settings)(eye))


def test_unchanged_meshes_are_not_uploaded_again(monkeypatch):
    low, high = pair(Matrix())
    session = session_of(low, [high])
    drawn, eye = view_shading.Shading(session), eye_on(low)
    uploads = []
    monkeypatch.setattr(
        session, "upload", lambda *args, given=session.upload, **more: uploads.append(args) or given(*args, **more)
    )
    first = [picture(lambda: view_shading.draw([drawn], Mode.SPLIT, eye)) for _ in range(3)]
    assert len(uploads) == 2
    assert np.array_equal(first[0], first[2])
    session.run(bpy.context)
    drawn.update(is_measured=False)
    picture(lambda: view_shading.draw([drawn], Mode.SPLIT, eye))
    assert len(uploads) == 4


def test_deleted_and_flattened_objects_are_not_drawn():
    low, high = pair(Matrix())
    session = session_of(low, [high])
    drawn, eye = view_shading.Shading(session), eye_on(low)
    low.scale.x = 0.0
    bpy.context.view_layer.update()
    assert not picture(lambda: drawn.draw("MAP", eye)).any()
    low.scale.x = 1.0
    bpy.data.objects.remove(high)
    bpy.context.view_layer.update()
    assert not picture(lambda: drawn.draw("HIGH", eye)).any()
    assert picture(lambda: drawn.draw("MAP", eye)).any()
    bpy.data.objects.remove(low)
    for mode in SHOWN:
        assert not picture(lambda mode=mode: drawn.draw(mode, eye)).any()
    session.free()
    assert not picture(lambda: drawn.draw("MAP", eye)).any()


class TestDeviation:
    """The angles between the normals shown and those of the high surface."""

    @staticmethod
    def of(low, high, **settings):
        """Measure the map of `low` and `high`."""
        drawn = view_shading.Shading(session_of(low, [high], **settings))
        drawn.update(is_measured=True)
        return drawn

    @pytest.mark.parametrize(
        ("settings", "matrix"),
        [
            *(({"basis": basis}, UNEVEN) for basis in decoders.DECODERS),
            ({}, MIRRORED),
            ({"space": "OBJECT"}, MIRRORED),
            ({"space": "WORLD"}, UNEVEN),
            ({"red": "-Z", "blue": "+X"}, ASLANT),
        ],
        ids=str,
    )
    def test_a_float_map_has_no_deviation(self, settings, matrix):
        drawn = self.of(*pair(matrix), **settings)
        measured = values(drawn)
        assert (measured[..., 3] == 1.0).mean() > 0.99
        assert measured[..., 0].max() < 0.1
        assert measured[..., 1].max() > 1.0
        figures = drawn.deviations
        assert figures.mean <= figures.percentile_99 < 0.1 < figures.bare_mean < figures.bare_percentile_99

    def test_another_reader_deviates_by_its_own_rules(self):
        low, high = zoo.terrain("lo", n=9, height=0.3), zoo.terrain("hi", n=96, height=0.3)
        drawn = self.of(low, high, basis="NORMALIZED")
        exact = drawn.deviations
        drawn.update(is_measured=True, target_engine="godot-old")  # it makes z, which no texel here has below 0
        assert drawn.deviations.percentile_99 == pytest.approx(exact.percentile_99, abs=0.01)
        for name in ("eevee", "cycles", "godot"):
            drawn.update(is_measured=True, target_engine=name)
            assert drawn.deviations.percentile_99 > 1.0
        drawn.update(is_measured=True, target_engine="directx")
        assert drawn.deviations.mean > 10.0
        drawn.update(is_measured=True)
        assert drawn.deviations == exact
        assert exact.percentile_99 < 0.1

    def test_eight_bits_deviate_by_their_rounding(self):
        drawn = self.of(*pair(Matrix()), space="OBJECT", depth=8)
        texels = drawn.session.texels.reshape(-1, 4)
        lost = value_encoding.angles_between(texels, value_encoding.rounded(texels, 8))
        assert drawn.deviations.mean == pytest.approx(lost.mean(), rel=1e-3)
        assert drawn.deviations.percentile_99 == pytest.approx(np.percentile(lost, 99), rel=1e-2)
        assert drawn.deviations.mean > 0.1

    @pytest.mark.parametrize("scale", [1.0, 2.5])
    @pytest.mark.parametrize("slopes", [(0.0, 0.2), (0.2, 0.0)], ids=["high", "low"])
    def test_without_a_map_a_plane_deviates_by_the_slope(self, slopes, scale):
        low, high = zoo.plane("lo", slope=slopes[0]), zoo.plane("hi", slope=slopes[1])
        for obj in (low, high):
            obj.scale.z = scale
        figures = self.of(low, high).deviations
        slope = math.degrees(math.atan(0.2 * scale))
        assert figures.bare_mean == pytest.approx(slope, abs=1e-3)
        assert figures.bare_percentile_99 == pytest.approx(slope, abs=1e-3)
        assert figures.percentile_99 < 0.01

    @pytest.mark.parametrize(("limit", "color"), [(3.0, (0.0, 0.35, 0.1)), (1.0, (0.7, 0.0, 0.0))])
    def test_angles_are_shown_as_colors(self, limit, color):
        """A third of the limit is green, the limit and above are red; the map itself is blue, as 0 is."""
        low, high = zoo.plane("lo"), zoo.plane("hi", slope=math.tan(math.radians(1.0)))
        drawn, eye = self.of(low, high), eye_on(low)
        pixels = picture(lambda: drawn.draw("BARE_DEVIATION", eye, limit=limit))
        assert np.abs(pixels[pixels[..., 3] > 0.0][:, :3] - color).max() < 5e-3
        pixels = picture(lambda: drawn.draw("DEVIATION", eye, limit=limit))
        assert np.abs(pixels[pixels[..., 3] > 0.0][:, :3] - (0.0, 0.01, 0.15)).max() < 5e-3

    def test_without_a_high_surface_there_is_no_deviation(self):
        low, high = zoo.plane("lo"), zoo.plane("hi", 2, slope=0.2)
        uv = np.array([corner.vector for corner in high.data.uv_layers[0].uv]).reshape(-1, 4, 2)
        uv[uv.mean(axis=1)[:, 0] > 0.5] += (5, 0)  # out of the way
        high.data.uv_layers[0].uv.foreach_set("vector", uv.astype(np.float32).ravel())
        drawn = self.of(low, high)
        measured = values(drawn)
        assert (measured[:, :64, 3] == 1.0).all()
        assert (measured[:, 64:, 3] == -1.0).all()
        assert drawn.deviations.bare_mean == pytest.approx(math.degrees(math.atan(0.2)), abs=1e-3)
        pixels = picture(lambda: drawn.draw("BARE_DEVIATION", eye_on(low)))
        assert (np.abs(pixels[..., :3] - 0.1).max(axis=-1) < 1e-4).sum() > 0.3 * (pixels[..., 3] > 0.0).sum()

    def test_the_rim_of_an_island_is_not_gray(self):
        """The nearest texel of its outer half texel is not part of the island."""
        low, high = zoo.disc("lo", sides=31), zoo.disc("hi", sides=31)
        drawn = self.of(low, high, width=16, height=16, space="OBJECT")
        pixels = picture(lambda: drawn.draw("DEVIATION", eye_on(low)))
        seen = pixels[..., 3] > 0.0
        assert (np.abs(pixels[seen][:, :3] - 0.1).max(axis=-1) < 1e-4).mean() < 0.02

    def test_texels_of_another_place_are_not_measured(self):
        """The UVs are rotated by half a turn: they fit their place only around the middle of the plane."""
        low, high = zoo.plane("lo", 8), zoo.plane("hi", 8, slope=0.02)
        uv = np.array([corner.vector for corner in high.data.uv_layers[0].uv])
        high.data.uv_layers[0].uv.foreach_set("vector", (1.0 - uv).astype(np.float32).ravel())
        drawn = self.of(low, high)
        measured = values(drawn)
        v, u = (np.mgrid[:128, :128] + 0.5) / 128
        # Twice the distance to the middle, on a plane 2 units wide, with sqrt(2) from its middle to a corner.
        away = 4.0 * np.hypot(u - 0.5, v - 0.5) / math.sqrt(2.0)
        truth = np.where(away > 0.05, -2.0, 1.0)
        assert (measured[..., 3] != truth).mean() < 0.002
        assert drawn.deviations.elsewhere == pytest.approx((truth < 0.0).mean(), abs=0.002)
        pixels = picture(lambda: drawn.draw("DEVIATION", eye_on(low)))
        purple = np.abs(pixels[..., :3] - (0.45, 0.0, 0.6)).max(axis=-1) < 1e-3
        assert purple.sum() > 0.98 * (pixels[..., 3] > 0.0).sum()

    @pytest.mark.parametrize(("shift", "aside", "is_elsewhere"), [(0.1, 0, True), (0.0, 0.5, False), (0.0, 5, False)])
    def test_moved_uvs_are_another_place_and_moved_objects_are_not(self, shift, aside, is_elsewhere):
        low, high = zoo.plane("lo", 4), zoo.plane("hi", 4, slope=0.02)
        uv = np.array([corner.vector for corner in high.data.uv_layers[0].uv])
        high.data.uv_layers[0].uv.foreach_set("vector", (uv + (shift, 0)).astype(np.float32).ravel())
        high.location.x = aside
        figures = self.of(low, high).deviations
        assert figures.elsewhere == float(is_elsewhere)
        assert math.isnan(figures.mean) == is_elsewhere

    def test_mirrored_halves_fit_both_halves(self):
        low, high = zoo.mirrored("lo"), zoo.mirrored("hi", slope=0.02)
        data = high.data
        order = np.arange(len(data.polygons)).reshape(2, -1)[::-1].ravel()
        corners = np.array([polygon.vertices[:] for polygon in data.polygons])[order]
        uv = np.array([corner.vector for corner in data.uv_layers[0].uv]).reshape(-1, 4, 2)[order]
        points = [vertex.co[:] for vertex in data.vertices]
        turned = zoo.build("turned", points, corners, uv)
        assert self.of(low, turned).deviations.elsewhere == 0.0

    def test_rays_are_measured_wherever_they_hit(self):
        low, high = zoo.plane("lo", 4), zoo.plane("hi", 4, slope=0.02)
        uv = np.array([corner.vector for corner in high.data.uv_layers[0].uv])
        high.data.uv_layers[0].uv.foreach_set("vector", (1.0 - uv).astype(np.float32).ravel())
        assert self.of(low, high, method="CAST", extrusion=0.1, max_distance=0.2).deviations.elsewhere == 0.0

    def test_cast_maps_have_a_deviation_as_well(self):
        low, high = pair(Matrix())
        drawn = self.of(low, high, method="CAST", samples=4, extrusion=0.1, max_distance=0.2)
        assert drawn.deviations.percentile_99 < 1.0 < drawn.deviations.bare_mean


def values(drawn):
    """The measured angles, texel by texel."""
    measured = np.empty((*drawn.session.settings.sampling.size[::-1], 4), np.float32)
    drawn._measured.read(measured)
    return measured


def test_the_legend_runs_from_left_to_right():
    pixels = picture(lambda: view_shading.draw_legend((10, 20), (90, 12)))
    assert pixels[20:32, 10:100, 3].all()
    assert pixels[..., 3].sum() == 90 * 12
    assert np.abs(pixels[25, 10, :3] - (0.0, 0.01, 0.15)).max() < 0.01
    assert np.abs(pixels[25, 99, :3] - (0.7, 0.0, 0.0)).max() < 0.02


@pytest.mark.parametrize(("budget", "size"), [("16000", (8192, 2048)), ("1000", (4096, 1024))])
def test_a_view_limits_the_map_size_and_keeps_the_map_in_memory(monkeypatch, budget, size):
    monkeypatch.setenv("IMPRINT_GPU_MEMORY", budget)
    settings = view_shading.settings_for(
        Settings(width=16384, height=4096, udim=True, tiles=(1002,), storage="FILE", output="x.png")
    )
    settings.check()
    assert settings.sampling.size == size
    assert (settings.sampling.udim, settings.storing.storage, settings.storing.material) == (False, "MEMORY", False)


def test_many_high_meshes_are_probed_no_more_than_a_few(monkeypatch):
    low = zoo.plane("lo")
    highs = [zoo.terrain(f"hi {number}", n=32) for number in range(8)]
    height = view_scene.height_over

    class Counted:
        found = 0

        def __init__(self, surface):
            self.surface = surface

        def find_nearest(self, point):
            Counted.found += 1
            return self.surface.find_nearest(point)

    monkeypatch.setattr(view_scene, "height_over", lambda surface, *more: height(Counted(surface), *more))
    view_scene.ViewObjects(session_of(low, highs)).place(with_highs=False)
    assert 0 < Counted.found <= view_scene.PROBES + 6 * len(highs)
