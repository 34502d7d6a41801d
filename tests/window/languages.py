# SPDX-License-Identifier: GPL-3.0-or-later
"""Compares the interface of a real Blender with the table of translations, in each of its languages, while the add-on is
registered and after that. Not a test that pytest finds.

    blender --background --factory-startup --python-exit-code 1 --python tests/window/languages.py

Blender ends with 1 if a text is not translated, or stays translated.
"""

import sys
from pathlib import Path

import bpy

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

import addon  # noqa: E402
from addon.ui.panels import settings_panels  # noqa: E402
from addon.ui.translations import catalog  # noqa: E402
from addon.ui.translations.lookup import OPERATOR  # noqa: E402


def main() -> None:
    preferences = bpy.context.preferences.view
    wrong = []
    for locale in catalog.LOCALES:
        preferences.language = locale
        preferences.use_translate_interface = preferences.use_translate_tooltips = True
        before = shown()
        addon.register()
        translated = shown()
        for key, texts in catalog.TABLE.items():
            if translated[key] != texts[locale]:
                wrong.append(f"{locale}: {key} is {translated[key]!r} and not {texts[locale]!r}")
        button = bpy.app.translations.pgettext_iface("Bake Normal Map", OPERATOR)
        panel = settings_panels.IMPRINT_PT_map
        label = bpy.app.translations.pgettext_iface(panel.bl_label, panel.bl_translation_context)
        print(f"{locale}: {len(catalog.TABLE)} texts, as {button!r} and {label!r}", flush=True)
        addon.unregister()
        wrong += [f"{locale}: {key} stays translated" for key, text in shown().items() if text != before[key]]
    print("\n".join(wrong) or "all texts are translated, and nothing stays", flush=True)
    if wrong:
        raise SystemExit(1)


def shown() -> dict[tuple[str, str], str]:
    """The texts of the table as Blender shows them now."""
    return {(context, text): bpy.app.translations.pgettext_iface(text, context) for context, text in catalog.TABLE}


main()
