# SPDX-License-Identifier: GPL-3.0-or-later
"""Files that are complete or absent, and paths that must not meet."""
