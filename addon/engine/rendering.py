# SPDX-License-Identifier: GPL-3.0-or-later
"""Runs the passes in order, band by band, from a source to arrays of texels."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace

import gpu
import numpy as np

from ..core import map_types
from ..core.declarations import bases
from ..core.map_types import NORMAL, Kind
from ..core.progress import Pace, Progress, Task, part
from ..core.settings import Settings
from ..core.texel_state import Map
from ..core.timings import Timings
from ..mesh.triangle_mesh import Mesh
from ..passes import mesh_upload, target
from ..passes.bake import preview_picture, samples, tangent
from .bands import Band, bands
from .margins import PostProcess
from .normal_channels import channels
from .sources import Source

COARSE = 8
"""How many times smaller than the map the first picture is, if drawing takes long."""


class Renderer:
    """Draws the maps of one bake, tile by tile: the normal map and the maps in the settings.

    basis: the mesh with the tangent space of the normals; None for normals that keep the space of the source. uploads: a
    cache of uploaded meshes.
    """

    def __init__(
        self,
        source: Source,
        basis: Mesh | None,
        settings: Settings,
        timings: Timings,
        pace: Pace,
        *,
        uploads: mesh_upload.UploadCache | None = None,
    ):
        self.source, self.settings, self.timings, self.pace = source, settings, timings, pace
        self._picture: gpu.types.GPUTexture | None = None
        self.basis = None
        if basis is not None:
            with timings.timed("upload"):
                self.basis = (uploads or mesh_upload.UploadCache()).upload(
                    f"{basis.name} as basis",
                    basis.triangles,
                    uv=basis.uv,
                    normal=basis.normals,
                    tangent=basis.tangents,
                )

    def texels(self, tile: int, post_processes: dict[str, PostProcess]) -> Task[dict[str, Map]]:
        """The maps of a tile by name, as they are stored."""
        size = self.settings.height, self.settings.width
        maps = {name: (np.empty((*size, 4), np.float32), np.empty(size, np.uint8)) for name in post_processes}

        def keep(name: str, band: Band, drawn: gpu.types.GPUTexture) -> None:
            with self.timings.timed("draw"):
                stored = post_processes[name].draw(band, drawn)
                stored.finish()
            with self.timings.timed("read"):
                for slot, array in enumerate(maps[name]):
                    stored.read(array[band.start : band.stop], slot)

        yield from self._banded(tile, self.settings.margin, keep)
        with self.timings.timed("draw"):
            for name, process in post_processes.items():
                process.complete(tile, *maps[name])
        return maps

    def raw(self, tile: int) -> Task[dict[str, np.ndarray]]:
        """The maps of a tile by name, without encoding and margin: (height, width, 4) float32, alpha as in Source."""
        settings = self.settings
        maps = {
            name: np.empty((settings.height, settings.width, 4), np.float32) for name in (NORMAL.name, *settings.maps)
        }

        def keep(name: str, band: Band, drawn: gpu.types.GPUTexture) -> None:
            with self.timings.timed("read"):
                target.read(drawn, maps[name][band.start : band.stop])

        yield from self._banded(tile, 0, keep)
        return maps

    def _banded(
        self, tile: int, margin: int | None, keep: Callable[[str, Band, gpu.types.GPUTexture], None]
    ) -> Task[None]:
        settings = self.settings
        parts = list(bands(settings.width, settings.height, margin, tile))
        if self.pace.has_listener and self.pace.has_picture and self.source.takes_time:
            yield from part(self._coarse(tile), 0.0, 0.0)
        for number, band in enumerate(parts):
            maps = yield from part(self._sampled(band), number / len(parts), (number + 1) / len(parts))
            for name, drawn in maps.items():
                keep(name, band, drawn)

    def _coarse(self, tile: int) -> Task[None]:
        """A first, coarse picture of the whole map."""
        settings = self.settings
        size = max(1, settings.width // COARSE), max(1, settings.height // COARSE)
        band = Band(0, size[1], size, 0, tile)
        for normals, _ in self._normals(band):
            yield self._step(normals, 0.0, band, clear=True)

    def _sampled(self, band: Band) -> Task[dict[str, gpu.types.GPUTexture]]:
        """The maps of a band. Normals and values are the mean of all samples, labels are the central sample."""
        settings, count = self.settings, self.settings.samples
        if count == 1:
            for drawn, rows in self._normals(band):
                if self.pace.has_listener:
                    yield self._step(drawn, rows.stop / band.height, band)
            return {NORMAL.name: drawn} | {name: self._surface_map(name, band) for name in settings.maps}
        sums = target.get("sums", band.width, band.height, "RGBA32F")
        if self.pace.has_listener:
            target.clear(sums)  # the picture shows rows that are not drawn yet
        labels = [name for name in settings.maps if map_types.BY_NAME[name].kind is Kind.LABEL]
        values = [name for name in settings.maps if name not in labels]
        offsets = samples.offsets(count)
        central = min(offsets, key=lambda offset: offset[0] ** 2 + offset[1] ** 2)
        for number, offset in enumerate(offsets):
            sample = replace(band, offset=offset)
            for drawn, rows in self._normals(sample):
                with self.timings.timed("draw"):
                    samples.add(sums, drawn, rows, is_first=number == 0)
                if self.pace.has_listener:
                    yield self._step(sums.texture, (number + rows.stop / band.height) / count, band)
            for name in values:
                self._add(name, sample, is_first=number == 0)
            for name in labels if offset == central else ():
                self._surface_map(name, sample)
        return self._means(band, values, labels)

    def _add(self, name: str, sample: Band, *, is_first: bool) -> None:
        """Add one sample of a map of kind VALUE to its sums."""
        sums, drawn = (
            target.get(f"sums of {name}", sample.width, sample.height, "RGBA32F"),
            self._surface_map(name, sample),
        )
        with self.timings.timed("draw"):
            samples.add(sums, drawn, range(sample.height), is_first=is_first)

    def _means(self, band: Band, values: Sequence[str], labels: Sequence[str]) -> dict[str, gpu.types.GPUTexture]:
        """The maps of a band from the sums of their samples. Maps of kind LABEL are already drawn."""

        def drawn(role: str) -> target.Target:
            return target.get(role, band.width, band.height, "RGBA32F")

        with self.timings.timed("draw"):
            normals = drawn("low" if self.basis else "high")
            samples.average(normals, drawn("sums"))
            for name in values:
                samples.average(drawn(name), drawn(f"sums of {name}"), is_direction=False)
            return {NORMAL.name: normals.texture} | {name: drawn(name).texture for name in (*values, *labels)}

    def _normals(self, band: Band) -> Iterator[tuple[gpu.types.GPUTexture, range]]:
        """One sample of the normals of a band, in the space of the settings, in slices."""
        drawn = self.source.normals(band)
        while True:
            with self.timings.timed("draw"):
                normals, rows = next(drawn, (None, None))
                if normals is None:
                    return
                if self.basis is not None:
                    in_tangent_space = target.get("low", band.width, band.height, "RGBA32F")
                    is_unit = bases.of_name(self.settings.basis).normalizes_normal
                    tangent.draw(
                        in_tangent_space, self.basis, normals, band.uv_to_clip, normalize_normal=is_unit, rows=rows
                    )
                    normals = in_tangent_space.texture
            yield normals, rows

    def _surface_map(self, name: str, band: Band) -> gpu.types.GPUTexture:
        """One sample of a map other than the normal map."""
        with self.timings.timed("draw"):
            return self.source.surface_map(name, band, target.get(name, band.width, band.height, "RGBA32F"))

    def _step(self, normals: gpu.types.GPUTexture, done: float, band: Band, *, clear: bool = False) -> Progress:
        size = self.settings.width, self.settings.height
        if band.is_whole:  # of a larger map, only the coarse picture is shown
            self._picture = preview_picture.draw(normals, size, channels(self.settings), clear=clear)
        return Progress("Drawing", done, self._picture)
