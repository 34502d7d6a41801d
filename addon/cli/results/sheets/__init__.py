# SPDX-License-Identifier: GPL-3.0-or-later
"""Pages of results for a browser, and the pictures in them."""
