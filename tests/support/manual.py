# SPDX-License-Identifier: GPL-3.0-or-later
"""The pages of the manual, taken apart: blocks of code, inline code, sections, tables. Needs no Blender."""

import re
import textwrap

from scripts.imprint import ROOT

SECURITY = ROOT / ".github" / "SECURITY.md"
PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", SECURITY, *sorted((ROOT / "docs").rglob("*.md"))]
FENCED = r"^ *```(\w*)\n(.*?)^ *```"
"""A block of code, in a list as well."""


def blocks(page):
    """The fenced blocks of a page: (language, text)."""
    found = re.findall(FENCED, page.read_text(encoding="utf-8"), re.MULTILINE | re.DOTALL)
    return [(language, textwrap.dedent(text)) for language, text in found]


def prose(page):
    """A page without its fenced blocks."""
    return re.sub(FENCED, "", page.read_text(encoding="utf-8"), flags=re.MULTILINE | re.DOTALL)


def inline(page):
    """What stands between backticks in the prose of a page."""
    return re.findall(r"`([^`]+)`", prose(page))


def section(page, heading):
    """The text below a heading, down to the next of its level or a higher one."""
    level = len(heading) - len(heading.lstrip("#"))
    text = page.read_text(encoding="utf-8")
    start = text.index(f"\n{heading}\n") + len(heading) + 2
    end = re.search(rf"^#{{1,{level}}} ", text[start:], re.MULTILINE)
    return text[start : start + end.start()] if end else text[start:]


def rows(text):
    """The cells of the tables in a text, without their heads."""
    lines = [line for line in text.splitlines() if line.startswith("|")]
    cells = [[cell.strip() for cell in re.split(r"(?<!\\)\|", line)[1:-1]] for line in lines]
    rules = [number for number, line in enumerate(cells) if all(re.fullmatch(":?-+:?", cell) for cell in line)]
    return [line for number, line in enumerate(cells) if number not in rules and number + 1 not in rules]


def names(cell):
    """The names between backticks in a cell."""
    return re.findall(r"`([^`]+)`", cell)


def encodings():
    """The rows of the table of encodings by the labels of maps: midlevel, scale, offset."""
    lines = rows(section(ROOT / "docs" / "maps.md", "## How to undo the encoding"))
    return {label: cells[1:] for cells in lines for label in re.sub(",? to .*", "", cells[0]).split(", ")}
