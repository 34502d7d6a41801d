# SPDX-License-Identifier: GPL-3.0-or-later
"""Adaptive samples: how many each texel takes, and passes that run on some texels alone."""
