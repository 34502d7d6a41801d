# SPDX-License-Identifier: GPL-3.0-or-later
"""Sentences for the user that know how much harm they tell of, their order, and those that say the same of several objects."""

import re
from collections.abc import Iterable
from dataclasses import dataclass
from enum import StrEnum


class Harm(StrEnum):
    """How much harm a sentence tells of, from the most."""

    WRONG = "WRONG"
    """The bake is wrong, or will be."""
    LOOK = "LOOK"
    """It may be."""
    NOTE = "NOTE"
    """It is not, and the user may want to know."""


WRONG, LOOK, NOTE = Harm
_RANKS = {harm: rank for rank, harm in enumerate(Harm)}


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

    def but(self, text: str, **changes: str | float) -> "Sentence":
        """Another text of the same harm. changes: kind or share."""
        return Sentence(text, **{"harm": self.harm, "kind": self.kind, "share": self.share} | changes)

    def filled(self, **values: object) -> "Sentence":
        """The text with these values in its places, and with their share."""
        share = values.get("share", self.share)
        return self.but(self.format(**values), share=share)


def rated(texts: Iterable[str], harm: Harm, kind: str = "") -> list[Sentence]:
    """Sentences of this harm."""
    return [Sentence(text, harm, kind) for text in texts]


def by_harm(texts: Iterable[str]) -> list[Sentence]:
    """The sentences, each once, the worst first."""
    unique = map(Sentence.of, dict.fromkeys(texts))
    return sorted(unique, key=lambda each: (_RANKS[each.harm], -each.share))


@dataclass(frozen=True)
class Alike:
    """A sentence that is true of several low objects but for names and numbers.

    Attributes:
        sentence: Of the first low object.
        lows: Their names.
    """

    sentence: Sentence
    lows: tuple[str, ...]


def grouped(found: Iterable[tuple[str, str]]) -> list[Alike]:
    """Sentences with the names of their low objects, those that say the same together, the worst first."""
    groups: dict[str, list[tuple[str, Sentence]]] = {}
    for low, text in found:
        sentence = Sentence.of(text)
        groups.setdefault(f"{sentence.harm} {_NAMES_AND_NUMBERS.sub('', sentence)}", []).append((low, sentence))
    alike = [
        Alike(by_harm(sentence for _, sentence in group)[0], tuple(dict.fromkeys(low for low, _ in group)))
        for group in groups.values()
    ]
    return sorted(alike, key=lambda each: (_RANKS[each.sentence.harm], -len(each.lows), -each.sentence.share))


_NAMES_AND_NUMBERS = re.compile(r"'[^']*'|\"[^\"]*\"|\d[\d.,]*")
