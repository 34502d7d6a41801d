# SPDX-License-Identifier: GPL-3.0-or-later
"""Suggests known words for misspelled ones."""

import difflib
from collections.abc import Iterable

SIMILAR = 0.75
"""How similar a word must be to be suggested. With less, "preset" would suggest "pairs"."""


def did_you_mean(words: Iterable[str], known: Iterable[str]) -> str:
    """The end of a sentence about unknown words, with a suggestion for each that is similar to a known one."""
    known = list(known)
    close = [found for word in words for found in difflib.get_close_matches(word, known, n=1, cutoff=SIMILAR)]
    return f", did you mean {' and '.join(map(repr, dict.fromkeys(close)))}?" if close else ""
