# SPDX-License-Identifier: GPL-3.0-or-later
"""Writes maps into image datablocks, files and materials."""
