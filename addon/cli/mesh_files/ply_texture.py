# SPDX-License-Identifier: GPL-3.0-or-later
"""Reads from .ply files what Blender's importer leaves out: the images, and UVs that are stored by face.

MeshLab, Metashape and OpenMVS write them: an image for each `comment TextureFile`, a list `texcoord` of each face, and
`texnumber`, the number of its image.
"""

import itertools
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from . import ply_header
from .ply_header import Element, Header

_SIDES = 3
"""Faces are read if all are triangles, as scans have."""
_INDICES = ("vertex_indices", "vertex_index")
_UV, _IMAGE = "texcoord", "texnumber"


@dataclass(frozen=True)
class Texture:
    """The images of a .ply, as it spells them. Of UVs by face also: uv (T, 3, 2) float32; corners (T, 3), indices of points;
    images (T,), the number of each triangle's image.
    """

    names: list[str]
    uv: np.ndarray | None = None
    corners: np.ndarray | None = None
    images: np.ndarray | None = None


def read(path: Path) -> Texture | None:
    """The images of the .ply at `path`; None if it names none. Raises OSError."""
    header = ply_header.read(path)
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
        widths = [each.dtype(header.order) for each in before]
        if any(width is None for width in widths):
            return None
        start = header.start + sum(each.count * width.itemsize for each, width in zip(before, widths, strict=True))
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
