# SPDX-License-Identifier: GPL-3.0-or-later
"""Names of objects: in paths of files, and as they tell which objects belong together."""
