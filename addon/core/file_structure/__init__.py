# SPDX-License-Identifier: GPL-3.0-or-later
"""How image files are built, as far as it takes to check and to correct what Blender wrote."""
