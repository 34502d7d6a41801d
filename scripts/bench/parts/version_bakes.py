# SPDX-License-Identifier: GPL-3.0-or-later
"""Bakes by this version and an older one, which take turns: all pairs, file formats, samples, and the most memory."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from scripts.bench import scenes
from scripts.bench.bakers import Contender, race
from scripts.bench.comparing import ALL_SAMPLES, PRESENT
from scripts.bench.scenes import RELIEF, Pair
from scripts.bench.versions import Child, Version
from tests.support import angles

METHODS = {"Flatten": "FLATTEN", "Cast": "CAST"}
WAYS = {
    **{label: {"method": method} for label, method in METHODS.items()},
    "Cast, outermost hit": {"method": "CAST", "hit": "OUTERMOST"},
}
FORMATS = (
    ("PNG, 16 bits", ".png", 16),
    ("PNG, 8 bits", ".png", 8),
    ("OpenEXR, 16 bits", ".exr", 16),
    ("OpenEXR, 32 bits", ".exr", 32),
    ("TIFF, 16 bits", ".tif", 16),
    ("TIFF, 8 bits", ".tif", 8),
    ("Targa, 8 bits", ".tga", 8),
)
"""Each with the ending of its files and the bits per channel; always red, green, blue and alpha."""
IN_MEMORY = {"depth": 32, "storage": "MEMORY"}


class VersionBake(Contender):
    """A version that bakes in its process. done: its last answer, see version_worker.py."""

    def __init__(self, name: str, child: Child, settings: dict):
        self.child, self.settings, self.done = child, settings, {}
        super().__init__(name, self._bake, lambda: None)

    def _bake(self) -> float:
        self.done = self.child.ask(do="bake", settings=self.settings)
        return self.done["seconds"]


@contextmanager
def started(versions: Sequence[Version], scratch: Path) -> Iterator[dict[str, Child]]:
    """A process for each version, by the versions' names."""
    with ExitStack() as stack:
        yield {
            version.name: stack.enter_context(version.worker(scratch / f"version_{number}.log"))
            for number, version in enumerate(versions)
        }


def open_in(children: dict[str, Child], path: Path) -> None:
    for child in children.values():
        child.ask(do="open_file", path=str(path))


# All pairs


def bakes(
    pairs: Iterator[tuple[Callable[[], Pair], tuple[int, ...]]],
    versions: Sequence[Version],
    scratch: Path,
    repeats: int,
) -> Iterator[dict]:
    """Yield a row for each pair and way to bake it, at the largest of its sizes. pairs: as from parts.pairs.chosen."""
    with started(versions, scratch) as children:
        for build, sizes in pairs:
            pair = build()
            open_in(children, scenes.saved(pair, scratch))
            reach = {"extrusion": pair.extrusion, "max_distance": 2.0 * pair.extrusion}
            shared = {"width": sizes[-1], "height": sizes[-1], **IN_MEMORY, **reach}
            for what, own in WAYS.items():
                timed = race([VersionBake(name, child, shared | own) for name, child in children.items()], repeats)
                yield {
                    "what": what,
                    "pair": pair.name,
                    "size": sizes[-1],
                    "times": {name: vars(times) for name, times in timed.items()},
                }


# File formats


class Storing(VersionBake):
    """A version that bakes a map into a file. Its time is that of the stage "image": from texels to a file that is there.

    whole: the seconds of the whole bakes. size: the bytes of the file.
    """

    def __init__(self, name: str, child: Child, settings: dict):
        self.path, self.whole, self.size = Path(settings["output"]), [], 0
        super().__init__(name, child, settings)

    def _bake(self) -> float:
        self.path.unlink(missing_ok=True)
        self.whole.append(super()._bake())
        self.size = self.path.stat().st_size
        return self.done["stages"]["image"]


def storing(pair: Path, versions: Sequence[Version], scratch: Path, quick: bool, repeats: int) -> Iterator[dict]:
    """Bake `pair` by Flatten into each format. Yields a row for each."""
    size = 1024 if quick else 2048
    shared = {"method": "FLATTEN", "width": size, "height": size, "storage": "FILE"}
    with started(versions, scratch) as children:
        open_in(children, pair)
        for what, ending, depth in FORMATS:
            field = [
                Storing(name, child, shared | {"depth": depth, "output": str(scratch / f"stored_{number}{ending}")})
                for number, (name, child) in enumerate(children.items())
            ]
            timed = race(field, repeats)
            yield {
                "what": what,
                "pair": pair.stem,
                "size": size,
                "times": {name: vars(times) for name, times in timed.items()},
                "whole": {one.name: one.whole[1:] for one in field},
                "bytes": {one.name: one.size for one in field},
            }


# Samples


@dataclass(frozen=True)
class Sampled:
    """Bakes of a pair at one size, by one of METHODS, with each of these numbers of samples."""

    pair: Path
    what: str
    size: int
    samples: tuple[int, ...]


def sampled(terrain: Path, folder: Path | None, quick: bool) -> list[Sampled]:
    """The terrain with several numbers of samples, and the pairs of the folder with 16."""
    if quick:
        return [Sampled(terrain, "Flatten", 1024, (1, 4, 16)), Sampled(terrain, "Cast", 512, (1, 16))]
    others = [path for path in sorted(folder.glob("*.blend")) if scenes.sizes(path)] if folder else []
    return [
        Sampled(terrain, "Flatten", 2048, (1, 4, 16, 64)),
        Sampled(terrain, "Cast", 1024, (1, 4, 16, 64)),
        *(Sampled(path, what, 1024, (16,)) for path in others for what in METHODS if (path, what) != (terrain, "Cast")),
    ]


def samples(chosen: Sequence[Sampled], versions: Sequence[Version], scratch: Path, repeats: int) -> Iterator[dict]:
    """Yield a row for each case and number of samples. Adaptive samples and all of them bake in the same process."""
    with started(versions, scratch) as children:
        for case in chosen:
            open_in(children, case.pair)
            for count in case.samples:
                yield _samples_row(case, count, children, scratch, repeats)


def _samples_row(case: Sampled, count: int, children: dict[str, Child], scratch: Path, repeats: int) -> dict:
    settings = {"method": METHODS[case.what], "width": case.size, "height": case.size, "samples": count, "margin": 0}
    settings |= IN_MEMORY
    field = [VersionBake(name, child, settings) for name, child in children.items()]
    if count > 1:
        field.append(VersionBake(ALL_SAMPLES, children[PRESENT], settings | {"adaptive": False}))
    timed = race(field, repeats)
    row = {
        "what": case.what,
        "pair": case.pair.stem,
        "size": case.size,
        "samples": count,
        "times": {name: vars(times) for name, times in timed.items()},
        "stopped_early": field[0].done.get("stopped_early"),
    }
    if count > 1 and not (timed[PRESENT].gap or timed[ALL_SAMPLES].gap):
        path = scratch / "samples.npy"
        row["angles"] = difference_of(_texels(field[0], path), _texels(field[-1], path))
    return row


def _texels(baker: VersionBake, path: Path) -> np.ndarray:
    """A map (size, size, 4) of normals; path: of a temporary file."""
    baker.bake()
    baker.child.ask(do="save_map", path=str(path))
    texels = np.load(path)
    path.unlink()
    return texels


def difference_of(found: np.ndarray, wanted: np.ndarray) -> dict[str, float]:
    """Degrees between two maps (height, width, 4) of stored normals, and the share of texels that only one of them covers.

    Texels with an alpha of 0 are not covered. Degrees are NaN if no texel is covered in both.
    """
    has, had = (texels[..., 3] > 0.0 for texels in (found, wanted))
    degrees = angles.degrees(angles.decode(found)[has & had], angles.decode(wanted)[has & had])
    high, higher, most = np.percentile(degrees, (99.0, 99.9, 100.0)).tolist() if degrees.size else (float("nan"),) * 3
    return {"percentile_99": high, "percentile_99_9": higher, "maximum": most, "unlike": float((has != had).mean())}


# Memory


@dataclass(frozen=True)
class Grid:
    """A bake of a generated grid of (columns, rows) quads into a map of size x size texels.

    rounds: the number of bakes that are timed, after the first one.
    """

    quads: tuple[int, int]
    size: int
    rounds: int = 0

    @property
    def triangles(self) -> int:
        return 2 * self.quads[0] * self.quads[1]


QUICK = (Grid((1000, 500), 1024), Grid((1000, 500), 2048))
USUAL = (
    Grid((1000, 500), 1024),
    Grid((2000, 1000), 1024),
    Grid((2500, 2000), 1024),
    Grid((2500, 2000), 512, rounds=5),
    Grid((1000, 500), 2048),
    Grid((1000, 500), 4096),
    Grid((1000, 500), 8192),
)
VERY_LARGE = (Grid((2500, 2000), 8192), Grid((5000, 3000), 8192), Grid((10000, 5000), 8192))


class Measured(VersionBake):
    """A version that bakes a grid.

    held, peak: the bytes of its process before the first bake, and at most during it. None where they are not known.
    """

    def __init__(self, name: str, child: Child, settings: dict, grid: Grid):
        self.grid, self.held, self.peak = grid, None, None
        super().__init__(name, child, settings)

    def _bake(self) -> float:
        is_first = not self.done
        if is_first:
            self.child.ask(do="make_grid", quads=self.grid.quads, height=RELIEF)
            self.child.ask(do="forget_peak")
            self.held = self.child.ask(do="peak")["bytes"]
        seconds = super()._bake()
        if is_first:
            self.peak = self.child.ask(do="peak")["bytes"]
        return seconds


def memory(grids: Sequence[Grid], versions: Sequence[Version], scratch: Path) -> Iterator[dict]:
    """Yield a row for each grid and method, each baked in processes of its own."""
    for grid in grids:
        for what in METHODS:
            yield _memory_row(grid, what, versions, scratch)


def _memory_row(grid: Grid, what: str, versions: Sequence[Version], scratch: Path) -> dict:
    # Rays reach as far as the waves, so that none are cast to measure that.
    shared = {"method": METHODS[what], "extrusion": 1.5 * RELIEF, "max_distance": 3.0 * RELIEF}
    shared |= {"width": grid.size, "height": grid.size, "depth": 16, "storage": "FILE"}
    with started(versions, scratch) as children:
        field = [
            Measured(name, child, shared | {"output": str(scratch / f"memory_{number}.png")}, grid)
            for number, (name, child) in enumerate(children.items())
        ]
        timed = race(field, grid.rounds)
    return {
        "what": f"{grid.triangles:,} triangles, {what}",
        "triangles": grid.triangles,
        "size": grid.size,
        "times": {name: vars(times) for name, times in timed.items()},
        "held_bytes": {one.name: one.held for one in field},
        "peak_bytes": {one.name: [one.peak] if one.peak else [] for one in field},
    }
