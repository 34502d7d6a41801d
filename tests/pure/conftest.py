# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests that need neither Blender nor a GPU, and run on any system."""

import pytest


@pytest.fixture(autouse=True)
def empty_scene():
    """Replaces the fixture that loads Blender's home file, which these tests do not use."""
