# SPDX-License-Identifier: GPL-3.0-or-later
"""Loads Blender's Python package without its interface and its add-ons, which a bake does not need, and ends its process.

`complete` loads later what some files need. This works only where Blender is a Python package. Blender itself has loaded
everything before it runs a script.
"""

import importlib
import os
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from importlib.machinery import ModuleSpec
from types import ModuleType
from typing import Any

from ..core.errors import NO_BLENDER, NoGpu
from ..core.progress import startup
from . import standard_streams

INTERFACE = ("bl_operators", "bl_ui", "nodeitems_builtins")
"""Blender's panels, menus and operators in Python. The add-ons below add to them."""
ADDONS = ("cycles", "io_scene_gltf2")
"""Cycles keeps its settings in scenes."""
NEVER = (
    "bl_pkg",
    "io_anim_bvh",
    "io_curve_svg",
    "io_mesh_uv_layout",
    "io_scene_fbx",
    "keyingsets_builtins",
    "pose_library",
)
"""What no bake needs: extensions from the network, formats that are no meshes or that Blender reads without Python, poses."""


class _StandIns:
    """Finds modules that do nothing instead of those of these names, and is their loader."""

    def __init__(self, names: Sequence[str]):
        self.names = names

    def find_spec(self, name: str, path=None, target=None) -> ModuleSpec | None:
        return ModuleSpec(name, self, origin=__file__, is_package=True) if name in self.names else None

    def create_module(self, spec: ModuleSpec) -> ModuleType | None:
        return None  # Python makes a plain one

    def exec_module(self, module: ModuleType) -> None:
        module.__file__ = __file__  # Blender refuses add-ons without a file
        module.register = _register if module.__name__ == INTERFACE[0] else _nothing
        module.unregister = _nothing


class _Lean:
    """What is left out so far."""

    def __init__(self):
        self.is_lean = self.was_lean = False
        self.classes: list[Any] = []
        """Classes that stand for those of modules that are left out."""


_lean = _Lean()


def load() -> None:
    """Import bpy, without what is left out. All is loaded if scripts of the user's own may need it."""
    if "bpy" in sys.modules:
        return
    finder = _StandIns(() if os.environ.get("BLENDER_SYSTEM_SCRIPTS") else (*INTERFACE, *ADDONS, *NEVER))
    sys.meta_path.insert(0, finder)
    try:
        with _functions_when_called():
            import bpy  # noqa: F401
    finally:
        sys.meta_path.remove(finder)
        for name in finder.names:
            if getattr(sys.modules.get(name), "__loader__", None) is finder:
                del sys.modules[name]
    _lean.is_lean = _lean.was_lean = bool(finder.names)


@contextmanager
def _functions_when_called() -> Iterator[None]:
    """Find the functions of shared libraries when they are first called, not all when the library is loaded.

    Blender's has forty others, of which a bake calls little.
    """
    if not hasattr(sys, "setdlopenflags"):  # Windows
        yield
        return
    flags = sys.getdlopenflags()
    sys.setdlopenflags(flags & ~os.RTLD_NOW | os.RTLD_LAZY)
    try:
        yield
    finally:
        sys.setdlopenflags(flags)


def complete(*more: str) -> None:
    """Load INTERFACE and ADDONS, for files that need them, and more add-ons; nothing where all is loaded."""
    if not _lean.was_lean:
        return
    import addon_utils
    from bpy.utils import unregister_class

    for name in more:
        addon_utils.enable(name)
    if not _lean.is_lean:
        return
    _lean.is_lean = False
    while _lean.classes:
        unregister_class(_lean.classes.pop())
    for name in INTERFACE:
        importlib.import_module(name).register()
    for name in ADDONS:
        addon_utils.enable(name)


def _register() -> None:
    """Register what Blender misses where the interface is left out."""
    import bpy

    class Drop(bpy.types.Operator):
        """Blender prints an error if there is no such operator."""

        bl_idname, bl_label = "wm.drop_blend_file", "Drop"

    class Cycles(bpy.types.RenderEngine):
        """Blender reads the name of an engine that is not registered as that of another one."""

        bl_idname, bl_label = "CYCLES", "Cycles"

    _lean.classes += [Drop, Cycles]
    for each in _lean.classes:
        bpy.utils.register_class(each)


def _nothing() -> None:
    pass


def load_blender() -> None:
    """Load Blender where it is a Python package. In Blender this does nothing. Raises NoGpu if it cannot be loaded here."""
    try:
        with standard_streams.silence(1), startup.spent("bpy"):
            load()
    except ImportError as error:
        raise NoGpu(
            NO_BLENDER if error.name == "bpy" else f"Blender's Python package does not load: {error}"
        ) from error


TEMPORARY = "blender_"
"""The start of the name of the folder that each process of Blender makes for its temporary files."""


def end(code: int) -> None:
    """End the process at once, with this exit code, where Blender is a Python package: it unloads for a quarter of a second.

    In Blender this returns: what its add-ons do at the end is theirs.
    """
    bpy = sys.modules.get("bpy")
    if bpy is None or not bpy.app.module:
        return
    standard_streams.flush()
    _remove_temporary(bpy.app.tempdir)
    os._exit(code)


def _remove_temporary(folder: str) -> None:
    """Remove Blender's temporary folder if it is empty, as bakes leave it.

    Never with its content: where Blender could not make a folder, this is the one that all programs share.
    """
    folder = os.path.normpath(folder)
    if os.path.basename(folder).startswith(TEMPORARY):
        with suppress(OSError):
            os.rmdir(folder)
