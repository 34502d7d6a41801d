# SPDX-License-Identifier: GPL-3.0-or-later
"""What draws the maps of one family from the samples of a band."""

from abc import ABC, abstractmethod
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import gpu

from ...core.progress import Task
from ...passes import target
from ...passes.surface.served_blocks import Blocks
from ..bands import Band


@dataclass(frozen=True)
class Sample:
    """One sample of each texel of a band, whose hits are known.

    number: from 0, among all samples of the band. is_central: whether it is the one nearest to the texel's center. normals,
    hits: as sources.Source has them. blocks: where in the band its materials are, if images are looked up.
    """

    band: Band
    number: int
    is_central: bool
    normals: target.Target
    hits: target.Target
    blocks: Blocks | None = None


class MapFamily(ABC):
    """Draws some maps of a bake from the hits of its samples."""

    effort: float
    """The time of a sample, roughly, as a multiple of the time that its hits take."""
    has_pages = False
    """Whether it loads images, so that many samples at once take less time than one after another."""

    @abstractmethod
    def add(self, drawn: Sequence[Sample]) -> Task[None]:
        """Add samples of a band. Their hits and normals stay as they are until the task ends."""

    @abstractmethod
    def finished(self, band: Band, known: gpu.types.GPUTexture) -> Iterator[tuple[str, gpu.types.GPUTexture]]:
        """The names and textures (RGBA32F; alpha 1 known, 0 empty, -1 missed) of the maps of a band whose samples were added.

        known: the normals of the only sample, or the sums of those of several. Each texture is valid until the next one is
        asked for.
        """
