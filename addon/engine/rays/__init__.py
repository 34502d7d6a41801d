# SPDX-License-Identifier: GPL-3.0-or-later
"""Rays from the low mesh to the high meshes: their tree, how far they go, and casting them."""
