# SPDX-License-Identifier: GPL-3.0-or-later
"""What a call would do, and what is wrong with it, without Blender."""
