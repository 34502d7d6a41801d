# SPDX-License-Identifier: GPL-3.0-or-later
"""Meshes far from the origin in .obj and .ply files: where they are, and copies of the files with the meshes near it.

Blender reads coordinates in single precision. At 5,000,000, as in maps of whole countries, it rounds them to 0.5.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

import numpy as np

from .ply_files import read_header

CHUNK = 1 << 24
"""Bytes of text that are moved at once."""
WINDOW, WINDOWS = 1 << 17, 24
"""Bytes of a window in a file, and the number of windows from which its box is estimated."""
FAR, LEAST = 16.0, 1000.0
"""A mesh is far from the origin if it is this many times its own size away, and at least this far."""
LARGEST = 1e18
"""Larger coordinates are damaged: single precision has no areas of such meshes."""
_AXES = ("x", "y", "z")
_IN_OBJ = [1, 2, 3]
"""The columns of x, y and z in a line of an .obj, after its letter."""


def far_origin(path: Path) -> np.ndarray | None:
    """A point (3,) float64 near the mesh in the file, which single precision stores exactly; None if it is not far away.

    Also None for files that store single precision, and for formats other than .obj and .ply. In the file's axes. Raises
    OSError.
    """
    find = {".obj": _obj_points, ".ply": _ply_points}.get(path.suffix.lower())
    points = find(path) if find else np.empty((0, 3))
    points = points[(np.abs(points) < LARGEST).all(axis=1)]
    if not len(points):
        return None
    low, high = points.min(axis=0), points.max(axis=0)
    center, size = (low + high) / 2.0, float(np.linalg.norm(high - low))
    if np.linalg.norm(center) <= max(FAR * size, LEAST):
        return None
    return np.round(center).astype(np.float32).astype(np.float64)


def write_near(source: Path, target: Path, origin: np.ndarray) -> None:
    """Copy the .obj or .ply at `source` with `origin` (3,) subtracted from all its points. Raises OSError."""
    with source.open("rb") as read, target.open("wb") as write:
        if source.suffix.lower() == ".obj":
            for lines in _blocks(read):
                write.write(_moved_obj(lines, origin))
            return
        if header := _Points.of(source):
            write.write(read.read(header.start))
            (_move_binary if header.order else _move_text)(read, write, header, origin)
        while content := read.read(CHUNK):
            write.write(content)


# .obj


def _obj_points(path: Path) -> np.ndarray:
    """Points (N, 3) float64 of an .obj, from windows that are spread over the file."""
    size, windows = path.stat().st_size, []
    with path.open("rb") as file:
        for start in _windows(0, size):
            file.seek(start)
            text = file.read(WINDOW)
            lines = text.split(b"\n")[1 if start else 0 : None if start + WINDOW >= size else -1]
            windows.append(_points([line for line in lines if line.lstrip().startswith((b"v ", b"v\t"))], _IN_OBJ))
    return np.concatenate(windows) if windows else np.empty((0, 3))


def _moved_obj(text: bytes, origin: np.ndarray) -> bytes:
    """Whole lines of an .obj, with `origin` subtracted from the points."""
    lines = np.array(text.split(b"\n"), object)
    starts = np.concatenate([[0], np.flatnonzero(np.frombuffer(text, np.uint8) == ord("\n")) + 1])
    padded = np.frombuffer(text + b"\n\n", np.uint8)
    first, second = padded[starts], padded[starts + 1]
    for indented in np.flatnonzero((first == ord(" ")) | (first == ord("\t"))):
        lines[indented] = lines[indented].lstrip()
        first[indented], second[indented] = (lines[indented] + b"\n\n")[:2]
    is_point = (first == ord("v")) & ((second == ord(" ")) | (second == ord("\t")))
    lines[is_point] = _moved(lines[is_point].tolist(), origin, _IN_OBJ)
    return b"\n".join(lines.tolist())


# .ply


@dataclass(frozen=True)
class _Points:
    """The points of a .ply.

    Attributes:
        order, start: As Header has them.
        columns: The places of x, y and z in a line of text.
    """

    order: str
    start: int
    count: int
    dtype: np.dtype
    columns: list[int]

    @classmethod
    def of(cls, path: Path) -> "_Points | None":
        """The points of the .ply at `path`; None unless they come first and are text or have double precision."""
        header = read_header(path)
        if header is None or not header.elements or header.elements[0].name != "vertex":
            return None
        points = header.elements[0]
        dtype = points.dtype(header.order)
        if dtype is None or not set(_AXES) <= set(points.names):
            return None
        if header.order and any(dtype[axis] != np.dtype(f"{header.order}f8") for axis in _AXES):
            return None
        count = min(points.count, path.stat().st_size)  # a row has at least a byte
        return cls(header.order, header.start, count, dtype, [points.names.index(axis) for axis in _AXES])


def _ply_points(path: Path) -> np.ndarray:
    """Points (N, 3) float64 of a .ply in double precision, from windows that are spread over its points."""
    header = _Points.of(path)
    if header is None:
        return np.empty((0, 3))
    with path.open("rb") as file:
        file.seek(header.start)
        if not header.order:
            lines = file.read(WINDOW).split(b"\n")
            return _points(lines[: min(header.count, len(lines) - 1)], header.columns)
        windows, width = [], header.dtype.itemsize
        for start in _windows(0, header.count * width):
            file.seek(header.start + start // width * width)
            content = file.read(WINDOW // width * width)
            points = np.frombuffer(content[: len(content) // width * width], header.dtype)
            left = header.count - start // width
            windows.append(np.stack([points[axis][:left] for axis in _AXES], axis=1).astype(np.float64))
    return np.concatenate(windows) if windows else np.empty((0, 3))


def _move_binary(read: BinaryIO, write: BinaryIO, header: _Points, origin: np.ndarray) -> None:
    left, width = header.count, header.dtype.itemsize
    while left > 0 and (content := read.read(min(left, CHUNK // width) * width)):
        points = np.frombuffer(content[: len(content) // width * width], header.dtype).copy()
        for axis, value in zip(_AXES, origin, strict=True):
            points[axis] -= value
        write.write(points.tobytes() + content[len(content) // width * width :])
        left -= len(points) or left


def _move_text(read: BinaryIO, write: BinaryIO, header: _Points, origin: np.ndarray) -> None:
    left = header.count
    for text in _blocks(read):
        lines = text.split(b"\n")
        here = min(left, len(lines) - 1 if text.endswith(b"\n") else len(lines))
        lines[:here] = _moved(lines[:here], origin, header.columns)
        write.write(b"\n".join(lines))
        left -= here
        if not left:
            return


# Both


def _windows(start: int, stop: int) -> Iterator[int]:
    """The beginnings of windows that are spread evenly from `start` to `stop`, or cover it."""
    if stop - start <= WINDOWS * WINDOW:
        yield from range(start, stop, WINDOW)
    else:
        yield from np.linspace(start, stop - WINDOW, WINDOWS).astype(np.int64).tolist()


def _blocks(file: BinaryIO) -> Iterator[bytes]:
    """The rest of a file in blocks of whole lines."""
    rest = b""
    while content := file.read(CHUNK):
        block, end, rest = (rest + content).rpartition(b"\n")
        if end:
            yield block + end
    if rest:
        yield rest


def _points(lines: list[bytes], columns: list[int]) -> np.ndarray:
    """The points (N, 3) float64 of lines of text, without those that cannot be read. columns: of x, y and z."""
    table = _table(lines, columns)
    if table is not None:
        return table
    rows = (_row(line, columns) for line in lines)
    return np.array([row for row in rows if row], np.float64).reshape(-1, 3)


def _moved(lines: list[bytes], origin: np.ndarray, columns: list[int]) -> list[bytes]:
    """Lines of text with `origin` subtracted from their points. Lines that cannot be read stay, for the importer to judge."""
    width = len(lines[0].split()) if lines else 0
    start = 1 if columns[0] == 1 else 0  # the letter of a line in an .obj is no number
    table = _table(lines, list(range(start, width)))
    if table is None or max(columns) >= width:
        return [_moved_line(line, origin, columns) for line in lines]
    table[:, np.array(columns) - start] -= origin
    row = " ".join(["v"] * start + ["%.12g"] * (width - start)) + "\n"
    return (row * len(table) % tuple(table.ravel().tolist())).encode().split(b"\n")[:-1]


def _table(lines: list[bytes], columns: list[int]) -> np.ndarray | None:
    """These columns of lines of text, float64; None if the lines differ in their columns or cannot be read."""
    if not lines or not columns or not all(lines):
        return None
    try:
        return np.loadtxt(lines, comments=None, usecols=columns, ndmin=2, encoding="latin1")
    except ValueError:
        return None


def _row(line: bytes, columns: list[int]) -> list[float]:
    words = line.split()
    try:
        return [float(words[column]) for column in columns]
    except (ValueError, IndexError):
        return []


def _moved_line(line: bytes, origin: np.ndarray, columns: list[int]) -> bytes:
    words = line.split()
    for column, value, offset in zip(columns, _row(line, columns), origin, strict=False):
        words[column] = b"%.12g" % (value - offset)
    return b" ".join(words)
