# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests the Python door as other programs use it: from an installed package, from an installed zip, as the manual says."""

import re
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

from scripts.imprint import ROOT

SCRIPT = Path(__file__).with_name("use_python.py")
MESHES = """
import numpy as np
low_vertices = np.float32([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]])
low_triangles, low_uv = np.array([[0, 1, 2], [0, 2, 3]]), (low_vertices[:, :2] + 1) / 2
high_vertices, high_triangles = low_vertices + np.float32([0, 0, 0.01]), low_triangles
"""
OBJ = "v -1 0 1\nv 1 0 1\nv 1 0 -1\nv -1 0 -1\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\nf 1/1 2/2 3/3 4/4\n"


@pytest.fixture(scope="module")
def packages(tmp_path_factory):
    """A folder with what `pip install .` puts beside other packages, as pyproject.toml lists it."""
    folder = tmp_path_factory.mktemp("packages")
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    for source, target in project["tool"]["hatch"]["build"]["targets"]["wheel"]["force-include"].items():
        copy = shutil.copytree if (ROOT / source).is_dir() else shutil.copyfile
        (folder / target).parent.mkdir(parents=True, exist_ok=True)
        copy(ROOT / source, folder / target)
    return folder


def run(packages, folder, program):
    """Run a program outside the checkout, with `packages` among the installed ones."""
    script = Path(folder, "program.py")
    lines = f"import sys\nsys.path.insert(0, {str(packages)!r})\n"
    script.write_text(lines + program.read_text(encoding="utf-8"), encoding="utf-8")
    command = [sys.executable, "-I", str(script)]
    return subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)


GRID = """import numpy
x, y = (each.ravel() for each in numpy.meshgrid(*[numpy.linspace(0.0, 1.0, 60)] * 2))
points = numpy.stack([x, y, 0.05 * numpy.sin(9.0 * x) * numpy.sin(9.0 * y)], axis=1)
first = (numpy.arange(59) + 60 * numpy.arange(59)[:, None]).ravel()
triangles = numpy.concatenate([first[:, None] + corners for corners in ([0, 1, 61], [0, 61, 60])])
"""
"""A wavy sheet of 6,962 triangles, of which the manual makes fewer."""


NO_BPY = """
class Finder:
    def find_spec(name, *_):
        if name == "bpy":
            raise ModuleNotFoundError("No module named 'bpy'", name=name)
sys.meta_path.insert(0, Finder)
"""
"""Lets Blender's package be missing."""


@pytest.mark.slow
def test_an_installed_package_bakes(packages, tmp_path):
    done = run(packages, tmp_path, SCRIPT)
    assert "baked through the door" in done.stdout, done.stdout + done.stderr


def lines_of_the_manual():
    """The examples of the manual: those of assets, which take longer, and all others."""
    examples = re.findall(r"```python\n(.*?)```", (ROOT / "docs" / "python.md").read_text(encoding="utf-8"), re.DOTALL)
    lines = [each for each in examples if "bpy.ops" not in each]
    later = ("imprint.asset", "imprint.encode")
    return [each for each in lines if any(word in each for word in later)], [
        each for each in lines if not any(word in each for word in later)
    ]


def test_the_lines_of_the_manual_bake(packages, tmp_path):
    _, lines = lines_of_the_manual()
    assert len(lines) == 4
    for name in ("rock_low.obj", "rock_high.obj"):
        (tmp_path / name).write_text(OBJ)
    checks = "assert normals.shape == (256, 256, 4)\nassert len(result.files) == 2\nprint('as the manual says')\n"
    program = tmp_path / "manual.py"
    program.write_text(MESHES + GRID + "\n".join(lines) + checks)
    done = run(packages, tmp_path, program)
    assert "as the manual says" in done.stdout, done.stdout + done.stderr


@pytest.mark.slow
def test_the_lines_of_the_manual_make_an_asset(packages, tmp_path):
    lines, _ = lines_of_the_manual()
    assert len(lines) == 2
    program = tmp_path / "manual.py"
    program.write_text(
        "import imprint\n" + GRID + "".join(lines) + "assert set(result.maps) == {'ao'}\nprint('as the manual says')\n"
    )
    done = run(packages, tmp_path, program)
    assert "as the manual says" in done.stdout and "(500, 3, 2) (256, 256, 4) 250" in done.stdout, (
        done.stdout + done.stderr
    )


def test_without_blender_the_package_says_what_to_install(packages, tmp_path):
    program = tmp_path / "without.py"
    program.write_text("sys.modules['bpy'] = None\nimport imprint\nimprint.bake\n")
    done = run(packages, tmp_path, program)
    assert done.returncode == 1
    assert "pip install 'imprint-bake[bpy]'" in done.stderr


def test_without_blender_the_program_says_what_to_install(packages, tmp_path):
    (tmp_path / "plane.obj").write_text(OBJ)
    program = tmp_path / "without.py"
    words = ["--low-file", "plane.obj", "--high-file", "plane.obj", "--output", "m.png"]
    program.write_text(f"{NO_BPY}\nfrom imprint import addon\nsys.argv[1:] = {words}\naddon.main()\n")
    done = run(packages, tmp_path, program)
    assert (done.returncode, done.stdout) == (3, "")
    assert done.stderr.endswith("pip install 'imprint-bake[bpy]'\n")
    assert "Traceback" not in done.stderr
