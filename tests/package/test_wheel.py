# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests the Python package as others get it: built, installed into an empty environment, used, and removed again."""

import email
import os
import subprocess
import sys
import tarfile
import tomllib
import zipfile

import pytest

from scripts.dev import blender_packages, release
from scripts.imprint import ROOT, SITE_PACKAGES, build_zip
from tests.package.test_python import OBJ, SCRIPT

pytestmark = pytest.mark.slow
JOBS = """
[[bake]]
low-file = "plane.obj"
high-file = "plane.obj"
output = "{name}.png"
size = 16
"""


@pytest.fixture(scope="module")
def built(tmp_path_factory):
    """(wheel, source) of this checkout."""
    return release.packages(tmp_path_factory.mktemp("dist"))


def names(wheel):
    with zipfile.ZipFile(wheel) as file:
        return {name for name in file.namelist() if ".dist-info/" not in name}


def test_the_wheel_has_the_extension_and_its_program(built, tmp_path):
    with zipfile.ZipFile(build_zip(sys.executable, SITE_PACKAGES, ROOT, tmp_path)) as file:
        extension = {f"imprint/{name}" for name in file.namelist()}
    texts = {f"imprint/{name}" for name in ("LICENSE", "README.md", "CHANGELOG.md")}
    assert names(built[0]) == extension - texts | {"imprint/py.typed", "imprint/scripts/bake.py"}


def test_the_source_makes_the_same_wheel(built, tmp_path):
    with tarfile.open(built[1]) as file:
        file.extractall(tmp_path, filter="data")
    (folder,) = tmp_path.iterdir()
    wheel, _ = release.packages(tmp_path / "dist", folder)
    assert wheel.read_bytes() == built[0].read_bytes()


def test_the_page_of_the_package_needs_no_other_file(built):
    with zipfile.ZipFile(built[0]) as file:
        (name,) = (name for name in file.namelist() if name.endswith("/METADATA"))
        metadata = email.message_from_bytes(file.read(name))
    page = metadata.get_payload()
    assert page.startswith("# Imprint in Python\n")
    assert page.count("](") == page.count("](https://")
    (bounds,) = (line for line in metadata.get_all("Requires-Dist") if line.startswith("bpy"))
    assert all(version.split(".")[:2] <= ["5", "3"] for version in blender_packages.PYTHONS)
    assert bounds == "bpy<5.4,>=4.5; extra == 'bpy'"


def test_it_is_installed_used_and_removed(built, tmp_path):
    """Blender's package and numpy are those of this environment, so that nothing large is installed once more."""
    subprocess.run([sys.executable, "-m", "venv", str(tmp_path / "env")], check=True)
    (programs,) = (path for path in (tmp_path / "env").iterdir() if path.name in {"bin", "Scripts"})
    (packages,) = (tmp_path / "env").rglob("site-packages")
    (packages / "blender.pth").write_text(f"{SITE_PACKAGES}\n")
    variables = {name: value for name, value in os.environ.items() if not name.startswith("PYTHON")}
    folder = tmp_path / "work"
    folder.mkdir()
    (folder / "plane.obj").write_text(OBJ)
    (folder / "jobs.toml").write_text("".join(JOBS.format(name=name) for name in "ab"))

    def run(program, *words, code=0):
        command = [str(programs / program), *map(str, words)]
        done = subprocess.run(command, cwd=folder, env=variables, capture_output=True, text=True, check=False)
        assert done.returncode == code, done.stdout + done.stderr
        return done.stdout

    def there():
        return {path for path in (tmp_path / "env").rglob("*") if "pip" not in path.parts}

    before = there()
    run("python", "-m", "pip", "install", "--quiet", "--no-index", "--no-deps", built[0])
    assert "usage: imprint" in run("imprint", "--help")
    version = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]["version"]
    assert run("imprint", "--version").startswith(f"Imprint {version}, ")
    run("imprint", "bake", "--low-file", "plane.obj", "--high-file", "plane.obj", "--size", 16, "--output", "m.png")
    run("imprint", "--jobs", "jobs.toml", "--workers", 2)
    assert {path.name for path in folder.glob("*.png")} == {"m.png", "a.png", "b.png"}
    assert "baked through the door" in run("python", SCRIPT)
    assert run("imprint", "--low-file", "plane.obj", code=2) == ""
    run("python", "-m", "pip", "uninstall", "--quiet", "--yes", "imprint-bake")
    assert there() == before
