# SPDX-License-Identifier: GPL-3.0-or-later
"""Compares the interface of a real Blender with the .po files, in each of its languages, while the add-on is
registered and after that. Not a test that pytest finds.

    blender --background --factory-startup --python-exit-code 1 --python tests/window/languages.py

Blender ends with 1 if a text is not translated, or stays translated.
"""

import sys
from collections.abc import Iterable
from pathlib import Path

import bpy

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

import addon  # noqa: E402
from addon.ui import settings_panels  # noqa: E402
from addon.ui.texts import OPERATOR, locales, read_translations  # noqa: E402


def main() -> None:
    preferences = bpy.context.preferences.view
    wrong = []
    for locale in locales():
        texts = read_translations(locale)
        preferences.language = locale
        preferences.use_translate_interface = preferences.use_translate_tooltips = True
        before = shown(texts)
        addon.register()
        translated = shown(texts)
        for key, text in texts.items():
            if translated[key] != text:
                wrong.append(f"{locale}: {key} is {translated[key]!r} and not {text!r}")
        button = bpy.app.translations.pgettext_iface("Bake Maps", OPERATOR)
        panel = settings_panels.IMPRINT_PT_map
        label = bpy.app.translations.pgettext_iface(panel.bl_label, panel.bl_translation_context)
        print(f"{locale}: {len(texts)} texts, as {button!r} and {label!r}", flush=True)
        addon.unregister()
        wrong += [f"{locale}: {key} stays translated" for key, text in shown(texts).items() if text != before[key]]
    print("\n".join(wrong) or "all texts are translated, and nothing stays", flush=True)
    if wrong:
        raise SystemExit(1)


def shown(texts: Iterable[tuple[str, str]]) -> dict[tuple[str, str], str]:
    """The texts, which come with their contexts, as Blender shows them now."""
    return {(context, text): bpy.app.translations.pgettext_iface(text, context) for context, text in texts}


main()
