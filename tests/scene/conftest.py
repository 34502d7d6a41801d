# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests of reading the scene."""

import bpy
import pytest


@pytest.fixture
def material():
    """A material with a Principled BSDF."""
    return bpy.data.materials.new("Rust")
