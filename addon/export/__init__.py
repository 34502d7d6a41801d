# SPDX-License-Identifier: GPL-3.0-or-later
"""Writes low meshes with their maps for engines, reads the files back, and measures what an engine would show of them."""
