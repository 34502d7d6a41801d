# SPDX-License-Identifier: GPL-3.0-or-later
"""Looks texts up in the language of the interface. Blender looks up by itself what it draws of registered classes."""

import bpy

LABEL = "Imprint"
"""Context of the labels of properties, menus and panels.

Blender's own translations go before those of add-ons. In its default context "Space" is a gap in German, and "Cast" is to
mold in Spanish.
"""
OPERATOR = "Operator"
"""Context of the labels of operators, which Blender sets."""
SENTENCE = "*"
"""Context of tooltips and messages: Blender's default, in which it looks up tooltips and reports."""


def label(text: str) -> str:
    """A label in the language of the interface, or `text` itself if it has no translation."""
    return bpy.app.translations.pgettext_iface(text, LABEL)


def message(text: str) -> str:
    """A sentence for a panel or a viewport, or `text` itself if it has no translation."""
    return bpy.app.translations.pgettext_iface(text, SENTENCE)


def tooltip(text: str) -> str:
    """A part of a tooltip, or `text` itself if it has no translation."""
    return bpy.app.translations.pgettext_tip(text, SENTENCE)
