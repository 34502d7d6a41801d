# SPDX-License-Identifier: GPL-3.0-or-later
"""What Blender's importers leave out and only print: files that a USD file refers to, and faces of an .obj without points."""

import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryFile

from ...core.errors import BakeError
from .. import standard_streams

_MOST = 1 << 22
"""Bytes of the importer's messages that are searched."""
_UNREAD = re.compile(rb"Could not (?:open asset|load sublayer) @(.+?)@ (?:for|of) ")
_LEFT_OUT = re.compile(rb"Invalid (?:vertex|UV|normal) index .*ignoring face")


class UnreadReference(BakeError):
    """A USD file refers to a file that cannot be read. path: of that file."""

    def __init__(self, name: str, path: str):
        super().__init__(f"{name!r} refers to {path!r}, which cannot be read.")
        self.path = path


@contextmanager
def checked(path: Path) -> Iterator[None]:
    """Raise UnreadReference or BakeError at the end of the block, which imports the file at `path`, if parts were left out."""
    with TemporaryFile() as file:
        with standard_streams.silence(into=file.fileno()):
            yield
        file.seek(0)
        said = file.read(_MOST)
    if found := _UNREAD.search(said):
        raise UnreadReference(str(path), found[1].decode(errors="backslashreplace"))
    if count := len(_LEFT_OUT.findall(said)):
        faces = "1 face" if count == 1 else f"{count:,} faces"
        raise BakeError(
            f"{faces} of {str(path)!r} cannot be read, since points, UVs or normals are missing: export it again."
        )
