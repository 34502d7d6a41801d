# SPDX-License-Identifier: GPL-3.0-or-later
"""Shows in the 3D viewport where rays start and end: two shells around the low mesh that follow the two distances."""

from dataclasses import dataclass
from enum import Enum

import bpy
import gpu

from ...core.errors import BakeError
from ...scene import object_refs
from ...views import cage_shells
from ..callbacks import DrawCallbacks, Handlers, Timer, redraw

OUTER, INNER = (0.1, 0.45, 1.0, 0.25), (1.0, 0.45, 0.1, 0.25)
"""Colors of where rays start and where they end."""


class CageState(Enum):
    """The state of the overlay."""

    OFF = "off"
    READING = "reading"
    """It waits for the timer to read the low mesh."""
    SHOWN = "shown"
    """It draws the low mesh as it is, or cannot read it."""


@dataclass(frozen=True)
class _Subject:
    """The shells of one low object, for one choice of ray directions."""

    low: object_refs.ObjectRef
    directions: str

    def is_of(self, low: bpy.types.Object, directions: str) -> bool:
        return (self.low.uid, self.directions) == (low.session_uid, directions)


class CageOverlay:
    """Draws the shells of the panel's low object."""

    def __init__(self):
        self._draw_callbacks = DrawCallbacks((bpy.types.SpaceView3D, self._draw, "POST_VIEW"))
        self._handlers = Handlers(
            ("depsgraph_update_post", self._on_update),
            ("frame_change_post", self._on_update),
            ("undo_post", self._on_undo),
            ("redo_post", self._on_undo),
        )
        self.timer = Timer(self.catch_up)
        self._wanted: _Subject | None = None
        """The shells that a view needed when it was last drawn."""
        self._read: _Subject | None = None
        self._mesh: gpu.types.GPUBatch | None = None
        """The low mesh of `_read`; None where it cannot be read."""
        self._is_outdated = False
        """Whether that mesh has changed since."""

    @property
    def state(self) -> CageState:
        if not self._draw_callbacks.are_added:
            return CageState.OFF
        return CageState.READING if self.timer.is_running else CageState.SHOWN

    @property
    def is_on(self) -> bool:
        """Whether the shells are drawn."""
        return self.state is not CageState.OFF

    def show(self) -> None:
        """Draw the shells from now on."""
        self._draw_callbacks.add()
        self._handlers.add()

    def hide(self) -> None:
        """Stop drawing. No handler, timer or mesh remains."""
        self._draw_callbacks.remove()
        self._handlers.remove()
        self.timer.stop()
        self._wanted = self._read = self._mesh = None

    def mesh_of(self, low: bpy.types.Object, directions: str) -> gpu.types.GPUBatch | None:
        """The low mesh as last read, or None. If it is missing or outdated, the timer reads it."""
        self._wanted = _Subject(object_refs.ObjectRef.of(low), directions)
        is_read = self._read is not None and self._read.is_of(low, directions)
        if not is_read or self._is_outdated:
            self.timer.start()
        return self._mesh if is_read else None

    def catch_up(self) -> None:
        """Read the low mesh. Do not call this while a view is being drawn: reading evaluates the scene."""
        low = self._wanted.low.find() if self._wanted is not None else None
        if low is None:
            return
        try:
            mesh = cage_shells.upload(low, bpy.context.evaluated_depsgraph_get(), self._wanted.directions)
        except BakeError:
            mesh = None
        self._read, self._mesh, self._is_outdated = self._wanted, mesh, False
        redraw()

    def _on_update(self, _scene: bpy.types.Scene, depsgraph: bpy.types.Depsgraph) -> None:
        """Only changes of the low object count: the user may move or sculpt another object for minutes."""
        if self._read is None:
            return
        self._is_outdated |= any(
            (update.is_updated_geometry or update.is_updated_transform)
            and update.id.original.session_uid == self._read.low.uid
            for update in depsgraph.updates
            if isinstance(update.id, bpy.types.Object)
        )

    def _on_undo(self, *_) -> None:
        self._is_outdated = True

    def _draw(self) -> None:
        context = bpy.context
        settings = context.scene.imprint
        low, _ = settings.chosen_objects(context)
        if low is None or low.type != "MESH" or low.mode != "OBJECT" or not low.data.polygons:
            return
        mesh = self.mesh_of(low, settings.directions)
        if mesh is None:
            return
        extrusion, reach = settings.distances(context)
        gpu.state.blend_set("ALPHA")
        gpu.state.depth_test_set("LESS_EQUAL")
        view = context.region_data.perspective_matrix
        for away, color in ((extrusion, OUTER), (extrusion - reach, INNER)):
            cage_shells.draw(mesh, view, away, color)
        gpu.state.depth_test_set("NONE")
        gpu.state.blend_set("NONE")


overlay = CageOverlay()
