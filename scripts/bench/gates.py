# SPDX-License-Identifier: GPL-3.0-or-later
"""Which limits tell right bakes from wrong ones: 16 right and 20 wrong bakes of four pairs, and what is measured of each.

    .venv/bin/python scripts/bench/gates.py ../shared/assets/pairs

A file of the folder is a pair: its objects `lo` and `hi`. Prints a table for the manual.
"""

import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import bpy
import gpu
import numpy as np

sys.path.insert(0, str(Path(__file__).parents[2]))

from addon.audit import deviations
from addon.core.errors import BakeError
from addon.core.settings import Settings
from addon.jobs import Job, Wants, bake_all

PAIRS = ("king_40480_4000", "spot_1696_536", "helmet_23358_6117", "shaderball_48048_23378")
USUAL = Settings(width=512, height=512, depth=8, storage="MEMORY", material=False, method="CAST", appearance=True)
METRICS = (
    ("deviation", "percentile_99"),
    ("between", "percentile_95"),
    ("between", "median"),
    ("appearance", "percentile_99"),
)
Stored = tuple[np.ndarray, np.ndarray]


def _green(stored: Stored) -> Stored:
    texels = stored[0].copy()
    texels[..., 1] = 1.0 - texels[..., 1]
    return texels, stored[1]


def _moved(stored: Stored) -> Stored:
    return np.roll(stored[0], (3, 3), (0, 1)), stored[1]


def _size(high: bpy.types.Object) -> float:
    return float(max(high.dimensions))


RIGHT: dict[str, dict[str, Any]] = {
    "512, 8 bits": {},
    "512, 16 bits": {"depth": 16},
    "512, 4 samples": {"samples": 4},
    "1024, 8 bits": {"width": 1024, "height": 1024},
}
WRONG: dict[str, Any] = {
    "long fixed distances": lambda high: {
        "extrusion": 0.3 * _size(high),
        "max_distance": 0.6 * _size(high),
        "hit": "OUTERMOST",
    },
    "short fixed distances": lambda high: {"extrusion": 1e-4 * _size(high), "max_distance": 2e-4 * _size(high)},
    "64 texels": lambda high: {"width": 64, "height": 64},
    "green turned over": _green,
    "moved by 3 texels": _moved,
}


def measured(path: Path, values: dict[str, Any], change: Callable[[Stored], Stored] | None) -> dict[str, Any]:
    """The report of a bake. change: of the map, before it is measured."""
    add = {kind: kind.add for kind in (deviations.Deviations, deviations.BetweenTexels)}
    if change is not None:
        for kind, known in add.items():
            kind.add = lambda self, tile, stored, known=known: known(self, tile, change(stored))
    try:
        low, high = (bpy.data.objects[name] for name in ("lo", "hi"))
        wants = Wants(measured=True)
        return bake_all(bpy.context, [Job(low, [high])], replace(USUAL, **values), wants=wants)[0].to_dict()
    finally:
        for kind, known in add.items():
            kind.add = known


def main() -> None:
    gpu.init()
    folder, rows = Path(sys.argv[1]), []
    for pair in PAIRS:
        for is_right, tries in ((True, RIGHT), (False, WRONG)):
            for name, how in tries.items():
                bpy.ops.wm.open_mainfile(filepath=str(folder / f"{pair}.blend"))
                high = bpy.data.objects["hi"]
                is_change = how in (_green, _moved)
                values = how if is_right else {} if is_change else how(high)
                try:
                    report = measured(folder, values, how if is_change else None)
                except BakeError as error:
                    print(pair, name, error, flush=True)
                    continue
                found = [report[part].get(key, 0.0) for part, key in METRICS]
                found += [100 * report[part].get("wrong", 0.0) for part in ("deviation", "between", "appearance")]
                found.append(100 * report["between"].get("left", 0.0))
                rows.append((is_right, pair.partition("_")[0], name, *found, 100 * report["missed"]))
                print(
                    "| "
                    + " | ".join(f"{each:.2f}" if isinstance(each, float) else str(each) for each in rows[-1])
                    + " |",
                    flush=True,
                )


if __name__ == "__main__":
    main()
