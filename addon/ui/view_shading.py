# SPDX-License-Identifier: GPL-3.0-or-later
"""How the views draw: their modes, the panes of the viewport that each of them takes, and a session with its map, lit, and the
deviations of the map. stored_maps.py draws the maps that the file has."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from enum import StrEnum

import gpu
import numpy as np

from ..core import udim
from ..core.declarations import targets
from ..core.declarations.choices import Space
from ..core.errors import BakeError
from ..core.map_types import NORMAL, WRITTEN
from ..core.settings import Settings
from ..engine import live_redraw, normal_space, uv_agreement
from ..engine.bands import Band
from ..jobs.live_session import Session
from ..mesh.inputs import Meshes
from ..mesh.triangle_mesh import Mesh
from ..output import value_encoding
from ..output.outputs import Outputs
from ..passes import data_texture, lit, mesh_upload, target, viewport
from .view_scene import PULL, Eye, Subject, ViewObjects, ViewScene, view_projection


class Mode(StrEnum):
    """A view that the 3D viewports can show."""

    OFF = "OFF"
    MAP = "MAP"
    HIGH = "HIGH"
    SPLIT = "SPLIT"
    SIDES = "SIDES"
    DEVIATION = "DEVIATION"
    BARE_DEVIATION = "BARE_DEVIATION"
    FORMAT = "FORMAT"

    @property
    def is_deviation(self) -> bool:
        """Whether it shows degrees."""
        return self in {Mode.DEVIATION, Mode.BARE_DEVIATION, Mode.FORMAT}

    @property
    def has_high(self) -> bool:
        """Whether it draws the high meshes."""
        return self in {Mode.HIGH, Mode.SPLIT, Mode.SIDES}

    @property
    def next(self) -> "Mode":
        """The next mode; OFF after the last."""
        modes = list(Mode)
        return modes[(modes.index(self) + 1) % len(modes)]


ITEMS = [
    (Mode.OFF.value, "Off", "The viewport as it is"),
    (Mode.MAP.value, "Map", "The low mesh with a map: the normal map lit, the others as they are stored"),
    (Mode.HIGH.value, "High", "The high mesh in its place, in the same light"),
    (Mode.SPLIT.value, "Split", "The high mesh and the low mesh with the map in one place, on both sides of a line"),
    (Mode.SIDES.value, "Side by Side", "The high mesh beside the low mesh with the map, as the same camera sees them"),
    (Mode.DEVIATION.value, "Deviation", "Degrees between the low mesh with the map and the high surface"),
    (Mode.BARE_DEVIATION.value, "Without Map", "Degrees between the low mesh without the map and the high surface"),
    (
        Mode.FORMAT.value,
        "Format",
        "Degrees between the normals as they are baked and as the Output panel stores them: by depth, blocks or quality",
    ),
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
OVER = 1.001
"""Factor on the pull of what is drawn over the map."""
BACKDROP = (0.045, 0.045, 0.045, 1.0)
"""Behind what Side by Side shows, where the objects themselves are not: linear, as Blender's own background."""


@dataclass(frozen=True)
class Pane:
    """A part of the viewport.

    Attributes:
        columns: Of pixels.
        shows: What is drawn there, a mode of one picture.
        scale, shift: Of the camera's picture, in clip space.
    """

    columns: range
    shows: Mode
    scale: float = 1.0
    shift: float = 0.0

    def seen_by(self, eye: Eye) -> Eye:
        """The camera that draws this pane."""
        projection = np.diag((self.scale, self.scale, 1.0, 1.0)) @ eye.projection
        projection[0] += self.shift * projection[3]
        return replace(eye, projection=projection)


def panes(mode: Mode, size: tuple[int, int], split: float, visible: tuple[int, int] | None = None) -> list[Pane]:
    """The panes of a viewport of this size in pixels.

    split: the position of the line, from 0 to 1. visible: the first column that nothing lies over, and the one after the last.
    """
    width, height = size
    if mode is Mode.SPLIT:
        line = round(min(max(split, 0.0), 1.0) * width)
        return [Pane(range(line), Mode.HIGH), Pane(range(line, width), Mode.MAP)]
    if mode is Mode.SIDES:
        first, last = visible or (0, width)
        middle, half = (first + last) // 2, (last - first) / 2
        scale = min(1.0, half / max(1, min(size)))  # what filled the viewport fills a half
        return [
            Pane(columns, shows, scale, 2.0 * center / width - 1.0)
            for columns, shows, center in (
                (range(middle), Mode.HIGH, first + half / 2),
                (range(middle, width), Mode.MAP, last - half / 2),
            )
        ]
    return [Pane(range(width), mode)]


class Drawing:
    """Draws the objects of a subject where they are now, with their meshes as last read."""

    def __init__(self, subject: Subject):
        self.subject, self.objects = subject, ViewObjects(subject)

    @property
    def is_whole(self) -> bool:
        """Whether it draws the map with all its texels."""
        return True

    def load_whole(self) -> None:
        """Load all texels of one image of the map that is not whole. Do not call this while a view is being drawn."""

    def draw(self, mode: Mode, eye: Eye, *, limit: float = 5.0, is_alone: bool = False) -> None:
        """Draw a mode of one picture into the bound framebuffer, which has depth.

        limit: degrees at which the colors of deviations end. is_alone: no high object is visible that could show through.
        Draws nothing if an object was deleted or has zero scale.
        """
        scene = self.objects.place(with_highs=mode is Mode.HIGH)
        if scene is None:
            return
        matrix = view_projection(eye, scene.local_space, PULL if is_alone else scene.pull)
        light = np.append(
            (eye.light[:3] - eye.light[3] * scene.local_space.origin) / scene.local_space.size, eye.light[3]
        )
        with _tested_for_depth():
            if mode == Mode.HIGH:
                for drawn, normals in scene.highs:
                    lit.draw_bare(drawn, matrix, lit.shading(normals, light))
            elif mode == Mode.MAP:
                self.draw_map(scene, matrix, light)
                self.draw_over(
                    scene, view_projection(eye, scene.local_space, OVER * (PULL if is_alone else scene.pull))
                )
            else:
                self.draw_deviation(scene, matrix, limit, Mode(mode))

    def draw_map(self, scene: ViewScene, matrix: np.ndarray, light: np.ndarray) -> None:
        """Draw the low mesh with the map."""
        raise NotImplementedError

    def draw_over(self, scene: ViewScene, matrix: np.ndarray) -> None:
        """Draw what lies over the map. matrix: a little nearer than that of the map."""

    def draw_deviation(self, scene: ViewScene, matrix: np.ndarray, limit: float, mode: Mode) -> None:
        """Draw how far the map is off, the low mesh without it, or what is stored; nothing if that is not known."""


def draw(
    drawings: Sequence[Drawing],
    mode: Mode,
    eye: Eye,
    *,
    split: float = 0.5,
    visible: tuple[int, int] | None = None,
    limit: float = 5.0,
    is_alone: bool = False,
) -> None:
    """Draw a mode into the bound framebuffer, with its panes. split, visible: as in `panes`; the others as in Drawing.draw."""
    x, y, width, height = gpu.state.viewport_get()
    for pane in panes(mode, (width, height), split, visible):
        if not pane.columns:  # Vulkan and Metal refuse a part without pixels
            continue
        with _only(x + pane.columns.start, y, len(pane.columns), height):
            if mode is Mode.SIDES:  # the scene has no depth there, and Blender draws its objects elsewhere
                gpu.state.active_framebuffer_get().clear(color=BACKDROP, depth=1.0)
            for drawing in drawings:
                drawing.draw(pane.shows, pane.seen_by(eye), limit=limit, is_alone=is_alone)


def reading(settings: Settings, target_engine: str, normals: np.ndarray, light: np.ndarray | None = None) -> np.ndarray:
    """How a normal map of these settings is read, and the light, as the shaders take them.

    target_engine: the name of the program that reads it; empty for those that it is made for. normals (3, 3): of
    the low mesh, to world space.
    """
    engine = targets.BY_NAME.get(target_engine)
    if engine and settings.map.space == Space.TANGENT:
        read = normal_space.reading_by(engine, settings)
    else:
        read = (255 if settings.storing.depth == 8 else 0, *normal_space.reading(settings.map)[1:])
    return lit.shading(normals, light, read=read)


MOST_BYTES, LAYER_BYTES = 512 * 2**20, 16
"""The most GPU memory for the deviations of hidden parts, and what a texel of a layer takes."""


@dataclass(frozen=True)
class Deviations:
    """Degrees between the shaded normals and those of the high surface, with and without the map, over texels of the whole map.

    Attributes:
        elsewhere: The share of texels that are not measured, because Flatten has drawn another part of the high surface there.
            The other values are NaN if no texel is measured.
        mean: With the map.
        percentile_99: With the map.
        bare_mean: Without it.
        bare_percentile_99: Without it.
    """

    mean: float
    percentile_99: float
    bare_mean: float
    bare_percentile_99: float
    elsewhere: float = 0.0


@dataclass(frozen=True)
class FormatLoss:
    """Degrees between the normals of a map and those that are read of it once it is stored, over texels of the low mesh.

    Attributes:
        label: The format, in words.
        mean, percentile_99: Over all texels of the low mesh that have a hit.
    """

    label: str
    mean: float
    percentile_99: float


def settings_for(settings: Settings) -> Settings:
    """Settings for the same map in memory only, with one tile, and small enough for a single band."""
    one_tile = settings.sampled(udim=False, tiles=()).mapped(texture_sets=False)
    smaller = one_tile.without_other_maps().without_file().without_materials()
    while not live_redraw.is_whole(smaller):
        width, height = smaller.sampling.size
        smaller = smaller.sampled(width=width // 2, height=height // 2)
    return smaller


class Shading(Drawing):
    """Draws a session with its map, lit, and the deviations of the map.

    deviations: those of the map from the last `update` that measured them, or None. loss: what its format cost when that was
    last measured, or None. target_engine: the name of the program as
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
        super().__init__(session)
        self.session = session
        self.deviations: Deviations | None = None
        self.loss: FormatLoss | None = None
        self._stored: tuple[int, Settings] | None = None
        """The map whose loss was measured, by its number, and its settings."""
        self._lost: gpu.types.GPUTexture | None = None
        self.target_engine = ""
        self._number = 0
        self._measured: target.Target | None = None
        self._hidden: list[tuple[Mesh, target.Target]] = []
        self._hidden_parts: list[gpu.types.GPUBatch] = []
        self._hidden_scene: ViewScene | None = None

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

    def update_loss(self, settings: Settings) -> None:
        """Measure what the last map that was drawn loses as settings store it, unless that is known. Raises BakeError."""
        settings = replace(self.session.settings.mapped(targets=settings.map.targets), storing=settings.storing)
        drawn, known = self.session.normals, (self.session.drawn, settings)
        if drawn is None or known == self._stored:
            return
        texels, state = drawn
        with Outputs(settings) as outputs:
            kept = outputs.kept(udim.FIRST, drawn)
            label = outputs.format_of(NORMAL.name, udim.FIRST)
        angles = np.zeros((*state.shape, 4), np.float32)
        is_written = state == WRITTEN
        off = value_encoding.angles_between(np.insert(texels[is_written][:, :3], 3, 1.0, axis=1), kept[is_written])
        angles[is_written, 0], angles[is_written, 3] = off, 1.0
        self._lost, self._stored = data_texture.image(angles), known
        self.loss = FormatLoss(label, float(off.mean()), float(np.percentile(off, 99.0)))

    def draw_map(self, scene: ViewScene, matrix: np.ndarray, light: np.ndarray) -> None:
        low, normals = scene.low
        if self.session.map is not None:  # its memory may have been freed
            lit.draw(low, self.session.map, matrix, self._reading(normals, light))

    def draw_deviation(self, scene: ViewScene, matrix: np.ndarray, limit: float, mode: Mode) -> None:
        is_bare = mode is Mode.BARE_DEVIATION
        if mode is Mode.FORMAT and self._lost is not None:
            viewport.draw_deviation(scene.low[0], self._lost, matrix, limit=limit, without_map=False)
        if mode is Mode.FORMAT or self._measured is None or self.session.map is None:
            return
        viewport.draw_deviation(scene.low[0], self._measured.texture, matrix, limit=limit, without_map=is_bare)
        if self._hidden_scene is not scene:
            self._hidden_scene, self._hidden_parts = scene, [scene.part(low) for low, _ in self._hidden]
        for part, (_, measured) in zip(self._hidden_parts, self._hidden, strict=True):
            # Over what was drawn of these triangles.
            viewport.draw_deviation(part, measured.texture, matrix, limit=limit, without_map=is_bare)

    def _reading(self, normals: np.ndarray, light: np.ndarray | None = None) -> np.ndarray:
        return reading(self.session.settings, self.target_engine, normals, light)

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


def draw_legend(place: tuple[float, float], size: tuple[float, float]) -> None:
    """Draw the colors of deviations as a bar. place, size: in pixels, from the lower left of the view."""
    view = np.array(gpu.state.viewport_get()[2:])
    viewport.draw_legend((*(np.multiply(size, 2) / view), *(np.multiply(place, 2) / view - 1.0)))


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
