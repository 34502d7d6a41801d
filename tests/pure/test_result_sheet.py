# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests of the page of a report: what it says, and that names are text. Needs no Blender; with Chromium, it is opened."""

import html.parser
import json
import os
import shutil
import subprocess

import pytest

from addon.cli import command
from addon.cli.results import result_sheet, run_report
from addon.cli.results.run_report import Entry, State
from addon.core.report import Report
from scripts.dev.in_engines.chromium import CHROMIUMS

EVIL = '<script>document.title="bad"</script>"\'&<img src=x onerror=alert(1)>'
CHROMIUM = next(filter(None, map(shutil.which, CHROMIUMS)), None)


def report():
    bake = Report("CAST", "TANGENT", (16, 16), "low", ["high"], missed=0.5, deviation={"percentile_99": 2.25}).to_dict()
    file = {"path": f"/maps/{EVIL.replace('/', '')}.png", "bytes": 1, "sha256": "0" * 64, "what": "map"}
    entries = [
        Entry(1, f"b {EVIL}", seconds=2.0, files=[file], reports=[bake]),
        Entry(2, "a", State.FAILED, EVIL, seconds=10.0),
        Entry(3, "c", State.GATE, gate=["missed is 50 %."], seconds=1.0, reports=[{**bake, "missed": 0.125}]),
    ]
    return json.loads(json.dumps(run_report.document(entries, 3)))


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
    head, first, second, third = read("".join(result_sheet.page(report(), "r.json"))).rows
    assert tuple(head) == result_sheet.COLUMNS
    assert first[:2] + first[3:8] == ["1", "done", "50", "", "0", "2.25", "2.00"]
    assert second[:3] == ["2", "failed", "a"]
    assert second[3:7] == ["", "", "", ""]
    assert third[-1] == "missed is 50 %."


def test_names_with_quotes_and_tags_are_text():
    found = read("".join(result_sheet.page(report(), EVIL)))
    assert found.tags.count("script") == 1
    assert "img" not in found.tags
    assert found.rows[1][2] == f"b {EVIL}"
    assert found.rows[2][-1] == EVIL
    assert found.rows[1][-2] == f"{EVIL.replace('/', '')}.png"


def test_the_command_writes_the_page(tmp_path):
    path, sheet = tmp_path / "r.json", tmp_path / "sheet.html"
    path.write_text(json.dumps(report()), encoding="utf-8")
    assert command.run(["report", "--sheet", str(sheet), str(path)]) == 1  # a bake failed
    assert len(read(sheet.read_text(encoding="utf-8")).rows) == 4
    both = tmp_path / "all.json"
    assert command.run(["report", "--sheet", str(sheet), "--merge", str(both), str(path)]) == 1
    assert both.is_file()


STEPS = """
<script>
const shown = () => [...document.querySelectorAll("tbody tr")].filter(row => !row.hidden).map(row => row.cells[0].textContent);
const heads = [...document.querySelectorAll("th button")], out = {start: shown(), title: document.title};
const press = name => heads.find(head => head.textContent === name).click();
press("Name"); out.name = shown();
press("Name"); out.nameDown = shown();
press("Seconds"); out.seconds = shown();
press("Missed %"); out.missed = shown();
press("Number");
const set = (id, value) => {
  const field = document.getElementById(id);
  field.value = value;
  field.dispatchEvent(new Event("input"));
};
set("state", "gate"); out.gate = shown();
set("state", ""); set("text", "ONERROR"); out.text = shown();
out.count = document.getElementById("count").textContent;
document.body.textContent = "RESULT" + JSON.stringify(out) + "END";
</script>
"""


@pytest.mark.skipif(CHROMIUM is None, reason="Chromium is not installed")
def test_a_browser_sorts_and_filters(tmp_path):
    page = tmp_path / "sheet.html"
    page.write_text(
        "".join(result_sheet.page(report(), "r.json")).replace("</body>", STEPS + "</body>"), encoding="utf-8"
    )
    options = ["--headless", "--no-first-run", "--disable-gpu", "--dump-dom", f"--user-data-dir={tmp_path / 'profile'}"]
    options += ["--no-sandbox"] if hasattr(os, "geteuid") and os.geteuid() == 0 else []
    done = subprocess.run([CHROMIUM, *options, page.as_uri()], capture_output=True, text=True, timeout=120, check=True)
    # The page as the browser writes it: the result comes after the script.
    text = html.unescape(done.stdout).rpartition("RESULT")[2].partition("END")[0]
    assert json.loads(text) == {
        "start": ["1", "2", "3"],
        "title": "r.json",
        "name": ["2", "1", "3"],
        "nameDown": ["3", "1", "2"],
        "seconds": ["3", "1", "2"],
        "missed": ["3", "1", "2"],
        "gate": ["3"],
        "text": ["1", "2"],
        "count": "2 of 3",
    }
