# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests of reading the scene."""

import bpy  # noqa: F401 - Blender's bmesh module comes with it
