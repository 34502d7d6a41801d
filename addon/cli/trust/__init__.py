# SPDX-License-Identifier: GPL-3.0-or-later
"""Bakes of files that other people made: what they may read and write, and the rights of the process that bakes them."""
