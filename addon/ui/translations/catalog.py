# SPDX-License-Identifier: GPL-3.0-or-later
"""The table of translations, which Blender gets while the add-on is registered."""

from types import MappingProxyType

import bpy

from ...core.declarations import readers
from . import (
    bake_texts,
    batch_texts,
    check_texts,
    convert_texts,
    cure_texts,
    map_texts,
    message_texts,
    output_texts,
    ray_texts,
    view_texts,
)
from .maps import material_map_texts, store_texts, surface_map_texts

LOCALES = ("de_DE", "es")
"""The languages of the table, by Blender's names for them."""
PARTS = (
    bake_texts,
    map_texts,
    surface_map_texts,
    material_map_texts,
    store_texts,
    output_texts,
    ray_texts,
    batch_texts,
    check_texts,
    convert_texts,
    cure_texts,
    view_texts,
    message_texts,
)
TABLE = MappingProxyType({key: texts for part in PARTS for key, texts in part.TABLE.items()})
"""{(context, English text): {locale: text}}. A text that several panels show is in the part of the first of them."""
UNTRANSLATED = MappingProxyType(
    {
        "names": {"Imprint", "Cycles", "MikkTSpace", "glTF", "Godot", "Unreal", "Unity URP", "Unity HDRP"},
        "programs that read maps": {reader.label for reader in readers.READERS},
        "numbers": {"1", "2", "4", "8", "16", "32", "64"},
        "axes": {"+X", "-X", "+Y (OpenGL)", "-Y (DirectX)", "+Z", "-Z"},
        "the same in all languages of the table": {"Auto", "Material"},
    }
)
"""Texts that are shown as they are, by the reason."""


def by_locale() -> dict[str, dict[tuple[str, str], str]]:
    """The table as Blender takes it."""
    return {locale: {key: texts[locale] for key, texts in TABLE.items()} for locale in LOCALES}


def register() -> None:
    bpy.app.translations.register(__name__, by_locale())


def unregister() -> None:
    bpy.app.translations.unregister(__name__)
