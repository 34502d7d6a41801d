# SPDX-License-Identifier: GPL-3.0-or-later
"""Live: the map follows the objects while they are edited."""
