# SPDX-License-Identifier: GPL-3.0-or-later
"""Builds the manual as a site, in a copy of its pages. MkDocs comes from the registry of Python packages, as .venv does."""

import json
import shutil
import subprocess
import sys

import pytest

from scripts.dev.site import build
from scripts.imprint import ROOT

READ_AS_OTHERS = """
import pathlib, sys
import yaml
from scripts.dev import run_workflow
for path in [*pathlib.Path(".github").rglob("*.yml"), pathlib.Path("CITATION.cff")]:
    text = path.read_text(encoding="utf-8")
    assert run_workflow.read_yaml(text) == yaml.load(text, yaml.BaseLoader), path
    print(path)
"""


@pytest.fixture(scope="module")
def python():
    """The Python of the environment with MkDocs."""
    return str(build.environment(ROOT / "out" / "site-environment"))


@pytest.fixture
def checkout(tmp_path, python):
    """A checkout with what the site is made of."""
    copy = tmp_path / "checkout"
    shutil.copytree(ROOT / "docs", copy / "docs")
    shutil.copytree(ROOT / "scripts" / "dev" / "site", copy / "scripts" / "dev" / "site")
    for name in ("README.md", "CONTRIBUTING.md", "CHANGELOG.md"):
        shutil.copy(ROOT / name, copy)
    return copy


def built(checkout):
    """Build the site. Returns the exit code and what was printed."""
    script = checkout / "scripts" / "dev" / "site" / "build.py"
    folders = ["--output", str(checkout / "site"), "--environment", str(ROOT / "out" / "site-environment")]
    done = subprocess.run([sys.executable, str(script), *folders], capture_output=True, text=True, check=False)
    return done.returncode, done.stdout + done.stderr


@pytest.mark.slow
def test_the_site_has_all_pages_and_a_search(checkout):
    code, output = built(checkout)
    assert code == 0, output
    pages = {path.stem for path in (checkout / "docs").glob("*.md")} | {"contributing", "changelog"}
    assert {path.parent.name for path in (checkout / "site").glob("*/index.html")} == pages
    found = json.loads((checkout / "site" / "search" / "search_index.json").read_text(encoding="utf-8"))["docs"]
    assert {entry["location"].partition("#")[0].strip("/") for entry in found} == {*pages, ""}
    front = (checkout / "site" / "index.html").read_text(encoding="utf-8")
    assert 'href="quick-start/"' in front
    assert 'src="images/terrain.jpg"' in front


@pytest.mark.slow
@pytest.mark.parametrize("target", ["quick-start.md#nowhere", "nowhere.md", "../README.md#nowhere"])
def test_a_broken_link_is_an_error(checkout, target):
    with (checkout / "docs" / "maps.md").open("a", encoding="utf-8") as page:
        page.write(f"\n[broken]({target})\n")
    code, output = built(checkout)
    assert code != 0
    assert "nowhere" in output


@pytest.mark.slow
def test_workflows_are_read_as_by_others(python):
    done = subprocess.run([python, "-c", READ_AS_OTHERS], cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert len(done.stdout.splitlines()) >= 9
