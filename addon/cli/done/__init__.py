# SPDX-License-Identifier: GPL-3.0-or-later
"""Which bakes are done already, by their records, and which process does one now. Without Blender."""
