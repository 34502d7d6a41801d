# SPDX-License-Identifier: GPL-3.0-or-later
"""What a setting is: its type, limits, words and place. Panel, command line, job file and manual are made from it."""
