# SPDX-License-Identifier: GPL-3.0-or-later
"""The files that mesh files name: libraries and images of .obj, buffers and images of glTF."""

import os
import struct
from collections.abc import Iterator
from pathlib import Path

from . import gltf_files, obj_files
from .found_files import folders

_READERS = {".obj": obj_files.references, ".gltf": gltf_files.references, ".glb": gltf_files.references}


def of(name: str) -> Iterator[Path]:
    """The files that the mesh file at the path `name` refers to, of which some may not exist.

    None for formats that only their importers read, and for what cannot be read.
    """
    find = _READERS.get(os.path.splitext(name)[1].lower())
    path = Path(name)
    try:
        # Opening a pipe may wait for ever.
        names = list(find(path)) if find and path.is_file() else []
    except (OSError, ValueError, RecursionError, struct.error):  # the importer will report what is wrong
        return
    for folder in folders(path):
        yield from (folder / name for name in names)
