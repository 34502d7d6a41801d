# SPDX-License-Identifier: GPL-3.0-or-later
"""Passes that cast many rays from each hit: ambient occlusion with bent normals, thickness, and curvature.

Each has an `add`, which adds rays to sums, and what turns the sums into values. All rays of a texel are points of one lattice.
"""
