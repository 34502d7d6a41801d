# SPDX-License-Identifier: GPL-3.0-or-later
"""Encodes texels as image files, without Blender: the costly part of each runs in threads."""
