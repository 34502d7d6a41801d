# SPDX-License-Identifier: GPL-3.0-or-later
"""Which objects show instances, or surfaces of curves, text and metaballs, besides their own mesh. high_reader reads them."""

from collections.abc import Iterator, Sequence

import bpy

SURFACES = {"CURVE", "SURFACE", "FONT", "META"}
"""Object types, besides meshes, that Blender converts to meshes."""
WITH_NODES = {"CURVES", "POINTCLOUD"}
"""Object types that show meshes if geometry nodes create some."""


def may_show(obj: bpy.types.Object) -> bool:
    """Whether `obj` may show a mesh or instances."""
    if obj.type == "EMPTY":
        return obj.instance_type == "COLLECTION" and obj.instance_collection is not None
    return obj.type in {"MESH", *SURFACES} or (obj.type in WITH_NODES and _has_nodes(obj))


def shows_more(obj: bpy.types.Object) -> bool:
    """Whether `obj` may show more than its own mesh."""
    return obj.type != "MESH" or obj.instance_type != "NONE" or _has_nodes(obj) or len(obj.particle_systems) > 0


def shows_itself(obj: bpy.types.Object, *, for_render: bool) -> bool:
    """Whether `obj` shows its own mesh, which objects with instances can hide."""
    if obj.type != "MESH":
        return False
    if obj.instance_type == "NONE" and not len(obj.particle_systems):
        return True
    return obj.show_instancer_for_render if for_render else obj.show_instancer_for_viewport


def sources(obj: bpy.types.Object) -> Iterator[bpy.types.Object]:
    """The objects that `obj` shows, but whose changes Blender does not report as changes of `obj`.

    These are the objects of an instanced collection, and children."""
    if obj.instance_type in {"VERTS", "FACES"}:
        yield from obj.children
    elif obj.instance_type == "COLLECTION" and obj.instance_collection is not None:
        for inner in obj.instance_collection.all_objects:
            yield inner
            yield from sources(inner)


def shown_by(owners: Sequence[bpy.types.Object]) -> dict[int, set[int]]:
    """The session_uids of the owners that show an object as an instance, by the session_uid of that object."""
    found: dict[int, set[int]] = {}
    for owner in owners:
        for obj in sources(owner):
            found.setdefault(obj.session_uid, set()).add(owner.session_uid)
    return found


def _has_nodes(obj: bpy.types.Object) -> bool:
    return any(modifier.type == "NODES" for modifier in obj.modifiers)
