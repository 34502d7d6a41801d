# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests that the page about maps, and the table of engines, name the files and the numbers that a bake has."""

import re
import shlex
from pathlib import PurePath

import pytest

from addon.cli.usage import arguments
from addon.core import map_types
from addon.core.declarations.all_settings import DECLARED
from addon.core.declarations.surface_map_settings import CURVATURE_SHARE, THICKNESS_SHARE
from addon.core.map_types import AO, BY_NAME, Family, Kind, Range
from addon.output import map_names
from addon.output.value_encoding import encoding
from scripts.imprint import ROOT
from tests.support.manual import encodings, names, rows, section

MAPS, WORKFLOWS = (ROOT / "docs" / f"{name}.md" for name in ("maps", "workflows"))


def settings_of(output, options=""):
    words = ["x.blend", "--low", "low", "--output", output, *shlex.split(options)]
    parsed = arguments.parse(words)
    arguments.check(parsed)
    return arguments.settings(parsed)


def file(settings):
    """The name of the file of a map."""
    return PurePath(settings.output).name


def test_the_names_are_those_of_a_bake():
    lines = [[names(cell)[0] for cell in cells] for cells in rows(section(MAPS, "## Names"))]
    assert len(lines) == 5
    for output, *expected in lines:
        settings = settings_of(output)
        found = [file(map_names.beside(settings, BY_NAME[name])) for name in (AO.name, "BASE_COLOR")]
        assert found == expected


def test_the_files_for_each_engine_are_those_of_a_bake():
    lines = rows(section(WORKFLOWS, "## For an engine"))
    assert len(lines) == 5
    for _, options, files in lines:
        settings = settings_of("rock_normal.png", names(options)[0])
        types = [settings.map.packing.map_type, *(BY_NAME[name] for name in settings.map.maps)]
        assert {file(map_names.beside(settings, one)) for one in types} == set(names(files))


def test_the_files_of_all_maps_from_one_press_are_those_of_its_command():
    text = section(WORKFLOWS, "## All maps from one press")
    (command,) = re.findall(r"imprint\.py bake (.*?)```", text, re.DOTALL)
    parsed = arguments.parse(shlex.split(command.replace("\\\n", " ")))
    settings = arguments.settings(parsed)
    written = [settings, *(map_names.beside(settings, BY_NAME[name]) for name in settings.map.maps)]
    (sentence,) = re.findall(r"This writes (.*?)\.\s\[", text, re.DOTALL)
    assert names(sentence) == list(map(file, written))


@pytest.mark.parametrize(
    ("heading", "words"),
    [
        ("## Rays", f"With {DECLARED['rays'].default}, the default"),
        ("## Thickness", f"**Thickness Distance**, {THICKNESS_SHARE * 100:g} % of the diagonal unless set"),
        (
            "## Curvature, convexity, cavity",
            f"**Curvature Radius**, {CURVATURE_SHARE * 100:g} % of the diagonal unless set",
        ),
    ],
)
def test_the_numbers_are_the_defaults(heading, words):
    assert words in " ".join(section(MAPS, heading).split())


def test_the_table_of_encodings_has_each_map_that_is_not_stored_as_it_is():
    moved = {
        one.label
        for one in (map_types.NORMAL, *map_types.OTHERS)
        if one.kind is Kind.NORMAL or one.range is not Range.UNIT or one.family in (Family.THICKNESS, Family.CURVATURE)
    }
    assert set(encodings()) == moved - {"Normal"} | {"All others"}


def test_normals_and_plain_values_are_decoded_as_the_table_says():
    settings = settings_of("rock.png")
    for label, name in (("Bent Normal", "BENT_NORMAL"), ("All others", AO.name)):
        how = encoding(BY_NAME[name], [], [], settings.storing)
        assert [f"{how['midlevel']:g}", f"{how['scale']:g}", "0"] == encodings()[label]
