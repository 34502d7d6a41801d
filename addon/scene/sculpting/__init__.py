# SPDX-License-Identifier: GPL-3.0-or-later
"""Meshes that are read again while they are edited."""
