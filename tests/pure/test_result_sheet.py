# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests of the page of a report: what it says, and that names are text."""

import base64
import errno
import html.parser
import json
import os
import tempfile

import pytest

from addon.cli import command, run_report
from addon.cli import sheet as sheet_module
from addon.cli.run_report import Entry, Totals
from addon.cli.sheet import SheetFile
from addon.core.errors import BakeError
from tests.support import reports


class Reader(html.parser.HTMLParser):
    """The cells of the table as text, and all elements."""

    def __init__(self):
        super().__init__()
        self.rows, self.tags, self.is_in_cell = [], [], False
        self.images = []

    def handle_starttag(self, tag, attrs):
        self.tags.append(tag)
        self.images += [dict(attrs)] if tag == "img" else []
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


def whole(report, title="r.json", picture=b""):
    return "".join(sheet_module.page(report, title, (sheet_module.row(entry, picture) for entry in report["bakes"])))


def test_a_row_has_the_figures_of_its_bake():
    head, first, second, third = read(whole(reports.of_three())).rows
    assert tuple(head) == sheet_module.COLUMNS
    assert first[:2] + first[3:9] == ["1", "done", "", "50", "", "0", "2.25", "2.00"]
    assert second[:3] == ["2", "failed", "a"]
    assert second[3:8] == ["", "", "", "", ""]
    assert third[-1] == "missed is 50 %."


def test_names_with_quotes_and_tags_are_text():
    found = read(whole(reports.of_three(), reports.EVIL))
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


def test_a_picture_is_in_the_page_and_its_name_is_text():
    found = read(whole(reports.of_three(), picture=b"\x89PNG"))
    assert [each["alt"].rpartition(":")[0] for each in found.images] == [f"b {reports.EVIL}", "a", "c"]
    assert {each["src"] for each in found.images} == {"data:image/png;base64," + base64.b64encode(b"\x89PNG").decode()}
    assert found.tags.count("img") == 3


def test_rows_are_in_the_order_of_the_job_file(tmp_path):
    sheet = SheetFile(tmp_path / "s.html", run_report.head(3))
    for number in (3, 1, 2):
        sheet.add(Entry(number, f"n{number}", image=b"p" * number))
    assert not (tmp_path / "s.html").exists()
    sheet.finish()
    assert [row[2] for row in read((tmp_path / "s.html").read_text(encoding="utf-8")).rows[1:]] == ["n1", "n2", "n3"]
    assert "3 planned: 3 done" in (tmp_path / "s.html").read_text(encoding="utf-8")
    assert [path.name for path in tmp_path.iterdir()] == ["s.html"]


def test_a_name_with_bytes_that_are_no_text_has_question_marks(tmp_path):
    """Python has such a byte of a file's name as half a character, which no encoding takes."""
    named, head = Entry(1, "crate \udcff"), run_report.head(1)
    sheet = SheetFile(tmp_path / "a.html", head)
    sheet.add(named)
    sheet.finish()
    merged = {**head, "summary": Totals([named]).to_dict()}
    sheet_module.write(tmp_path / "b.html", merged, iter([sheet_module.row(named.to_dict(), b"")]))
    for name in ("a.html", "b.html"):
        assert "<td>crate ?</td>" in (tmp_path / name).read_text(encoding="utf-8")


def test_a_page_that_cannot_be_written_is_an_error(tmp_path):
    (tmp_path / "file").touch()
    with pytest.raises(BakeError, match="file"):
        SheetFile(tmp_path / "file" / "s.html", run_report.head(1))


def test_a_full_disk_stops_no_bake_and_is_an_error_at_the_end(tmp_path, monkeypatch):
    def full(**_):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(tempfile, "TemporaryFile", full)
    sheet = SheetFile(tmp_path / "s.html", run_report.head(1))
    sheet.add(Entry(1, "a"))
    with pytest.raises(BakeError, match="could not be written: No space left on device"):
        sheet.finish()
    assert list(tmp_path.iterdir()) == []


def test_a_run_that_ends_early_leaves_no_file(tmp_path):
    sheet = SheetFile(tmp_path / "s.html", run_report.head(1))
    sheet.add(Entry(1, "a"))
    sheet.close()
    assert sheet._rows._file.closed
    assert list(tmp_path.iterdir()) == []


def done(picture=b"", sha256="0" * 64, *, number=1, of="2" * 64):
    file, mesh = {"path": "m.png", "sha256": sha256}, {"path": "m.obj", "sha256": of}
    return Entry(number, f"set {number} (a/b)", inputs=[mesh], files=[file], image=picture)


def test_a_picture_is_found_again_for_the_same_map(tmp_path):
    first, again, other = done(b"picture"), done(number=2), done(sha256="1" * 64)
    mesh = done(of="3" * 64)  # another mesh with the same map
    for each in (first, again, other, mesh):
        sheet_module.keep_picture(str(tmp_path), each)
    (path,) = tmp_path.iterdir()
    assert path.name.startswith("m_")
    assert path.read_bytes() == b"picture"
    assert [each.picture for each in (first, again, other, mesh)] == [str(path), str(path), "", ""]


def test_a_bake_that_wrote_nothing_has_no_picture(tmp_path):
    bake = Entry(1, "a", image=b"picture")
    sheet_module.keep_picture(str(tmp_path), bake)
    assert (bake.picture, list(tmp_path.iterdir())) == ("", [])


def test_the_command_takes_the_pictures_that_a_run_kept(tmp_path):
    report = reports.of_three()
    (tmp_path / "p.png").write_bytes(b"picture")
    report["bakes"][0]["picture"], report["bakes"][1]["picture"] = str(tmp_path / "p.png"), str(tmp_path / "gone.png")
    (tmp_path / "r.json").write_text(json.dumps(report), encoding="utf-8")
    assert command.run(["report", "--sheet", str(tmp_path / "s.html"), str(tmp_path / "r.json")]) == 1
    (image,) = read((tmp_path / "s.html").read_text(encoding="utf-8")).images
    assert image["src"] == "data:image/png;base64," + base64.b64encode(b"picture").decode()


def test_what_is_no_path_is_no_link():
    entry = reports.of_three()["bakes"][0]
    entry["files"][0]["path"] = "javascript:alert(1)"
    assert "<td>javascript:alert(1)</td>" in sheet_module.row(entry, b"")
