# SPDX-License-Identifier: GPL-3.0-or-later
"""The views of the 3D viewport: meshes lit with the map and without, and the cage's shells."""
