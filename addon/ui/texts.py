# SPDX-License-Identifier: GPL-3.0-or-later
"""Texts of the interface: in the language that is set, and in the panels of the sidebar.

addon/locale/ has the translations. Blender looks up by itself what it draws of registered classes.
"""

import json
from collections.abc import Callable, Iterator
from functools import lru_cache
from pathlib import Path
from typing import Any

import blf
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


def draw_props(layout: bpy.types.UILayout, group: bpy.types.bpy_struct, *names: str) -> None:
    """These properties of a group, one below the other."""
    for name in names:
        layout.prop(group, name)


BESIDE_PANEL = 54.0
"""What tabs and margins take of the sidebar's width, in pixels at a scale of 1."""


def room(context: bpy.types.Context) -> float:
    """The width of what a panel draws, in pixels at a scale of 1."""
    return context.region.width / context.preferences.system.ui_scale - BESIDE_PANEL


BESIDE_TEXT = 93.0
"""What tabs, margins, a box and an icon take of the sidebar's width beside a line of text, in pixels at a scale of 1."""
LEAST = 100.0
"""The least width of a line, in pixels at a scale of 1."""


def draw_paragraphs(layout: bpy.types.UILayout, context: bpy.types.Context, lines: list[str], icon: str) -> None:
    """Draw lines, translated and wrapped to the width of the sidebar; Blender's labels do not wrap by themselves."""
    scale = context.preferences.system.ui_scale
    width = max(LEAST * scale, context.region.width - BESIDE_TEXT * scale)
    column = layout.column(align=True)
    for line in lines:
        for number, part in enumerate(wrapped(message(line), width, font_size(scale))):
            column.label(text=part, icon="BLANK1" if number else icon, translate=False)


def font_size(scale: float) -> float:
    """The size of the letters of buttons and labels, in pixels."""
    return bpy.context.preferences.ui_styles[0].widget.points * scale


def text_width(text: str, size: float) -> float:
    """The width of a line of this size, in pixels."""
    blf.size(0, size)
    return blf.dimensions(0, text)[0]


@lru_cache(maxsize=2**12)  # a panel asks at each redraw
def wrapped(text: str, width: float, size: float) -> list[str]:
    """The lines of a text that is not to be wider than `width` in letters of this size, both in pixels. Words that are too
    long, as paths, are divided."""
    lines = [""]
    for word in text.split():
        longer = f"{lines[-1]} {word}".lstrip()
        if text_width(longer, size) <= width:
            lines[-1] = longer
            continue
        lines.append(word)
        while text_width(lines[-1], size) > width and len(lines[-1]) > 1:
            rest = lines[-1]
            count = next((at for at in range(2, len(rest)) if text_width(rest[:at], size) > width), len(rest)) - 1
            lines[-1:] = [rest[:count], rest[count:]]
    return [line for line in lines if line]
