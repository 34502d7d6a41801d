# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests how the version of Blender is found."""

import importlib.metadata
import sys
from types import SimpleNamespace

import pytest

from addon.core import versions


@pytest.fixture
def no_package_read():
    versions._package.cache_clear()
    yield
    versions._package.cache_clear()


@pytest.mark.usefixtures("no_package_read")
def test_the_version_of_the_package_is_read_once(monkeypatch):
    monkeypatch.delitem(sys.modules, "bpy", raising=False)
    read = []
    monkeypatch.setattr(importlib.metadata, "version", lambda name: read.append(name) or "5.2.3")
    assert [versions.blender(), versions.blender()] == ["5.2.3", "5.2.3"]
    assert read == ["bpy"]


@pytest.mark.usefixtures("no_package_read")
def test_a_blender_that_is_loaded_later_is_asked(monkeypatch):
    monkeypatch.delitem(sys.modules, "bpy", raising=False)
    monkeypatch.setattr(importlib.metadata, "version", lambda name: "5.2.3")
    assert versions.blender() == "5.2.3"
    monkeypatch.setitem(sys.modules, "bpy", SimpleNamespace(app=SimpleNamespace(version=(4, 5, 15))))
    assert versions.blender() == "4.5.15"
