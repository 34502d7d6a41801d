# SPDX-License-Identifier: GPL-3.0-or-later
"""Draws a normal map with adaptive samples: two in each texel, and more where those of its neighbors do not lie on a plane."""

from collections.abc import Iterator
from dataclasses import replace
from functools import partial

import gpu
import numpy as np

from ...core.progress import relay
from ...core.settings import Run
from ...mesh import uv_blocks
from ...passes import adaptive, target
from ...passes.bake import samples
from ..bands import Band
from ..sources import Rays

LIMITS = {2: 0.17, 4: 0.3, 8: 0.5, 16: 0.7}
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
        self.limits = [LIMITS[count] for count in taken[:-1].tolist()]
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
                some = adaptive.find_active(drawn.texture, needed, number, covered)
            if some is None:
                break
            several = several or some
            for offset in offsets:
                sample = replace(band, offset=offset)
                for normals in relay(self.source.normals_of(sample, some), within=self._timed):
                    if normals is None:
                        yield done / whole
                with self._timed():
                    adaptive.add_sample(sums, normals, some)
                    drawn.finish()
                done += 1
                yield done / whole
        if several is not None:
            with self._timed():
                adaptive.average_samples(sums, several)

    def _compare(self, band: Band) -> tuple[target.Target, np.ndarray]:
        """In how many rounds each texel takes part, as adaptive.draw_rounds has it."""
        drawn = target.get("adaptive samples", band.width, band.height, *adaptive.ROUND_FORMATS)
        needed = adaptive.draw_rounds(drawn, *self._pair, offset=self.rounds[0][0], limits=self.limits)
        self.stopped = needed[band.halo : band.height - band.halo] < len(self.rounds)
        self._mean = drawn.textures[1]
        return drawn, needed

    def _leave_out_empty(self, needed: np.ndarray, band: Band) -> gpu.types.GPUTexture | None:
        """Set the empty texels of `needed` that no sample can reach to 0. Returns the squares of the others."""
        is_empty = needed == adaptive.EMPTY
        if not is_empty.any():
            return None
        to_clip, size = replace(band, offset=(0.0, 0.0)).uv_to_clip, (band.width, band.height)
        covered = uv_blocks.covered([self.source.low], to_clip, size, adaptive.COVERED)
        reached = covered.repeat(adaptive.COVERED, axis=0).repeat(adaptive.COVERED, axis=1)[: band.height, : band.width]
        needed[is_empty & ~reached] = 0
        return adaptive.upload_covered(covered)
