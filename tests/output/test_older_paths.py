# SPDX-License-Identifier: GPL-3.0-or-later
"""Paths of files, as Blender 4.5 has them."""

from types import SimpleNamespace

import bpy
import pytest

from addon import older_blender
from addon.core.errors import BakeError
from tests.support import zoo

ELSEWHERE = "/elsewhere/points.mdd"


@pytest.fixture
def paths(gpu_context, tmp_path):
    """What visiting the paths of an open file gives, which has two images and a cache of points. Returns the images' paths."""
    found = []
    for name in ("a.png", "b.png"):
        image = bpy.data.images.new(name, 4, 4)
        image.filepath_raw = str(tmp_path / name)
        image.save()
        found.append(image.filepath)
    zoo.plane("lo").modifiers.new("cache", "MESH_CACHE").filepath = ELSEWHERE
    return found


@pytest.fixture
def older(monkeypatch):
    """Blender has no `file_path_foreach`."""
    data = SimpleNamespace(file_path_map=bpy.data.file_path_map)
    monkeypatch.setattr(older_blender, "bpy", SimpleNamespace(data=data, app=bpy.app))


def visited(change=lambda _owner, _path: None):
    """The names of owners and the paths that are visited."""
    found = []

    def visit(owner, path, _about):
        found.append((owner.name, path))
        return change(owner, path)

    older_blender.visit_file_paths(visit)
    return sorted(found)


def test_paths_are_those_of_this_blender(paths, request):
    wanted = [each for each in visited() if each[1]]
    assert {path for _, path in wanted} == {*paths, ELSEWHERE}
    request.getfixturevalue("older")
    assert visited() == wanted


def test_the_path_of_an_image_can_be_emptied(paths, older):
    visited(lambda owner, _path: "" if owner.name == "a.png" else None)
    assert [bpy.data.images[name].filepath for name in ("a.png", "b.png")] == ["", paths[1]]


def test_a_path_that_cannot_be_emptied_is_named(paths, older):
    with pytest.raises(BakeError, match=rf"cannot leave out '{ELSEWHERE}' of 'lo': 5.0 can"):
        visited(lambda _owner, path: "" if path == ELSEWHERE else None)
