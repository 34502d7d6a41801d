# SPDX-License-Identifier: GPL-3.0-or-later
"""Meshes as numpy arrays. Nothing here imports Blender."""
