# SPDX-License-Identifier: GPL-3.0-or-later
"""Files that a USD file refers to and that cannot be read: Blender's importer leaves them out and says so in no result."""

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


class UnreadReference(BakeError):
    """A USD file refers to a file that cannot be read. path: of that file."""

    def __init__(self, name: str, path: str):
        super().__init__(f"{name!r} refers to {path!r}, which cannot be read.")
        self.path = path


@contextmanager
def checked(path: Path) -> Iterator[None]:
    """Raise UnreadReference at the end of the block, which imports the USD file at `path`, if it could not read all of it."""
    with TemporaryFile() as said:
        with standard_streams.silence(into=said.fileno()):
            yield
        said.seek(0)
        found = _UNREAD.search(said.read(_MOST))
    if found:
        raise UnreadReference(str(path), found[1].decode(errors="backslashreplace"))
