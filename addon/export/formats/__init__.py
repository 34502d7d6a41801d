# SPDX-License-Identifier: GPL-3.0-or-later
"""The formats: each has a function that writes staged objects with Blender's exporter, and one that reads the file back."""
