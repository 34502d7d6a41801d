# SPDX-License-Identifier: GPL-3.0-or-later
"""What the command line and job files understand. Nothing here needs Blender."""
