# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests that the pages for artists use the names in the interface, and that their pictures exist."""

import ast
import re
import shlex

import pytest

from addon.cli.usage import arguments
from scripts.imprint import ROOT
from tests.support.manual import names, prose, rows, section

PAGES = [
    ROOT / "README.md",
    *(
        ROOT / "docs" / f"{name}.md"
        for name in ("quick-start", "panels", "maps", "workflows", "engines", "troubleshooting")
    ),
]
OF_BLENDER = {
    "Edit > Preferences > Get Extensions",
    "Install from Disk",
    "Mesh > Normals > Recalculate Outside",
    "Color Space",
    "Face Orientation",
    "Repositories",
    "Non-Color",
    "Tangents",
    "Weight Paint",
    "Weights > Set Weight",
    "Alpha Mode",
    "Channel Packed",
}
"""Names in Blender's own interface."""
LARGEST = 200 * 1024
"""The most bytes of a picture, so that pages load quickly."""
NUMBER = re.compile(r"[\d.]+|\.\w+|\+")


def shown():
    """The texts in the code of the interface and in the declarations of settings."""
    texts = set(OF_BLENDER)
    for folder in ("ui", "core"):
        for path in (ROOT / "addon" / folder).rglob("*.py"):
            for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
                if isinstance(node, ast.Constant) and isinstance(node.value, str):
                    texts.add(node.value)
    return texts | {path.stem for path in (ROOT / "addon" / "presets").rglob("*.py")}


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_names_in_bold_are_in_the_interface(page):
    known = shown()
    text = re.sub(r"<!-- (table|options).*?<!-- end -->", "", prose(page), flags=re.DOTALL)
    bold = {name for name in re.findall(r"\*\*([^*\n]+)\*\*", text) if not NUMBER.fullmatch(name)}
    sentences = {name for name in bold if name.endswith((":", ".")) or name.islower()}
    parts = {part for name in bold - sentences for part in ([name] if name in known else name.split(" > "))}
    assert sorted(parts - known) == []


@pytest.mark.parametrize("heading", ["## Checks", "## View"])
def test_checks_and_views_have_the_names_in_the_interface(heading):
    named = {cells[0] for cells in rows(section(ROOT / "docs" / "panels.md", heading)) if not cells[0].startswith("!")}
    assert sorted(named - shown()) == []


def test_the_options_of_each_preset_do_the_same_as_the_preset():
    said = {}
    for cells in rows(section(ROOT / "docs" / "engines.md", "## Presets")):
        if len(cells) == 2:
            (options,) = names(cells[1])
            parsed = arguments.parse(["x.blend", "--low", "low", "--output", "map.png", *shlex.split(options)])
            said |= dict.fromkeys(
                cells[0].split(", "),
                (parsed.red, parsed.green, parsed.blue, parsed.basis, str(parsed.depth), parsed.alpha),
            )
    presets = {}
    for path in (ROOT / "addon" / "presets").rglob("*.py"):
        lines = re.findall(r"^settings\.(\w+) = (.+)$", path.read_text(encoding="utf-8"), re.MULTILINE)
        values = {name: ast.literal_eval(value) for name, value in lines}
        presets[path.stem] = tuple(values[name] for name in ("red", "green", "blue", "basis", "depth", "alpha"))
    assert said == presets


def test_each_picture_is_shown_and_small():
    folders = [ROOT / "docs" / "images", ROOT / "docs" / "extension"]
    pictures = {path for folder in folders for path in folder.iterdir() if path.suffix in {".jpg", ".png"}}
    shown_in = [*PAGES, ROOT / "docs" / "extension" / "description.md"]
    linked = {
        (page.parent / target).resolve()
        for page in shown_in
        for target in re.findall(r"!\[[^\]]*\]\(([^)]+)\)", prose(page))
    }
    assert linked == pictures
    assert {path.name: path.stat().st_size for path in pictures if path.stat().st_size > LARGEST} == {}
