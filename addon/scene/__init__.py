# SPDX-License-Identifier: GPL-3.0-or-later
"""Reads Blender's objects into numpy arrays."""
