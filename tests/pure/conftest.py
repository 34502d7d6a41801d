# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests of plain Python: they run where neither Blender nor a GPU is, on any system."""

import pytest


@pytest.fixture(autouse=True)
def empty_scene():
    """Takes the place of the fixture that loads Blender's home file: these tests use none."""
