# SPDX-License-Identifier: GPL-3.0-or-later
"""Levels of detail as plain data: limits, the search for the coarsest mesh, the report."""
