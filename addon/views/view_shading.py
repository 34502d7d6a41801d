# SPDX-License-Identifier: GPL-3.0-or-later
"""Draws the views of a session: its meshes lit with and without the map, and the deviations of the map."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace

import gpu
import numpy as np

from ..core.declarations import readers
from ..core.declarations.choices import Pack, Space, Storage
from ..core.errors import BakeError
from ..core.settings import Settings
from ..engine import normal_channels, uv_agreement
from ..engine.bands import BAND_TEXELS, Band
from ..jobs.live_session import Session
from ..mesh.inputs import Meshes
from ..mesh.triangle_mesh import Mesh
from ..output import quantize
from ..passes import mesh_upload, target
from ..passes.view import deviation, lit
from .mode_names import Mode
from .view_objects import PULL, Eye, ViewObjects, ViewScene, view_projection

MIDDLE = 0.25
"""Share of the view's width for the low mesh without its map, between the other two."""
MOST_BYTES, LAYER_BYTES = 512 * 2**20, 16
"""The most GPU memory for the deviations of hidden parts, and what a texel of a layer takes."""


@dataclass(frozen=True)
class Figures:
    """Degrees between the shaded normals and those of the high surface, with and without the map, over texels of the whole map.

    elsewhere: the share of texels that are not measured, because Flatten has drawn another part of the high surface there.
    The other figures are NaN if no texel is measured.
    """

    mean: float
    percentile_99: float
    bare_mean: float
    bare_percentile_99: float
    elsewhere: float = 0.0


def settings_for(settings: Settings) -> Settings:
    """Settings for the same map in memory only, with one tile, and small enough for a single band."""
    width, height = settings.width, settings.height
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

    figures: the deviations of the map from the last `update` that measured them, or None. reader: the name of the program as
    which a tangent-space map is read; empty for those that it is made for.
    """

    def __init__(self, session: Session):
        """Raises BakeError for a map that is drawn in bands."""
        if session.map is None:
            settings = session.settings
            raise BakeError(
                f"A map of {settings.width} x {settings.height} texels is drawn in bands and is never whole on the GPU: "
                "choose a smaller size to see it live."
            )
        self.session, self.objects = session, ViewObjects(session)
        self.figures: Figures | None = None
        self.reader = ""
        self._number = 0
        self._measured: target.Target | None = None
        self._hidden: list[tuple[Mesh, target.Target]] = []
        self._hidden_parts: list[gpu.types.GPUBatch] = []
        self._hidden_scene: ViewScene | None = None
        self._square: gpu.types.GPUBatch | None = None

    def update(self, *, is_measured: bool, reader: str = "") -> None:
        """Use the session's last map, read as the program `reader` reads it. Do not call this while a view is being drawn."""
        if (self.session.drawn, reader) != (self._number, self.reader):
            self._number, self.reader, self.figures, self._measured = self.session.drawn, reader, None, None
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
                high, low, mapped = zones(width, split)
                with _only(x + high.start, y, len(high), height):
                    _draw_bare(scene.highs, matrix, light)
                with _only(x + low.start, y, len(low), height):
                    _draw_bare([scene.low], matrix, light)
                with _only(x + mapped.start, y, len(mapped), height):
                    self._draw_map(scene, matrix, light)
            elif self._measured is not None:
                how = {"limit": limit, "without_map": mode == Mode.BARE_DEVIATION}
                deviation.draw(scene.low[0], self._measured.texture, matrix, **how)
                if self._hidden_scene is not scene:
                    self._hidden_scene, self._hidden_parts = scene, [scene.part(low) for low, _ in self._hidden]
                for part, (_, measured) in zip(self._hidden_parts, self._hidden, strict=True):
                    deviation.draw(part, measured.texture, matrix, **how)  # over what was drawn of these triangles

    def draw_legend(self, place: tuple[float, float], size: tuple[float, float]) -> None:
        """Draw the colors of deviations as a bar. place, size: in pixels, from the lower left of the view."""
        if self._square is None:
            corners = np.array([(0, 0), (1, 0), (0, 1), (1, 1)], np.float32)
            self._square = mesh_upload.upload(np.array([(0, 1, 2), (2, 1, 3)], np.int32), position=corners)
        view = np.array(gpu.state.viewport_get()[2:])
        deviation.draw_legend(self._square, (*(np.multiply(size, 2) / view), *(np.multiply(place, 2) / view - 1.0)))

    def _draw_map(self, scene: ViewScene, matrix: np.ndarray, light: np.ndarray) -> None:
        low, normals = scene.low
        lit.draw(low, self.session.map, matrix, self._reading(normals, light))

    def _reading(self, normals: np.ndarray, light: np.ndarray | None = None) -> np.ndarray:
        """How the map is read, and the light, as the shaders take them."""
        settings, reader = self.session.settings, readers.BY_NAME.get(self.reader)
        if reader and settings.space == Space.TANGENT:
            read = normal_channels.reading_by(reader, settings)
        else:
            read = (255 if settings.depth == 8 else 0, *normal_channels.reading(settings)[1:])
        return lit.shading(normals, light, read=read)

    def _measure(self) -> None:
        settings, meshes = self.session.settings, self.session.meshes
        size = settings.width, settings.height
        with target.using(target.TargetPool()):  # frees the intermediate targets at the end
            self._measured = target.get("deviation", *size, "RGBA32F")
            high_normals, uploaded = self.session.high_normals(), self.objects.upload_low(self.objects.low)
            self._measure_low(self._measured, uploaded, high_normals, meshes)
            texels = [quantize.sample(_read(self._measured))]
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
            texels.append(quantize.sample(values))
        texels = np.concatenate(texels)
        measured, elsewhere = texels[texels[:, 3] > 0.0], np.count_nonzero(texels[:, 3] < -1.5)
        if len(measured) + elsewhere:
            means, highest = np.full((2, 2), np.nan)
            if len(measured):
                means = measured[:, :2].mean(axis=0, dtype=np.float64)
                highest = np.percentile(measured[:, :2], 99, axis=0)
            share = elsewhere / (len(measured) + elsewhere)
            self.figures = Figures(*map(float, (means[0], highest[0], means[1], highest[1], share)))

    def _measure_low(
        self, into: target.Target, uploaded: gpu.types.GPUBatch, high_normals: gpu.types.GPUTexture, meshes: Meshes
    ) -> None:
        """Write the deviations of the low mesh, or of a layer of hidden parts. meshes: of these triangles."""
        low = meshes.basis or meshes.low
        reading, elsewhere = self._reading(low.normal_matrix), self._elsewhere(meshes)
        where = {"elsewhere": elsewhere, "stretch": low.stretch}
        deviation.measure(into, uploaded, self.session.map, high_normals, reading, **where)

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
