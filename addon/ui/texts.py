# SPDX-License-Identifier: GPL-3.0-or-later
"""Texts of the interface: in the language that is set, and in the panels of the sidebar.

addon/locale/ has the translations. Blender looks up by itself what it draws of registered classes.
"""

import json
import textwrap
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

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


def labeled(kind: Callable, name: str, description: str, **more: Any) -> Any:
    """A property of Blender whose label and tooltip are translated. kind: such as bpy.props.IntProperty; `more` is for it."""
    return kind(name=name, description=description, translation_context=LABEL, **more)


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


class SidebarPanel:
    """A panel in the "Imprint" tab of the 3D viewport's sidebar."""

    bl_space_type = "VIEW_3D"
    bl_region_type = "UI"
    bl_category = "Imprint"
    bl_translation_context = LABEL


def split_layout(layout: bpy.types.UILayout) -> bpy.types.UILayout:
    """The same layout, which draws properties as a name on the left and a field on the right."""
    layout.use_property_split = True
    layout.use_property_decorate = False
    return layout


def draw_paragraphs(layout: bpy.types.UILayout, context: bpy.types.Context, lines: list[str], icon: str) -> None:
    """Draw lines, translated and wrapped to the width of the sidebar; Blender's labels do not wrap by themselves."""
    width = max(20, int(context.region.width / (7.0 * context.preferences.system.ui_scale)) - 6)
    column = layout.column(align=True)
    for line in lines:
        for number, part in enumerate(textwrap.wrap(message(line), width)):
            column.label(text=part, icon="BLANK1" if number else icon, translate=False)
