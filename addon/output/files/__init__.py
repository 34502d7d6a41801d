# SPDX-License-Identifier: GPL-3.0-or-later
"""Writes files atomically, and detects clashes of their paths."""
