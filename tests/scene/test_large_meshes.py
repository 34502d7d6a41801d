# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests that meshes which are read from copies, array by array, are the same as others."""

from dataclasses import fields

import bpy
import numpy as np
import pytest

from addon.core.settings import Settings
from addon.scene import mesh_reader, reading
from tests.support import zoo
from tests.support.snapshot import difference, snapshot


def smoothed():
    high = zoo.terrain("hi", 8)
    high.modifiers.new("Subdivision", "SUBSURF").levels = 2
    return high


def doubled():
    high = zoo.cube("hi")
    high.modifiers.new("Array", "ARRAY").count = 3
    high.scale = 1.0, -2.0, 0.5
    return high


def font():
    high = bpy.data.objects.new("hi", bpy.data.curves.new("hi", "FONT"))
    high.data.body, high.data.extrude = "Ab", 0.1
    bpy.context.scene.collection.objects.link(high)
    return high


def read(low, high, **settings):
    bpy.context.view_layer.update()
    return reading.read(bpy.context, low, [high], None, Settings(**settings)).highs[0]


@pytest.mark.parametrize("settings", [{"method": "FLATTEN"}, {"method": "CAST", "maps": ("MATERIAL_ID",)}], ids=str)
@pytest.mark.parametrize("make", [smoothed, doubled])
def test_large_meshes_are_read_from_copies_that_are_gone_afterwards(monkeypatch, make, settings):
    low, high = zoo.plane("lo"), make()
    whole = read(low, high, **settings)
    before, made = snapshot(), []
    monkeypatch.setattr(mesh_reader, "LARGE", len(whole.vertices))
    part = mesh_reader.part_of_copy
    monkeypatch.setattr(
        mesh_reader, "part_of_copy", lambda data, copy: part(data, lambda: made.append(copy()) or made[-1])
    )
    in_parts = read(low, high, **settings)
    assert len(made) == 5
    assert not difference(before, snapshot())
    for field in fields(whole):
        a, b = (getattr(mesh, field.name) for mesh in (whole, in_parts))
        assert np.array_equal(a, b) if isinstance(a, np.ndarray) else a == b, field.name


def test_smaller_meshes_are_read_without_copies(monkeypatch):
    low, high = zoo.plane("lo"), smoothed()
    monkeypatch.setattr(mesh_reader, "LARGE", len(read(low, high).vertices) + 1)
    monkeypatch.setattr(mesh_reader, "copied", lambda obj, depsgraph: pytest.fail)
    read(low, high)


def test_text_is_read_from_copies(monkeypatch):
    low, high = zoo.plane("lo"), font()
    whole = read(low, high, method="CAST")
    monkeypatch.setattr(mesh_reader, "LARGE", 1)
    assert np.array_equal(read(low, high, method="CAST").normals, whole.normals)
    assert not [data for data in bpy.data.meshes if data.users == 0]
