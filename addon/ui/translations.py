# SPDX-License-Identifier: GPL-3.0-or-later
"""The interface in other languages: reads addon/locale/ for Blender, and looks texts up in the language that is set.

Blender looks up by itself what it draws of registered classes.
"""

import json
from collections.abc import Iterator
from pathlib import Path

import bpy

FOLDER = Path(__file__).parents[1] / "locale"
"""Has a .po file for each language, which is named as Blender names the language."""
LABEL = "Imprint"
"""Context of the labels of properties, menus and panels.

Blender's own translations go before those of add-ons. In its default context "Space" is a gap in German, and "Cast" is to
mold in Spanish.
"""
OPERATOR = "Operator"
"""Context of the labels of operators, which Blender sets."""
SENTENCE = "*"
"""Context of tooltips and messages: Blender's default, in which it looks up tooltips and reports. Entries of the .po files
without a `msgctxt` have it, as in Blender's own."""


def label(text: str) -> str:
    """A label in the language of the interface, or `text` itself if it has no translation."""
    return bpy.app.translations.pgettext_iface(text, LABEL)


def message(text: str) -> str:
    """A sentence for a panel or a viewport, or `text` itself if it has no translation."""
    return bpy.app.translations.pgettext_iface(text, SENTENCE)


def tooltip(text: str) -> str:
    """A part of a tooltip, or `text` itself if it has no translation."""
    return bpy.app.translations.pgettext_tip(text, SENTENCE)


def locales() -> list[str]:
    """Blender's names for the languages."""
    return sorted(path.stem for path in FOLDER.glob("*.po"))


def read_translations(locale: str) -> dict[tuple[str, str], str]:
    """The translations into a language, by context and English text."""
    text = (FOLDER / f"{locale}.po").read_text(encoding="utf-8")
    return {
        (entry.get("msgctxt", SENTENCE), entry["msgid"]): entry["msgstr"]
        for entry in po_entries(text)
        if entry["msgid"] and entry["msgstr"]  # the header has no msgid
    }


def po_entries(text: str) -> Iterator[dict[str, str]]:
    """The entries of a .po file without plurals: `msgctxt` if there is one, `msgid` and `msgstr`.

    As in gettext, entries that translators have marked as fuzzy are left out, and those that are commented out.
    """
    entry, keyword, fuzzy = {}, "", False
    for line in [*text.split("\n"), "#"]:
        if "msgstr" in entry and line.startswith(("#", "msgctxt", "msgid")):
            if not fuzzy:
                yield entry
            entry, fuzzy = {}, False
        if line.startswith("#~"):
            fuzzy = False
        elif line.startswith("#,"):
            fuzzy = fuzzy or "fuzzy" in line
        elif line.startswith("msg"):
            keyword, quoted = line.split(maxsplit=1)
            entry[keyword] = json.loads(quoted)
        elif line.startswith('"'):
            entry[keyword] += json.loads(line)


def register() -> None:
    bpy.app.translations.register(__name__, {locale: read_translations(locale) for locale in locales()})


def unregister() -> None:
    bpy.app.translations.unregister(__name__)
