# SPDX-License-Identifier: GPL-3.0-or-later
"""How a process of the command line starts and ends, where Blender is a Python package."""
