# SPDX-License-Identifier: GPL-3.0-or-later
"""Draws all maps of a band from samples of the high surface, whose hits are found once."""

from collections.abc import Iterator, Sequence
from dataclasses import replace

import gpu

from ...core.map_types import NORMAL
from ...core.progress import Progress, Task, finish, part
from ...mesh.triangle_mesh import Mesh
from ...passes import target
from ...passes.bake import flat_hits, preview_picture, samples
from ...passes.surface import served_blocks
from ..adaptive.adaptive_normals import AdaptiveNormals
from ..adaptive.flat_normals import FlatNormals
from ..adaptive.normal_space import NormalSpace
from ..bands import Band
from ..normal_channels import channels
from ..sources import Flat, Source
from .family import MapFamily, Run, Sample
from .own_normals import OwnNormals

KEPT_BYTES = 512 * 2**20
"""The most GPU memory for the hits and normals of samples that are drawn together."""
HIT_BYTES = 32
"""The GPU memory of the hit and the normal of one texel."""
COARSE = 8
"""How many times smaller than the map the first picture is, if drawing takes long."""


class SampledMaps:
    """The maps of a band, as rendering.BandMaps has them: the normal map and those of `families`.

    basis: the low mesh with the tangent space of the normals; None for normals that keep the space of the source. detail: the
    high meshes' own normal and bump maps, or None.
    """

    def __init__(
        self,
        source: Source,
        basis: gpu.types.GPUBatch | None,
        families: Sequence[MapFamily],
        detail: OwnNormals | None,
        run: Run,
        *,
        basis_mesh: Mesh | None = None,
    ):
        self.source, self.basis, self.families, self.detail = source, basis, families, detail
        self.settings, self.timings, self.pace = run.settings, run.timings, run.pace
        self.space = NormalSpace(basis, basis_mesh, run.settings)
        # Maps of other families are means over the samples of each texel that they share.
        is_adaptive = run.settings.are_adaptive(source.method) and not families and detail is None
        kind = FlatNormals if isinstance(source, Flat) else AdaptiveNormals
        self.adaptive = kind(source, self.space, run) if is_adaptive else None
        self._picture: gpu.types.GPUTexture | None = None

    def of(self, band: Band) -> Task[Iterator[tuple[str, gpu.types.GPUTexture]]]:
        """The maps by name, each valid until the next one is asked for. Normals and values are the mean of all samples."""
        if self.adaptive is not None:
            return (yield from self._adaptive(band))
        count = self.settings.samples
        offsets = samples.offsets(count)
        central = min(offsets, key=lambda offset: offset[0] ** 2 + offset[1] ** 2)
        sums = target.get("sums", band.width, band.height, "RGBA32F") if count > 1 else None
        if sums is not None and self.pace.has_listener:
            target.clear(sums)  # the picture shows rows that are not drawn yet
        known = None
        size = self._group_size(band)
        for first in range(0, count, size):
            group = list(enumerate(offsets))[first : first + size]
            steps = self._group(band, [(number, offset, offset == central) for number, offset in group], sums)
            known = yield from part(steps, first / count, min(count, first + size) / count)
        return self._finished(band, known if sums is None else sums.texture, sums)

    def _adaptive(self, band: Band) -> Task[Iterator[tuple[str, gpu.types.GPUTexture]]]:
        """`of` with adaptive samples, of the normal map alone."""
        share = 2.0 / self.settings.samples  # later samples are drawn in a part of the texels
        share += 0.5 * (1.0 - share)
        for normals, _, done in self.adaptive.first(band):
            if self.pace.has_listener:
                yield self._step(normals, done * share, band)
        for done in self.adaptive.rest(band):
            if self.pace.has_listener:
                yield self._step(self.adaptive.mean, share + done * (1.0 - share), band)
        return iter([(NORMAL.name, self.adaptive.mean)])

    def high_normals(self, band: Band) -> gpu.types.GPUTexture:
        """The normals of the high surface at the centers of texels, with its own maps, in the space of the source."""
        for _ in self.source.normals(band):
            pass
        if self.detail is not None:
            finish(self.detail.apply([Sample(band, 0, True, self.source.drawn(), self.source.hits(band))]))
        return self.source.drawn().texture

    def coarse(self, tile: int) -> Task[None]:
        """A first, coarse picture of the whole map."""
        settings = self.settings
        size = max(1, settings.width // COARSE), max(1, settings.height // COARSE)
        band = Band(0, size[1], size, 0, tile)
        for normals, _ in self._normals(band):
            yield self._step(normals, 0.0, band, clear=True)

    @property
    def takes_time(self) -> bool:
        return self.source.takes_time

    @property
    def stopped(self) -> int:
        """As BandMaps has it."""
        return self.adaptive.stopped if self.adaptive else 0

    @property
    def _has_pages(self) -> bool:
        """Whether images of the high meshes are looked up."""
        return self.detail is not None or any(family.has_pages for family in self.families)

    def _group_size(self, band: Band) -> int:
        """How many samples are drawn together: as many as fit, if images have to be loaded for them."""
        texels = band.width * band.height
        return max(1, min(self.settings.samples, KEPT_BYTES // (HIT_BYTES * texels))) if self._has_pages else 1

    def _group(
        self, band: Band, group: Sequence[tuple[int, tuple[float, float], bool]], sums: target.Target | None
    ) -> Task[gpu.types.GPUTexture]:
        """Draw some samples: hits, normals, then all other maps. Returns the normals of the last sample."""
        efforts = [1.0, *(family.effort for family in self.families)]
        whole = sum(efforts)
        drawn, known = [], None
        for slot, (number, offset, is_central) in enumerate(group):
            sample_band = replace(band, offset=offset)
            for normals, rows in self._normals(sample_band, slot):
                known = normals
                if sums is not None and self.detail is None and rows:
                    with self.timings.timed("draw"):
                        samples.add(sums, normals, rows, is_first=number == 0)
                if self.pace.has_listener:
                    done = (slot + rows.stop / band.height) / len(group) / whole
                    # Normals with detail are added to the sums after a group.
                    has_sums = sums is not None and (self.detail is None or group[0][0] > 0)
                    yield self._step(sums.texture if has_sums else normals, done, band)
            if self.families or self.detail is not None:
                hits = self.source.hits(sample_band, slot)
                if self.detail is None:
                    self._clip(hits, known)
                blocks = None
                if self._has_pages:
                    with self.timings.timed("draw"):
                        blocks = served_blocks.find(hits, self.source.surface.labels)
                drawn.append(Sample(sample_band, number, is_central, self.source.drawn(slot), hits, blocks))
        if self.detail is not None:
            known = yield from part(self._with_detail(drawn, sums), efforts[0] / whole, efforts[0] / whole)
        before = efforts[0]
        for family in self.families:
            yield from part(family.add(drawn), before / whole, (before + family.effort) / whole)
            before += family.effort
        return known

    def _with_detail(self, drawn: Sequence[Sample], sums: target.Target | None) -> Task[gpu.types.GPUTexture]:
        """Apply the high meshes' own maps to the normals of some samples, and add them to the sums."""
        yield from self.detail.apply(drawn)
        known = None
        for sample in drawn:
            with self.timings.timed("draw"):
                known = self.space.draw(sample.normals.texture, sample.band, range(sample.band.height))
                self._clip(sample.hits, known)
                if sums is not None:
                    samples.add(sums, known, range(sample.band.height), is_first=sample.number == 0)
        return known

    def _clip(self, hits: target.Target, normals: gpu.types.GPUTexture) -> None:
        """Leave the hits of a sample where its normal counts, so that all maps are means of the same samples."""
        if self.settings.samples > 1 and not self.source.is_within_low:
            flat_hits.clip(hits, normals)

    def _finished(
        self, band: Band, known: gpu.types.GPUTexture, sums: target.Target | None
    ) -> Iterator[tuple[str, gpu.types.GPUTexture]]:
        if sums is None:
            yield NORMAL.name, known
        else:
            is_turned = self.basis is not None
            into = target.get("low", band.width, band.height, "RGBA32F") if is_turned else self.source.drawn()
            with self.timings.timed("draw"):
                samples.average(into, sums)
            yield NORMAL.name, into.texture
        for family in self.families:
            yield from family.finished(band, known)

    def _normals(self, band: Band, slot: int = 0) -> Iterator[tuple[gpu.types.GPUTexture, range]]:
        """One sample of the normals of a band, in the space of the settings, in slices."""
        drawn = self.source.normals(band, slot)
        while True:
            with self.timings.timed("draw"):
                normals, rows = next(drawn, (None, None))
                if normals is None:
                    return
                # Detail is added in the space of the source; then only the picture needs them.
                if rows and (self.detail is None or (self.pace.has_listener and self.pace.has_picture)):
                    normals = self.space.draw(normals, band, rows)
            yield normals, rows

    def _step(self, normals: gpu.types.GPUTexture, done: float, band: Band, *, clear: bool = False) -> Progress:
        size = self.settings.width, self.settings.height
        # Of a map in bands, only the coarse picture is shown.
        if band.is_whole and (clear or self.pace.takes_picture()):
            self._picture = preview_picture.draw(normals, size, channels(self.settings), clear=clear)
        return Progress("Drawing", done, self._picture)
