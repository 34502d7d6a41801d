# SPDX-License-Identifier: GPL-3.0-or-later
"""The modes of the views: what a 3D viewport can show of a map."""

from enum import StrEnum

from ..core.declarations import readers


class Mode(StrEnum):
    """A view that the 3D viewports can show."""

    OFF = "OFF"
    MAP = "MAP"
    SPLIT = "SPLIT"
    DEVIATION = "DEVIATION"
    BARE_DEVIATION = "BARE_DEVIATION"

    @property
    def is_deviation(self) -> bool:
        return self in {Mode.DEVIATION, Mode.BARE_DEVIATION}

    @property
    def next(self) -> "Mode":
        """The next mode; OFF after the last."""
        modes = list(Mode)
        return modes[(modes.index(self) + 1) % len(modes)]


ITEMS = [
    (Mode.OFF.value, "Off", "The viewport as it is"),
    (Mode.MAP.value, "Map", "The low mesh with the map, lit"),
    (
        Mode.SPLIT.value,
        "Split",
        "The high mesh, the low mesh, and the low mesh with the map, side by side in one place",
    ),
    (Mode.DEVIATION.value, "Deviation", "Degrees between the low mesh with the map and the high surface"),
    (Mode.BARE_DEVIATION.value, "Without Map", "Degrees between the low mesh without the map and the high surface"),
]
"""The modes as items of an EnumProperty, in their order."""
OWN = "OWN"
READERS = [
    (OWN, "As Baked", "The program that the map is made for"),
    *((reader.name, reader.label, f"It decodes with the basis {reader.basis.label}") for reader in readers.READERS),
]
"""The programs as which a view can read the map, as items of an EnumProperty."""
SHOWN = tuple(mode for mode in Mode if mode is not Mode.OFF)
"""The modes that draw something."""
