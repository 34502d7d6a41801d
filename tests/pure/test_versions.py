# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests how the version of Blender is found, and what changes the hash of the code."""

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


def code_after(root, name="", content=b""):
    """The hash of the code in `root`, after a change of a file."""
    if name:
        (root / name).parent.mkdir(parents=True, exist_ok=True)
        (root / name).write_bytes(content)
    versions.code.cache_clear()
    return versions.code(root)


def test_any_code_that_bakes_changes_the_hash_and_that_of_the_window_does_not(tmp_path):
    before = code_after(tmp_path, "addon/jobs/bake.py", b"one\ntwo\n")
    for name in (
        "addon/ui/panel.py",
        "addon/ui/live.py",
        "addon/jobs/__pycache__/bake.pyc",
    ):
        assert code_after(tmp_path, name, b"window") == before
    assert code_after(tmp_path, "addon/jobs/bake.py", b"one\r\ntwo\r\n") == before
    seen = {before}
    for name in ("addon/jobs/bake.py", "shaders/bake/cast_frag.glsl", "addon/scene/new.py", "addon/ui.py"):
        seen.add(code_after(tmp_path, name, b"other"))
    (tmp_path / "addon/scene/new.py").rename(tmp_path / "addon/scene/newer.py")
    seen.add(code_after(tmp_path))
    assert len(seen) == 6


def test_the_hash_is_that_of_this_code():
    versions.code.cache_clear()
    assert versions.code() == code_after(versions.ROOT) != code_after(versions.ROOT / "docs")
