# SPDX-License-Identifier: GPL-3.0-or-later
"""Live: maps that are drawn again when their objects change."""
