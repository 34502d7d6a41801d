# SPDX-License-Identifier: GPL-3.0-or-later
"""Sentences for the user that know how much harm they tell of, and their order."""

import re
from collections.abc import Iterable
from enum import StrEnum
from typing import Any


class Harm(StrEnum):
    """How much harm a sentence tells of, from the most."""

    WRONG = "WRONG"
    """The bake is wrong, or will be."""
    LOOK = "LOOK"
    """It may be."""
    NOTE = "NOTE"
    """It is not, and the user may want to know."""


WRONG, LOOK, NOTE = Harm
RANKS = {harm: rank for rank, harm in enumerate(Harm)}
"""From 0 for the worst."""


class Sentence(str):
    """A sentence that is rated where it is made. It is a string, so that reports, shells and other programs take it as one."""

    harm: Harm
    kind: str
    """What it is about: a key of Report.checks, or one of the kinds in audit/severity.py; empty if it stands for itself."""
    share: float
    """Of the map or the mesh that it is about; 0 where that is not known. The larger ones come first."""

    def __new__(cls, text: str, harm: Harm = LOOK, kind: str = "", share: float = 0.0) -> "Sentence":
        sentence = super().__new__(cls, text)
        sentence.harm, sentence.kind, sentence.share = Harm(harm), kind, share
        return sentence

    @classmethod
    def of(cls, text: str) -> "Sentence":
        """The sentence itself, or one that was not rated: it is worth a look."""
        return text if isinstance(text, Sentence) else cls(text)

    def but(self, text: str, *, kind: str | None = None, share: float | None = None) -> "Sentence":
        """Another text of the same harm, and the same kind and share if none is given."""
        kind, share = self.kind if kind is None else kind, self.share if share is None else share
        return Sentence(text, self.harm, kind, share)

    def filled(self, **values: Any) -> "Sentence":
        """The text with these values in its places, and with their share."""
        share = values.get("share")
        return self.but(self.format(**values), share=share)


def rated(texts: Iterable[str], harm: Harm, kind: str = "") -> list[Sentence]:
    """Sentences of this harm."""
    return [Sentence(text, harm, kind) for text in texts]


def by_harm(texts: Iterable[str]) -> list[Sentence]:
    """The sentences, each once, the worst first."""
    unique = map(Sentence.of, dict.fromkeys(texts))
    return sorted(unique, key=lambda each: (RANKS[each.harm], -each.share))


def gist(text: str) -> str:
    """A sentence without names and numbers: the same for sentences that say the same of several objects."""
    return _NAMES_AND_NUMBERS.sub("", text)


_NAMES_AND_NUMBERS = re.compile(r"'[^']*'|\"[^\"]*\"|\d[\d.,]*")
