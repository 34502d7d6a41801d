# SPDX-License-Identifier: GPL-3.0-or-later
"""Connects images to the shaders of one material, with the nodes and links that an artist would use."""
