# SPDX-License-Identifier: GPL-3.0-or-later
"""Reads the headers of .ply files, and the images and UVs by face of scans, which Blender's importer leaves out.

MeshLab, Metashape and OpenMVS write an image for each `comment TextureFile`, a list `texcoord` of each face, and `texnumber`,
the number of its image.
"""

import itertools
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
    """A property of an element.

    Attributes:
        counts: The type of a list's length; empty for a single value.
        name: As the file spells it.
        kind: The type of a value, as numpy names it.
    """

    name: str
    kind: str
    counts: str = ""


@dataclass(frozen=True)
class Element:
    """Rows of a .ply, such as its points or its faces.

    Attributes:
        name: As the file spells it.
        count: The number of rows.
    """

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
    """The head of a .ply.

    Attributes:
        order: Of bytes, as numpy spells it; empty for text.
        start: Of the first element, in bytes from the start of the file.
        textures: The images that comments name.
    """

    order: str
    start: int
    elements: list[Element]
    textures: list[str]


def read_header(path: Path) -> Header | None:
    """The header of the .ply at `path`; None if it cannot be read. Raises OSError."""
    order: str | None = None
    start, elements, textures = 0, [], []
    with path.open("rb") as file:
        for number, line in enumerate(iter(lambda: file.readline(LONGEST_LINE), b"")):
            start += len(line)
            words = line.decode(errors="replace").split()
            if (number == 0 and words != ["ply"]) or number > MOST_LINES:
                return None
            if words == ["end_header"]:
                if order is None or any(len(set(each.names)) < len(each.names) for each in elements):
                    return None
                return Header(order, start, elements, textures)
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


_SIDES = 3
"""Faces are read if all are triangles, as scans have."""
_INDICES = ("vertex_indices", "vertex_index")
_UV, _IMAGE = "texcoord", "texnumber"


@dataclass(frozen=True)
class Texture:
    """The images of a .ply, and UVs by face if it has them.

    Attributes:
        names: As the file spells them.
        uv (T, 3, 2) float32: Of the corners.
        corners (T, 3): Indices of points.
        images (T,): The number of each triangle's image.
    """

    names: list[str]
    uv: np.ndarray | None = None
    corners: np.ndarray | None = None
    images: np.ndarray | None = None


def read_texture(path: Path) -> Texture | None:
    """The images of the .ply at `path`; None if it names none. Raises OSError."""
    header = read_header(path)
    if header is None or not header.textures:
        return None
    by_name = {element.name: element for element in header.elements}
    face = by_name.get("face")
    if face is None or _UV not in face.names or not any(name in face.names for name in _INDICES):
        return Texture(header.textures)
    rows = _rows(path, header, face)
    if rows is None:
        return Texture(header.textures)
    corners, uv, images = rows
    return Texture(header.textures, uv.reshape(-1, _SIDES, 2).astype(np.float32), corners, images)


def _rows(path: Path, header: Header, face: Element) -> tuple[np.ndarray, np.ndarray, np.ndarray] | None:
    """The points, UVs and images of all faces; None if they are not all triangles with UVs."""
    index = next(name for name in _INDICES if name in face.names)
    sides = {index: _SIDES, _UV: 2 * _SIDES}
    dtype = face.dtype("<" if not header.order else header.order, sides)
    before = list(itertools.takewhile(lambda each: each is not face, header.elements))
    if dtype is None:
        return None
    if header.order:
        rows = [(each.count, each.dtype(header.order)) for each in before]
        start = header.start + sum(count * row.itemsize for count, row in rows if row is not None)
        if any(row is None for _, row in rows):
            return None
        if path.stat().st_size < start + face.count * dtype.itemsize:
            return None
        table = np.fromfile(path, dtype, face.count, offset=start)
    else:
        table = _from_text(path, header, sum(each.count for each in before), face, dtype)
    if table is None or not all((table[f"count of {name}"] == count).all() for name, count in sides.items()):
        return None
    images = table[_IMAGE] if _IMAGE in face.names else np.zeros(len(table), np.int32)
    return table[index].astype(np.int64), table[_UV], images.astype(np.int64)


def _from_text(path: Path, header: Header, skipped: int, face: Element, dtype: np.dtype) -> np.ndarray | None:
    with path.open("rb") as file:
        file.seek(header.start)
        try:
            lines = list(itertools.islice(file, skipped, skipped + face.count))
            return np.loadtxt(lines, dtype, comments=None, ndmin=1) if lines else None
        except ValueError:
            return None
