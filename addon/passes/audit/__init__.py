# SPDX-License-Identifier: GPL-3.0-or-later
"""Passes that count and identify triangles in UV space."""
