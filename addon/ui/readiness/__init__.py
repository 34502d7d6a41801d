# SPDX-License-Identifier: GPL-3.0-or-later
"""The findings before a bake in the panel, and the buttons that cure them."""
