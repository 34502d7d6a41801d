# SPDX-License-Identifier: GPL-3.0-or-later
"""Files that are there whole or not at all."""

import itertools
import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from .errors import BakeError

_NUMBERS = itertools.count()


def check_writable(path: Path) -> None:
    """Raise BakeError unless a file can be put at `path`."""
    try:
        if path.is_dir():
            raise BakeError(f"{str(path)!r} is a folder: name a file.")
        # Ask the file system: permission bits say nothing about a full or read-only disk.
        with tempfile.NamedTemporaryFile(dir=path.parent):
            pass
    except OSError as error:
        raise BakeError(f"{str(path)!r} cannot be written: {reason(error)}.") from error


def reason(error: OSError | RuntimeError) -> str:
    """What a failed operation of the system or of Blender says for itself, in one line without a full stop."""
    if isinstance(error, OSError) and error.strerror:
        return error.strerror
    # Blender raises several reports at once, the first of them the cause.
    return str(error).strip().partition("\n")[0].removeprefix("Error: ").rstrip(".")


class Partial:
    """What is to take the place of the file at `path`, which stays as it is until `commit`.

    here: the path beside it to write to.
    """

    def __init__(self, path: Path):
        self.path = path
        # Not made of path.stem, which may already be as long as the file system allows.
        self.here = path.with_name(f".imprint.{os.getpid()}.{next(_NUMBERS)}.partial{path.suffix}")

    @contextmanager
    def told(self) -> Iterator[None]:
        """Turn what goes wrong in the block into a BakeError."""
        try:
            yield
        except (OSError, RuntimeError) as error:  # Blender's writers raise RuntimeError
            raise BakeError(f"{str(self.path)!r} could not be written: {reason(error)}.") from error

    def commit(self) -> None:
        """Put what was written into its place, in one step of the file system. Raises BakeError if that cannot be."""
        with self.told():
            os.replace(self.here, self.path)

    def discard(self) -> None:
        """Leave nothing behind; after `commit` there is nothing."""
        self.here.unlink(missing_ok=True)


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """A path beside `path` to write to; what was written takes the place of `path` when the block ends well.

    Raises BakeError if it cannot; then `path` is as it was.
    """
    partial = Partial(path)
    try:
        with partial.told():
            yield partial.here
        partial.commit()
    finally:
        partial.discard()
