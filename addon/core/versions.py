# SPDX-License-Identifier: GPL-3.0-or-later
"""The versions of Imprint and of Blender, and a hash of the code that bakes."""

import hashlib
import importlib.metadata
import sys
import tomllib
from functools import cache
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
MANIFEST = ROOT / "blender_manifest.toml"
CODE = ("addon", "shaders")
"""The folders with what decides how a map looks."""
WINDOW = ("addon/ui/",)
"""The folders below them with what only a window uses."""


@cache
def imprint() -> str:
    """The version of Imprint, from the manifest."""
    return tomllib.loads(MANIFEST.read_text(encoding="utf-8"))["version"]


@cache
def code(root: Path = ROOT) -> str:
    """A hash of the code that bakes, which changes where the version does not, as between two commits. Ends of lines do not
    count: git changes them on Windows."""
    digest = hashlib.sha256()
    for folder in CODE:
        names = sorted((path.relative_to(root).as_posix(), path) for path in (root / folder).rglob("*.*"))
        for name, path in names:
            if path.suffix in {".py", ".glsl"} and not name.startswith(WINDOW):
                content = path.read_bytes().replace(b"\r\n", b"\n")
                digest.update(f"{name} {len(content)}\n".encode() + content)
    return digest.hexdigest()


def line() -> str:
    """The versions and the hash of the code in a line for people."""
    return f"Imprint {imprint()}, code {code()[:12]}, Blender {blender() or 'none'}"


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
