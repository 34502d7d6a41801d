# SPDX-License-Identifier: GPL-3.0-or-later
"""References to objects by session_uid."""

import os
from dataclasses import dataclass

import bpy

from ..core import naming
from ..core.errors import BakeError

GONE = -1
"""The uid of an object that does not exist."""


@dataclass(frozen=True)
class ObjectRef:
    """A reference to an object that stays valid if the object is renamed, or deleted and restored by Undo.

    A bpy reference crashes after Undo, and a name may also belong to a linked or a newer object. uid: its session_uid, or 0
    for any object of that name. name: its name when `of` was called. library: the absolute path of the library of a linked
    object; reloading the library gives the object another session_uid.
    """

    uid: int
    name: str
    library: str = ""

    @classmethod
    def of(cls, obj: bpy.types.Object) -> "ObjectRef":
        """A reference to `obj`."""
        return cls(obj.session_uid, obj.name, _library(obj))

    def find(self) -> bpy.types.Object | None:
        """The object, or None if it was deleted."""
        found = bpy.data.objects.get(self.name)  # nearly always right, and much faster than a search
        if found is None or self.uid not in {0, found.session_uid}:
            found = next((obj for obj in bpy.data.objects if obj.session_uid == self.uid), None)
        if found is None and self.library:
            found = next(
                (obj for obj in bpy.data.objects if obj.name == self.name and _library(obj) == self.library), None
            )
        return found

    def resolve(self) -> bpy.types.Object:
        """The object. Raises BakeError if it was deleted."""
        if not self.uid:
            return by_name(self.name)
        found = self.find()
        if found is None:
            raise BakeError(f"{self.name!r} was deleted: bring it back with Undo, or choose another object.")
        return found


def by_name(name: str) -> bpy.types.Object:
    """The object with this name. Raises BakeError, with similar names, if there is none."""
    if name not in bpy.data.objects:
        raise BakeError(naming.no_such_object(name, bpy.data.objects.keys()))
    return bpy.data.objects[name]


def scene_by_uid(uid: int) -> bpy.types.Scene | None:
    """The scene with this session_uid, or None if it was deleted."""
    return next((scene for scene in bpy.data.scenes if scene.session_uid == uid), None)


def _library(obj: bpy.types.Object) -> str:
    """The absolute path of the library that `obj` is linked from; empty for a local object."""
    return os.path.abspath(bpy.path.abspath(obj.library.filepath)) if obj.library else ""
