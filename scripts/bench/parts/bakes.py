# SPDX-License-Identifier: GPL-3.0-or-later
"""Seconds of bakes of all pairs by this version and an older one, from the objects to an image."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack
from pathlib import Path

from scripts.bench import scenes
from scripts.bench.bakers import Contender, race
from scripts.bench.scenes import Pair
from scripts.bench.versions import Child, Version

WAYS = {
    "Flatten": {"method": "FLATTEN"},
    "Cast": {"method": "CAST"},
    "Cast, outermost hit": {"method": "CAST", "hit": "OUTERMOST"},
}


class Bake(Contender):
    """A version that bakes with these settings."""

    def __init__(self, version: Version, child: Child, settings: dict):
        self.stages = {}
        self.child, self.settings = child, settings
        super().__init__(version.name, self._bake, lambda: None)

    def _bake(self) -> float:
        done = self.child.ask(do="bake", settings=self.settings)
        self.stages = done["stages"]
        return done["seconds"]

    def median_stages(self) -> dict[str, float]:
        """Those of the last bake."""
        return self.stages


def measure(
    pairs: Iterator[tuple[Callable[[], Pair], tuple[int, ...]]],
    versions: Sequence[Version],
    scratch: Path,
    repeats: int,
) -> Iterator[dict]:
    """Yield a row for each pair and way to bake it, at the largest of its sizes. pairs: as from parts.pairs.chosen."""
    with ExitStack() as stack:
        children = [
            stack.enter_context(version.worker(scratch / f"bakes_{n}.log")) for n, version in enumerate(versions)
        ]
        for build, sizes in pairs:
            pair = build()
            path = scenes.saved(pair, scratch)
            for child in children:
                child.ask(do="open_file", path=str(path))
            reach = {"extrusion": pair.extrusion, "max_distance": 2.0 * pair.extrusion}
            shared = {"width": sizes[-1], "height": sizes[-1], "depth": 32, "storage": "MEMORY", **reach}
            for what, own in WAYS.items():
                field = [Bake(version, child, shared | own) for version, child in zip(versions, children, strict=True)]
                timed = race(field, repeats)
                yield {
                    "what": what,
                    "pair": pair.name,
                    "size": sizes[-1],
                    "times": {name: vars(times) for name, times in timed.items()},
                }
