# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests of the GPU passes alone."""

import bpy  # noqa: F401 - Blender's gpu module comes with it
