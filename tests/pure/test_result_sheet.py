# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests of the page of a report: what it says, and that names are text."""

import html.parser
import json

from addon.cli import command
from addon.cli.results import result_sheet
from tests.support import reports


class Reader(html.parser.HTMLParser):
    """The cells of the table as text, and all elements."""

    def __init__(self):
        super().__init__()
        self.rows, self.tags, self.is_in_cell = [], [], False

    def handle_starttag(self, tag, attrs):
        self.tags.append(tag)
        if tag == "tr":
            self.rows.append([])
        elif tag in {"td", "th"}:
            self.rows[-1].append("")
            self.is_in_cell = True

    def handle_endtag(self, tag):
        self.is_in_cell &= tag not in {"td", "th"}

    def handle_data(self, data):
        if self.is_in_cell:
            self.rows[-1][-1] += data


def read(text):
    reader = Reader()
    reader.feed(text)
    return reader


def test_a_row_has_the_figures_of_its_bake():
    head, first, second, third = read("".join(result_sheet.page(reports.of_three(), "r.json"))).rows
    assert tuple(head) == result_sheet.COLUMNS
    assert first[:2] + first[3:8] == ["1", "done", "50", "", "0", "2.25", "2.00"]
    assert second[:3] == ["2", "failed", "a"]
    assert second[3:7] == ["", "", "", ""]
    assert third[-1] == "missed is 50 %."


def test_names_with_quotes_and_tags_are_text():
    found = read("".join(result_sheet.page(reports.of_three(), reports.EVIL)))
    assert found.tags.count("script") == 1
    assert "img" not in found.tags
    assert found.rows[1][2] == f"b {reports.EVIL}"
    assert found.rows[2][-1] == reports.EVIL
    assert found.rows[1][-2] == f"{reports.EVIL.replace('/', '')}.png"


def test_the_command_writes_the_page(tmp_path):
    path, sheet = tmp_path / "r.json", tmp_path / "sheet.html"
    path.write_text(json.dumps(reports.of_three()), encoding="utf-8")
    assert command.run(["report", "--sheet", str(sheet), str(path)]) == 1  # a bake failed
    assert len(read(sheet.read_text(encoding="utf-8")).rows) == 4
    both = tmp_path / "all.json"
    assert command.run(["report", "--sheet", str(sheet), "--merge", str(both), str(path)]) == 1
    assert both.is_file()
