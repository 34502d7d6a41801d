# SPDX-License-Identifier: GPL-3.0-or-later
"""The button that exports the last bake."""
