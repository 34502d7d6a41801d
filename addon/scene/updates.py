# SPDX-License-Identifier: GPL-3.0-or-later
"""Which objects have another shape after an update of Blender's depsgraph."""

import bpy


class Shapes:
    """Tells the changes of shapes from those of materials, among the updates of one handler.

    From 5.3 on, Blender reports the geometry of a mesh object as updated if it shows its datablock, as without modifiers, and
    a material of that has changed: also when Live stores its map into an image of the material. Curves and metaballs, which
    older versions report so, count as changed.
    """

    def __init__(self):
        self._shows_data: dict[int, bool] = {}
        """Whether a mesh object, by its session_uid, showed its datablock when its geometry was last reported."""

    def changed(self, depsgraph: bpy.types.Depsgraph) -> set[int]:
        """The session_uid of each object whose evaluated shape is another one than before."""
        updates = [update for update in depsgraph.updates if update.is_updated_geometry or update.is_updated_shading]
        shaded = {update.id.original for update in updates if not update.is_updated_geometry}
        uids = set()
        for update in updates:
            obj = update.id.original
            if not isinstance(obj, bpy.types.Object) or not update.is_updated_geometry:
                continue
            is_shown = obj.type == "MESH" and update.id.data == obj.data.evaluated_get(depsgraph)
            # The modifiers of an object that shows its datablock do nothing now, but may have done something before.
            was_shown = self._shows_data.get(obj.session_uid, is_shown)
            self._shows_data[obj.session_uid] = is_shown
            if not (is_shown and was_shown and obj.data in shaded):
                uids.add(obj.session_uid)
        return uids
