# SPDX-License-Identifier: GPL-3.0-or-later
"""Copies of large meshes to read from, one for each array, so that what Blender adds to a mesh is freed as soon as it is read.

A copy shares all arrays. Blender doubles an array when it is read, and keeps the normals and triangles that it computes.
"""

from collections.abc import Callable, Iterator
from contextlib import contextmanager

import bpy

LARGE = 2**25
"""Face corners. Smaller meshes are read without copies: Blender then keeps their normals for the next bake."""

Copied = Callable[[], bpy.types.Mesh]
"""A function that adds a copy of a mesh to bpy.data."""


def copied(obj: bpy.types.Object, depsgraph: bpy.types.Depsgraph) -> Copied | None:
    """Copies the mesh of `obj` with its modifiers, as `depsgraph` evaluates it. None in modes that change it before that."""
    if obj.mode != "OBJECT":
        return None
    return lambda: bpy.data.meshes.new_from_object(obj.evaluated_get(depsgraph), depsgraph=depsgraph)


@contextmanager
def part(data: bpy.types.Mesh, copied: Copied | None) -> Iterator[bpy.types.Mesh]:
    """A mesh to read one array of `data` from: a copy in this block if `data` is LARGE, otherwise `data`."""
    if copied is None or len(data.loops) < LARGE:
        yield data
        return
    copy = copied()
    try:
        yield copy
    finally:
        bpy.data.meshes.remove(copy)
