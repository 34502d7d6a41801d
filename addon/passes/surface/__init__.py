# SPDX-License-Identifier: GPL-3.0-or-later
"""Looks up what the high meshes' materials show at the hits: colors, numbers, attributes, and normals of their own maps."""
