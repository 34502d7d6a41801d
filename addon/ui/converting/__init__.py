# SPDX-License-Identifier: GPL-3.0-or-later
"""The conversion of an existing map: its panel and its operator."""
