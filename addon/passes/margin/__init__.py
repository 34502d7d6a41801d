# SPDX-License-Identifier: GPL-3.0-or-later
"""Passes that fill the margin around UV islands."""
