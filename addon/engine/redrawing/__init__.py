# SPDX-License-Identifier: GPL-3.0-or-later
"""Draws those parts of a map again whose meshes have changed."""
