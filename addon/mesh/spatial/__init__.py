# SPDX-License-Identifier: GPL-3.0-or-later
"""Orders triangles in space: trees over them, and which of them touch."""
