# SPDX-License-Identifier: GPL-3.0-or-later
"""Draws all maps of a band from samples of the high surface, whose hits are found once."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import partial

import gpu
import numpy as np

from ..core.declarations.choices import Method
from ..core.map_types import BY_NAME, NORMAL
from ..core.preflight import texel_bytes
from ..core.progress import Progress, Task, finish, part, relay
from ..core.settings import Run
from ..mesh import uv_layout
from ..mesh.inputs import Meshes
from ..passes import allocation, high_in_uv, mesh_upload, samples, surface_tables, target, viewport
from . import map_families, material_maps, ray_maps
from .bands import Band, BandMaps
from .map_families import FamilyInputs, MapFamily, Sample
from .material_maps import OwnNormals
from .normal_space import NormalSpace, channels
from .rounded_edges import RoundedEdges
from .sources import FlatAndRays, Rays, Slices, Source, world_to_space

KEPT_BYTES = 512 * 2**20
"""The most GPU memory for the hits and normals of samples that are drawn together, where the budget has room for them."""
HIT_BYTES = 32
"""The GPU memory of the hit and the normal of one texel."""
COARSE = 8
"""How many times smaller than the map the first picture is, if drawing takes long."""


class SampledMaps(BandMaps):
    """The maps of a band from samples: the normal map and those of `families`.

    space: of the normals. details: what turns normals at hits: the high meshes' own maps, rounded edges.

    Samples are added up in the space of the source, and only their mean is turned: programs turn a texel by one basis, too.
    """

    def __init__(
        self,
        source: Source,
        space: NormalSpace,
        families: Sequence[MapFamily],
        details: Sequence[OwnNormals | RoundedEdges],
        run: Run,
    ):
        self.source, self.space, self.families, self.details = source, space, families, details
        self.settings, self.timings, self.pace = run.settings, run.timings, run.pace
        # Maps of other families are means over the samples of each texel that they share.
        is_alone = not families and not details
        self.adaptive: AdaptiveNormals | None = None
        if isinstance(source, Rays) and is_alone and run.settings.sampling.are_adaptive(source.method):
            self.adaptive = AdaptiveNormals(source, run)
        self._picture: gpu.types.GPUTexture | None = None
        self._most_texels = 0
        """Of a band so far."""

    def of(self, band: Band) -> Task[Iterator[tuple[str, gpu.types.GPUTexture]]]:
        """The maps by name, each valid until the next one is asked for. Normals and values are the mean of all samples."""
        if self.adaptive is not None:
            return (yield from self._adaptive(self.adaptive, band))
        count = self.settings.sampling.samples
        offsets = samples.offsets(count)
        central = min(offsets, key=lambda offset: offset[0] ** 2 + offset[1] ** 2)
        sums = target.get("sums", band.width, band.height, "RGBA32F") if count > 1 else None
        if sums is not None and self.pace.has_listener:
            target.clear(sums)  # the picture shows rows that are not drawn yet
        size = self._group_size(band)
        for first in range(0, count, size):
            group = list(enumerate(offsets))[first : first + size]
            steps = self._group(band, [(number, offset, offset == central) for number, offset in group], sums)
            yield from part(steps, first / count, min(count, first + size) / count)
        return self._finished(band, sums)

    def _adaptive(self, adaptive: "AdaptiveNormals", band: Band) -> Task[Iterator[tuple[str, gpu.types.GPUTexture]]]:
        """`of` with adaptive samples, of the normal map alone."""
        share = 2.0 / self.settings.sampling.samples  # later samples are drawn in a part of the texels
        share += 0.5 * (1.0 - share)
        for normals, _, done in adaptive.first(band):
            if self.pace.has_listener:
                yield self._step(normals, done * share, band)
        for done in adaptive.rest(band):
            if self.pace.has_listener:
                yield self._step(adaptive.mean, share + done * (1.0 - share), band)
        with self.timings.timed("draw"):
            turned = self.space.of_texels(adaptive.mean, band)
        return iter([(NORMAL.name, turned)])

    def high_normals(self, band: Band) -> gpu.types.GPUTexture:
        """The normals of the high surface at the centers of texels, with its own maps, in the space of the source."""
        for _ in self.source.normals(band):
            pass
        if self.details:
            hits, covered = self.source.hits(band), self.source.covered(band)
            finish(self._turn([Sample(band, 0, True, self.source.drawn(), hits, covered)]))
        return self.source.drawn().texture

    def coarse(self, tile: int) -> Task[None]:
        """A first, coarse picture of the whole map."""
        settings = self.settings
        size = max(1, settings.sampling.width // COARSE), max(1, settings.sampling.height // COARSE)
        band = Band(0, size[1], size, 0, tile)
        for normals, _ in self._normals(band):
            yield self._step(normals, 0.0, band, clear=True)

    @property
    def texel_bytes(self) -> int:
        method = Method.AUTO if isinstance(self.source, FlatAndRays) else self.source.method
        return texel_bytes(self.settings, method, has_detail=bool(self.details))

    @property
    def takes_time(self) -> bool:
        return self.source.takes_time

    @property
    def stopped(self) -> np.ndarray | None:
        return self.adaptive.stopped if self.adaptive else None

    @property
    def _has_images(self) -> bool:
        """Whether images of the high meshes are looked up."""
        return any(each.has_images for each in (*self.details, *self.families))

    def _group_size(self, band: Band) -> int:
        """How many samples are drawn together: as many as fit, if images have to be loaded for them."""
        if not self._has_images:
            return 1
        # A last band of fewer rows takes no larger group: targets of the band before it are still there.
        self._most_texels = texels = max(self._most_texels, band.width * band.height)
        left = allocation.budget() - texels * (self.texel_bytes - HIT_BYTES)
        return max(1, min(self.settings.sampling.samples, min(KEPT_BYTES, left) // (HIT_BYTES * texels)))

    def _group(
        self, band: Band, group: Sequence[tuple[int, tuple[float, float], bool]], sums: target.Target | None
    ) -> Task[None]:
        """Draw some samples: hits, normals, then all other maps."""
        efforts = [1.0, *(family.effort for family in self.families)]
        whole = sum(efforts)
        drawn = []
        for slot, (number, offset, is_central) in enumerate(group):
            sample_band = replace(band, offset=offset)
            for normals, rows in self._normals(sample_band, slot):
                if sums is not None and not self.details and rows:
                    with self.timings.timed("draw"):
                        samples.add(sums, normals, rows, is_first=number == 0)
                if self.pace.has_listener:
                    done = (slot + rows.stop / band.height) / len(group) / whole
                    # Normals with detail are added to the sums after a group.
                    has_sums = not self.details or group[0][0] > 0
                    yield self._step(normals if sums is None or not has_sums else sums.texture, done, band)
            if self.families or self.details:
                hits = self.source.hits(sample_band, slot)
                blocks = None
                if self._has_images and self.source.surface is not None:
                    with self.timings.timed("draw"):
                        blocks = surface_tables.find_blocks(hits, self.source.surface.labels)
                covered = self.source.covered(sample_band)
                drawn.append(Sample(sample_band, number, is_central, self.source.drawn(slot), hits, covered, blocks))
        if self.details:
            yield from part(self._with_details(drawn, sums), efforts[0] / whole, efforts[0] / whole)
        if self.families and sums is not None and not self.source.is_within_low:
            for sample in drawn:
                self._leave_on_low(sample)
        before = efforts[0]
        for family in self.families:
            yield from part(family.add(drawn), before / whole, (before + family.effort) / whole)
            before += family.effort

    def _turn(self, drawn: Sequence[Sample]) -> Task[None]:
        """Turn the normals of some samples."""
        for detail in self.details:
            yield from detail.apply(drawn)

    def _with_details(self, drawn: Sequence[Sample], sums: target.Target | None) -> Task[None]:
        """Turn the normals of some samples, and add them to the sums."""
        yield from self._turn(drawn)
        if sums is None:
            return
        for sample in drawn:
            with self.timings.timed("draw"):
                samples.add(sums, sample.normals.texture, range(sample.band.height), is_first=sample.number == 0)

    def _leave_on_low(self, sample: Sample) -> None:
        """Leave the hits of a sample where it is on the low mesh too, and count them. Other maps are their means."""
        with self.timings.timed("draw"):
            known = self.space.of_sample(sample.normals.texture, sample.band)
            high_in_uv.clip_hits(sample.hits, known)
            samples.add(self._on_low(sample.band), known, range(sample.band.height), is_first=sample.number == 0)

    def _on_low(self, band: Band) -> target.Target:
        return target.get("sums on the low mesh", band.width, band.height, "RGBA32F")

    def _finished(self, band: Band, sums: target.Target | None) -> Iterator[tuple[str, gpu.types.GPUTexture]]:
        """sums: of the samples; None for a single one."""
        mean = self.source.drawn()
        with self.timings.timed("draw"):
            if sums is not None:
                samples.average(mean, sums)
            turned = self.space.of_texels(mean.texture, band)
        yield NORMAL.name, turned
        known = turned
        if sums is not None and self.families:
            known = sums.texture if self.source.is_within_low else self._on_low(band).texture
        for family in self.families:
            yield from family.finished(band, known)

    def _normals(self, band: Band, slot: int = 0) -> Slices:
        """One sample of the normals of a band, in slices."""
        return relay(self.source.normals(band, slot), within=partial(self.timings.timed, "draw"))

    def _step(self, normals: gpu.types.GPUTexture, done: float, band: Band, *, clear: bool = False) -> Progress:
        size = self.settings.sampling.width, self.settings.sampling.height
        # Of a map in bands, only the coarse picture is shown.
        if band.is_whole and (clear or self.pace.takes_picture()):
            clear = clear or self._picture is None  # it may show another bake, and new memory shows anything
            shown = self.space.of_sample(normals, band)
            self._picture = viewport.draw_preview(shown, size, channels(self.settings.map), clear=clear)
        return Progress("Drawing", done, self._picture)


def maps_of_bake(
    meshes: Meshes,
    source: Source,
    run: Run,
    *,
    uploads: mesh_upload.UploadCache | None = None,
) -> SampledMaps:
    """What draws the maps of a bake, band by band. uploads: a cache of uploaded meshes."""
    families, details = [], []
    with run.timings.timed("upload"):
        space = NormalSpace(meshes.basis, run.settings, uploads)
        if source.surface is not None:
            to_space = world_to_space(meshes.low, run.settings.map)
            families = list(_families(FamilyInputs(meshes, source.surface, space, to_space, run)))
            if meshes.has_detail:
                details.append(OwnNormals(meshes, source.surface, to_space, run))
            if run.settings.map.edge_radius:
                details.append(RoundedEdges(source.surface, to_space, run))
    return SampledMaps(source, space, families, details, run)


FAMILIES = {
    kind.family: kind
    for module in (map_families, ray_maps, material_maps)
    for kind in vars(module).values()
    if isinstance(kind, type) and issubclass(kind, MapFamily) and "family" in vars(kind)
}
"""What draws the maps of each family: all classes that these modules have."""


def _families(inputs: FamilyInputs) -> Iterator[MapFamily]:
    for family, kind in FAMILIES.items():
        names = [name for name in inputs.run.settings.map.drawn_maps if BY_NAME[name].family is family]
        if names:
            yield kind(names, inputs)


ADAPTIVE_LIMITS = {2: 0.17, 4: 0.3, 8: 0.5, 16: 0.7}
"""Degrees of a second difference up to which this many samples are enough."""


class AdaptiveNormals:
    """The normals of a band in the space of the source, as a single sample has them: `first`, then `rest`, then `mean`.

    stopped (rows, width) bool: which texels of the last band, without its halo, took fewer samples than the settings say.
    """

    def __init__(self, source: Rays, run: Run):
        self.source = source
        self.settings, self._timed = run.settings, partial(run.timings.timed, "draw")
        self.rounds = samples.rounds(self.settings.sampling.samples)
        taken = np.cumsum([len(offsets) for offsets in self.rounds])
        self.limits = [ADAPTIVE_LIMITS[count] for count in taken[:-1].tolist()]
        self.stopped: np.ndarray | None = None

    @property
    def mean(self) -> gpu.types.GPUTexture:
        """The normals after `rest`."""
        return self._mean

    def first(self, band: Band) -> Iterator[tuple[gpu.types.GPUTexture, range, float]]:
        """Draw the first two samples of each texel, in slices. Yields normals with the rows that are ready, and the share."""
        self._pair = []
        for slot, offset in enumerate(self.rounds[0]):
            sample = replace(band, offset=offset)
            for normals, rows in relay(self.source.normals(sample, slot), within=self._timed):
                yield normals, rows, (slot + rows.stop / band.height) / 2.0
            self._pair.append(self.source.drawn(slot).texture)

    def rest(self, band: Band) -> Iterator[float]:
        """Draw the other samples, and average them into `mean`. Yields the share of them that is done."""
        with self._timed():
            drawn, needed = self._compare(band)
            covered = self._leave_out_empty(needed, band)
        sums = self.mean
        whole, done = sum(map(len, self.rounds[1:])), 0
        several = None
        for number, offsets in enumerate(self.rounds[1:], start=2):
            with self._timed():
                some = samples.find_active(drawn.texture, needed, number, covered)
            if some is None:
                break
            several = several or some
            for offset in offsets:
                sample = replace(band, offset=offset)
                for normals in relay(self.source.normals_of(sample, some), within=self._timed):
                    if normals is None:
                        yield done / whole
                        continue
                    with self._timed():
                        samples.add_sample(sums, normals, some)
                        drawn.finish()
                done += 1
                yield done / whole
        if several is not None:
            with self._timed():
                samples.average_samples(sums, several)

    def _compare(self, band: Band) -> tuple[target.Target, np.ndarray]:
        """In how many rounds each texel takes part, as samples.draw_rounds has it."""
        drawn = target.get("adaptive samples", band.width, band.height, *samples.ROUND_FORMATS)
        needed = samples.draw_rounds(drawn, *self._pair, offset=self.rounds[0][0], limits=self.limits)
        self.stopped = needed[band.halo : band.height - band.halo] < len(self.rounds)
        self._mean = drawn.textures[1]
        return drawn, needed

    def _leave_out_empty(self, needed: np.ndarray, band: Band) -> gpu.types.GPUTexture | None:
        """Set the empty texels of `needed` that no sample can reach to 0. Returns the squares of the others."""
        is_empty = needed == samples.EMPTY
        if not is_empty.any():
            return None
        to_clip, size = replace(band, offset=(0.0, 0.0)).uv_to_clip, (band.width, band.height)
        covered = uv_layout.covered_squares([self.source.low], to_clip, size, samples.COVERED)
        reached = covered.repeat(samples.COVERED, axis=0).repeat(samples.COVERED, axis=1)[: band.height, : band.width]
        needed[is_empty & ~reached] = 0
        return samples.upload_covered(covered)
