# SPDX-License-Identifier: GPL-3.0-or-later
"""Names of objects in paths, the same on every system."""

import re

LOW = "{low}"
"""What stands for the low object's name in a path."""

_REFUSED = re.compile(r'[<>:"/\\|?*\x00-\x1f\x7f\ud800-\udfff]|[. ](?=[. ]*$)')
"""What some file system refuses in a name, or drops from its end."""
_DEVICE = re.compile(r"^(con|prn|aux|nul|com\d|lpt\d)(?=\.|$)", re.IGNORECASE)
"""Names that are no files on Windows, whatever their ending."""


def file_name(name: str) -> str:
    """`name` with an underscore for each letter that some file system refuses; all others stay."""
    return _DEVICE.sub(r"\1_", _REFUSED.sub("_", name))


def fill(path: str, low_name: str) -> str:
    """`path` with the low object's name in it."""
    return path.replace(LOW, file_name(low_name))
