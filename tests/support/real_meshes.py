# SPDX-License-Identifier: GPL-3.0-or-later
"""The files of real meshes, of which each has a low object and a high one: docs/testing.md."""

from pathlib import Path

import bpy

PAIRS = (
    "kepler_199712_9079",
    "sthelens_290088_9079",
    "spot_1696_536",
    "spot_control_vs_subd5",
    "shaderball_48048_23378",
    "shaderball_61644_20517",
    "king_40480_4000",
    "helmet_23358_6117",
    "normaltangenttest_published",
)
"""Pairs that share their UVs, but for the last one."""
FAST = ["spot_1696_536"]
"""The pair with the fastest bakes runs in the fast lane."""


def open_pair(assets: Path, name: str, folder: str = "pairs") -> tuple[bpy.types.Object, bpy.types.Object]:
    """Open a file. Returns its low object and its high one."""
    bpy.ops.wm.open_mainfile(filepath=str(assets / folder / f"{name}.blend"))
    return bpy.data.objects["lo"], bpy.data.objects["hi"]
