# SPDX-License-Identifier: GPL-3.0-or-later
"""The files that the options of a bake name to read. `read_files` has those that these lead to, once they are open."""

import argparse
from collections.abc import Iterator

from ..usage import arguments

OPENED = "the file to open"


def inputs(options: argparse.Namespace, open_file: str = "") -> Iterator[tuple[str, str]]:
    """The paths of the files, in their order, and what they are. open_file: of the open .blend, for a bake without files."""
    opened = options.file or ([open_file] if not (options.low_file or arguments.is_folder(options)) else [])
    parts = [*((path, OPENED) for path in opened), (options.low_file, "the low mesh's file")]
    parts += [*((path, "the high mesh's file") for path in options.high_file), (options.cage_file, "the cage's file")]
    parts.append((options.convert, "the map to convert"))
    return ((path, what) for path, what in parts if path)


def scenes(options: argparse.Namespace, open_file: str = "") -> list[str]:
    """As `inputs`, the paths of mesh files and .blend files, each once."""
    return list(dict.fromkeys(path for path, _ in inputs(options, open_file) if path != options.convert))
