# SPDX-License-Identifier: GPL-3.0-or-later
"""Turns meshes as arrays into maps as arrays: chooses the method, casts rays, renders the maps."""
