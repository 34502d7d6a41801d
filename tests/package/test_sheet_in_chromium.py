# SPDX-License-Identifier: GPL-3.0-or-later
"""Opens the page of a report in Chromium, where that is installed."""

import html
import json
import os
import shutil
import subprocess

import numpy as np
import pytest

from addon.cli import sheet
from addon.output import png_writer
from scripts.dev.in_engines.chromium import CHROMIUMS
from tests.support import reports

CHROMIUM = next(filter(None, map(shutil.which, CHROMIUMS)), None)

# All of it runs within the event that ends loading: the browser prints the page after that, and waits for nothing else.
STEPS = """
<script>
addEventListener("load", () => {
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
const images = [...document.images];
out.images = images.map(each => [each.naturalWidth, each.naturalHeight]);
images[0].click(); out.large = images[0].getBoundingClientRect().width;
images[0].click(); out.small = images[0].getBoundingClientRect().width;
document.body.textContent = "RESULT" + JSON.stringify(out) + "END";
});
</script>
"""


@pytest.mark.skipif(CHROMIUM is None, reason="Chromium is not installed")
def test_a_browser_sorts_and_filters(tmp_path):
    report = reports.of_three()
    pictures = [png_writer.small(np.full((2, width, 3), 99, np.uint8)) for width in (600, 500, 400)]
    rows = map(sheet.row, report["bakes"], pictures)
    page = tmp_path / "sheet.html"
    page.write_text("".join(sheet.page(report, "r.json", rows)).replace("</body>", STEPS + "</body>"), encoding="utf-8")
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
        "images": [[600, 2], [500, 2], [400, 2]],
        "large": 600,
        "small": 252,
    }
