# SPDX-License-Identifier: GPL-3.0-or-later
"""Runs the chosen parts of the benchmark, and collects what they measure as plain data."""

import os
import platform
import re
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import bpy
import gpu

from addon.passes.shader import is_software
from scripts.bench import scenes
from scripts.bench.parts import closed_forms as known_normals
from scripts.bench.parts import growth as growing
from scripts.bench.parts import live_updates, shell_runs, version_bakes
from scripts.bench.parts import occlusion as ambient_occlusion
from scripts.bench.parts import pairs as pairs_of_meshes
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
    return list(version_bakes.bakes(pairs, bench.versions, bench.scratch, bench.repeats))


def storing(bench: Bench) -> list[dict]:
    pair = scenes.terrain_file(bench.folder, bench.scratch)
    return list(version_bakes.storing(pair, bench.versions, bench.scratch, bench.quick, bench.repeats))


def start(bench: Bench) -> list[dict]:
    pair = scenes.terrain_file(bench.folder, bench.scratch)
    return shell_runs.start(pair, bench.versions, bench.scratch, bench.repeats)


def batches(bench: Bench) -> list[dict]:
    pair = scenes.small_file(bench.folder, bench.scratch)
    return shell_runs.batches(pair, bench.versions, bench.scratch, bench.quick, bench.repeats)


def memory(bench: Bench) -> list[dict]:
    grids = version_bakes.QUICK if bench.quick else version_bakes.USUAL
    return list(version_bakes.memory(grids, bench.versions, bench.scratch))


def samples(bench: Bench) -> list[dict]:
    chosen = version_bakes.sampled(scenes.terrain_file(bench.folder, bench.scratch), bench.folder, bench.quick)
    return list(version_bakes.samples(chosen, bench.versions, bench.scratch, bench.repeats))


def very_large(bench: Bench) -> list[dict]:
    return list(version_bakes.memory(version_bakes.VERY_LARGE, bench.versions[:1], bench.scratch))


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
    """Run the parts that are named. Returns what they measured, and the machine."""
    bench.result |= {"quick": bench.quick, "repeats": bench.repeats, "machine": machine()}
    bench.result["versions"] = [version.name for version in bench.versions]
    for name in (name for name in PARTS if name in only):
        bench.log(name.replace("_", " "))
        bench.result[name] = PARTS[name](bench)
    return bench.result


def machine() -> dict:
    """The machine of the measurements."""
    gpu.init()
    renderer = gpu.platform.renderer_get()
    return {
        "processor": _processor(),
        "cores": os.cpu_count(),
        "load": round(os.getloadavg()[0], 1) if hasattr(os, "getloadavg") else None,
        "system": f"{platform.system()} {platform.machine()}",
        "renderer": renderer,
        "in_software": is_software(renderer),
        "backend": gpu.platform.backend_type_get(),
        "blender": bpy.app.version_string,
    }


def _processor() -> str:
    try:
        text = Path("/proc/cpuinfo").read_text(encoding="utf-8")
    except OSError:
        return platform.processor()
    found = re.search(r"model name\s*: (.+)", text)
    return found[1] if found else platform.processor()
