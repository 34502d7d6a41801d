# SPDX-License-Identifier: GPL-3.0-or-later
"""Every text of the interface is in each .po file, and every entry of these files is a text of the interface.

Blender's Python package has no languages: tests/window/languages.py checks the interface of a Blender that has them.
"""

import ast
import functools
import gettext
import re
import shutil
import string
import subprocess
from collections.abc import Iterator
from types import SimpleNamespace

import bpy
import pytest

from addon.core.declarations import targets
from addon.engine import ray_maps
from addon.ui import texts
from addon.ui.texts import FOLDER, LABEL, OPERATOR, SENTENCE
from scripts.imprint import ROOT

Text = tuple[str, str]
"""The context of a text, and the text in English."""
LOCALES = ("de_DE", "es")
UNTRANSLATED = {
    "Imprint": "a name",
    "Cycles": "a name",
    "MikkTSpace": "a name",
    "glTF": "a name",
    "Godot": "a name",
    "Unreal": "a name",
    "Unity URP": "a name",
    "Unity HDRP": "a name",
    **{target.label: "a program that reads maps" for target in targets.TARGETS},
    **dict.fromkeys(("1", "2", "4", "8", "16", "32", "64"), "a number"),
    **dict.fromkeys(("BC4", "BC5", "BC6H", "BC7"), "a format of blocks"),
    **dict.fromkeys(("+X", "-X", "+Y (OpenGL)", "-Y (DirectX)", "+Z", "-Z", "U", "V"), "an axis"),
    **dict.fromkeys(("Auto", "Material"), "the same in all languages"),
}
"""Texts that are shown as they are, with the reason."""
LOOKUPS = {"label": LABEL, "message": SENTENCE, "tooltip": SENTENCE}
"""The functions that look a text up, and the context of each."""
RAISED_OR_SHOWN = {"Progress": LABEL, "BakeError": SENTENCE}
"""Classes whose texts the interface looks up when it shows them, and the context of each."""
OF_BLENDER = {"rna_type", "name", "bl_idname", "remove_name", "remove_active"}
"""Properties that base classes of Blender give to classes of the add-on."""
UNNAMED = re.compile(r"[\W\d]*")
"""Texts without a word."""


def own_classes() -> Iterator[type]:
    kinds = bpy.types.Operator, bpy.types.Panel, bpy.types.Menu, bpy.types.PropertyGroup, bpy.types.AddonPreferences
    for kind in kinds:
        yield from (cls for cls in kind.__subclasses__() if cls.__module__.startswith("addon."))


def of_properties(struct: bpy.types.Struct) -> Iterator[Text]:
    for prop in struct.properties:
        if prop.identifier not in OF_BLENDER:
            yield prop.translation_context, prop.name
            yield SENTENCE, prop.description
            for item in prop.enum_items_static if prop.type == "ENUM" else ():
                yield prop.translation_context, item.name
                yield SENTENCE, item.description


def registered_texts() -> Iterator[Text]:
    """The labels and tooltips of the registered classes and properties."""
    for cls in own_classes():
        if issubclass(cls, bpy.types.Operator):
            group, name = cls.bl_idname.split(".")
            struct = getattr(getattr(bpy.ops, group), name).get_rna_type()
            yield OPERATOR, cls.bl_label
            yield SENTENCE, struct.description
            yield from of_properties(struct)
        elif issubclass(cls, bpy.types.PropertyGroup | bpy.types.AddonPreferences):
            yield from of_properties(cls.bl_rna)
        else:
            yield cls.bl_translation_context, cls.bl_label
    for name in ("imprint_summary", "imprint_warnings", "imprint_batch"):
        prop = bpy.types.WindowManager.bl_rna.properties[name]
        yield from ((prop.translation_context, prop.name), (SENTENCE, prop.description))
    for owner in (bpy.types.Object, bpy.types.Material):
        prop = owner.bl_rna.properties["imprint_size"]
        item = prop.enum_items["0"]  # the others are numbers
        yield from ((prop.translation_context, prop.name), (SENTENCE, prop.description))
        yield from ((prop.translation_context, item.name), (SENTENCE, item.description))


@functools.cache
def nodes() -> dict[str, list[ast.expr]]:
    """The calls and texts in the code of the add-on, by the package."""
    found = {}
    for path in (ROOT / "addon").rglob("*.py"):
        package = found.setdefault(path.relative_to(ROOT / "addon").parts[0], [])
        tree = ast.parse(path.read_text(encoding="utf-8"))
        package += [node for node in ast.walk(tree) if isinstance(node, ast.Call) or is_text(node)]
    return found


def calls(*packages: str) -> Iterator[ast.Call]:
    yield from (node for package in packages for node in nodes()[package] if isinstance(node, ast.Call))


def called(call: ast.Call) -> str:
    """The name of the function or method that is called."""
    return getattr(call.func, "attr", getattr(call.func, "id", ""))


def is_text(node: ast.AST) -> bool:
    return isinstance(node, ast.Constant) and isinstance(node.value, str)


def drawn_texts() -> Iterator[Text]:
    """The texts that code looks up, the names of steps that the progress bar shows, and errors that name no object."""
    for call in calls("ui"):
        if called(call) in LOOKUPS and isinstance(call.func, ast.Name) and is_text(call.args[0]):
            yield LOOKUPS[called(call)], call.args[0].value
    for call in calls("ui", "jobs", "engine", "scene", "core", "output", "audit"):
        if called(call) in RAISED_OR_SHOWN and call.args and is_text(call.args[0]):
            yield RAISED_OR_SHOWN[called(call)], call.args[0].value
    yield from ((LABEL, call.args[0].value) for call in calls("export", "mesh") if called(call) == "Progress")
    yield from ((LABEL, kind.title) for kind in ray_maps.RayMaps.__subclasses__())


def constants() -> set[str]:
    """All texts in the code of the add-on."""
    return {node.value for package in nodes().values() for node in package if is_text(node)}


def shown_texts() -> set[Text]:
    """All that is to be translated."""
    found = {*registered_texts(), *drawn_texts()}
    return {(context, text) for context, text in found if text not in UNTRANSLATED and not UNNAMED.fullmatch(text)}


def fields(text: str) -> list[str | None]:
    """The placeholders in braces."""
    return sorted(name for _, name, *_ in string.Formatter().parse(text) if name is not None)


@pytest.fixture(params=LOCALES)
def entries(request):
    """The translations into one of the languages, by context and English text."""
    return texts.read_translations(request.param)


def test_each_file_is_a_language():
    assert texts.locales() == list(LOCALES)


@pytest.mark.usefixtures("registered")
class TestTexts:
    def test_none_is_missing(self, entries):
        assert sorted(shown_texts() - set(entries)) == []

    def test_each_is_used(self, entries):
        """Sentences that functions return count as used if the code has them."""
        unused, code = set(entries) - shown_texts(), constants()
        assert sorted((context, text) for context, text in unused if context != SENTENCE or text not in code) == []

    def test_properties_and_panels_have_the_context_of_labels(self):
        """In its default context Blender would use its own translations of the same words."""
        known = {context for context, text in registered_texts() if text}
        assert known == {LABEL, OPERATOR, SENTENCE}
        labels = {text for cls in own_classes() for text in [getattr(cls, "bl_label", "")]}
        assert not [text for text in labels if (SENTENCE, text) in set(registered_texts())]


class TestEntries:
    def test_placeholders_are_those_of_the_english_text(self, entries):
        assert [text for (_, english), text in entries.items() if fields(text) != fields(english)] == []


class TestFiles:
    @pytest.mark.parametrize("locale", LOCALES)
    def test_each_entry_is_there_once_and_translated(self, locale):
        """An entry that is marked as fuzzy, or has no translation yet, is not shown."""
        text = (FOLDER / f"{locale}.po").read_text(encoding="utf-8")
        assert len(texts.read_translations(locale)) == text.count("\nmsgid ") - 1

    @pytest.mark.skipif(not shutil.which("msgfmt"), reason="needs gettext")
    @pytest.mark.parametrize("locale", LOCALES)
    def test_gettext_accepts_it_and_reads_the_same(self, locale, tmp_path):
        compiled = tmp_path / "compiled.mo"
        subprocess.run(["msgfmt", "--check", "-o", compiled, FOLDER / f"{locale}.po"], check=True)
        with compiled.open("rb") as file:
            catalog = gettext.GNUTranslations(file)
        for (context, text), translation in texts.read_translations(locale).items():
            found = catalog.gettext(text) if context == SENTENCE else catalog.pgettext(context, text)
            assert found == translation

    def test_what_translators_tools_write_is_read_as_gettext_reads_it(self):
        text = """msgid ""
msgstr ""
"Language: es\\n"

# A translator's note
#. A note from the code
#: panel.py:3
msgctxt "Imprint"
msgid "High"
msgstr "Alto"
msgid "without a blank line, "
"wrapped: \\"{}\\""
msgstr ""
"ajustado: "
"\\"{}\\""

#, fuzzy, python-brace-format
#| msgid "old"
msgid "unsure"
msgstr "dudoso"

#, fuzzy
#~ msgid "removed"
#~ msgstr "quitado"

msgid "untranslated"
msgstr ""
"""
        assert list(texts.po_entries(text)) == [
            {"msgid": "", "msgstr": "Language: es\n"},
            {"msgctxt": "Imprint", "msgid": "High", "msgstr": "Alto"},
            {"msgid": 'without a blank line, wrapped: "{}"', "msgstr": 'ajustado: "{}"'},
            {"msgid": "untranslated", "msgstr": ""},
        ]


def test_fixed_texts_of_a_layout_are_looked_up():
    """Blender would look them up in its default context."""
    given = [arg.value for call in calls("ui") for arg in call.keywords if arg.arg == "text"]
    assert len(given) > 30
    assert [
        ast.unparse(text) for text in given if isinstance(text, ast.JoinedStr) or (is_text(text) and text.value)
    ] == []


def test_texts_are_looked_up_in_their_contexts(monkeypatch):
    """The wheel of Blender has no translations: a stand-in returns what it is asked for."""
    asked = SimpleNamespace(
        pgettext_iface=lambda text, context: ("interface", text, context),
        pgettext_tip=lambda text, context: ("tooltip", text, context),
    )
    monkeypatch.setattr(texts, "bpy", SimpleNamespace(app=SimpleNamespace(translations=asked)))
    assert texts.label("a") == ("interface", "a", LABEL)
    assert texts.message("a") == ("interface", "a", SENTENCE)
    assert texts.tooltip("a") == ("tooltip", "a", SENTENCE)


def test_blender_gets_the_texts_of_each_language(monkeypatch):
    registered = {}
    given = SimpleNamespace(register=registered.__setitem__, unregister=registered.pop)
    monkeypatch.setattr(texts, "bpy", SimpleNamespace(app=SimpleNamespace(translations=given)))
    texts.register()
    (found,) = registered.values()
    assert found == {locale: texts.read_translations(locale) for locale in LOCALES}
    assert all(found.values())
    texts.unregister()
    assert registered == {}
