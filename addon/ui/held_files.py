# SPDX-License-Identifier: GPL-3.0-or-later
"""Undo and Redo bring back the files that steps of the window have written: each scene has the name of the last such step."""

import secrets
from collections.abc import Collection, Iterator
from contextlib import contextmanager
from pathlib import Path

import bpy
from bpy.props import StringProperty

from ..core import udim
from ..output.file_history import FileHistory
from .callbacks import Timer, events, redraw, registering
from .texts import labeled


class HeldFiles:
    """Keeps the files of steps in the window.

    is_on: whether it does. Scripts in the background have no Undo.
    told: what Undo or Redo did not bring back, in sentences, until the next step.
    """

    def __init__(self):
        self.is_on = False
        self.told: list[str] = []
        self._history = FileHistory()
        self._scenes: set[int] = set()
        """The session_uid of each scene that has had the name of a step: those that are added later have none."""
        events.hear(undo_post=self.put_back, redo_post=self.put_back, save_post=self._after_saving, end=self.forget)

    def begin(self) -> None:
        """Begin a step: an undo step of Blender has to follow its end."""
        if self.is_on and not self._history.has_begun:
            self.told = []
            self._history.begin(bpy.app.tempdir, bpy.context.preferences.edit.undo_steps)

    def end(self) -> None:
        """End the step, before Blender notes the scene for Undo."""
        name = secrets.token_hex(8)
        if self._history.has_begun and self._history.end(name):
            for scene in bpy.data.scenes:
                if scene.is_editable:
                    scene.imprint_files = name
                    self._scenes.add(scene.session_uid)

    @contextmanager
    def step(self) -> Iterator[None]:
        """A step, in the block; in a step, a part of it."""
        if self._history.has_begun:
            yield
            return
        self.begin()
        try:
            yield
        finally:
            self.end()

    def put_back(self, *_) -> None:
        """Give the files the content that they had in the step that Undo or Redo has restored."""
        scenes = [scene for scene in bpy.data.scenes if scene.session_uid in self._scenes]
        if self._history.is_empty or not scenes:
            return
        moved = self._history.go_to({scene.imprint_files for scene in scenes})
        if moved.paths:
            _reload(moved.paths)
        if moved.paths or moved.sentences:
            self.told = moved.sentences
            redraw(region="UI")
        if moved.sentences:
            _telling.start()

    def _after_saving(self, path: str = "", *_) -> None:
        """The .blend that was saved shows the files as they are, whatever is undone before it is saved again. path: where it
        was saved, which is another place where it is a copy."""
        if path == bpy.data.filepath:
            self._history.save()

    def forget(self) -> None:
        """Keep nothing."""
        self._history.forget()
        self._scenes.clear()
        self.told = []


def _reload(paths: Collection[Path]) -> None:
    """Load the images of these files again. Packed ones have their own content."""
    resolved = set(map(str, paths))
    for image in bpy.data.images:
        if image.source in {"FILE", "TILED"} and image.filepath and not image.packed_files:
            path = bpy.path.abspath(image.filepath, library=image.library)
            files = [udim.fill(path, tile.number) for tile in image.tiles] if image.source == "TILED" else [path]
            if any(str(Path(file).resolve()) in resolved for file in files):
                image.reload()


class IMPRINT_OT_tell(bpy.types.Operator):
    """Show in the status bar and the Info editor what Undo did not bring back"""

    bl_idname = "imprint.tell"
    bl_label = "Tell of Files"
    bl_options = {"INTERNAL"}

    def invoke(self, context: bpy.types.Context, _event: bpy.types.Event) -> set[str]:
        context.window_manager.modal_handler_add(self)
        return {"RUNNING_MODAL"}

    def modal(self, _context: bpy.types.Context, _event: bpy.types.Event) -> set[str]:
        for text in held_files.told:
            self.report({"WARNING"}, text)
        return {"FINISHED", "PASS_THROUGH"}


def _tell() -> None:
    """Blender shows the reports of operators that wait for events, and of no others that Python calls."""
    window = next(iter(bpy.context.window_manager.windows), None)
    if window is not None and not bpy.app.background:
        with bpy.context.temp_override(window=window):
            bpy.ops.imprint.tell("INVOKE_DEFAULT")


_telling = Timer(_tell)
held_files = HeldFiles()
_register, _unregister = registering(
    (IMPRINT_OT_tell,),
    properties={
        "Scene.imprint_files": labeled(
            StringProperty, "Files", "Name of the last step that wrote files, for Undo", options={"HIDDEN", "SKIP_SAVE"}
        )
    },
)


def register() -> None:
    _register()
    held_files.is_on = not bpy.app.background


def unregister() -> None:
    held_files.forget()
    held_files.is_on = False
    _unregister()
