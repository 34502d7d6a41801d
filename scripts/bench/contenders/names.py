# SPDX-License-Identifier: GPL-3.0-or-later
"""The names of the bakers, as the report shows them."""

FLATTEN, CAST, OUTERMOST, KEPT, CYCLES, MULTIRES = (
    "Imprint, Flatten",
    "Imprint, Cast",
    "Imprint, Cast, outermost hit",
    "Imprint, Cast, tree kept",
    "Cycles, selected to active",
    "Blender, multires",
)
PEERS = {
    "open3d": "Open3D, RaycastingScene",
    "embreex": "embreex, rays alone",
    "pymeshlab": "pymeshlab, transfer to texture",
}
"""Of the bakers outside Blender, by the module that they are in."""
PRESENT = "Imprint"
"""This version, where it is compared with an older one."""
ALL_SAMPLES = "Imprint, all samples"
"""This version, without adaptive samples."""
OURS = (PRESENT, ALL_SAMPLES, FLATTEN, CAST, OUTERMOST, KEPT)
"""The names of this version, by which two runs are compared."""
