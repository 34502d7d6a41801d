# SPDX-License-Identifier: GPL-3.0-or-later
"""What a coarser level of a mesh keeps of the UV layout."""
