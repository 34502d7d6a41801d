# SPDX-License-Identifier: GPL-3.0-or-later
"""Adaptive samples: normal maps that take more samples only where the first ones disagree."""
