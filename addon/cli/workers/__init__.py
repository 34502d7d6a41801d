# SPDX-License-Identifier: GPL-3.0-or-later
"""Bakes in processes of their own: a crash, a hang or too much memory ends one bake, and no other."""
