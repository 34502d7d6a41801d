# SPDX-License-Identifier: GPL-3.0-or-later
"""Conversions of normal maps, as plain data: what a stored map means, and the report."""
