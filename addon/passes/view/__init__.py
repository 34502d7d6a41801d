# SPDX-License-Identifier: GPL-3.0-or-later
"""Passes that draw in the viewport."""
