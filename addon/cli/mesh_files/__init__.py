# SPDX-License-Identifier: GPL-3.0-or-later
"""Mesh files from other programs: their images, their coordinates far from the origin, and their import."""
