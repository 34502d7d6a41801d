# SPDX-License-Identifier: GPL-3.0-or-later
"""Reads which materials high meshes have, and the UV maps, attributes and tangents that those need."""
