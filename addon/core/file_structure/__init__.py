# SPDX-License-Identifier: GPL-3.0-or-later
"""Reads as much of the structure of image files as is needed to know their size."""
