# SPDX-License-Identifier: GPL-3.0-or-later
"""The files that a glTF names, and what its meshes are compressed with."""

import json
import struct
from collections.abc import Iterator
from pathlib import Path
from urllib.parse import unquote

from .found_files import MOST_BYTES_READ

_COMPRESSIONS = {"Draco": "_draco_mesh_compression", "meshopt": "_meshopt_compression"}
"""The names of extensions of glTF, without who made them."""


def compressions(path: Path) -> list[str]:
    """What the meshes of a glTF may be compressed with: "Draco", "meshopt". Empty for other files, and for damaged ones."""
    try:
        names = _list_in(_table_of(path), "extensionsUsed") if path.suffix.lower() in {".glb", ".gltf"} else []
    except (OSError, ValueError, RecursionError, struct.error):
        return []
    return [name for name, spelling in _COMPRESSIONS.items() if any(str(each).endswith(spelling) for each in names)]


def references(path: Path) -> Iterator[str]:
    """The files that the glTF at `path` names. Raises as `_table_of`."""
    table = _table_of(path)
    for key in ("buffers", "images"):
        for entry in _list_in(table, key):
            uri = entry.get("uri") if isinstance(entry, dict) else None
            if isinstance(uri, str) and not uri.startswith("data:"):
                yield unquote(uri)


def _table_of(path: Path) -> object:
    """The JSON of a glTF. Raises OSError, ValueError and struct.error for what is none, and for one that is too large."""
    with path.open("rb") as file:
        if path.suffix.lower() == ".glb":
            (length,) = struct.unpack_from("<12xI", file.read(20))  # of the first chunk, which is the JSON
        else:
            length = path.stat().st_size
        if length > MOST_BYTES_READ:
            return {}
        return json.loads(file.read(length))


def _list_in(table: object, key: str) -> list:
    items = table.get(key, []) if isinstance(table, dict) else []
    return items if isinstance(items, list) else []
