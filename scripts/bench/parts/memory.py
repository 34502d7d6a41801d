# SPDX-License-Identifier: GPL-3.0-or-later
"""The most memory that bakes hold, and their seconds, each in a process of its own."""

from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

from scripts.bench.bakers import Contender, race
from scripts.bench.comparing import CAST, FLATTEN
from scripts.bench.scenes import RELIEF
from scripts.bench.versions import Child, Version

METHODS = {FLATTEN: "FLATTEN", CAST: "CAST"}
METHOD_WORDS = {FLATTEN: "Flatten", CAST: "Cast"}


@dataclass(frozen=True)
class Case:
    """A bake of a generated grid of (columns, rows) quads into a map of size x size texels.

    rounds: the number of bakes that are timed, after the first one.
    """

    quads: tuple[int, int]
    size: int
    rounds: int = 0

    @property
    def triangles(self) -> int:
        return 2 * self.quads[0] * self.quads[1]


QUICK = (Case((1000, 500), 1024), Case((1000, 500), 2048))
USUAL = (
    Case((1000, 500), 1024),
    Case((2000, 1000), 1024),
    Case((2500, 2000), 1024),
    Case((2500, 2000), 512, rounds=5),
    Case((1000, 500), 2048),
    Case((1000, 500), 4096),
    Case((1000, 500), 8192),
)
VERY_LARGE = (Case((2500, 2000), 8192), Case((5000, 3000), 8192), Case((10000, 5000), 8192))


class Measured(Contender):
    """A version that bakes a case with one method.

    held, peak: the bytes of its process before the first bake, and at most during it. None where they are not known.
    """

    def __init__(self, version: Version, child: Child, case: Case, settings: dict):
        self.child, self.case, self.settings = child, case, settings
        self.held = self.peak = None
        self.stages = {}
        super().__init__(version.name, self._bake, lambda: None)

    def _bake(self) -> float:
        is_first = not self.stages
        if is_first:
            self.child.ask(do="make_grid", quads=self.case.quads, height=RELIEF)
            self.child.ask(do="forget_peak")
            self.held = self.child.ask(do="peak")["bytes"]
        done = self.child.ask(do="bake", settings=self.settings)
        self.stages = done["stages"]
        if is_first:
            self.peak = self.child.ask(do="peak")["bytes"]
        return done["seconds"]

    def median_stages(self) -> dict[str, float]:
        """Those of the last bake."""
        return self.stages


def measure(cases: Sequence[Case], versions: Sequence[Version], scratch: Path) -> Iterator[dict]:
    """Yield a row for each case and method."""
    for case in cases:
        for method in METHODS:
            yield _row(case, method, versions, scratch)


def _row(case: Case, method: str, versions: Sequence[Version], scratch: Path) -> dict:
    with ExitStack() as stack:
        field = [
            Measured(
                version,
                stack.enter_context(version.worker(scratch / f"memory_{n}.log")),
                case,
                _settings(case, method, scratch / f"memory_{n}.png"),
            )
            for n, version in enumerate(versions)
        ]
        timed = race(field, case.rounds)
    return {
        "what": f"{case.triangles:,} triangles, {METHOD_WORDS[method]}",
        "triangles": case.triangles,
        "method": method,
        "size": case.size,
        "times": {name: vars(times) for name, times in timed.items()},
        "held_bytes": {measured.name: measured.held for measured in field},
        "peak_bytes": {measured.name: [measured.peak] if measured.peak else [] for measured in field},
    }


def _settings(case: Case, method: str, path: Path) -> dict:
    """Rays reach as far as the waves, so that none are cast to measure that."""
    size = {"width": case.size, "height": case.size, "depth": 16, "storage": "FILE", "output": str(path)}
    return {"method": METHODS[method], "extrusion": 1.5 * RELIEF, "max_distance": 3.0 * RELIEF, **size}
