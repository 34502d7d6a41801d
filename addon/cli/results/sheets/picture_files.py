# SPDX-License-Identifier: GPL-3.0-or-later
"""Keeps the pictures of bakes, for pages of results that are made later."""

import hashlib
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from ....core.file_formats import PNG
from ....output.files.atomic_file import replacing
from .. import kept_files
from ..bake_result import Done


def path_of(folder: str, files: Sequence[dict[str, Any]], inputs: Sequence[dict[str, Any]]) -> Path:
    """The absolute path of a bake's picture. What the bake read and wrote is in its name: another map has another picture, and
    a bake that has moved in the job file the same. files, inputs: those of its entry, with their hashes; it has files."""
    read_and_written = "".join(str(each["sha256"]) for each in (*inputs, *files))
    digest = hashlib.sha256(read_and_written.encode()).hexdigest()
    name = kept_files.plain(Path(files[0]["path"]).stem)
    return Path(folder).absolute() / f"{name}_{digest[:12]}{PNG.endings[0]}"


def keep(folder: str, done: Done) -> bytes:
    """Write the picture of a bake, or find that of a bake that was done before, and note its path in the entry.

    Returns it, or nothing if there is none. Raises BakeError if it cannot be written.
    """
    if not done.entry.files:
        return b""
    path = path_of(folder, done.entry.files, done.entry.inputs)
    if done.picture:
        with replacing(path) as partial:
            partial.write_bytes(done.picture)
    elif not path.is_file():
        return b""
    done.entry.picture = str(path)
    return done.picture or read(str(path))


def read(path: str) -> bytes:
    """A picture, or nothing if it cannot be read."""
    try:
        return Path(path).read_bytes() if path else b""
    except OSError:
        return b""
