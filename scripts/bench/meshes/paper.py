# SPDX-License-Identifier: GPL-3.0-or-later
"""What the paper measured."""

PAPER = (
    # high and low polygons; milliseconds on the paper's GPU, of ATI NormalMapper and of nVidia Melody
    (1696, 536, "under 1", 16850, 16306),
    (7910, 4274, "under 1", 24125, 50589),
    (48048, 23378, "31", 97704, 160975),
    (61644, 20517, "31", 129969, 179569),
)
"""Table 1 of the paper: Gumbau, González and Chover, "Hardware generation of normal maps"."""
TERRAIN = (275_772, 9_079)
"""The demo's terrain, used if no folder of pairs has one: about the paper's next sizes."""
