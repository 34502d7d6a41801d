# SPDX-License-Identifier: GPL-3.0-or-later
"""Whole jobs: one bake, several bakes, a sequence, a live session."""
