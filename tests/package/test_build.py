# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests that Blender's own tool builds and validates the zip, and that it is complete and can be installed."""

import importlib.util
import os
import shutil
import subprocess
import sys
import tomllib
import zipfile
from pathlib import Path

import pytest

from scripts import imprint

TOP = ["__init__.py", "blender_manifest.toml", "LICENSE", "README.md", "CHANGELOG.md"]
SITE_PACKAGES = Path(importlib.util.find_spec("bpy").origin).parent.parent


def build(source, output):
    """Build and validate the extension in a source folder, with the wheel of this Python."""
    return imprint.build_zip(sys.executable, SITE_PACKAGES, source, output)


def listing(archive):
    """Return the names in a zip, with the entries of folders, if any."""
    with zipfile.ZipFile(archive) as file:
        return sorted(file.namelist())


def expected_listing(source):
    """Return the names that the zip must have: the files at the top, modules, translations, answers and shaders."""
    inside = [
        *(source / "addon").rglob("*.py"),
        *(source / "addon").rglob("*.po"),
        source / "addon" / "jobs" / "gpu_answers.npz",
        *(source / "shaders").rglob("*.glsl"),
    ]
    return sorted([*TOP, *(path.relative_to(source).as_posix() for path in inside)])


@pytest.fixture(scope="module")
def archive(tmp_path_factory):
    """The zip of this checkout."""
    return build(imprint.ROOT, tmp_path_factory.mktemp("dist"))


def test_the_zip_has_the_add_on_and_nothing_else(archive):
    assert listing(archive) == expected_listing(imprint.ROOT)


def test_the_zip_is_named_after_the_manifest(archive):
    manifest = tomllib.loads((imprint.ROOT / "blender_manifest.toml").read_text())
    assert archive.name == f"{manifest['id']}-{manifest['version']}.zip"


def test_other_files_of_a_checkout_are_not_packed(tmp_path):
    """Not even those in folders that no rule names."""
    source = tmp_path / "checkout"
    for folder in ("addon", "shaders"):
        shutil.copytree(imprint.ROOT / folder, source / folder)
    for name in TOP:
        shutil.copy(imprint.ROOT / name, source)
    for name in (
        ".venv/lib/module.py",
        ".git/config",
        ".python-version",
        "imprint-0.0.9.zip",
        "notes/idea.py",
        "out/normal.png",
        "pyproject.toml",
        "scene.blend1",
        "tests/ui/test_panel.py",
        "addon/__pycache__/live.cpython-313.pyc",
        "addon/.DS_Store",
        "shaders/view/lit.blend1",
    ):
        (source / name).parent.mkdir(parents=True, exist_ok=True)
        (source / name).touch()
    assert listing(build(source, tmp_path / "dist")) == expected_listing(imprint.ROOT)


def test_a_broken_manifest_is_refused(tmp_path):
    (tmp_path / "__init__.py").touch()
    (tmp_path / "blender_manifest.toml").write_text('schema_version = "1.0.0"\nid = "imprint"\n')
    with pytest.raises(imprint.Failure, match="missing"):
        build(tmp_path, tmp_path / "dist")


@pytest.mark.slow
def test_the_zip_can_be_installed_and_used(archive, tmp_path):
    """In a separate, isolated process (-I), so that nothing is imported from the checkout."""
    program = [sys.executable, "-I", str(Path(__file__).with_name("install_zip.py")), str(archive)]
    profile = dict(os.environ, BLENDER_USER_RESOURCES=str(tmp_path / "profile"))
    done = subprocess.run(program, env=profile, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    assert done.stdout.endswith("installed, used and removed\n")
