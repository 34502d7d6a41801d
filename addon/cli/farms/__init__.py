# SPDX-License-Identifier: GPL-3.0-or-later
"""The command that sends a job file to a farm, without Blender."""
