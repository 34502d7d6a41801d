# SPDX-License-Identifier: GPL-3.0-or-later
"""Draws the maps of a band of texels: samples of the high surface, and every map that starts from them."""
