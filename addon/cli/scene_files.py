# SPDX-License-Identifier: GPL-3.0-or-later
"""Scenes for a bake without a window: a .blend is opened, mesh files are imported into an empty scene."""

import os
from collections.abc import Iterable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from pathlib import Path

import bpy

from ..core.errors import BakeError
from ..core.file_formats import OPENED
from ..core.file_structure import blend_files, whole_files
from ..jobs.job import Job
from ..output.files.atomic_file import reason
from ..scene import dependencies
from ..scene.evaluation import set_until
from . import interruption, read_files, standard_streams
from .importers import IMPORTERS, PLAIN, Space, UnreadReference, import_file


class SceneLoader:
    """The scene to bake in, which is changed only when other files are wanted."""

    def __init__(self, folders: Sequence[str] = ()):
        """folders: those that an untrusted file may name files in; none for other files."""
        self._folders = folders
        self._open: tuple[list[Path], Space] = [], PLAIN
        self.notes: list[str] = []
        """Sentences about what is left out of the open files."""
        self._held = ExitStack()
        """Restores the simulation caches."""
        self._changed: set[str] = set()
        """The names of objects that bakes changed: their materials, and the maps in their attributes."""

    def open(self, names: Sequence[str], space: Space) -> None:
        """Open a .blend, or import files into an empty scene; nothing where these are open already.

        A .blend after the first file is appended. space: of the mesh files. Raises BakeError.
        """
        first, *others = (str(_existing(name)) for name in names)
        wanted = [Path(name).resolve() for name in names], space
        if wanted == self._open:
            return
        self._leave()
        if _ending(first) in IMPORTERS:
            _empty()
            self._import_meshes(first, space)
        else:  # a .blend1 as well
            _open_blend(first)
        for name in others:
            self._import_meshes(name, space)
        self.take()
        self._open = wanted

    def take(self) -> None:
        """Use the open scene, whose simulations write no files then. Raises BakeError for what untrusted files must not do."""
        self.notes = read_files.leave_out(self._folders) if self._folders else []
        self.notes += _hold_caches(self._held)

    @contextmanager
    def caches_released(self) -> Iterator[None]:
        """Restore the simulation caches in this block, so that the scene is saved with them."""
        self._held.close()
        yield
        self.take()

    def _leave(self) -> None:
        """Forget the open files: other files or an empty scene replace them."""
        self._open, self.notes, self._held, self._changed = ([], PLAIN), [], ExitStack(), set()

    def changed(self, names: Iterable[str]) -> None:
        """Remember that a bake changed these objects."""
        self._changed.update(names)

    def reopen_if_changed(self, names: Iterable[str]) -> bool:
        """Forget the open .blend if earlier bakes changed one of these objects, so that `open` reads it again.

        Returns whether it did.
        """
        is_needed = bool(self._open[0]) and not self._changed.isdisjoint(names)
        if is_needed:
            self._leave()
        return is_needed

    def job(
        self, low: str, highs: Sequence[str], cage: str | None = None, space: Space = PLAIN, high_up: str = ""
    ) -> Job:
        """An empty scene with these files. The low file and the cage's must contain one mesh each.

        The low object is named after its file, without the ending. space: of the files. high_up: the axis that points up in the
        high files, as in Space. Raises BakeError.
        """
        for name in (low, *highs, *([cage] if cage else [])):
            _existing(name)
        self._leave()
        _empty()
        low_object = _only(low, self._import_meshes(low, space))
        low_object.rename(Path(low).stem, mode="ALWAYS")
        high_objects = [obj for name in highs for obj in self._import_meshes(name, replace(space, up=high_up))] or [
            low_object
        ]
        cage_object = _only(cage, self._import_meshes(cage, space)) if cage else None
        self.take()
        return Job(low_object, high_objects, cage_object)

    def _import_meshes(self, name: str, space: Space) -> list[bpy.types.Object]:
        """As `import_meshes`. A file that an untrusted one refers to elsewhere is named as that."""
        try:
            return import_meshes(name, space)
        except UnreadReference as error:
            if self._folders:
                read_files.check_reference(name, error.path, self._folders)
            raise


def import_meshes(name: str, space: Space) -> list[bpy.types.Object]:
    """Import a file, or append the objects of a .blend; returns the meshes that have faces. Raises BakeError."""
    interruption.check()
    path = _existing(name)
    if _ending(path) not in OPENED:
        raise BakeError(f"{str(path)!r} is not a supported mesh file. Supported: {', '.join(OPENED)}.")
    meshes = [obj for obj in import_file(path, space) if obj.data.polygons or obj.modifiers]
    if not meshes:
        raise BakeError(f"{str(path)!r} holds no mesh with faces.")
    return meshes


def _ending(path: str | Path) -> str:
    return Path(path).suffix.lower()


def _existing(name: str) -> Path:
    path = Path(name).absolute()
    if not os.path.isfile(path):
        raise BakeError(f"There is no file {str(path)!r}.")
    if problem := whole_files.problem(str(path)):
        raise BakeError(f"{str(path)!r} {problem}.")
    return path


def _open_blend(name: str) -> None:
    interruption.check()
    if blend_files.object_names(Path(name)) is None:  # Blender may crash
        raise BakeError(blend_files.NOT_WHOLE.format(name))
    try:
        with standard_streams.silence():
            bpy.ops.wm.open_mainfile(filepath=name, load_ui=False, use_scripts=False)
    except RuntimeError as error:
        raise BakeError(f"{name!r} could not be opened: {reason(error)}.") from error


def _hold_caches(held: ExitStack) -> list[str]:
    """Keep simulations from writing files as frames change, until `held` is closed. Returns sentences about what changes."""
    notes = []
    for obj in bpy.data.objects:
        for modifier in obj.modifiers:
            domain = modifier.domain_settings if modifier.type == "FLUID" else None
            if domain and domain.cache_type == "REPLAY":
                set_until(modifier, "show_viewport", False, held)
                set_until(modifier, "show_render", False, held)
                notes.append(
                    f"The fluid of {obj.name!r} was switched off, as its type Replay writes files: bake it as All or Modular."
                )
        _hold_points(obj, held)
    return notes


def _hold_points(obj: bpy.types.Object, held: ExitStack) -> None:
    """Caches that are baked on disk are read from there; the others stay in memory."""
    for cache in dependencies.point_caches(obj):
        if cache.use_disk_cache and not cache.is_baked:
            set_until(cache, "use_disk_cache", False, held)


def _empty() -> None:
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True, load_ui=False)


def _only(name: str, meshes: Iterable[bpy.types.Object]) -> bpy.types.Object:
    first, *others = meshes
    if others:
        raise BakeError(
            f"{str(Path(name).absolute())!r} holds {len(others) + 1} meshes where one is wanted: join them, or give the "
            "file as FILE and name one of them."
        )
    return first
