# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests the parts of scripts/imprint.py that need no real environment."""

import ast
import errno
import os
import signal
import subprocess
import sys
import threading
import time
import tomllib
from pathlib import Path

import pytest

from scripts import imprint

OLDEST = (3, 9)
SEGFAULT = -11


def fake_python(folder, body, name="python3.13"):
    """Write an executable shell script with `body`. Returns the command that starts it."""
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / name
    path.write_text(f"#!/bin/sh\n{body}\n")
    path.chmod(0o755)
    return [str(path)]


@pytest.fixture
def bare(tmp_path, monkeypatch):
    """An empty checkout for the script, with requirements and without an environment."""
    venv = tmp_path / ".venv"
    monkeypatch.setattr(imprint, "VENV", venv)
    monkeypatch.setattr(imprint, "PYTHON", venv / "python")
    monkeypatch.setattr(imprint, "STAMP", venv / "imprint-stamp")
    monkeypatch.setattr(imprint, "GPU_STAMP", venv / "imprint-gpu")
    monkeypatch.setattr(imprint, "REQUIREMENTS", tmp_path / "requirements.txt")
    imprint.REQUIREMENTS.write_text("bpy==5.2.3\n")
    return tmp_path


def finish_environment():
    """Does what make_environment() would do."""
    imprint.VENV.mkdir(exist_ok=True)
    (imprint.VENV / imprint.MARK).touch()
    imprint.PYTHON.touch()
    imprint.STAMP.write_text(imprint.wanted_stamp())


class TestOldPythons:
    def test_syntax(self):
        ast.parse(Path(imprint.__file__).read_text(), feature_version=OLDEST)


class TestOtherSettings:
    """What a shell has for other Pythons, and signals before anything runs."""

    def run(self, folder, *words, **variables):
        environment = dict(os.environ, PYTHONPATH=str(folder), **variables)
        command = [sys.executable, imprint.__file__, *words]
        done = subprocess.run(command, capture_output=True, text=True, check=False, env=environment)
        return done.returncode, done.stdout, done.stderr

    def test_modules_of_other_pythons_do_not_count(self, tmp_path):
        (tmp_path / "tomllib.py").write_text(
            "raise ImportError('of another Python')"
        )  # which the launcher does not load
        code, shown, error = self.run(tmp_path, "bake", "--jobs", str(tmp_path / "none.toml"), "--check")
        assert (code, shown) == (2, "")
        assert error.startswith("imprint: ") and error.count("\n") == 1 and "none.toml" in error

    def test_python_without_docstrings(self, tmp_path):
        code, shown, error = self.run(tmp_path, "--help", PYTHONOPTIMIZE="2")
        assert (code, error) == (0, "")
        assert imprint.DESCRIPTION in " ".join(shown.split())

    def test_the_version_needs_no_environment(self, tmp_path, bare, capsys):
        manifest = tomllib.loads((imprint.ROOT / "blender_manifest.toml").read_text(encoding="utf-8"))
        assert imprint.main(["--version"]) == 0
        assert capsys.readouterr().out == f"Imprint {manifest['version']}\n"

    @pytest.mark.skipif(imprint.WINDOWS, reason="signals of POSIX")
    def test_a_signal_while_the_launcher_starts_leaves_no_traceback(self, tmp_path):
        (tmp_path / "ctypes.py").write_text(
            "import os, signal, time\nos.kill(os.getpid(), signal.SIGINT)\ntime.sleep(9)"
        )
        assert self.run(tmp_path, "--help") == (-signal.SIGINT, "", "")


class TestEnvironmentOfAnotherUser:
    @pytest.mark.parametrize("is_closed_above", [True, False])
    def test_the_message_says_whose_it_is(self, bare, monkeypatch, capsys, is_closed_above):
        finish_environment()
        refused = str(bare if is_closed_above else imprint.PYTHON)
        access = os.access
        monkeypatch.setattr(imprint.os, "access", lambda path, mode: str(path) != refused and access(path, mode))

        def environment():
            raise PermissionError(13, "Permission denied", str(imprint.PYTHON))

        monkeypatch.setattr(imprint, "environment", environment)
        assert imprint.main(["build"]) == 1
        owner = Path(refused).owner()
        error = capsys.readouterr().err
        assert error.startswith(f"imprint: {refused} belongs to {owner}, and you may not use it")
        assert error.count("\n") == 1

    def test_other_files_keep_their_message(self, bare, monkeypatch, capsys):
        def environment():
            raise PermissionError(13, "Permission denied", str(bare / "dist"))

        monkeypatch.setattr(imprint, "environment", environment)
        assert imprint.main(["build"]) == 1
        assert capsys.readouterr().err == f"imprint: [Errno 13] Permission denied: '{bare}/dist'\n"


class TestChoiceOfPython:
    def test_a_shim_that_fails_is_skipped(self, tmp_path):
        shim = fake_python(tmp_path / "shims", "echo 'pyenv: command not found' >&2; exit 127")
        real = fake_python(tmp_path / "real", "echo 3.13 /base/python3.13")
        assert imprint.find_python([shim, real]) == "/base/python3.13"

    def test_a_missing_command_is_skipped(self, tmp_path):
        assert imprint.base_python([str(tmp_path / "nowhere")]) is None

    def test_the_base_of_this_python_is_found(self):
        assert imprint.base_python([sys.executable]) == sys._base_executable

    def test_without_a_python_the_message_says_what_to_install(self):
        with pytest.raises(imprint.Failure) as failure:
            imprint.find_python([])
        message = str(failure.value)
        assert "\n" not in message
        assert "uv python install 3.13" in message

    def test_pyenv_is_found_by_its_command_when_home_is_empty(self, tmp_path, monkeypatch):
        fake_python(tmp_path / "pyenv/libexec", "true", name="pyenv")
        (tmp_path / "pyenv/bin").mkdir()
        (tmp_path / "pyenv/bin/pyenv").symlink_to("../libexec/pyenv")
        python = fake_python(tmp_path / "pyenv/versions/3.13.7/bin", "true")
        monkeypatch.delenv("PYENV_ROOT", raising=False)
        monkeypatch.setenv("HOME", str(tmp_path / "home"))
        monkeypatch.setenv("PATH", str(tmp_path / "pyenv/bin"))
        assert python in list(imprint.python_candidates())

    def test_pyenv_root_is_searched_first(self, tmp_path, monkeypatch):
        monkeypatch.setenv("PYENV_ROOT", str(tmp_path))
        assert next(imprint.pyenv_roots()) == tmp_path


class TestStamp:
    def test_a_finished_environment_is_ready(self, bare):
        assert not imprint.is_ready()
        finish_environment()
        assert imprint.is_ready()

    def test_an_environment_for_other_requirements_is_not_ready(self, bare):
        finish_environment()
        imprint.REQUIREMENTS.write_text("bpy==5.2.4\n")
        assert not imprint.is_ready()

    def test_an_environment_for_other_requirements_is_updated(self, bare, monkeypatch):
        finish_environment()
        fake_python(imprint.VENV, "echo 3.13 /base/python3.13", imprint.PYTHON.name)
        imprint.REQUIREMENTS.write_text("bpy==5.2.4\n")
        started = []
        monkeypatch.setattr(imprint.subprocess, "call", lambda command, **_: started.append(command))
        imprint.environment()
        assert [command[2] for command in started] == ["pip"]
        assert imprint.is_ready()

    @pytest.mark.parametrize("missing", ["STAMP", "PYTHON"])
    def test_an_incomplete_environment_is_replaced(self, bare, monkeypatch, missing):
        finish_environment()
        fake_python(imprint.VENV, "echo 3.13 /base/python3.13", imprint.PYTHON.name)
        getattr(imprint, missing).unlink()
        started = []
        monkeypatch.setattr(imprint.subprocess, "call", lambda command, **_: started.append(command))
        monkeypatch.setattr(imprint, "find_python", lambda candidates: "python3.13")
        imprint.environment()
        assert [command[2] for command in started] == ["venv", "pip"]

    def test_an_environment_of_an_older_imprint_is_updated_and_then_known(self, bare, monkeypatch):
        """It has a stamp alone, which an update that fails does not leave."""
        finish_environment()
        fake_python(imprint.VENV, "echo 3.13 /base/python3.13", imprint.PYTHON.name)
        (imprint.VENV / imprint.MARK).unlink()
        imprint.REQUIREMENTS.write_text("bpy==5.2.4\n")
        monkeypatch.setattr(imprint.subprocess, "call", lambda command, **_: 1)
        for _ in range(2):
            with pytest.raises(imprint.NoEnvironment, match="starts over"):
                imprint.environment()

    def test_a_failed_update_starts_over(self, bare, monkeypatch):
        finish_environment()
        fake_python(imprint.VENV, "echo 3.13 /base/python3.13", imprint.PYTHON.name)
        imprint.REQUIREMENTS.write_text("bpy==5.2.4\n")
        monkeypatch.setattr(imprint.subprocess, "call", lambda command, **_: 1)
        with pytest.raises(imprint.Failure, match="starts over"):
            imprint.environment()
        assert not imprint.STAMP.exists()

    def test_two_processes_make_the_environment_once(self, bare, monkeypatch):
        made = []

        def make():
            made.append(1)
            time.sleep(0.2)  # until the other thread waits
            finish_environment()

        monkeypatch.setattr(imprint, "make_environment", make)
        both = [threading.Thread(target=imprint.environment) for _ in range(2)]
        for thread in both:
            thread.start()
        for thread in both:
            thread.join()
        assert made == [1]


def tree(folder):
    """All files and links below a folder, with what they hold or lead to."""
    return {
        str(path.relative_to(folder)): os.readlink(path) if path.is_symlink() else path.is_file() and path.read_bytes()
        for path in folder.rglob("*")
    }


def of_a_person(folder):
    """An environment that a person made, with a program in it."""
    (folder / "bin").mkdir(parents=True)
    (folder / "pyvenv.cfg").write_text("home = /usr/bin\n")
    (folder / "bin/tool").write_text("mine")


def linked(folder, *, is_complete):
    """A link to the environment of another checkout."""
    of_a_person(folder.parent / "other")
    if is_complete:
        (folder.parent / "other" / imprint.STAMP.name).write_text("3.13 of other requirements\n")
    folder.symlink_to("other", target_is_directory=True)


def dangling(folder):
    folder.symlink_to("nowhere")


STRANGE = {
    "of a person": (of_a_person, "was not made by Imprint"),
    "link": (lambda folder: linked(folder, is_complete=False), "is a link to other, which Imprint does not change"),
    "link to a stamp": (lambda folder: linked(folder, is_complete=True), "is a link to other"),
    "link to nothing": (dangling, "is a link to nowhere"),
    "file": (lambda folder: folder.write_text("mine"), "is no folder"),
}


class TestFoldersOfOthers:
    """Nothing that Imprint has not made is emptied or replaced."""

    @pytest.mark.parametrize(("make", "error"), STRANGE.values(), ids=STRANGE)
    def test_an_environment_that_is_not_imprints_is_left_alone(self, bare, monkeypatch, capsys, make, error):
        make(imprint.VENV)
        before = tree(bare)
        monkeypatch.setattr(imprint.subprocess, "call", lambda command, **_: pytest.fail(f"ran {command}"))
        monkeypatch.setattr(imprint, "find_python", lambda candidates: "python3.13")
        for command in ("bake", "demo", "test", "build"):
            assert imprint.main([command]) == 3
            (line,) = capsys.readouterr().err.splitlines()
            assert line.startswith(f"imprint: {imprint.VENV} {error}")
        assert tree(bare) == before

    def test_a_link_to_a_complete_environment_is_used(self, bare):
        finish_environment()
        imprint.VENV.rename(bare / "other")
        imprint.VENV.symlink_to("other", target_is_directory=True)
        assert imprint.environment() == str(imprint.PYTHON)

    def test_an_empty_folder_is_taken(self, bare):
        """As where a container mounts a volume."""
        imprint.VENV.mkdir()
        imprint.empty(imprint.VENV)
        assert os.listdir(imprint.VENV) == [imprint.MARK]

    def test_links_in_a_folder_are_removed_and_not_what_they_lead_to(self, bare):
        (bare / "mine").mkdir()
        (bare / "mine/file").write_text("mine")
        imprint.empty(imprint.VENV)
        (imprint.VENV / "lib").symlink_to(bare / "mine")
        (imprint.VENV / "sub").mkdir()
        (imprint.VENV / "sub/link").symlink_to(bare / "mine")
        imprint.empty(imprint.VENV)
        assert os.listdir(imprint.VENV) == [imprint.MARK]
        assert (bare / "mine/file").read_text() == "mine"

    def test_other_scripts_leave_folders_of_others_alone(self, tmp_path, monkeypatch):
        from scripts.dev import blender_packages
        from scripts.dev.site import build

        of_a_person(tmp_path / "5.1.2")
        before = tree(tmp_path)
        monkeypatch.setattr(blender_packages, "find_python", lambda wanted: sys.executable)
        monkeypatch.setattr(subprocess, "run", lambda command, **_: pytest.fail(f"ran {command}"))
        for make in (
            lambda: blender_packages.environment(tmp_path, "5.1.2"),
            lambda: build.environment(tmp_path / "5.1.2"),
        ):
            with pytest.raises(SystemExit, match="was not made by Imprint"):
                make()
        assert tree(tmp_path) == before


class TestNoEnvironment:
    """Another machine may have what this one lacks: farms need exit code 3 for that."""

    def test_without_a_network(self, bare, monkeypatch, capsys):
        monkeypatch.setattr(imprint, "find_python", lambda candidates: "python3.13")
        monkeypatch.setattr(imprint.subprocess, "call", lambda command, **_: int("pip" in command))
        assert imprint.main(["bake", "--version"]) == 3
        assert capsys.readouterr().err.splitlines()[-1].startswith("imprint: the environment could not be set up")

    def test_without_a_python(self, bare, monkeypatch, capsys):
        monkeypatch.setattr(imprint, "python_candidates", list)
        assert imprint.main(["bake"]) == 3
        assert not imprint.VENV.exists()

    @pytest.mark.parametrize("number", [errno.EROFS, errno.EACCES, errno.ENOSPC])
    def test_in_a_checkout_that_is_read_only(self, bare, monkeypatch, capsys, number):
        def refuse(*_):
            raise OSError(number, os.strerror(number), str(imprint.REQUIREMENTS))

        monkeypatch.setattr(imprint, "open", refuse, raising=False)
        assert imprint.main(["bake"]) == 3
        (line,) = capsys.readouterr().err.splitlines()
        assert line.startswith(
            f"imprint: there is no complete environment in {imprint.VENV}, and none can be made here: "
        )
        assert os.strerror(number) in line and "make it once where you may write to" in line


@pytest.fixture
def linux(monkeypatch):
    """A Linux with all libraries, even if this machine lacks some."""
    monkeypatch.setattr(sys, "platform", "linux")
    monkeypatch.setattr(imprint, "is_loadable", lambda library: True)


class TestMissingLibraries:
    IMPORT_ERROR = "ImportError: libSM.so.6: cannot open shared object file: No such file or directory"

    def test_a_library_in_the_error_is_found(self, linux):
        assert imprint.missing(1, self.IMPORT_ERROR) == ["libSM.so.6"]

    def test_other_missing_libraries_are_found(self, linux, monkeypatch):
        monkeypatch.setattr(imprint, "is_loadable", lambda library: library != "libXi.so.6")
        assert imprint.missing(1, self.IMPORT_ERROR) == ["libSM.so.6", "libXi.so.6"]

    def test_a_crash_with_all_libraries_means_a_missing_driver(self, linux):
        assert imprint.missing(SEGFAULT, "") == [imprint.DRIVER]

    def test_a_crash_with_a_memory_limit_does_not(self, linux, monkeypatch):
        resource = pytest.importorskip("resource")
        monkeypatch.setattr(resource, "getrlimit", lambda _: (2**30, resource.RLIM_INFINITY))
        warning = "libEGL warning: failed to open swrast: /dri/swrast_dri.so: cannot open shared object file"
        assert imprint.missing(SEGFAULT, warning) == []
        message = imprint.explain([], [], SEGFAULT, warning)
        assert "signal 11, Segmentation fault, with memory limited to 1,024 MiB" in message

    def test_a_library_that_does_not_fit_into_memory_is_not_missing(self, monkeypatch):
        def fail(_):
            raise OSError("libGL.so.1: failed to map segment from shared object")

        monkeypatch.setattr(imprint.ctypes, "CDLL", fail)
        assert imprint.is_loadable("libGL.so.1")

    def test_the_command_installs_the_packages(self, monkeypatch):
        monkeypatch.setattr(imprint, "IS_ROOT", False)
        things = ["libSM.so.6", "libEGL.so.1"]
        apt = "sudo apt-get install --no-install-recommends libegl1 libsm6"
        assert " ".join(imprint.remedy(things, "apt-get")) == apt
        assert imprint.remedy(things, "dnf") == ["sudo", "dnf", "install", "libSM", "libglvnd-egl"]

    def test_an_unknown_library_is_named_without_a_command(self):
        assert imprint.remedy(["libunheard.so.1"], "apt-get") == []
        message = imprint.explain(["libunheard.so.1"], [], 1, "")
        assert "libunheard.so.1" in message

    def test_the_message_is_one_line_with_library_and_command(self):
        message = imprint.explain(["libSM.so.6"], ["apt-get", "install", "libsm6"], 1, self.IMPORT_ERROR)
        assert "libSM.so.6" in message
        assert "apt-get install libsm6" in message
        assert "\n" not in message

    def test_other_errors_are_in_the_message(self):
        assert "RuntimeError: no" in imprint.explain([], [], 1, "Traceback\nRuntimeError: no\n")


class TestProbe:
    def test_a_success_is_stored(self, bare, monkeypatch):
        finish_environment()
        probes = []
        monkeypatch.setattr(imprint, "probe", lambda python: probes.append(python) or (0, ""))
        imprint.require_gpu("python", may_install=True)
        imprint.require_gpu("python", may_install=False)
        assert probes == ["python"]

    def test_a_failure_is_not_stored(self, bare, linux, monkeypatch):
        finish_environment()
        monkeypatch.setattr(imprint, "IS_ROOT", False)
        monkeypatch.setattr(imprint, "probe", lambda python: (SEGFAULT, ""))
        with pytest.raises(imprint.Failure, match="OpenGL driver"):
            imprint.require_gpu("python", may_install=True)
        assert not imprint.GPU_STAMP.exists()

    def test_root_on_debian_installs_packages_and_probes_again(self, bare, linux, monkeypatch):
        finish_environment()
        answers = [(1, TestMissingLibraries.IMPORT_ERROR), (0, "")]
        commands = []
        monkeypatch.setattr(imprint, "IS_ROOT", True)
        monkeypatch.setattr(imprint.shutil, "which", lambda name: name if name == "apt-get" else None)
        monkeypatch.setattr(imprint, "probe", lambda python: answers.pop(0))
        monkeypatch.setattr(imprint.subprocess, "call", lambda command, **_: commands.append(command))
        imprint.require_gpu("python", may_install=True)
        assert [command[1] for command in commands] == ["update", "install"]
        assert "libsm6" in commands[1]

    @pytest.mark.parametrize("command", ["bake", "lod", "bench", "demo", "test"])
    def test_only_demo_and_test_install_packages_as_root(self, bare, linux, monkeypatch, capfd, command):
        finish_environment()
        commands = []
        monkeypatch.setattr(imprint, "require_test_programs", lambda: None)
        monkeypatch.setattr(imprint, "IS_ROOT", True)
        monkeypatch.setattr(imprint.shutil, "which", lambda name: name if name == "apt-get" else None)
        monkeypatch.setattr(imprint, "probe", lambda python: (1, TestMissingLibraries.IMPORT_ERROR))
        monkeypatch.setattr(imprint.subprocess, "call", lambda command, **_: commands.append(command))
        assert imprint.main([command]) == 3
        installs = [words for words in commands if words[0] == "apt-get"]
        assert len(installs) == (2 if command in ("demo", "test") else 0)
        assert "to fix it: apt-get install --no-install-recommends libsm6" in capfd.readouterr().err


@pytest.fixture
def ready(bare, monkeypatch):
    """A checkout with an environment. Returns the list of commands that are started, and a dict with their exit code."""
    finish_environment()
    started = []
    ending = {"code": 0}
    monkeypatch.setattr(imprint, "probe", lambda python: (0, ""))
    monkeypatch.setattr(imprint, "require_test_programs", lambda: None)
    monkeypatch.setattr(imprint, "cores", lambda: 6)
    monkeypatch.setattr(imprint.subprocess, "call", lambda command, **_: started.append(command) or ending["code"])
    return started, ending


@pytest.fixture
def baking(ready, bare):
    """A function that replaces Blender by a shell script. It returns the file that the script writes its arguments to."""

    def become(body):
        fake_python(imprint.PYTHON.parent, f'printf "%s\\n" "$@" > "{bare}/started"\n{body}', imprint.PYTHON.name)
        return bare / "started"

    return become


class TestCommands:
    @pytest.mark.parametrize("arguments", [["--help"], ["--high", "a.obj", "--", "-x", "b"], ["-h"], []])
    def test_bake_gets_its_arguments_unchanged(self, baking, arguments):
        started = baking("exit 0")
        assert imprint.main(["bake", *arguments]) == 0
        assert started.read_text().splitlines() == [str(imprint.SCRIPTS / "bake.py"), "--", *arguments]

    @pytest.mark.parametrize(
        ("variables", "after"),
        [(("1", ""), "|byte code"), (("1", "own"), "1|own"), (("", ""), "|")],
    )
    def test_byte_code_is_kept_in_the_environment(self, baking, bare, monkeypatch, variables, after):
        monkeypatch.setattr(imprint, "BYTE_CODE", "byte code")
        for name, value in zip(("PYTHONDONTWRITEBYTECODE", "PYTHONPYCACHEPREFIX"), variables, strict=True):
            monkeypatch.setenv(name, value)
        baking(f'printf "%s|%s" "$PYTHONDONTWRITEBYTECODE" "$PYTHONPYCACHEPREFIX" > "{bare}/variables"')
        assert imprint.main(["bake"]) == 0
        assert (bare / "variables").read_text() == after

    @pytest.mark.parametrize("is_there", [False, True])
    def test_without_write_access_only_byte_code_that_is_there_is_read(self, tmp_path, monkeypatch, is_there):
        """With a prefix Python ignores the byte code beside the code, and would compile all at each run."""
        monkeypatch.setattr(imprint, "BYTE_CODE", tmp_path if is_there else tmp_path / "none")
        monkeypatch.setattr(imprint.os, "access", lambda *_: False)
        monkeypatch.setenv("PYTHONDONTWRITEBYTECODE", "1")
        monkeypatch.delenv("PYTHONPYCACHEPREFIX", raising=False)
        assert bool(imprint.byte_code()) == is_there

    def test_blender_is_given_the_time_of_the_start(self, baking, bare):
        baking(f'printf "$IMPRINT_BEGUN" > "{bare}/begun"')
        assert imprint.main(["bake"]) == 0
        assert float((bare / "begun").read_text()) == imprint.BEGUN
        assert 0.0 < imprint.BEGUN < time.time()

    @pytest.mark.parametrize("code", [0, 1, 2])
    def test_the_exit_code_is_returned_without_a_message(self, baking, code, capfd):
        baking(f"exit {code}")
        assert imprint.main(["bake"]) == code
        assert capfd.readouterr() == ("", "")

    def test_a_crash_gives_one_line_with_the_bake_and_a_new_probe(self, baking, monkeypatch, capfd):
        baking("printf rock > /dev/fd/$IMPRINT_BAKING; kill -SEGV $$")
        probes = []
        monkeypatch.setattr(imprint, "probe", lambda python: probes.append(python) or (0, ""))
        assert imprint.main(["bake"]) == 1
        message = capfd.readouterr().err
        assert message.startswith("imprint: Blender crashed with signal 11, Segmentation fault while baking rock")
        assert message.count("\n") == 1
        assert len(probes) == 2
        assert not imprint.GPU_STAMP.exists()

    @pytest.mark.parametrize(("probed", "word"), [(SEGFAULT, "OpenGL driver"), (-6, "Blender crashed with signal 11")])
    @pytest.mark.usefixtures("linux")
    def test_the_driver_is_named_if_the_probe_crashes_in_the_same_way(self, baking, monkeypatch, capfd, probed, word):
        baking("kill -SEGV $$")
        answers = [(0, ""), (probed, "")]
        monkeypatch.setattr(imprint, "probe", lambda python: answers.pop(0))
        assert imprint.main(["bake"]) == 1
        assert word in capfd.readouterr().err

    def test_a_killed_bake_does_not_name_a_driver(self, baking, monkeypatch, capfd):
        baking("kill -KILL $$")
        answers = [(0, "")]
        monkeypatch.setattr(imprint, "probe", lambda python: answers.pop(0))
        assert imprint.main(["bake"]) == 1
        assert "signal 9, Killed: another process killed it, or memory ran out" in capfd.readouterr().err

    @pytest.mark.skipif(imprint.WINDOWS, reason="signals of POSIX")
    def test_a_signal_before_blender_starts_is_not_lost(self, baking, monkeypatch):
        started = baking("exit 0")
        make = imprint.tempfile.TemporaryFile
        monkeypatch.setattr(imprint.tempfile, "TemporaryFile", lambda: signal.raise_signal(signal.SIGTERM) or make())
        assert imprint.main(["bake"]) == 128 + signal.SIGTERM
        assert not started.exists()

    PARALLEL = ["-n", "6", "--dist", "loadfile", "--no-loadscope-reorder"]

    def test_pytest_runs_even_if_ruff_fails(self, ready):
        started, ending = ready
        ending["code"] = 1
        assert imprint.main(["test", "-k", "word", "tests/pure"]) == 1
        assert [command[2] for command in started] == ["ruff", "pytest"]
        assert started[1][3:] == [*self.PARALLEL, "-m", "not slow", "-k", "word", "tests/pure"]

    def test_all_runs_the_slow_tests_as_well(self, ready):
        started, _ = ready
        assert imprint.main(["test", "--all", "-k", "word"]) == 0
        assert started[1][3:] == [*self.PARALLEL, "-k", "word"]

    @pytest.mark.parametrize(("processes", "threads"), [(None, "1"), ("0", "6"), ("1", "6"), ("2", "3"), ("9", "1")])
    def test_processes_share_the_cores(self, ready, monkeypatch, processes, threads):
        environments = []
        monkeypatch.delenv("LP_NUM_THREADS", raising=False)
        monkeypatch.setattr(imprint, "byte_code", lambda: {"PYTHONPYCACHEPREFIX": "byte code"})
        monkeypatch.setattr(imprint, "run_blender", lambda *_, env, **__: environments.append(env))
        imprint.main(["test", *(["-n", processes] if processes else [])])
        assert environments[0]["LP_NUM_THREADS"] == threads
        assert environments[0]["PYTHONPYCACHEPREFIX"] == "byte code"

    def test_the_help_of_the_tests_runs_no_tests(self, ready, capsys):
        started, _ = ready
        with pytest.raises(SystemExit) as ended:
            imprint.main(["test", "--help"])
        assert (ended.value.code, started) == (0, [])
        shown = " ".join(capsys.readouterr().out.split())
        assert all(words in shown for words in ("--all", "-n PROCESSES", "-m pytest tests/pure"))

    def test_wrong_usage_has_exit_code_2(self, capsys):
        with pytest.raises(SystemExit) as ended:
            imprint.main(["bakke"])
        assert ended.value.code == 2


BLENDER = """
import os, signal, sys, time
log, signals, kind = open(sys.argv[1], "a", buffering=1), sys.argv[2].split(), sys.argv[3]
def receive(number, _):
    print(signal.Signals(number).name, file=log)
    if signals:
        os.kill(os.getppid(), signal.Signals[signals.pop(0)])
    elif kind != "ignores":
        sys.exit(3)
for number in (signal.SIGUSR1, signal.SIGUSR2):
    signal.signal(number, receive)
signal.pthread_sigmask(signal.SIG_UNBLOCK, [signal.SIGUSR1, signal.SIGUSR2])
os.kill(os.getppid(), signal.Signals[signals.pop(0)])
time.sleep(5 if kind in ("ignores", "stops") else 0.2)
print("was not stopped", file=log)
"""


@pytest.mark.skipif(imprint.WINDOWS, reason="signals of POSIX")
class TestSignals:
    """How the launcher stops. A script instead of Blender sends it the signals."""

    @pytest.fixture
    def run(self, baking, bare, monkeypatch):
        monkeypatch.setattr(imprint.Bake, "GRACE", 0.1)

        def run(signals, kind):
            (bare / "blender.py").write_text(BLENDER)
            baking(f'exec "{sys.executable}" "{bare}/blender.py" "{bare}/log" "{signals}" {kind}')
            return imprint.main(["bake"]), (bare / "log").read_text().split("\n")[:-1]

        return run

    def test_the_first_signal_stops_blender_cleanly(self, run, monkeypatch):
        monkeypatch.setattr(imprint.Bake, "GRACE", 60.0)
        before = signal.getsignal(signal.SIGTERM)
        assert run("SIGTERM", "stops") == (128 + signal.SIGTERM, ["SIGUSR1"])
        assert signal.getsignal(signal.SIGTERM) == before

    def test_the_second_signal_ends_blender_at_once(self, run, monkeypatch):
        monkeypatch.setattr(imprint.Bake, "GRACE", 60.0)
        assert run("SIGINT SIGTERM", "stops") == (128 + signal.SIGINT, ["SIGUSR1", "SIGUSR2"])

    def test_a_blender_that_hangs_is_killed_some_time_after_one_signal(self, run, monkeypatch):
        monkeypatch.setattr(imprint.Bake, "PATIENCE", 0.1)
        assert run("SIGTERM", "ignores") == (128 + signal.SIGTERM, ["SIGUSR1", "SIGUSR2"])

    def test_a_blender_that_ignores_signals_is_killed(self, run):
        assert run("SIGTERM SIGTERM", "ignores") == (128 + signal.SIGTERM, ["SIGUSR1", "SIGUSR2"])

    def test_nohup_is_respected(self, run):
        before = signal.signal(signal.SIGHUP, signal.SIG_IGN)
        try:
            assert run("SIGHUP", "goes on") == (0, ["was not stopped"])
        finally:
            signal.signal(signal.SIGHUP, before)


# Lanes
