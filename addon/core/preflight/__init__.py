# SPDX-License-Identifier: GPL-3.0-or-later
"""Checks before a bake: whether meshes fit each other, and how much memory the bake needs."""
