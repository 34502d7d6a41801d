# SPDX-License-Identifier: GPL-3.0-or-later
"""Levels of detail: coarser meshes with the UV layout of one mesh, each with a map of its own."""
