# SPDX-License-Identifier: GPL-3.0-or-later
"""The declared settings as Blender's properties."""
