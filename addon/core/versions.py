# SPDX-License-Identifier: GPL-3.0-or-later
"""The versions of Imprint and of Blender."""

import importlib.metadata
import sys
import tomllib
from functools import cache
from pathlib import Path

MANIFEST = Path(__file__).resolve().parents[2] / "blender_manifest.toml"


@cache
def imprint() -> str:
    """The version of Imprint, from the manifest."""
    return tomllib.loads(MANIFEST.read_text(encoding="utf-8"))["version"]


def blender() -> str:
    """The version of Blender, as 5.2.3: of the one that runs, or of the Python package if it is not loaded; "" without one."""
    if bpy := sys.modules.get("bpy"):
        return ".".join(map(str, bpy.app.version))
    return _package()


@cache
def _package() -> str:
    """The version of the Python package bpy; "" without one."""
    try:
        return importlib.metadata.version("bpy")
    except importlib.metadata.PackageNotFoundError:
        return ""
