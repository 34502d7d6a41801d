# SPDX-License-Identifier: GPL-3.0-or-later
"""A setting is declared once: settings, command line, job file and manual have what the declaration says."""

import re
from dataclasses import fields

import pytest

from addon.cli.usage import arguments
from addon.cli.usage.job_file import KEYS
from addon.cli.usage.options import FILES, OBJECTS, OPTIONS
from addon.core.declarations import kinds
from addon.core.declarations.all_settings import DECLARED, PANELS
from addon.core.errors import BakeError
from addon.core.settings import Settings
from scripts.dev import tables

OPTIONAL = {name: setting for name, setting in DECLARED.items() if setting.option}
FIELDS = {field.name: field for field in fields(Settings)}


def plain(text):
    """Text without line breaks and the marks of Markdown."""
    return re.sub(r"\s+", " ", text.replace("`", "").replace("\\|", "|"))


def test_the_manuals_tables_are_up_to_date():
    """Write them again with `python3 scripts/dev/tables.py`."""
    assert [page.name for page in tables.outdated()] == []


def test_the_manual_has_each_table_once():
    text = "".join(page.read_text(encoding="utf-8") for page in tables.PAGES)
    found = [place[2] or place[3] for place in tables.PLACE.finditer(text)]
    assert sorted(found) == sorted(tables.TABLES)


@pytest.mark.parametrize("name", FIELDS)
def test_each_field_of_the_settings_is_declared(name):
    assert FIELDS[name].default == DECLARED[name].default


def test_what_is_declared_is_a_field_or_belongs_to_the_panel_alone():
    """The panel's switches and slots, and what the command line says in another way."""
    more = {name for name, setting in DECLARED.items() if name not in FIELDS and setting.option}
    assert more == {"low", "highs", "cage", "size"}
    assert {name for name in FIELDS if not DECLARED[name].option} == {"width", "height", "storage"}


def test_no_two_panels_show_the_same_setting():
    assert sum(len(panel.settings) for panel in PANELS.values()) == len(DECLARED)


@pytest.mark.parametrize("name", DECLARED)
def test_the_words_are_sentences_without_a_full_stop(name):
    setting = DECLARED[name]
    items = setting.items if isinstance(setting, kinds.Choice) else ()
    for text in (
        setting.label,
        setting.panel_tooltip,
        *(text for item in items for text in (item.label, item.tooltip)),
    ):
        assert text
        assert not text.endswith(".")
        assert text[0].isupper() or not text[0].isalpha()


@pytest.mark.parametrize("name", [name for name, setting in DECLARED.items() if setting.switch])
def test_a_switch_decides_whether_a_number_is_none(name):
    switch = DECLARED[DECLARED[name].switch]
    assert (switch.default == switch.empties) == (DECLARED[name].default is None)


@pytest.mark.parametrize("name", OPTIONAL)
def test_help_tooltip_and_manual_say_the_same(name):
    setting = OPTIONAL[name]
    said = setting.option.off or setting.tooltip
    help_text = plain(arguments.parser("imprint").format_help()).replace("- ", "-")
    manual = plain((tables.ROOT / "docs" / "command-line.md").read_text(encoding="utf-8"))
    panels = plain((tables.ROOT / "docs" / "panels.md").read_text(encoding="utf-8"))
    assert said.replace("- ", "-") in help_text
    assert said in manual
    assert setting.tooltip in panels


def test_each_option_is_made_from_a_declaration_or_named_as_no_setting():
    made = {setting.option.word or name.replace("_", "-") for name, setting in OPTIONAL.items()}
    words = {word for group in OPTIONS.values() for word in group}
    assert words - made == (set(OBJECTS) | set(FILES)) - {"low", "high", "cage"}
    assert made <= words
    assert set(KEYS) == words | {"file"}


WRONG = {
    "method": "flatten",
    "samples": 3,
    "maps": ("HEIGTH",),
    "width": 15,
    "margin": -1,
    "extrusion": -0.5,
    "max_distance": 0.0,
    "limit": float("nan"),
    "missed": (0.5, 0.5, 1.5),
}


@pytest.mark.parametrize("name", WRONG)
def test_a_value_outside_the_limits_is_refused_by_the_label(name):
    with pytest.raises(BakeError, match=f"^{DECLARED[name].label}: "):
        Settings(**{name: WRONG[name]}).check()


def test_zero_is_an_extrusion():
    Settings(extrusion=0.0).check()
