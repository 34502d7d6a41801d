# SPDX-License-Identifier: GPL-3.0-or-later
"""Vertex groups of low meshes that change rays: which settings name, and a proposal of weights."""
