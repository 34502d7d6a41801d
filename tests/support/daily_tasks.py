# SPDX-License-Identifier: GPL-3.0-or-later
"""The presses that ten daily tasks take, as tests/window/artist.py makes them. scripts/dev/presses.py counts them, too."""

PRESSES = {
    "bake a normal map of a pair": 2,  # the low object, whose high one is found by its name, and Bake
    "bake six maps": 8,
    "look at occlusion on the model": 1,
    "compare high and low": 1,
    "switch to Unreal Engine": 2,
    "batch of seven, find the wrong two": 3,  # Sets and the plus sign at first, and Bake each time
    "make levels of detail": 2,  # the panel More, in which that of the levels is open
    "change the size": 2,
    "export a .glb": 2,
    "bake a high mesh that is inside out": 1,
}
