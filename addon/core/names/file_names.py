# SPDX-License-Identifier: GPL-3.0-or-later
"""Puts names of objects into paths, in the same way on every system."""

import re

from ..udim import TOKEN

LOW, MATERIAL = "{low}", "{material}"
"""The placeholders for the names of the low object and, in texture sets, of its material."""

ATLAS = "atlas"
"""Replaces the low object's name in the name of a map that several low objects share."""

USUAL = f"{LOW}_normal"
"""How maps are named where nothing else is set."""

_REFUSED = re.compile(r'[<>:"/\\|?*%\x00-\x1f\x7f\ud800-\udfff]|[. ](?=[. ]*$)')
"""Characters that some file systems refuse in a name, or remove from its end, and %, which Blender refuses in paths of UDIM."""
_DEVICE = re.compile(r"^(con|prn|aux|nul|com\d|lpt\d)(?=\.|$)", re.IGNORECASE)
"""Names of devices on Windows, whatever their ending."""
_NAME = re.compile(rf"[^/\\]+?(?=[._ -]?{TOKEN}|(?:\.[^./\\]*)?$)")
"""The name in a path to a file, without what starts with the number of its tile, and without its ending."""


def file_name(name: str) -> str:
    """`name` with an underscore in place of each character that some file system refuses."""
    return _DEVICE.sub(r"\1_", _REFUSED.sub("_", name))


def fill(path: str, low_name: str, material: str = "") -> str:
    """`path` with the low object's name in place of LOW and, for a texture set, the material's in place of MATERIAL."""
    filled = path.replace(MATERIAL, file_name(material)) if material else path
    return filled.replace(LOW, file_name(low_name)) if LOW in filled else filled


def renamed(path: str, name: str) -> str:
    """`path` with another name. Its folder, the number of its tile and its ending stay; an empty path stays empty."""
    return _NAME.sub(lambda _: name, path, count=1)


def of_texture_sets(names: str) -> str:
    """`names` with the material's name after that of the low object."""
    return names.replace(LOW, f"{LOW}_{MATERIAL}")
