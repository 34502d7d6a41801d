# SPDX-License-Identifier: GPL-3.0-or-later
"""Hits on high meshes whose triangles are in several parts."""
