# SPDX-License-Identifier: GPL-3.0-or-later
"""Sends batches to farms. Its modules do without Blender."""
