# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests that need neither Blender nor a GPU, and run on any system."""

import sys

import pytest


@pytest.fixture(autouse=True)
def empty_scene(monkeypatch):
    """Replaces the fixture that loads Blender's home file: these tests do not use it, nor Blender's modules."""
    for name in ("bpy", "gpu", "bmesh", "mathutils"):
        monkeypatch.setitem(sys.modules, name, None)  # importing it is an ImportError
