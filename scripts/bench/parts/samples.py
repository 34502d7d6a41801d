# SPDX-License-Identifier: GPL-3.0-or-later
"""Seconds of several samples a texel, adaptive and all of them, and the angle between the two maps."""

from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from scripts.bench import scenes
from scripts.bench.bakers import Contender, race
from scripts.bench.comparing import ALL_SAMPLES, PRESENT
from scripts.bench.versions import Child, Version
from tests.support import angles

WORDS = {"FLATTEN": "Flatten", "CAST": "Cast"}


@dataclass(frozen=True)
class Case:
    """Bakes of a pair at one size, by one method, with each of these numbers of samples."""

    pair: Path
    method: str
    size: int
    samples: tuple[int, ...]


def cases(terrain: Path, folder: Path | None, quick: bool) -> list[Case]:
    """The terrain with several numbers of samples, and the pairs of the folder with 16."""
    if quick:
        return [Case(terrain, "FLATTEN", 1024, (1, 4, 16)), Case(terrain, "CAST", 512, (1, 16))]
    others = [path for path in sorted(folder.glob("*.blend")) if scenes.sizes(path)] if folder else []
    return [
        Case(terrain, "FLATTEN", 2048, (1, 4, 16, 64)),
        Case(terrain, "CAST", 1024, (1, 4, 16, 64)),
        *(
            Case(path, method, 1024, (16,))
            for path in others
            for method in WORDS
            if (path, method) != (terrain, "CAST")
        ),
    ]


class Sampled(Contender):
    """A version that bakes with several samples into an image. stopped_early: the share of texels that took fewer."""

    def __init__(self, name: str, child: Child, settings: dict):
        self.child, self.settings, self.stopped_early = child, settings, None
        super().__init__(name, self._bake, lambda: None)

    def _bake(self) -> float:
        done = self.child.ask(do="bake", settings=self.settings)
        self.stopped_early = done["stopped_early"]
        return done["seconds"]

    def texels(self, path: Path) -> np.ndarray:
        """A map (size, size, 4) of normals; path: of a temporary file."""
        self.child.ask(do="bake", settings=self.settings)
        self.child.ask(do="save_map", path=str(path))
        texels = np.load(path)
        path.unlink()
        return texels


def measure(chosen: Sequence[Case], versions: Sequence[Version], scratch: Path, repeats: int) -> Iterator[dict]:
    """Yield a row for each case and number of samples. Both kinds of samples bake in the same process."""
    with ExitStack() as stack:
        children = [
            stack.enter_context(version.worker(scratch / f"samples_{n}.log")) for n, version in enumerate(versions)
        ]
        for case in chosen:
            for child in children:
                child.ask(do="open_file", path=str(case.pair))
            for samples in case.samples:
                yield _row(case, samples, children, versions, scratch=scratch, repeats=repeats)


def _row(
    case: Case, samples: int, children: Sequence[Child], versions: Sequence[Version], *, scratch: Path, repeats: int
) -> dict:
    settings = {"method": case.method, "width": case.size, "height": case.size, "samples": samples}
    settings |= {"depth": 32, "storage": "MEMORY", "margin": 0}
    field = [Sampled(version.name, child, settings) for version, child in zip(versions, children, strict=True)]
    if samples > 1:
        field.append(Sampled(ALL_SAMPLES, children[0], settings | {"adaptive": False}))
    timed = race(field, repeats)
    row = {
        "what": WORDS[case.method],
        "pair": case.pair.stem,
        "size": case.size,
        "samples": samples,
        "times": {name: vars(times) for name, times in timed.items()},
        "stopped_early": field[0].stopped_early,
    }
    if samples > 1 and not (timed[PRESENT].gap or timed[ALL_SAMPLES].gap):
        path = scratch / "samples.npy"
        row["angles"] = difference_of(field[0].texels(path), field[-1].texels(path))
    return row


def difference_of(found: np.ndarray, wanted: np.ndarray) -> dict[str, float]:
    """Degrees between two maps (height, width, 4) of stored normals, and the share of texels that only one of them covers.

    Texels with an alpha of 0 are not covered. Degrees are NaN if no texel is covered in both.
    """
    has, had = (texels[..., 3] > 0.0 for texels in (found, wanted))
    degrees = angles.degrees(angles.decode(found)[has & had], angles.decode(wanted)[has & had])
    high, higher, most = np.percentile(degrees, (99.0, 99.9, 100.0)).tolist() if degrees.size else (float("nan"),) * 3
    return {"percentile_99": high, "percentile_99_9": higher, "maximum": most, "unlike": float((has != had).mean())}
