# SPDX-License-Identifier: GPL-3.0-or-later
"""What became of the bakes of a call: on a terminal, in the report, as an exit code. Without Blender."""
