# SPDX-License-Identifier: GPL-3.0-or-later
"""The views of a session: their modes, the objects where they are now, the drawing, and the deviations of the map."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from enum import StrEnum
from functools import partial

import gpu
import numpy as np
from mathutils.bvhtree import BVHTree

from ..core.declarations import targets
from ..core.declarations.choices import Pack, Space, Storage
from ..core.errors import BakeError
from ..core.settings import Settings
from ..engine import normal_space, uv_agreement
from ..engine.bands import BAND_TEXELS, Band
from ..jobs.live_session import Session
from ..mesh.inputs import Meshes
from ..mesh.local_space import LocalSpace, gap, local_space_of
from ..mesh.triangle_mesh import Mesh, normal_matrix
from ..output import value_encoding
from ..passes import lit, mesh_upload, target, viewport
from ..scene import mesh_reader


class Mode(StrEnum):
    """A view that the 3D viewports can show."""

    OFF = "OFF"
    MAP = "MAP"
    SPLIT = "SPLIT"
    DEVIATION = "DEVIATION"
    BARE_DEVIATION = "BARE_DEVIATION"

    @property
    def is_deviation(self) -> bool:
        return self in {Mode.DEVIATION, Mode.BARE_DEVIATION}

    @property
    def next(self) -> "Mode":
        """The next mode; OFF after the last."""
        modes = list(Mode)
        return modes[(modes.index(self) + 1) % len(modes)]


ITEMS = [
    (Mode.OFF.value, "Off", "The viewport as it is"),
    (Mode.MAP.value, "Map", "The low mesh with the map, lit"),
    (
        Mode.SPLIT.value,
        "Split",
        "The high mesh, the low mesh, and the low mesh with the map, side by side in one place",
    ),
    (Mode.DEVIATION.value, "Deviation", "Degrees between the low mesh with the map and the high surface"),
    (Mode.BARE_DEVIATION.value, "Without Map", "Degrees between the low mesh without the map and the high surface"),
]
"""The modes as items of an EnumProperty, in their order."""
OWN = "OWN"
TARGETS = [
    (OWN, "As Baked", "The program that the map is made for"),
    *((one.name, one.label, f"It decodes with the basis {one.basis.label}") for one in targets.TARGETS),
]
"""The programs as which a view can read the map, as items of an EnumProperty."""
SHOWN = tuple(mode for mode in Mode if mode is not Mode.OFF)
"""The modes that draw something."""


PULL = 0.1
"""Share of the low mesh's radius: the drawing is pulled towards the viewer by at least this much, so that neither the low
object nor the high one around it shows through."""
SIDEWAYS = 3.0
"""Factor on the height of the highest bump: the drawing is pulled this far, because a bump seen from the side hides more."""
PROBES = 1000
"""How many vertices of all high meshes have their height over the low mesh measured, besides the outermost of each."""


@dataclass(frozen=True)
class Eye:
    """A view and its light.

    view, projection (4, 4): from world to view space, and from view to clip space. light (4,): the direction of the
    light in the world and 0, or its position and 1.
    """

    view: np.ndarray
    projection: np.ndarray
    light: np.ndarray


@dataclass(frozen=True)
class ViewScene:
    """The batches that a view draws, with the normal matrices of their objects.

    local_space: of the batches, around the low mesh. pull: how far the drawing is pulled towards the viewer, in its units.
    low_to_world (4, 4): the matrix of the low object.
    """

    local_space: LocalSpace
    pull: float
    low: tuple[gpu.types.GPUBatch, np.ndarray]
    highs: list[tuple[gpu.types.GPUBatch, np.ndarray]]
    low_to_world: np.ndarray

    def part(self, low: Mesh) -> gpu.types.GPUBatch:
        """Some triangles of the low mesh, with UVs of their own."""
        positions = _positions(replace(low, to_world=self.low_to_world), self.local_space)
        return mesh_upload.upload(low.triangles, uv=low.uv, position=positions)


class ViewObjects:
    """Places the objects of `session`, with their meshes as last read."""

    def __init__(self, session: Session):
        self.session = session
        self._scene: ViewScene | None = None
        self._placed: tuple[Meshes, list[bytes]] | None = None
        self._near: tuple[tuple | None, BVHTree | None] = None, None

    @property
    def low(self) -> Mesh:
        """The low mesh, with tangents where the map has them."""
        meshes = self.session.meshes
        return meshes.basis or meshes.low

    def upload_low(self, low: Mesh, **attributes: np.ndarray) -> gpu.types.GPUBatch:
        """The low mesh with its tangent space, and other attributes by corner."""
        return self.session.upload(f"{low.name} as basis", low, **low.tangent_space, **attributes)

    def place(self, *, with_highs: bool) -> ViewScene | None:
        """The objects where they are now, without high objects that were deleted.

        Returns None if the low object was deleted, if an object has zero scale, or, `with_highs`, if a high one was deleted.
        """
        meshes = self.session.meshes
        shown = [self.low, *meshes.highs]
        objects = [ref.find() for ref in self.session.job.refs[: len(shown)]]
        if objects[0] is None or (with_highs and None in objects):
            return None
        shown = [mesh for mesh, obj in zip(shown, objects, strict=True) if obj is not None]
        matrices = [mesh_reader.matrix(obj) for obj in objects if obj is not None]
        if not all(np.isfinite(matrix).all() and np.linalg.det(matrix[:3, :3]) for matrix in matrices):
            return None
        bytes_of_matrices = [matrix.tobytes() for matrix in matrices]
        if self._placed is None or self._placed[0] is not meshes or self._placed[1] != bytes_of_matrices:
            low, *highs = (replace(mesh, to_world=matrix) for mesh, matrix in zip(shown, matrices, strict=True))
            self._scene, self._placed = self._scene_of(low, highs), (meshes, bytes_of_matrices)
        return self._scene

    def _scene_of(self, low: Mesh, highs: list[Mesh]) -> ViewScene:
        local_space = local_space_of([low])
        around, pull = local_space, PULL
        if highs and gap(low, highs) > 0.0:  # moved aside: drawn around the low mesh
            around = LocalSpace(local_space_of(highs).origin, local_space.size)
        elif highs:
            surface = self._surface(low, local_space)
            pull = max(
                PULL,
                SIDEWAYS * max(height_over(surface, local_space.points(high), PROBES // len(highs)) for high in highs),
            )
        return ViewScene(
            local_space,
            pull,
            (self.upload_low(low, position=_positions(low, local_space)), low.normal_matrix),
            [
                (
                    self.session.upload(high.name, high, normal=high.normals, position=_positions(high, around)),
                    normal_matrix(high.to_world),
                )
                for high in highs
            ],
            low.to_world,
        )

    def _surface(self, low: Mesh, local_space: LocalSpace) -> BVHTree:
        """The low mesh as a tree for nearest points, built again only for another mesh."""
        key = low.triangles, low.positions, low.to_world.tobytes()
        known, surface = self._near
        if known is None or known[0] is not key[0] or known[1] is not key[1] or known[2] != key[2]:
            surface = BVHTree.FromPolygons(local_space.points(low).tolist(), low.vertices[low.triangles].tolist())
            self._near = key, surface
        return surface


def _positions(mesh: Mesh, local_space: LocalSpace) -> np.ndarray:
    return local_space.points(mesh)[mesh.vertices]


def height_over(surface: BVHTree, points: np.ndarray, count: int) -> float:
    """The greatest distance of points (V, 3) from a surface, over the outermost points and about `count` others."""
    outermost = [*points.argmin(axis=0), *points.argmax(axis=0)]
    probes = np.concatenate([points[outermost], points[:: -(-len(points) // max(1, count))]])
    return max(surface.find_nearest(probe)[3] or 0.0 for probe in probes.tolist())


def view_projection(eye: Eye, local_space: LocalSpace, pull: float) -> np.ndarray:
    """The matrix (4, 4) from `local_space` to clip space, with depths pulled towards the viewer by `pull` of its units.

    Pixels stay in place.
    """
    to_world = np.diag([*[local_space.size] * 3, 1.0])
    to_world[:3, 3] = local_space.origin
    projection, pull = np.array(eye.projection, np.float64), pull * local_space.size
    if projection[3, 3] == 0.0:  # perspective: points move along their rays by the same share of their distance
        distance = max(-(eye.view @ (*local_space.origin, 1.0))[2], 2.0 * pull)
        projection[2, 3] /= 1.0 - pull / distance
    else:
        projection[2, 3] += pull * projection[2, 2]
    return projection @ eye.view @ to_world


MIDDLE = 0.25
"""Share of the view's width for the low mesh without its map, between the other two."""
MOST_BYTES, LAYER_BYTES = 512 * 2**20, 16
"""The most GPU memory for the deviations of hidden parts, and what a texel of a layer takes."""


@dataclass(frozen=True)
class Deviations:
    """Degrees between the shaded normals and those of the high surface, with and without the map, over texels of the whole map.

    elsewhere: the share of texels that are not measured, because Flatten has drawn another part of the high surface there.
    The other values are NaN if no texel is measured.
    """

    mean: float
    percentile_99: float
    bare_mean: float
    bare_percentile_99: float
    elsewhere: float = 0.0


def settings_for(settings: Settings) -> Settings:
    """Settings for the same map in memory only, with one tile, and small enough for a single band."""
    width, height = settings.sampling.size
    while width * height > BAND_TEXELS:
        width, height = width // 2, height // 2
    return replace(
        settings,
        width=width,
        height=height,
        udim=False,
        tiles=(),
        normal=True,
        maps=(),
        pack=Pack.NONE,
        texture_sets=False,
        material=False,
        storage=Storage.MEMORY,
        output="",
    )


def zones(width: int, split: float) -> list[range]:
    """The pixel columns for the high mesh, the low mesh and the low mesh with its map, in a view of `width`.

    split: the position of the dividing line, from 0 to 1.
    """
    first, last = (round(min(max(split + side * MIDDLE / 2, 0.0), 1.0) * width) for side in (-1, 1))
    return [range(first), range(first, last), range(last, width)]


class Shading:
    """Draws the objects of `session` where they are now, with their meshes as last read. The session must have a map.

    deviations: those of the map from the last `update` that measured them, or None. target_engine: the name of the program as
    which a tangent-space map is read; empty for those that it is made for.
    """

    def __init__(self, session: Session):
        """Raises BakeError for a map that is drawn in bands."""
        if session.map is None:
            width, height = session.settings.sampling.size
            raise BakeError(
                f"A map of {width} x {height} texels is drawn in bands and is never whole on the GPU: "
                "choose a smaller size to see it live."
            )
        self.session, self.objects = session, ViewObjects(session)
        self.deviations: Deviations | None = None
        self.target_engine = ""
        self._number = 0
        self._measured: target.Target | None = None
        self._hidden: list[tuple[Mesh, target.Target]] = []
        self._hidden_parts: list[gpu.types.GPUBatch] = []
        self._hidden_scene: ViewScene | None = None
        self._square: gpu.types.GPUBatch | None = None

    def update(self, *, is_measured: bool, target_engine: str = "") -> None:
        """Use the session's last map, read as `target_engine` reads it. Do not call this while a view is being drawn."""
        if (self.session.drawn, target_engine) != (self._number, self.target_engine):
            self._number, self.target_engine, self.deviations, self._measured = (
                self.session.drawn,
                target_engine,
                None,
                None,
            )
            self._hidden = []
        if is_measured and self._measured is None:
            self._measure()

    def draw(self, mode: Mode, eye: Eye, *, split: float = 0.5, limit: float = 5.0, is_alone: bool = False) -> None:
        """Draw a mode other than OFF into the bound framebuffer, which has depth.

        split: the position of the dividing line, from 0 to 1. limit: degrees at which the colors of deviations end. is_alone:
        no high object is visible that could show through. Draws nothing if an object was deleted or has zero scale, or if
        the deviations of the map are not measured yet.
        """
        scene = self.objects.place(with_highs=mode == Mode.SPLIT)
        drawn = self.session.map
        if scene is None or drawn is None:
            return
        matrix = view_projection(eye, scene.local_space, PULL if is_alone else scene.pull)
        light = np.append(
            (eye.light[:3] - eye.light[3] * scene.local_space.origin) / scene.local_space.size, eye.light[3]
        )
        with _tested_for_depth():
            if mode == Mode.MAP:
                self._draw_map(scene, matrix, light)
            elif mode == Mode.SPLIT:
                x, y, width, height = gpu.state.viewport_get()
                draws = (
                    partial(_draw_bare, scene.highs, matrix, light),
                    partial(_draw_bare, [scene.low], matrix, light),
                    partial(self._draw_map, scene, matrix, light),
                )
                for zone, draw in zip(zones(width, split), draws, strict=True):
                    if zone:  # Vulkan and Metal refuse a part without pixels
                        with _only(x + zone.start, y, len(zone), height):
                            draw()
            elif self._measured is not None:
                how = {"limit": limit, "without_map": mode == Mode.BARE_DEVIATION}
                viewport.draw_deviation(scene.low[0], self._measured.texture, matrix, **how)
                if self._hidden_scene is not scene:
                    self._hidden_scene, self._hidden_parts = scene, [scene.part(low) for low, _ in self._hidden]
                for part, (_, measured) in zip(self._hidden_parts, self._hidden, strict=True):
                    # Over what was drawn of these triangles.
                    viewport.draw_deviation(part, measured.texture, matrix, **how)

    def draw_legend(self, place: tuple[float, float], size: tuple[float, float]) -> None:
        """Draw the colors of deviations as a bar. place, size: in pixels, from the lower left of the view."""
        if self._square is None:
            corners = np.array([(0, 0), (1, 0), (0, 1), (1, 1)], np.float32)
            self._square = mesh_upload.upload(np.array([(0, 1, 2), (2, 1, 3)], np.int32), position=corners)
        view = np.array(gpu.state.viewport_get()[2:])
        viewport.draw_legend(self._square, (*(np.multiply(size, 2) / view), *(np.multiply(place, 2) / view - 1.0)))

    def _draw_map(self, scene: ViewScene, matrix: np.ndarray, light: np.ndarray) -> None:
        low, normals = scene.low
        lit.draw(low, self.session.map, matrix, self._reading(normals, light))

    def _reading(self, normals: np.ndarray, light: np.ndarray | None = None) -> np.ndarray:
        """How the map is read, and the light, as the shaders take them."""
        settings, target_engine = self.session.settings, targets.BY_NAME.get(self.target_engine)
        if target_engine and settings.map.space == Space.TANGENT:
            read = normal_space.reading_by(target_engine, settings)
        else:
            read = (255 if settings.storing.depth == 8 else 0, *normal_space.reading(settings.map)[1:])
        return lit.shading(normals, light, read=read)

    def _measure(self) -> None:
        settings, meshes = self.session.settings, self.session.meshes
        size = settings.sampling.width, settings.sampling.height
        with target.using(target.TargetPool()):  # frees the intermediate targets at the end
            self._measured = target.get("deviation", *size, "RGBA32F")
            high_normals, uploaded = self.session.high_normals(), self.objects.upload_low(self.objects.low)
            self._measure_low(self._measured, uploaded, high_normals, meshes)
            texels = [value_encoding.sample_texels(_read(self._measured))]
        self._hidden, self._hidden_scene = [], None
        hidden, whole = self.session.hidden_parts(), Band(0, size[1], size, 0)
        for layer in hidden.layers[: max(1, MOST_BYTES // (LAYER_BYTES * size[0] * size[1]))]:
            with target.using(target.TargetPool()):
                into, low = target.get("deviation", *size, "RGBA32F"), layer.meshes.basis or layer.meshes.low
                high_normals = layer.maps.high_normals(whole)
                uploaded = mesh_upload.upload(low.triangles, **low.tangent_space)
                self._measure_low(into, uploaded, high_normals, layer.meshes)
                values = _read(into)
                values[~hidden.is_hidden(layer, whole)] = 0.0
            self._hidden.append((low, into))
            texels.append(value_encoding.sample_texels(values))
        texels = np.concatenate(texels)
        measured, elsewhere = texels[texels[:, 3] > 0.0], np.count_nonzero(texels[:, 3] < -1.5)
        if len(measured) + elsewhere:
            means, highest = np.full((2, 2), np.nan)
            if len(measured):
                means = measured[:, :2].mean(axis=0, dtype=np.float64)
                highest = np.percentile(measured[:, :2], 99, axis=0)
            share = elsewhere / (len(measured) + elsewhere)
            self.deviations = Deviations(*map(float, (means[0], highest[0], means[1], highest[1], share)))

    def _measure_low(
        self, into: target.Target, uploaded: gpu.types.GPUBatch, high_normals: gpu.types.GPUTexture, meshes: Meshes
    ) -> None:
        """Write the deviations of the low mesh, or of a layer of hidden parts. meshes: of these triangles."""
        low = meshes.basis or meshes.low
        reading, elsewhere = self._reading(low.normal_matrix), self._elsewhere(meshes)
        where = {"elsewhere": elsewhere, "stretch": low.stretch}
        viewport.measure_deviation(into, uploaded, self.session.map, high_normals, reading, **where)

    def _elsewhere(self, meshes: Meshes) -> np.ndarray:
        """Which parts of the map, (rows, columns) bool, show another part of the high surface than the low mesh has there."""
        if self.session.plan.casts_rays or meshes.is_own_base:  # a base mesh shares the UVs
            return np.zeros((1, 1), bool)
        return uv_agreement.mismatched(meshes.low, meshes.highs)


def _read(drawn: target.Target) -> np.ndarray:
    values = np.empty((drawn.height, drawn.width, 4), np.float32)
    drawn.read(values)
    return values


def _draw_bare(parts: list[tuple[gpu.types.GPUBatch, np.ndarray]], matrix: np.ndarray, light: np.ndarray) -> None:
    for drawn, normals in parts:
        lit.draw_bare(drawn, matrix, lit.shading(normals, light))


@contextmanager
def _tested_for_depth() -> Iterator[None]:
    before = gpu.state.depth_test_get(), gpu.state.depth_mask_get(), gpu.state.blend_get()
    gpu.state.depth_test_set("LESS_EQUAL")
    gpu.state.depth_mask_set(True)
    gpu.state.blend_set("NONE")
    try:
        yield
    finally:
        gpu.state.depth_test_set(before[0])
        gpu.state.depth_mask_set(before[1])
        gpu.state.blend_set(before[2])


@contextmanager
def _only(x: int, y: int, width: int, height: int) -> Iterator[None]:
    """Draw only inside these pixels until the block ends."""
    gpu.state.scissor_test_set(True)
    gpu.state.scissor_set(x, y, width, height)
    try:
        yield
    finally:
        gpu.state.scissor_test_set(False)
