# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests what is removed when the making of meshes fails."""

import bpy
import pytest

from addon.jobs import temporary


def test_what_others_made_meanwhile_stays():
    """A second window and other add-ons go on while a task runs."""
    with pytest.raises(KeyError), temporary.only_if_finished():
        bpy.data.texts.new("notes")
        bpy.data.actions.new("swing")
        bpy.data.meshes.new("low")
        bpy.data.images.new("map", 4, 4)
        raise KeyError
    assert "notes" in bpy.data.texts
    assert "swing" in bpy.data.actions
    assert not bpy.data.meshes
    assert "map" not in bpy.data.images
