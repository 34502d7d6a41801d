# SPDX-License-Identifier: GPL-3.0-or-later
"""Reads the headers of .ply files."""

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

LONGEST_LINE, MOST_LINES = 1 << 14, 1000
TYPES = {
    **dict.fromkeys(("char", "int8"), "i1"),
    **dict.fromkeys(("uchar", "uint8"), "u1"),
    **dict.fromkeys(("short", "int16"), "i2"),
    **dict.fromkeys(("ushort", "uint16"), "u2"),
    **dict.fromkeys(("int", "int32"), "i4"),
    **dict.fromkeys(("uint", "uint32"), "u4"),
    **dict.fromkeys(("float", "float32"), "f4"),
    **dict.fromkeys(("double", "float64"), "f8"),
}
"""The types of .ply files as numpy names them."""
_ORDERS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}


@dataclass(frozen=True)
class Property:
    """A property of an element. counts: the type of a list's length; empty for a single value."""

    name: str
    kind: str
    counts: str = ""


@dataclass(frozen=True)
class Element:
    """Rows of a .ply, such as its points or its faces."""

    name: str
    count: int
    properties: list[Property] = field(default_factory=list)

    @property
    def names(self) -> list[str]:
        return [each.name for each in self.properties]

    def dtype(self, order: str, sides: dict[str, int] | None = None) -> np.dtype | None:
        """The type of a row; None if it has lists whose length is not in `sides`, by name. Lengths precede their lists."""
        fields = []
        for each in self.properties:
            if each.counts:
                if not sides or each.name not in sides:
                    return None
                fields += [
                    (f"count of {each.name}", order + each.counts),
                    (each.name, order + each.kind, sides[each.name]),
                ]
            else:
                fields.append((each.name, order + each.kind))
        return np.dtype(fields)


@dataclass(frozen=True)
class Header:
    """order: of bytes, as numpy spells it; empty for text. start: of the first element, in bytes from the start of the file.
    textures: the images that comments name."""

    order: str
    start: int
    elements: list[Element]
    textures: list[str]


def read(path: Path) -> Header | None:
    """The header of the .ply at `path`; None if it cannot be read. Raises OSError."""
    order, start, elements, textures = None, 0, [], []
    with path.open("rb") as file:
        for number, line in enumerate(iter(lambda: file.readline(LONGEST_LINE), b"")):
            start += len(line)
            words = line.decode(errors="replace").split()
            if (number == 0 and words != ["ply"]) or number > MOST_LINES:
                return None
            if words == ["end_header"]:
                valid = order is not None and all(len(set(each.names)) == len(each.names) for each in elements)
                return Header(order, start, elements, textures) if valid else None
            match words:
                case ["format", name, _]:
                    order = _ORDERS.get(name)
                case ["element", name, count] if count.isdecimal():
                    elements.append(Element(name, int(count)))
                case ["property", "list", counts, kind, name] if elements and {counts, kind} <= set(TYPES):
                    elements[-1].properties.append(Property(name, TYPES[kind], TYPES[counts]))
                case ["property", kind, name] if elements and kind in TYPES:
                    elements[-1].properties.append(Property(name, TYPES[kind]))
                case ["element" | "property", *_]:
                    return None
                case ["comment", "TextureFile", *_]:
                    textures.append(line.decode(errors="replace").split("TextureFile", 1)[1].strip())
    return None
