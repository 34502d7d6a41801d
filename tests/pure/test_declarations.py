# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests that settings, command line, job files and manual follow the declarations."""

import re
from dataclasses import fields

import pytest

from addon.cli import arguments
from addon.cli.job_file import KEYS
from addon.cli.options import FILES, OBJECTS, OPTIONS
from addon.core.declarations import kinds
from addon.core.declarations.all_settings import DECLARED, PANELS
from addon.core.declarations.map_settings import CONVERT
from addon.core.errors import BakeError
from addon.core.settings import PARTS, Settings
from scripts.dev import tables

OPTIONAL = {name: setting for name, setting in DECLARED.items() if setting.option}
FIELDS = {field.name: field for kind in PARTS.values() for field in fields(kind)}


def plain(text):
    """Text without line breaks and Markdown."""
    return re.sub(r"\s+", " ", text.replace("`", "").replace("\\|", "|"))


def test_the_manuals_tables_are_up_to_date():
    """To update them, run `python3 scripts/dev/tables.py`."""
    assert [page.name for page in tables.outdated()] == []


def test_the_manual_has_each_table_once():
    text = "".join(page.read_text(encoding="utf-8") for page in tables.PAGES)
    found = [place[2] or place[3] for place in tables.PLACE.finditer(text)]
    assert sorted(found) == sorted(tables.TABLES)


@pytest.mark.parametrize("name", FIELDS)
def test_each_field_of_the_settings_is_declared(name):
    assert FIELDS[name].default == DECLARED[name].default


def test_each_declaration_is_a_field_or_used_only_by_the_panel():
    """Only the panel uses its switches and slots, settings with another option or none in a bake."""
    more = {name for name, setting in DECLARED.items() if name not in FIELDS and setting.option}
    assert more == {"low", "highs", "cage", "size", "export", *CONVERT}
    assert {name for name in FIELDS if not DECLARED[name].option} == {"width", "height", "storage"}


def test_no_two_panels_show_the_same_setting():
    assert sum(len(panel.settings) for panel in PANELS.values()) == len(DECLARED)


@pytest.mark.parametrize("name", DECLARED)
def test_texts_have_no_full_stop_at_their_end(name):
    setting = DECLARED[name]
    items = setting.items if isinstance(setting, kinds.Choice) else ()
    for text in (
        setting.label,
        setting.panel_tooltip,
        *(text for item in items for text in (item.label, item.tooltip)),
    ):
        assert text
        assert not text.endswith(".")
        assert text[0].isupper() or not text[0].isalpha() or text.startswith(("glTF", "three.js", "xNormal"))


@pytest.mark.parametrize("name", [name for name, setting in DECLARED.items() if setting.switch])
def test_a_switch_decides_whether_a_number_is_none(name):
    switch = DECLARED[DECLARED[name].switch]
    assert (switch.default == switch.empties) == (DECLARED[name].default is None)


@pytest.mark.parametrize("name", OPTIONAL)
def test_help_tooltip_and_manual_have_the_same_text(name):
    setting = OPTIONAL[name]
    text = setting.option.off or setting.tooltip
    help_text = plain(arguments.parser("imprint").format_help()).replace("- ", "-")
    panels = plain((tables.ROOT / "docs" / "panels.md").read_text(encoding="utf-8"))
    assert text.replace("- ", "-") in help_text
    assert setting.tooltip in panels
    assert f"--{setting.option.word or name.replace('_', '-')}" in panels


def test_each_option_comes_from_a_declaration_or_is_in_the_list_of_others():
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
def test_the_message_about_a_value_outside_the_limits_has_the_label(name):
    with pytest.raises(BakeError, match=f"^{DECLARED[name].label}: "):
        Settings(**{name: WRONG[name]}).check()


def test_extrusion_may_be_zero():
    Settings(extrusion=0.0).check()


@pytest.mark.parametrize(
    ("method", "samples", "expected"),
    [("FLATTEN", 64, False), ("CAST", 2, False), ("CAST", 4, True), ("AUTO", 4, True)],
)
def test_samples_are_adaptive_from_a_number_on_that_depends_on_the_method(method, samples, expected):
    assert Settings(samples=samples).sampling.are_adaptive(method) is expected
    assert not Settings(samples=samples, adaptive=False).sampling.are_adaptive(method)
