# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests how scripts/dev/in_blender.py gets a Blender and what it starts, with a program that stands in for Blender."""

import hashlib
import io
import json
import os
import sys
import tarfile
import zipfile

import pytest

from scripts.dev import in_blender

STAND_IN = r"""#!{python}
import json, pathlib, sys
words = sys.argv[1:]
with open({log!r}, "a") as log:
    log.write(json.dumps(words) + "\n")
after = lambda word: pathlib.Path(words[words.index(word) + 1])
if "build" in words:
    (after("--output-dir") / "imprint-1.2.3.zip").touch()
if "--report" in words:
    for name in ("map.png", "map_ao.png", "map_height.png"):
        after("--output").with_name(name).touch()
    one = dict(backend="OPENGL", renderer="llvmpipe", missed={missed})
    after("--report").write_text(json.dumps(dict(bakes=[dict(reports=[one])])))
print("installed, used and removed", "baked through the door")
sys.exit({code} if {failing!r} in words else 0)
"""


@pytest.fixture
def stand_in(tmp_path):
    """Writes a program like Blender. Returns its command and a function that reads the words of each call."""
    if os.name == "nt":
        pytest.skip("a script of POSIX")

    def make(failing="", code=1, missed=0.0):
        path, log = tmp_path / "blender", tmp_path / "log"
        text = STAND_IN.format(python=sys.executable, log=str(log), failing=failing, code=code, missed=missed)
        path.write_text(text)
        path.chmod(0o755)
        return [str(path)], lambda: [json.loads(line) for line in log.read_text().splitlines()]

    return make


def check(command, backend, tmp_path):
    folder = tmp_path / "scratch"
    folder.mkdir()
    in_blender.check(command, backend, folder)


def test_the_zip_is_built_installed_and_used(stand_in, tmp_path):
    command, calls = stand_in()
    check(command, "opengl", tmp_path)
    words = calls()
    assert all(one[:5] == ["--background", "--gpu-backend", "opengl", "--python-exit-code", "1"] for one in words)
    commands = [one[6:8] for one in words[:3]]
    assert commands == [["extension", "build"], ["extension", "validate"], ["extension", "install-file"]]
    assert [one[6] for one in words[3:5]] == ["imprint", "imprint"]
    assert [one[6].rpartition("/")[2] for one in words[5:]] == ["install_zip.py", "use_python.py"]
    assert {one[-1].rpartition("/")[2] for one in (words[1], words[2], *words[5:])} == {"imprint-1.2.3.zip"}


@pytest.mark.parametrize("failing", ["build", "validate", "install-file", "--version", "--report", "--python"])
def test_each_step_may_fail(stand_in, tmp_path, failing):
    command, calls = stand_in(failing)
    with pytest.raises(SystemExit, match=r"exit code 1: .*"):
        check(command, None, tmp_path)
    assert failing in calls()[-1]


def test_another_backend_is_a_failure(stand_in, tmp_path):
    command, _ = stand_in()
    with pytest.raises(SystemExit, match="ran on OPENGL, not on vulkan"):
        check(command, "vulkan", tmp_path)


def test_rays_that_miss_are_a_failure(stand_in, tmp_path):
    command, _ = stand_in(missed=0.25)
    with pytest.raises(SystemExit, match=r"25\.00%"):
        check(command, None, tmp_path)


# Releases


def archive(name):
    """The bytes of a release with one file, for this system."""
    content, member = io.BytesIO(), f"blender-5.2.3-here/{name}"
    if sys.platform == "win32":
        with zipfile.ZipFile(content, "w") as file:
            file.writestr(member, "a program")
    else:
        with tarfile.open(fileobj=content, mode="w:xz") as file:
            info = tarfile.TarInfo(member)
            info.size = len("a program")
            file.addfile(info, io.BytesIO(b"a program"))
    return content.getvalue()


@pytest.fixture
def releases(monkeypatch):
    """Addresses and what is there, in place of the network."""
    if sys.platform == "darwin":
        pytest.skip("an image that macOS alone makes")
    content = archive(in_blender.PROGRAMS[sys.platform])
    name = f"blender-5.2.3-{in_blender.ENDINGS[sys.platform]}"
    names = ("Blender4.5", "Blender5.2", "Blender5.10", "BlenderBenchmark")
    linux = ("blender-5.10.2-linux-x64.tar.xz", "blender-5.10.10-linux-x64.tar.xz", "blender-5.10.11-windows-x64.zip")
    base = in_blender.RELEASES
    sums = f"{'0' * 64}  other.zip\n{hashlib.sha256(content).hexdigest()}  {name}\n"
    found = {
        f"{base}/": "".join(f'<a href="{one}/">{one}/</a>\n' for one in names).encode(),
        f"{base}/Blender5.10/": "".join(f'<a href="{one}">{one}</a>\n' for one in linux).encode(),
        f"{base}/Blender5.2/blender-5.2.3.sha256": sums.encode(),
        f"{base}/Blender5.2/{name}": content,
    }
    monkeypatch.setattr(in_blender, "read", found.pop)
    return found


def test_a_release_is_unpacked_once(releases, tmp_path):
    program = in_blender.download("5.2.3", tmp_path / "blenders")
    assert program.read_text() == "a program"
    assert in_blender.download("5.2.3", tmp_path / "blenders") == program  # the address is gone
    assert [path.name for path in (tmp_path / "blenders").iterdir()] == ["5.2.3"]


def test_a_damaged_release_is_refused(releases, tmp_path):
    (name,) = (name for name in releases if name.endswith(in_blender.ENDINGS[sys.platform]))
    releases[name] += b"x"
    with pytest.raises(SystemExit, match="damaged"):
        in_blender.download("5.2.3", tmp_path / "blenders")
    assert not (tmp_path / "blenders" / "5.2.3").exists()


def test_the_newest_release_has_the_highest_numbers(releases):
    assert in_blender.newest() == "5.10.10"
