# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests what paths in job files mean on systems of POSIX."""

import os
import re

import pytest

from addon.cli import arguments, job_file
from addon.cli.arguments import WrongUsage
from tests.pure import test_job_file as files

pytestmark = pytest.mark.skipif(os.name == "nt", reason="paths of POSIX")

write = files.write


PLACES = {"HOME": "/home/me", "SHOW": "/shows/one", "SHOT": "010"}


PATHS = {
    "~/m.png": "/home/me/m.png",
    "a/~/m.png": "{here}/a/~/m.png",
    "~me.png": "{here}/~me.png",
    "$SHOW/m.png": "/shows/one/m.png",
    "${SHOW}/s$SHOT/{low}_$SHOT.png": "/shows/one/s010/{low}_010.png",
    "a$SHOT.png": "{here}/a010.png",
    "a$.png": "{here}/a$.png",
    "a:.png": "{here}/a:.png",
}


@pytest.mark.parametrize("path", PATHS)
def test_paths_in_a_job_file_have_what_a_shell_would_put_there(write, monkeypatch, path):
    for name, value in PLACES.items():
        monkeypatch.setenv(name, value)
    (found,) = job_file.read(write({"bake": [{"file": "a.blend", "low": "a", "output": path}]}, "jobs/jobs.json"))
    assert found.output == PATHS[path].replace("{here}", os.path.abspath("jobs"))


@pytest.mark.parametrize(
    ("path", "is_untrusted", "expected"),
    [
        ("$NONE/m.png", False, "'$NONE/m.png' needs the variable NONE, which is not set"),
        ("m${NONE}.png", False, "'m${NONE}.png' needs the variable NONE, which is not set"),
        ("$HOME/m.png", True, "'$HOME/m.png' has ~ or a variable, which files of other people cannot have"),
        ("~/m.png", True, "'~/m.png' has ~ or a variable, which files of other people cannot have"),
        (r"C:\maps\m.png", False, r"'C:\\maps\\m.png' is a path of Windows, and this system has other ones"),
        ("c:/maps/m.png", False, "'c:/maps/m.png' is a path of Windows, and this system has other ones"),
        (r"\\server\m.png", False, r"'\\\\server\\m.png' is a path of Windows, and this system has other ones"),
    ],
)
def test_paths_that_mean_nothing_here_are_mistakes(write, monkeypatch, path, is_untrusted, expected):
    monkeypatch.delenv("NONE", raising=False)
    content = {"bake": [{"file": "a.blend", "low": "a", "output": path}]}
    with pytest.raises(WrongUsage) as refused:
        job_file.read(write(content, "jobs/jobs.json"), is_untrusted=is_untrusted)
    assert str(refused.value).endswith(f", set 1: output: {expected}")
    if "Windows" in expected:
        with pytest.raises(WrongUsage, match=re.escape(expected)):
            arguments.parse(["a.blend", "--low", "a", "--output", path])
