# SPDX-License-Identifier: GPL-3.0-or-later
"""Runs the chosen parts of the benchmark, and collects their figures as plain data."""

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from scripts.bench import scenes
from scripts.bench.parts import bakes as bakes_of_versions
from scripts.bench.parts import batches as many_bakes
from scripts.bench.parts import closed_forms as known_normals
from scripts.bench.parts import growth as growing
from scripts.bench.parts import live_updates, machine
from scripts.bench.parts import memory as peaks
from scripts.bench.parts import occlusion as ambient_occlusion
from scripts.bench.parts import pairs as pairs_of_meshes
from scripts.bench.parts import samples as several_samples
from scripts.bench.parts import start as shell_runs
from scripts.bench.parts import storing as file_formats
from scripts.bench.versions import Version


@dataclass
class Bench:
    """What the parts need. folder: of pairs. scratch: a temporary folder.

    result: of the parts so far, as plain data.
    """

    versions: Sequence[Version]
    folder: Path | None
    scratch: Path
    quick: bool
    log: Callable[[str], None]
    result: dict = field(default_factory=dict)

    @property
    def repeats(self) -> int:
        """The number of rounds."""
        return 3 if self.quick else 5


def pairs(bench: Bench) -> list[dict]:
    rows = []
    for number, (build, sizes) in enumerate(pairs_of_meshes.chosen(bench.folder, bench.quick)):
        pair = build()
        bench.log(pair.name)
        rows += pairs_of_meshes.time_pair(pair, sizes, bench.repeats, bench.quick)
        if not (bench.quick and number):
            rows += [
                pairs_of_meshes.time_samples(pair, size, bench.repeats) for size in pairs_of_meshes.sampled(pair, sizes)
            ]
    return rows


def closed_forms(bench: Bench) -> list[dict]:
    return known_normals.closed_forms(bench.quick, bench.repeats)


def occlusion(bench: Bench) -> list[dict]:
    return list(ambient_occlusion.compare(bench.folder, bench.quick))


def growth(bench: Bench) -> dict:
    return growing.growth(bench.quick, bench.repeats, bench.log)


def live(bench: Bench) -> list[dict]:
    return live_updates.measure()


def bakes(bench: Bench) -> list[dict]:
    if len(bench.versions) == 1:
        return []
    pairs = pairs_of_meshes.chosen(bench.folder, bench.quick)
    return list(bakes_of_versions.measure(pairs, bench.versions, bench.scratch, bench.repeats))


def storing(bench: Bench) -> list[dict]:
    pair = scenes.terrain_file(bench.folder, bench.scratch)
    return file_formats.measure(pair, bench.versions, bench.scratch, bench.quick, bench.repeats)


def start(bench: Bench) -> list[dict]:
    pair = scenes.terrain_file(bench.folder, bench.scratch)
    return shell_runs.measure(pair, bench.versions, bench.scratch, bench.repeats)


def batches(bench: Bench) -> list[dict]:
    pair = scenes.small_file(bench.folder, bench.scratch)
    return many_bakes.measure(pair, bench.versions, bench.scratch, bench.quick, bench.repeats)


def memory(bench: Bench) -> list[dict]:
    return list(peaks.measure(peaks.QUICK if bench.quick else peaks.USUAL, bench.versions, bench.scratch))


def samples(bench: Bench) -> list[dict]:
    chosen = several_samples.cases(scenes.terrain_file(bench.folder, bench.scratch), bench.folder, bench.quick)
    return list(several_samples.measure(chosen, bench.versions, bench.scratch, bench.repeats))


def very_large(bench: Bench) -> list[dict]:
    return list(peaks.measure(peaks.VERY_LARGE, bench.versions[:1], bench.scratch))


PARTS = {
    part.__name__: part
    for part in (
        *(pairs, closed_forms, occlusion, growth, live),
        *(bakes, storing, start, batches, memory, samples, very_large),
    )
}
OPTIONAL = ("very_large",)
"""Parts that are measured only if they are named."""
USUAL = tuple(name for name in PARTS if name not in OPTIONAL)


def measure(bench: Bench, only: Collection[str]) -> dict:
    """Run the parts that are named. Returns their figures, and those of the machine."""
    bench.result |= {"quick": bench.quick, "repeats": bench.repeats, "machine": machine.machine()}
    bench.result["versions"] = [version.name for version in bench.versions]
    for name in (name for name in PARTS if name in only):
        bench.log(name.replace("_", " "))
        bench.result[name] = PARTS[name](bench)
    return bench.result
