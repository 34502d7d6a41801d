# SPDX-License-Identifier: GPL-3.0-or-later
"""Draws meshes with more triangles than texels, or than fit on the GPU at once."""
