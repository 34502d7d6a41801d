# SPDX-License-Identifier: GPL-3.0-or-later
"""Formats of textures that GPUs read: blocks of 4 x 4 texels, each in 8 or 16 bytes."""
