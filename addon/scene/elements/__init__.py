# SPDX-License-Identifier: GPL-3.0-or-later
"""Faces, edges, vertices and corners of Blender's meshes by number."""
