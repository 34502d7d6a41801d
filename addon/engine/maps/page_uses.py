# SPDX-License-Identifier: GPL-3.0-or-later
"""Draws images of the high meshes at the hits of samples. One image is in memory at a time; those that no hit shows are not
loaded."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

from ...core.material_feeds import ImageFeed, ImagePixels
from ...core.progress import Progress, Task
from ...core.settings import Run
from ...passes.surface import image_page
from ...passes.surface.material_table import MaterialTable
from .family import Sample


@dataclass(frozen=True)
class PageUse:
    """One use of an image, on the materials that have `number` in `materials`.

    draw: draws a page at the hits of a sample. It takes the sample, the page, and the UDIM tile that the page is, or None.
    """

    feed: ImageFeed
    materials: MaterialTable
    number: int
    draw: Callable[[Sample, image_page.Page, int | None], None]

    def is_in(self, sample: Sample) -> bool:
        """Whether hits of a sample may show the image."""
        return sample.blocks is None or len(sample.blocks.serving(self.materials, self.number)) > 0


def draw_pages(
    uses: Iterable[PageUse], drawn: Sequence[Sample], load_page: Callable[[str, int], ImagePixels], run: Run
) -> Task[None]:
    """Load each page that samples show, and draw all its uses. load_page: as Meshes has it."""
    pages: dict[tuple[str, int], list[PageUse]] = {}
    for use in uses:
        if any(map(use.is_in, drawn)):
            for tile in use.feed.tiles or (0,):
                pages.setdefault((use.feed.image, tile), []).append(use)
    for done, ((image, tile), found) in enumerate(pages.items()):
        yield Progress("Reading the images of the high meshes", done / len(pages))
        with run.timings.timed("pages"):
            page = image_page.upload(load_page(image, tile))
        with run.timings.timed("draw"):
            for use in found:
                for sample in drawn:
                    use.draw(sample, page, tile or None)
            drawn[-1].hits.finish()  # before the page is freed
        del page  # before the next one is loaded
