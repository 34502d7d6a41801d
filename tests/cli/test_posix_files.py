# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests links, pipes and devices in the place of files, as Windows does not have them."""

import os

import pytest

from addon.cli import worker_process
from addon.cli.records import Contents
from addon.cli.run_report import FAILED, State
from tests.pure import test_plan_listing as lists
from tests.pure import test_resuming as records

pytestmark = pytest.mark.skipif(os.name == "nt", reason="links need rights on Windows, and pipes are no files there")

folder, here, untrusted, version = records.folder, lists.here, records.untrusted, records.version


@pytest.mark.parametrize("key", ["inputs", "files"])
@pytest.mark.parametrize("kind", ["link", "pipe"])
def test_what_a_record_names_is_not_read_if_it_is_no_file(folder, untrusted, monkeypatch, key, kind):
    records.run([records.plan(folder)], **untrusted)
    place = folder / ("in" if key == "inputs" else "out") / "more"
    (folder / "outside").write_text("secret")
    if kind == "link":
        place.symlink_to(folder / "outside")
    else:
        os.mkfifo(place)
    records.changed(untrusted, key, place, **({"bytes": 0} if kind == "pipe" else {}))
    assert not records.read_of(folder, untrusted, monkeypatch, "more", "outside")


@pytest.mark.parametrize("kind", ["link", "pipe"])
def test_a_map_of_a_process_that_lies_is_neither_a_link_nor_a_pipe(folder, untrusted, monkeypatch, kind):
    make = os.mkfifo if kind == "pipe" else lambda path: path.symlink_to(folder / "out/other.png")
    entry = records.lie_of_map(folder, untrusted, monkeypatch, make)
    assert (entry.state, entry.files) == (State.FAILED, [])


def test_a_pipe_or_a_device_has_no_content(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    assert [Contents().of(path).size for path in (str(tmp_path / "pipe"), "/dev/zero")] == [None, None]


def test_only_plain_files_have_last_words(tmp_path):
    secret = tmp_path / "secret"
    secret.write_text("secret")
    os.symlink(secret, tmp_path / "link")
    os.mkfifo(tmp_path / "pipe")
    assert worker_process.crash_output_of_log(str(secret)) == ", after it printed 'secret'"
    assert [worker_process.crash_output_of_log(str(tmp_path / name)) for name in ("link", "pipe", "none", "")] == [
        ""
    ] * 4
    assert worker_process.crash_output_of_log(str(tmp_path)) == ""


def test_a_list_does_not_wait_for_a_pipe(capsys, here):
    os.mkfifo(here / "pipe.obj")
    code, _, (problem,) = lists.listed(capsys, [{**lists.SET, "high-file": "pipe.obj"}], "--check")
    assert (code, "There is no file" in problem) == (FAILED, True)
