# SPDX-License-Identifier: GPL-3.0-or-later
"""The stored map of a conversion, and how it fits the low mesh."""
