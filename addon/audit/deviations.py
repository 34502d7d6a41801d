# SPDX-License-Identifier: GPL-3.0-or-later
"""Measures angles in degrees: how far the low mesh with its map deviates from the high meshes, and what other engines show."""

from collections.abc import Iterable, Mapping
from functools import cached_property
from typing import Any

import gpu
import numpy as np

from ..core.declarations import bases, targets
from ..core.declarations.choices import Space
from ..core.map_types import WRITTEN, Map
from ..core.sentences import LOOK, Sentence
from ..core.settings import Settings
from ..engine import bands, normal_space, uv_agreement
from ..engine.baking import Drawing
from ..engine.bands import Band
from ..engine.sampling import SampledMaps
from ..engine.stacked_uvs import Layer, StackedParts
from ..mesh import triangle_mesh
from ..mesh.inputs import Meshes
from ..mesh.triangle_mesh import Mesh
from ..passes import audit, block_encoding, data_texture, lit, mesh_upload, target, viewport
from . import severity
from .pictures import BakePictures


class _Drawn:
    """What is measured together: the low mesh, or a layer of hidden parts. meshes, highs: of these triangles."""

    def __init__(self, drawing: Drawing, layer: Layer | None = None):
        self.meshes, self._drawing, self.layer = drawing.plan.meshes, drawing, layer
        self.low = self.meshes.basis or self.meshes.low

    @property
    def highs(self) -> SampledMaps:
        return self._drawing.maps

    def bands(self, size: tuple[int, int], tile: int) -> Iterable[Band]:
        """The bands in which a map of this size is measured."""
        if self.layer is not None:
            return self.layer.bands(size, tile)
        return bands.bands(*size, 0, tile, texel_bytes=self.highs.texel_bytes)

    @cached_property
    def uploaded(self) -> gpu.types.GPUBatch:
        """The low mesh as viewport.measure_deviation takes it."""
        return mesh_upload.upload(self.low.triangles, **self.low.tangent_space)


class Deviations:
    """The angles at the centers of texels, with the map as it is kept, and read by its own basis.

    Each triangle of the low mesh counts at its own place, also where it shares texels that were drawn for another one. Texels
    on which Flatten draws another place of the high surface are left out. drawing: of the bake, with own hits. It takes
    about as long as one sample. pictures: receives them. hidden: the parts of the low mesh that others hide; None to leave
    them out.
    """

    def __init__(
        self,
        drawing: Drawing,
        settings: Settings,
        pictures: BakePictures | None = None,
        *,
        hidden: StackedParts | None = None,
    ):
        self._plan, self.settings, self._pictures = drawing.plan, settings, pictures
        self._counts, self._hidden, self._pool = AngleCounts(), hidden, target.TargetPool()
        self.whole = _Drawn(drawing)

    def add(self, tile: int, kept: Map) -> None:
        """Measure a UDIM tile of the normal map as images and files keep it."""
        height, width = kept[1].shape
        self._add(tile, kept, self.whole.bands((width, height), tile), self.whole)
        with target.using(self._pool):
            for drawn in self._layers:
                self._add(tile, kept, drawn.bands((width, height), tile), drawn)
        self._pool.free()

    @cached_property
    def _layers(self) -> list[_Drawn]:
        return [_Drawn(layer.drawing, layer) for layer in (self._hidden.layers if self._hidden else [])]

    def _add(self, tile: int, kept: Map, of_tile: Iterable[Band], drawn: _Drawn) -> None:
        """Measure some bands of a tile."""
        texels, state = kept
        elsewhere = self.elsewhere(tile, drawn.meshes)
        for band in of_tile:
            rows = slice(band.start, band.stop)
            part = np.arange(band.start, band.stop) * len(elsewhere) // len(state)
            angles = self.angles(band.without_halo, texels[rows], elsewhere[part], drawn)
            is_drawn = state[rows] == WRITTEN
            if drawn.layer is not None and self._hidden is not None:
                is_drawn &= (angles[..., 3] != 0.0) & self._hidden.is_hidden(drawn.layer, band)
            is_known = is_drawn & (angles[..., 3] > 0.0)
            self._counts.add(angles[is_known][:, 0])
            if self._pictures is not None:
                self._pictures.add_degrees(tile, band.start, angles[..., 0], is_known, is_drawn)

    def results(self) -> dict[str, float | int]:
        """The angles as Report.deviation has them; empty if no texel was measured."""
        return self._counts.with_wrong()

    def elsewhere(self, tile: int, meshes: Meshes) -> np.ndarray:
        """Where the high surface that is drawn is another place, as viewport.measure_deviation takes it."""
        if self._plan.casts_rays or meshes.is_own_base:
            return np.zeros((1, 1), bool)
        return uv_agreement.mismatched(meshes.low, meshes.drawn_highs, tile)

    def angles(self, band: Band, texels: np.ndarray, elsewhere: np.ndarray, drawn: _Drawn) -> np.ndarray:
        """What viewport.measure_deviation writes, (height, width, 4) float32."""
        low, settings = drawn.low, self.settings
        read = normal_space.reading(settings.map)
        measured = target.get("deviation", band.width, band.height, "RGBA32F")
        viewport.measure_deviation(
            measured,
            drawn.uploaded,
            data_texture.image(texels),
            drawn.highs.high_normals(band),
            lit.shading(low.normal_matrix, read=read),
            elsewhere=elsewhere,
            stretch=low.stretch,
            uv_to_clip=band.uv_to_clip,
        )
        return measured.texels()


WRONG = 20.0
"""Degrees from which a texel is taken for one of another surface, or of none."""
UNSEEN = 0.35
"""Degrees that do not count in what a map leaves of the detail: 8 bits turn 99 % of the normals by less."""
LEAST_DETAIL = 0.5
"""Degrees of detail, as a mean, below which what a map leaves of it is told as a share of this."""
MOST_BETWEEN = 1025
"""The most places along a side of the map that BetweenTexels looks at. Odd, so that they lie anywhere between texels."""


class BetweenTexels:
    """The angles between the normals that the low mesh shows with its map, read between texels as programs read it, and those
    of the high surface there. Where texels are too few for the detail, they are large, though each texel is right.

    Arguments as in Deviations.
    """

    def __init__(self, drawing: Drawing, settings: Settings):
        self._of = Deviations(drawing, settings)
        self._counts, self._sums = AngleCounts(), np.zeros(2)

    def add(self, tile: int, kept: Map) -> None:
        """Measure a UDIM tile of the normal map as images and files keep it."""
        drawn, texels = self._of.whole, kept[0]
        width, height = (min(2 * side + 1, MOST_BETWEEN) for side in kept[1].shape[::-1])
        for band in drawn.bands((width, height), tile):
            rows = band.start + np.arange(band.stop - band.start) + 0.5
            between = _between(texels, rows / height, (np.arange(width) + 0.5) / width)
            angles = self._of.angles(band.without_halo, between, self._of.elsewhere(tile, drawn.meshes), drawn)
            known = angles[angles[..., 3] > 0.0]
            self._counts.add(known[:, 0])
            self._sums += np.maximum(known[:, :2] - (UNSEEN, 0.0), 0.0).sum(axis=0)

    def results(self) -> dict[str, float | int]:
        """As Report.between has it; empty if nothing was measured."""
        counts = self._counts.with_wrong()
        if counts:
            with_map, without = self._sums / counts["texels"]
            counts["left"] = float(with_map / max(without, LEAST_DETAIL))
        return counts


def _between(texels: np.ndarray, rows: np.ndarray, columns: np.ndarray) -> np.ndarray:
    """Texels (h, w, n), read by linear interpolation at places (R,) along v and (C,) along u, from 0 to 1: (R, C, n) float32.

    The map repeats."""
    for axis, places in enumerate((rows, columns)):
        count = texels.shape[axis]
        first = np.floor(places * count - 0.5).astype(np.int64)
        share = (places * count - 0.5 - first).astype(np.float32)[(slice(None), *[None] * (2 - axis))]
        one, other = (texels.take((first + step) % count, axis) for step in (0, 1))
        texels = one + (other - one) * share
    return np.ascontiguousarray(texels, np.float32)


class OtherEngines:
    """The angles between the normals that a map means, before it is rounded or encoded, and those that programs show of what is
    stored, and of what their own compressors leave of that.

    low: the low mesh with its tangents; None for a map in another space, which no engine reads. warnings: names the engines
    that cannot be measured, as they make other tangents of an unevenly scaled mesh.
    """

    def __init__(self, low: Mesh | None, settings: Settings):
        self.engines, self.warnings = [], []
        self.low, self.settings = low, settings
        self._uploaded: gpu.types.GPUBatch | None = None
        if low is not None and settings.map.space == Space.TANGENT and settings.map.normal:
            self._choose(low)
        self._counts = {(engine.name, ""): AngleCounts() for engine in self.engines}
        if not settings.storing.is_blocks:
            compressing = [engine for engine in self.engines if engine.compresses]
            self._counts |= {(engine.name, engine.compresses): AngleCounts() for engine in compressing}

    def _choose(self, low: Mesh) -> None:
        """Note the engines that can be measured, and warn of the others."""
        named = [targets.BY_NAME[name] for name in self.settings.map.targets]
        own = bases.of_name(self.settings.map.basis)
        is_uneven = bool(named) and triangle_mesh.is_uneven(low.to_world)
        self.engines = [engine for engine in named if not is_uneven or engine.basis.has_tangents_of(own)]
        unlike = ", ".join(engine.label for engine in named if engine not in self.engines)
        if unlike:
            self.warnings.append(
                f"{unlike}: of {low.name!r}, which is scaled more along one axis than along another, other tangents are made "
                "there than the map is for. Apply the scale (Object > Apply > Scale) and bake again."
            )

    def add(self, tile: int, meant: Map, kept: np.ndarray) -> None:
        """Measure a UDIM tile of the normal map.

        Args:
            meant: as it is stored, before it is rounded or encoded.
            kept: what images and files keep of its texels, (height, width, 4) float32.
        """
        low = self.low
        if not self.engines or low is None:
            return
        texels, state = meant
        if self._uploaded is None:
            self._uploaded = mesh_upload.upload(low.triangles, uv=low.uv, normal=low.normals, tangent=low.tangents)
        own = normal_space.reading(self.settings.map)
        names = dict.fromkeys(name for _, name in self._counts)
        shown = {name: block_encoding.compressed(kept, name) if name else kept for name in names}
        for band in bands.bands(state.shape[1], state.shape[0], 0, tile):
            rows, to_clip = slice(band.start, band.stop), band.without_halo.uv_to_clip
            texture = data_texture.image(texels[rows])
            read = {name: data_texture.image(of_name[rows]) for name, of_name in shown.items()}
            is_written = state[rows] == WRITTEN
            for (engine, name), counts in self._counts.items():
                other = normal_space.reading_by(targets.BY_NAME[engine], self.settings, is_compressed=bool(name))
                angles = audit.measure_engine_angles(self._uploaded, texture, read[name], to_clip, own=own, other=other)
                counts.add(angles[is_written & (angles >= 0.0)])

    def results(self, backwards: int) -> dict[str, dict[str, float | int | dict[str, float | int]]]:
        """The angles by the names of the engines, as Report.targets has them. backwards: the texels with a z of 0 or less."""
        results: dict[str, dict[str, float | int | dict[str, float | int]]] = {}
        for engine in self.engines:
            stored = self._counts[engine.name, ""].results()
            results[engine.name] = {**stored, "rebuilt": backwards if engine.rebuilds_z else 0}
            compressed = self._counts.get((engine.name, engine.compresses)) if engine.compresses else None
            if compressed:
                results[engine.name]["compressed"] = compressed.results()
        return results


def engine_warnings(results: Mapping[str, Mapping[str, Any]]) -> list[Sentence]:
    """A sentence for the programs that show texels wrong because they make z of x and y."""
    wrong = {targets.BY_NAME[name].label: result["rebuilt"] for name, result in results.items() if result["rebuilt"]}
    if not wrong:
        return []
    count = max(wrong.values())
    text = f"{', '.join(wrong)}: z is made of x and y there, and {count:,} texels with a z of 0 or less come out wrong."
    return [Sentence(text, LOOK, severity.REBUILT)]


def other_greens(names: Iterable[str], green: str) -> list[str]:
    """A sentence for each of these programs that reads another green than the map stores."""
    engines = [targets.BY_NAME[name] for name in names]
    return [
        f"{engine.label} reads green as {engine.green}, and this map has {green}: set green to {engine.green.lower()}."
        for engine in engines
        if engine.green != green
    ]


DROPPED = 11
"""The last bits of an angle in single precision that its bin leaves out. Percentiles are within 0.02 % of angles, small ones
too."""
BINS = (int(np.float32(180.0).view(np.int32)) >> DROPPED) + 1


class AngleCounts:
    """Angles in degrees, from 0 to 180."""

    def __init__(self):
        self._counts = np.zeros(BINS, np.int64)
        self._largest, self._is_any = 0.0, False

    def add(self, angles: np.ndarray, weight: int = 1) -> None:
        """Count angles (N,), each as so many texels."""
        if len(angles):
            # The bits of numbers that are not negative have the order of the numbers.
            bins = np.clip(angles, np.float32(0.0), np.float32(180.0)).astype(np.float32).view(np.int32) >> DROPPED
            np.add.at(self._counts, bins, weight)  # counts of all bins would be far more numbers
            self._largest, self._is_any = max(self._largest, float(angles.max())), True

    def results(self) -> dict[str, float | int]:
        """The median, percentile_95, percentile_99 and maximum, and the number of texels."""
        sums = np.cumsum(self._counts)
        median, most, nearly_all = (
            self._of_bin(int(np.searchsorted(sums, share * max(1, sums[-1])))) for share in (0.5, 0.95, 0.99)
        )
        return {
            "median": median,
            "percentile_95": most,
            "percentile_99": nearly_all,
            "maximum": self._largest,
            "texels": int(sums[-1]),
        }

    def with_wrong(self) -> dict[str, float | int]:
        """The results, and the share of the texels that are more than WRONG degrees off (wrong); empty without texels."""
        if not self._is_any:
            return {}
        results = self.results()
        first = int(np.float32(WRONG).view(np.int32)) >> DROPPED
        return {**results, "wrong": float(self._counts[first:].sum()) / results["texels"]}

    def _of_bin(self, number: int) -> float:
        """The middle of a bin, at most the largest angle."""
        middle = (int(number) << DROPPED) + (1 << DROPPED - 1) if number else 0
        return min(float(np.int32(middle).view(np.float32)), self._largest)
