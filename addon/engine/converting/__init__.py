# SPDX-License-Identifier: GPL-3.0-or-later
"""Existing normal maps in another space or basis."""
