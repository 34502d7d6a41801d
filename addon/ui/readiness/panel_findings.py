# SPDX-License-Identifier: GPL-3.0-or-later
"""The findings before a bake that the panel shows. They are found once, until the low object or a setting changes."""

import bpy

from ...core.settings import Settings
from ...jobs import readiness
from ...jobs.readiness import Finding
from ..callbacks import Handlers


class PanelFindings:
    """The findings for the low object of the panel.

    looks: how often a mesh was looked at. known: what was found the last time, or nothing after a change.
    """

    def __init__(self):
        self.looks = 0
        self._key: tuple | None = None
        self.known: list[Finding] = []
        self._pair: tuple | None = None
        self._flipped: list[Finding] = []
        self._handlers = Handlers(
            ("depsgraph_update_post", self._after_update), ("undo_post", self._drop), ("redo_post", self._drop)
        )

    def of(
        self,
        context: bpy.types.Context,
        low: bpy.types.Object,
        highs: list[bpy.types.Object],
        settings: Settings,
        *,
        is_exported: bool = False,
    ) -> list[Finding]:
        """The findings for a bake of `low`: whether it is flipped, and more if other programs read the map. settings: of the
        panel, valid.

        is_exported: as in readiness.is_for_others.
        """
        found = self._flipped_ones(context, low, highs)
        if not readiness.is_for_others(settings, is_exported=is_exported):
            return found
        return found + readiness.unsolved_by_export(
            self._of(context, low, low in highs, settings), is_exported=is_exported
        )

    def _flipped_ones(
        self, context: bpy.types.Context, low: bpy.types.Object, highs: list[bpy.types.Object]
    ) -> list[Finding]:
        """Whether the faces of high and low point to opposite sides, from the last time if nothing has changed since."""
        key = tuple(
            value
            for obj in (low, *highs)
            for value in (obj.session_uid, obj.data.session_uid if obj.data else 0, obj.name, obj.mode)
        )
        if key != self._pair:
            self._handlers.add()
            self._flipped = readiness.viewport_flipped(context, low, highs)
            self._pair = key
        return self._flipped

    def _of(
        self, context: bpy.types.Context, low: bpy.types.Object, is_own_base: bool, settings: Settings
    ) -> list[Finding]:
        """All findings, from the last time if nothing has changed since."""
        layer = settings.uv_layer or readiness.active_layer(low)
        # Names are in the sentences.
        key = (
            *(low.session_uid, low.data.session_uid, low.name, low.mode, is_own_base),
            *(layer, readiness.active_layer(low), settings.udim),
        )
        if key != self._key:
            self._handlers.add()
            self.looks += 1
            self.known = readiness.viewport_findings(context, low, settings, is_own_base=is_own_base)
            self._key = key
        return self.known

    def forget(self) -> None:
        """Forget the findings, and follow no changes."""
        self._drop()
        self._handlers.remove()

    def _drop(self, *_) -> None:
        self._key, self.known = None, []
        self._pair, self._flipped = None, []

    def _after_update(self, _scene: bpy.types.Scene, depsgraph: bpy.types.Depsgraph) -> None:
        if self._key is None and self._pair is None:
            return
        moved = {update.id.original.session_uid for update in depsgraph.updates if update.is_updated_transform}
        changed = {
            update.id.original.session_uid
            for update in depsgraph.updates
            if update.is_updated_geometry or isinstance(update.id, bpy.types.Mesh)
        }
        if self._pair is not None and not (changed | moved).isdisjoint(self._pair):
            self._pair, self._flipped = None, []
        if self._key is not None and changed.intersection(self._key[:2]):
            self._key, self.known = None, []


findings = PanelFindings()
