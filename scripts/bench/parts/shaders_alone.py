# SPDX-License-Identifier: GPL-3.0-or-later
"""The shaders without Blender."""

import json
import subprocess
from pathlib import Path

import bpy

from scripts.bench.contenders import peers
from scripts.bench.meshes import files, scenes
from scripts.bench.meshes.paper import PAPER, TERRAIN
from scripts.dev import export


def hardware(folder: Path | None, scratch: Path, quick: bool) -> dict:
    """Run scripts/dev/hardware.py, which times the shaders without Blender. Returns its result, or {"error": the reason}."""
    exported = []
    sizes = (1024, 2048) if quick else (512, 1024, 2048)
    counts = [(high, low) for high, low, *_ in PAPER] + [TERRAIN]
    for high, low in counts[3:] if quick else counts:
        pair = (
            scenes.opened(files.terrain(folder, scratch))
            if (high, low) == TERRAIN
            else scenes.sized(folder, high, low)()
        )
        blend, file = scratch / f"{pair.name}.blend", scratch / f"{pair.name}.npz"
        bpy.ops.wm.save_as_mainfile(filepath=str(blend), copy=True)
        export.export(blend, file)
        exported.append(file)
    result = scratch / "hardware.json"
    command = [str(peers.PYTHON), str(peers.ROOT / "scripts/dev/hardware.py"), *map(str, exported)]
    command += ["--sizes", *map(str, sizes), "--output", str(result)]
    done = subprocess.run(command, check=False, capture_output=True, text=True)
    if done.returncode:
        return {"error": (done.stderr.strip().splitlines() or ["no message"])[-1]}
    return json.loads(result.read_text(encoding="utf-8"))
