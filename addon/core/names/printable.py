# SPDX-License-Identifier: GPL-3.0-or-later
"""Names and paths on a terminal: one that has control characters must not move the cursor, or look like two lines."""

import re

_CONTROL = re.compile(r"[\x00-\x1f\x7f-\x9f\u2028\u2029\u202a-\u202e\u2066-\u2069]")
"""Also those that begin lines or turn the direction of text."""


def printable(text: str) -> str:
    """`text` with a question mark in place of each control character."""
    return _CONTROL.sub("?", text)
