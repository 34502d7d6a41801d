# SPDX-License-Identifier: GPL-3.0-or-later
"""Sends jobs to render farms. Without Blender, for its window and the command line."""
