# SPDX-License-Identifier: GPL-3.0-or-later
"""Scenes for a bake without a window: what is opened and imported, which files the open scene reads, and which it must not."""

import argparse
import os
from collections.abc import Collection, Iterable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from pathlib import Path

import bpy

from .. import older_blender
from ..core.declarations.choices import Occluders
from ..core.errors import BakeError, reason, shorten_list
from ..core.file_structure import blend_files, mesh_references, usd_layers
from ..jobs.job import Job
from ..output import datablocks
from ..scene import dependencies, evaluation, importing
from ..scene.evaluation import set_until
from ..scene.importing import PLAIN, Space
from . import interruption, plans, standard_streams
from .untrusted import is_below


class SceneLoader:
    """The scene to bake in, which is changed only when other files are wanted."""

    def __init__(self, folders: Sequence[str] = ()):
        """folders: those that an untrusted file may name files in; none for other files."""
        self._folders = folders
        self._open: tuple[list[Path], Space] = [], PLAIN
        self.notes: list[str] = []
        """Sentences about what is left out of the open files."""
        self._shown: str | None = None
        """The scene that the open file shows; None until it was asked for."""
        self._held = ExitStack()
        """Restores the simulation caches."""
        self._changed: set[str] = set()
        """The names of objects that bakes changed: their materials, and the maps in their attributes."""
        self._without_normals: set[int] = set()
        """The session_uid of the meshes of files that do not say how they are shaded."""

    def open(self, names: Sequence[str], space: Space) -> None:
        """Open a .blend, or import files into an empty scene; nothing where these are open already.

        A .blend after the first file is appended. space: of the mesh files. Raises BakeError.
        """
        first, *others = (str(importing.existing(name)) for name in names)
        wanted = [Path(name).resolve() for name in names], space
        if wanted == self._open:
            return
        self._leave()
        if _ending(first) in importing.IMPORTERS:
            _empty()
            self._import_meshes(first, space)
        else:  # a .blend1 as well
            _open_blend(first)
        for name in others:
            with importing.scene_apart():
                self._import_meshes(name, space)
        self.take()
        self._open = wanted

    def choose(self, name: str) -> None:
        """Show the scene of this name, or for "" the one that the open file shows. Raises BakeError, with the names there
        are."""
        window, shown = bpy.context.window, self._shown
        if shown is None:
            shown = self._shown = window.scene.name
        scene = bpy.data.scenes.get(name or shown)
        if scene is None:
            names = shorten_list(map(repr, bpy.data.scenes.keys()))
            raise BakeError(f"There is no scene called {name!r} in the file: it has {names}.")
        if window.scene != scene:
            window.scene = scene

    def take(self) -> None:
        """Use the open scene, whose simulations write no files then. Raises BakeError for what untrusted files must not do."""
        self.notes = leave_out(self._folders) if self._folders else []
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
        self._shown = None
        self._without_normals = set()

    def smooth(self, jobs: Sequence[Job], degrees: int, made: Collection[Job] = ()) -> dict[str, int]:
        """Shade high objects of files that do not say how they are shaded, as Report.smooth_files has it, which is returned.

        Low objects stay flat, as engines show them. made: the jobs whose low object stands for one that is still to be made.
        """
        there = [job.low.data for job in jobs if job not in made]
        lows = {data.session_uid for data in there if data is not None}  # a check names others
        highs = dict.fromkeys(high for job in jobs for high in job.highs if high.type == "MESH")
        unshaded = [high for high in highs if high.data.session_uid in self._without_normals - lows]
        for data in bpy.data.meshes:
            if data.session_uid in self._without_normals:
                importing.smooth(data, degrees if any(high.data == data for high in unshaded) else 0)
        return {high.name: degrees for high in unshaded if degrees}

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
            importing.existing(name)
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
        """As `importing.import_meshes`. A file that an untrusted one refers to elsewhere is named as that."""
        interruption.check()
        try:
            meshes = importing.import_meshes(name, space)
            self._without_normals |= {
                obj.data.session_uid for obj in meshes if importing.lacks_normals(Path(name), obj.data)
            }
            return meshes
        except importing.UnreadReference as error:
            if self._folders:
                check_reference(name, error.path, self._folders)
            raise


def _ending(path: str | Path) -> str:
    return Path(path).suffix.lower()


def _open_blend(name: str) -> None:
    interruption.check()
    if blend_files.object_names(Path(name)) is None:  # Blender may crash
        raise BakeError(blend_files.NOT_WHOLE.format(name))
    try:
        with standard_streams.silence():
            bpy.ops.wm.open_mainfile(filepath=name, load_ui=False, use_scripts=False)
    except RuntimeError as error:
        raise BakeError(f"{name!r} could not be opened: {reason(error)}.") from error


@contextmanager
def opened_blend(name: str) -> Iterator[None]:
    """Open a .blend in the block, and an empty scene after it. Raises BakeError."""
    _open_blend(str(importing.existing(name)))
    try:
        yield
    finally:
        _empty()


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


def read_by(options: argparse.Namespace, jobs: Sequence[Job]) -> Iterator[tuple[str, str]]:
    """The files that the open scene's bake reads beside those of its options, and what they are. Some may not exist."""
    yield from used(options)
    for name in plans.scene_paths(options):
        title = f"what {os.path.basename(name)!r} refers to"
        yield from ((str(path), title) for path in mesh_references.of(name))
    lows, highs = [job.low for job in jobs], [high for job in jobs for high in job.highs]
    cages = [job.cage for job in jobs if job.cage]
    shown = evaluation.shown_surfaces(bpy.context) if options.occluders == Occluders.SCENE else []
    for each in dependencies.of(list(dict.fromkeys([*lows, *highs, *cages, *shown])), highs):
        # The materials of a low object that is its own high one show the maps that the bake replaces.
        if not (each.is_own_map and set(lows) & set(highs)):
            yield each.path, each.what


def not_followed(options: argparse.Namespace, jobs: Sequence[Job]) -> list[str]:
    """Why the bake may read files that `read_by` does not know, in clauses."""
    objects = [obj for job in jobs for obj in (job.low, *job.highs, job.cage) if obj]
    return [
        *filter(None, (usd_layers.named(name).unknown for name in plans.scene_paths(options))),
        *dependencies.not_followed(objects),
    ]


def used(options: argparse.Namespace) -> Iterator[tuple[str, str]]:
    """The files that the open scene uses beside its own, and what they are: libraries, caches, layers of USD files, textures of
    imported meshes."""
    yield from (
        (path, what) for path, what in datablocks.sources() if path != bpy.data.filepath
    )  # it may be saved over
    # The images of a .blend may be maps of an earlier bake, which the next bake replaces.
    named = plans.scene_paths(options)
    for name in named:
        yield from ((path, f"what {os.path.basename(name)!r} refers to") for path in usd_layers.named(name).layers)
    if named and not any(Path(name).suffix.lower().startswith(".blend") for name in named):
        for image in bpy.data.images:
            if image.filepath and not image.packed_file and image.source in {"FILE", "TILED", "SEQUENCE"}:
                yield bpy.path.abspath(image.filepath), "a texture of the meshes"


def forbid_scripts() -> None:
    """Run no scripts of files, even if preferences say so."""
    bpy.context.preferences.filepaths.use_scripts_auto_execute = False


def leave_out(folders: Sequence[str]) -> list[str]:
    """Empty the paths of images, sounds, fonts, caches and others that are not below `folders`, so that they are not read.

    Returns sentences. Raises BakeError for libraries there, and for nodes that import files.
    """
    _check_nodes()
    for library in bpy.data.libraries:
        if not _is_inside(dependencies.absolute(library.filepath, library), folders):
            raise BakeError(f"The library {library.filepath!r} {_not_in(folders)}")
    left: list[str] = []

    def visit(owner: bpy.types.ID, path: str, _about: object) -> str | None:
        if not path or _is_inside(dependencies.absolute(path, owner), folders):
            return None
        left.append(path)
        return ""

    older_blender.visit_file_paths(visit)
    if not left:
        return []
    paths = shorten_list(map(repr, dict.fromkeys(left)))
    return [f"Files outside {folders[0]!r} were not read: {paths}."]


def check_reference(name: str, path: str, folders: Sequence[str]) -> None:
    """Raise BakeError if the file `name` refers to one that is not below `folders`. path: of that one, from the first."""
    if not _is_inside(os.path.join(os.path.dirname(name), path), folders):
        raise BakeError(f"{name!r} refers to {path!r}, which {_not_in(folders)}")


def _not_in(folders: Sequence[str]) -> str:
    return f"is not in {folders[0]!r}, the only folder that --untrusted reads."


def _check_nodes() -> None:
    for tree in bpy.data.node_groups:
        node = next((node for node in tree.nodes if node.bl_idname.startswith(dependencies.IMPORT_NODES)), None)
        if node is not None:
            raise BakeError(
                f"The node {node.name!r} of {tree.name!r} imports a file, which --untrusted refuses: remove it."
            )


def _is_inside(path: str, folders: Sequence[str]) -> bool:
    return any(is_below(os.path.realpath(path), folder) for folder in folders)
