# SPDX-License-Identifier: GPL-3.0-or-later
"""Arrays in, texels out: chooses the method, casts rays, renders the maps."""
