# SPDX-License-Identifier: GPL-3.0-or-later
"""Conversions of maps on the command line."""
