# SPDX-License-Identifier: GPL-3.0-or-later
"""The button that sends a job file to Flamenco. What is sent is tested in tests/pure/test_farm_submission.py."""

from types import SimpleNamespace

import bpy
import pytest

from addon import flamenco
from addon.core.errors import BakeError
from addon.ui import bake_operators
from tests.support.panel_layout import draw

pytestmark = pytest.mark.usefixtures("registered")


@pytest.fixture
def address(monkeypatch):
    """A Flamenco Manager in the preferences."""
    monkeypatch.setattr(bake_operators, "flamenco_address", lambda _context: "http://farm")
    return "http://farm"


@pytest.fixture
def sent(monkeypatch):
    """The jobs that are sent, in place of sending them. Blender is online."""
    jobs = []
    monkeypatch.setattr(flamenco, "submit", lambda url, job: jobs.append((url, job)) or f"{url}/app/jobs/1")
    monkeypatch.setattr(bake_operators.bpy, "app", SimpleNamespace(online_access=True), raising=False)
    return jobs


def test_the_button_is_there_if_an_address_is_set(address):
    assert "imprint.send_to_flamenco" in {name for name, _ in draw().buttons}


def test_without_an_address_there_is_no_button():
    assert bake_operators.flamenco_address(bpy.context) == ""
    assert "imprint.send_to_flamenco" not in {name for name, _ in draw().buttons}


def test_without_online_access_nothing_is_sent(address, sent, monkeypatch, tmp_path):
    monkeypatch.setattr(bake_operators.bpy, "app", SimpleNamespace(online_access=False))
    with pytest.raises(RuntimeError, match="poll"):
        bpy.ops.imprint.send_to_flamenco(filepath=str(tmp_path / "jobs.toml"))
    assert sent == []


def test_a_job_file_is_sent(address, sent, tmp_path):
    path = tmp_path / "props.toml"
    path.touch()
    assert bpy.ops.imprint.send_to_flamenco(filepath=str(path), shards=4) == {"FINISHED"}
    assert sent == [(address, flamenco.Job("props", {"jobs": str(path), "shards": 4}))]


def test_a_missing_file_is_named(address, sent, tmp_path):
    with pytest.raises(RuntimeError, match=r"no file .*none\.toml"):
        bpy.ops.imprint.send_to_flamenco(filepath=str(tmp_path / "none.toml"))
    assert sent == []


def test_what_the_manager_refuses_is_shown(address, sent, tmp_path, monkeypatch):
    def refuse(*_):
        raise BakeError("The Flamenco Manager refuses the job: no")

    path = tmp_path / "props.toml"
    path.touch()
    monkeypatch.setattr(flamenco, "submit", refuse)
    with pytest.raises(RuntimeError, match="refuses the job"):
        bpy.ops.imprint.send_to_flamenco(filepath=str(path))
