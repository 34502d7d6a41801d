# SPDX-License-Identifier: GPL-3.0-or-later
"""The .blend files of pairs, for processes that open them by themselves."""

from pathlib import Path

import bpy

from scripts.bench.meshes import scenes
from scripts.bench.meshes.paper import PAPER, TERRAIN


def terrain(folder: Path | None, scratch: Path) -> Path:
    """The first terrain of the folder, or the demo's, saved in `scratch`."""
    found = [path for path in sorted(folder.glob("*.blend")) if path.name.startswith(scenes.TERRAINS)] if folder else []
    return found[0] if found else saved(scenes.made(*TERRAIN), scratch)


def small(folder: Path | None, scratch: Path) -> Path:
    """The smallest pair of the paper's table, from the folder or generated and saved in `scratch`."""
    high, low, *_ = PAPER[0]
    found = sorted(folder.glob(f"*_{high}_{low}.blend")) if folder else []
    return found[0] if found else saved(scenes.made(high, low), scratch)


def saved(pair: scenes.Pair, scratch: Path) -> Path:
    """Save the open scene, which shows a pair, in `scratch`."""
    path = scratch / f"{pair.name}.blend"
    bpy.ops.wm.save_as_mainfile(filepath=str(path), copy=True)
    return path.absolute()
