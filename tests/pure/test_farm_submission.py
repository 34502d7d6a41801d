# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests `farm`, which sends a job file to a Flamenco Manager: a server on this machine stands for one."""

import base64
import json
import threading
from http.server import BaseHTTPRequestHandler, HTTPServer

import pytest

from addon.cli import command, run_report

KIND = {
    "name": "imprint-bake",
    "etag": "7",
    "settings": [
        {"key": "jobs", "type": "string"},
        {"key": "shards", "type": "int32", "default": 16},
        {"key": "command", "type": "string", "default": "{blender} --command imprint"},
    ],
}


class Manager(BaseHTTPRequestHandler):
    """Answers with what `answers` has for the end of an address, and keeps what is sent."""

    answers, sent, secrets = {}, [], []

    def do_GET(self):  # noqa: N802 - the base class calls it
        self.secrets.append(self.headers["Authorization"])
        status, body = self.answers[self.path.removeprefix("/api/v3/")]
        data = body if isinstance(body, bytes) else json.dumps(body).encode()
        self.send_response(status)
        self.send_header("Content-Length", str(len(data)))
        self.end_headers()
        self.wfile.write(data)

    def do_POST(self):  # noqa: N802
        self.sent.append(json.loads(self.rfile.read(int(self.headers["Content-Length"]))))
        self.do_GET()

    def log_message(self, *_):
        pass


@pytest.fixture
def manager(monkeypatch):
    """A manager that takes jobs, and its address."""
    for name in ("http_proxy", "HTTP_PROXY", "all_proxy", "ALL_PROXY"):
        monkeypatch.delenv(name, raising=False)
    Manager.sent, Manager.secrets = [], []
    Manager.answers = {"jobs/type/imprint-bake": (200, KIND), "jobs": (200, {"id": "a-b-c"})}
    with HTTPServer(("127.0.0.1", 0), Manager) as server:
        Manager.url = f"http://127.0.0.1:{server.server_port}"
        serving = threading.Thread(target=server.serve_forever, kwargs={"poll_interval": 0.01})
        serving.start()
        yield Manager
        server.shutdown()
        serving.join()


@pytest.fixture
def jobs(tmp_path):
    path = tmp_path / "props.toml"
    path.write_text('[[bake]]\nlow-file = "low.obj"\noutput = "map.png"\n')
    return str(path)


def run(capsys, *words):
    """The exit code, and the lines of both streams."""
    code = command.run(["farm", *words])
    out, err = capsys.readouterr()
    return code, out.splitlines(), err.splitlines()


def test_a_job_has_the_settings_of_its_type(manager, jobs, capsys):
    assert run(capsys, "--flamenco", manager.url, jobs) == (0, [f"{manager.url}/app/jobs/a-b-c"], [])
    (sent,) = manager.sent
    assert (sent["name"], sent["type"], sent["type_etag"], sent["priority"]) == ("props", "imprint-bake", "7", 50)
    assert sent["settings"] == {"jobs": jobs, "shards": 16, "command": "{blender} --command imprint"}


def test_options_become_settings(manager, jobs, tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    words = ["--shards", "4", "--force", "--reports", "out", "--name", "Props", "--priority", "70", "--options"]
    code, *_ = run(capsys, "--flamenco", f"{manager.url}/", "props.toml", *words, "--size 64", "--command", "x y")
    (sent,) = manager.sent
    assert (code, sent["name"], sent["priority"]) == (0, "Props", 70)
    own = {"shards": 4, "force": True, "reports": str(tmp_path / "out"), "options": "--size 64", "command": "x y"}
    assert sent["settings"] == {"jobs": jobs, **own}


@pytest.mark.parametrize(
    ("answers", "part"),
    [
        ({"jobs/type/imprint-bake": (404, {"code": 404, "message": "none"})}, "copy imprint_bake.js"),
        ({"jobs/type/imprint-bake": (500, b"")}, "500"),
        ({"jobs/type/imprint-bake": (200, b"<html>")}, "is not a Flamenco Manager"),
        ({"jobs": (412, {"code": 412, "message": "the job type has changed"})}, "the job type has changed"),
        ({"jobs": (502, b"<html>")}, "502"),
    ],
)
def test_what_the_manager_refuses_is_one_sentence(manager, jobs, capsys, answers, part):
    manager.answers.update(answers)
    code, out, err = run(capsys, "--flamenco", manager.url, jobs)
    assert (code, out, len(err)) == (run_report.FAILED, [], 1)
    assert part in err[0]


@pytest.mark.parametrize("answer", [[], {}, {"settings": 1, "etag": ""}, None])
def test_answers_of_other_programs_are_one_sentence(manager, jobs, capsys, answer):
    manager.answers["jobs/type/imprint-bake"] = 200, answer
    code, _, err = run(capsys, "--flamenco", manager.url, jobs)
    assert (code, err) == (
        run_report.FAILED,
        [f"imprint farm: The server at {manager.url} is not a Flamenco Manager"],
    )
    assert not manager.sent


def test_a_manager_that_is_not_there(jobs, capsys):
    code, _, (line,) = run(capsys, "--flamenco", "127.0.0.1:9", jobs)
    assert code == run_report.FAILED
    assert line.startswith("imprint farm: No Flamenco Manager answers at http://127.0.0.1:9: ")


def test_a_user_and_a_password_are_sent_and_not_shown(manager, jobs, capsys):
    url = manager.url.replace("//", "//ann:se%40cret@")
    assert run(capsys, "--flamenco", url, jobs) == (0, [f"{manager.url}/app/jobs/a-b-c"], [])
    assert manager.secrets == [f"Basic {base64.b64encode(b'ann:se@cret').decode()}"] * 2
    manager.answers["jobs"] = 412, {"code": 412, "message": "no"}
    assert run(capsys, "--flamenco", url, jobs)[2][0].startswith(
        f"imprint farm: The Flamenco Manager at {manager.url} ref"
    )


@pytest.mark.parametrize(
    "url",
    [
        *("http://ann:secret@127.0.0.1:9", "ann:secret@127.0.0.1:9", "http://ann:secret@127.0.0.1:port"),
        *("ftp://ann:secret@host", "http://ann:sec/secret@127.0.0.1:9", "http://ann:secret@", "http://a:secret@b c"),
        *("http://ann:secret@[::1", "http://ann@b:secret@127.0.0.1:9"),
    ],
)
def test_no_error_shows_a_password(jobs, capsys, url):
    code, out, (line,) = run(capsys, "--flamenco", url, jobs)
    assert (code, out) == (run_report.FAILED, [])
    assert "secret" not in line and "ann" not in line


@pytest.mark.parametrize(
    "url", ["", "file:///etc/passwd", "ftp://host", "http://", "http://host:port", "http://[", "http://a b"]
)
def test_what_is_no_address(jobs, capsys, url):
    code, _, (line,) = run(capsys, "--flamenco", url, jobs)
    assert code == run_report.FAILED
    assert "is not the address of a Flamenco Manager" in line


@pytest.mark.parametrize(
    ("words", "sent"),
    [
        (["--untrusted", "--options", "--records /r"], "--untrusted --records /r"),
        (["--untrusted", "--options", '--records "/a b"'], '--untrusted --records "/a b"'),
        (["--options=--untrusted --records /r"], "--untrusted --records /r"),
    ],
)
def test_untrusted_files_are_so_for_all_bakes(manager, jobs, capsys, words, sent):
    assert run(capsys, "--flamenco", manager.url, jobs, *words)[0] == 0
    assert manager.sent[0]["settings"]["options"] == sent


def test_a_job_file_that_is_not_trusted_is_not_waited_for(manager, tmp_path, capsys):
    (tmp_path / "jobs.toml").mkdir()
    words = ["--flamenco", manager.url, str(tmp_path / "jobs.toml"), "--untrusted"]
    code, _, (line,) = run(capsys, *words, "--options", "--records /r")
    assert (code, manager.sent) == (run_report.WRONG_USAGE, [])
    assert "is not a file" in line
    assert "--resume needs --records DIR with --untrusted" in run(capsys, *words)[2][0]  # as the tasks say


@pytest.mark.parametrize(
    ("options", "part"),
    [
        ("--sizee 64", "did you mean '--size'?"),
        ("--size", "--size: expected one argument"),
        ('--output-folder "/a b"', "--output-folder are for --untrusted"),
        ("--shard 1/2", "leave out --shard"),
        ("--jobs other.toml", "leave out --jobs"),
        ("--report /a.json", "leave out --report"),
    ],
)
def test_mistakes_in_the_options_are_found_before_it_is_sent(manager, jobs, capsys, options, part):
    code, _, (line,) = run(capsys, "--flamenco", manager.url, jobs, f"--options={options}")
    assert (code, manager.sent) == (run_report.WRONG_USAGE, [])
    assert part in line


def test_mistakes_in_the_job_file_are_found_before_it_is_sent(manager, tmp_path, capsys):
    path = tmp_path / "props.toml"
    path.write_text('[[bake]]\nlow-file = "low.obj"\noutput = "map.png"\nsamplez = 4\n')
    code, _, (line,) = run(capsys, "--flamenco", manager.url, str(path))
    assert (code, manager.sent) == (run_report.WRONG_USAGE, [])
    assert "samplez" in line


@pytest.mark.parametrize(
    "words", [[], ["props.toml"], ["--flamenco", "x"], ["props.toml", "--flamenco", "x", "--shards", "0"]]
)
def test_wrong_usage(capsys, words):
    code, out, err = run(capsys, *words)
    assert (code, out) == (run_report.WRONG_USAGE, [])
    assert len(err) == 1
