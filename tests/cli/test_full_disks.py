# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests reports and pages of results on a disk that is always full, as Linux has one."""

import os
import tempfile

import pytest

from addon.cli import run_report
from addon.cli.run_report import Entry, ReportFile
from addon.cli.sheet import SheetFile
from addon.core.errors import BakeError
from tests.pure.test_report import entry

pytestmark = pytest.mark.skipif(not os.path.exists("/dev/full"), reason="there is no device that is always full")


def test_a_full_disk_is_an_error_at_the_end(tmp_path):
    (tmp_path / "1.json.lines").symlink_to("/dev/full")
    file = ReportFile(tmp_path / "1.json", run_report.head(2))
    file.add(entry(1))
    file.add(entry(2))
    with pytest.raises(BakeError, match="1.json.lines' could not be written"):
        file.finish()
    file.close()
    assert not (tmp_path / "1.json").exists()


@pytest.mark.parametrize("size", [1, 100_000])
def test_a_disk_that_is_full_while_the_rows_are_written_is_an_error_at_the_end(tmp_path, monkeypatch, size):
    monkeypatch.setattr(tempfile, "TemporaryFile", lambda **_: open("/dev/full", "w+b"))  # noqa: SIM115
    sheet = SheetFile(tmp_path / "s.html", run_report.head(1))
    sheet.add(Entry(1, "a", image=b"p" * size))
    with pytest.raises(BakeError, match="No space left on device"):
        sheet.finish()
    sheet.close()
    assert list(tmp_path.iterdir()) == []
