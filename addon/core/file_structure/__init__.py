# SPDX-License-Identifier: GPL-3.0-or-later
"""Reads as much of the structure of files as is needed: their size, whether they are whole, and what they refer to."""
