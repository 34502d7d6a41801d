# SPDX-License-Identifier: GPL-3.0-or-later
"""The sentence about a name that no object has."""

import difflib
from collections.abc import Collection

from ..errors import shorten_list


def sentence(name: str, there: Collection[str]) -> str:
    """Says that no object is called `name`, with similar names. there: the names of all objects."""
    close = difflib.get_close_matches(name, there, n=3, cutoff=0.4)
    listed = f"it has {shorten_list(map(repr, there))}." if there else "it has no objects."
    hint = f"did you mean {' or '.join(map(repr, close))}?" if close else listed
    return f"There is no object called {name!r} in the file: {hint}"
