# SPDX-License-Identifier: GPL-3.0-or-later
"""From objects and settings to an image, a material and a report."""
