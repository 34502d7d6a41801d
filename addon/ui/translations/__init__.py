# SPDX-License-Identifier: GPL-3.0-or-later
"""The texts of the interface in German and Spanish."""
