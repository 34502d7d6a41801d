# SPDX-License-Identifier: GPL-3.0-or-later
"""Plain data and rules. Nothing here imports bpy or gpu."""
