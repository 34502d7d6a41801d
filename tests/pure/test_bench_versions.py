# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests how the benchmark checks out an older version, and the processes that it asks."""

import subprocess
import sys

import pytest

from scripts.bench.contenders import versions
from scripts.bench.contenders.child import Child, ChildError
from scripts.bench.contenders.names import PRESENT

CHILD = """
import json, sys
for line in sys.stdin:
    request = json.loads(line)
    if request["do"] == "die":
        sys.exit("out of ink")
    print(json.dumps({"error": "no"} if request["do"] == "fail" else {"same": request}), flush=True)
"""


@pytest.fixture
def repository(tmp_path, monkeypatch):
    """A repository with two commits, whose first one has the tag v9.1.0, as the root of the benchmark."""
    root = tmp_path / "repository"
    (root / "scripts").mkdir(parents=True)

    def git(*arguments):
        subprocess.run(["git", "-C", root, "-c", "user.name=a", "-c", "user.email=a@b", *arguments], check=True)

    git("init", "-q")
    for text, tag in (("old", "v9.1.0"), ("new", "")):
        for name in ("imprint.py", "requirements.txt"):
            (root / "scripts" / name).write_text("same" if name == "requirements.txt" else text)
        git("add", "-A")
        git("commit", "-q", "-m", text)
        if tag:
            git("tag", tag)
    monkeypatch.setattr(versions, "ROOT", root)
    monkeypatch.setattr(versions, "HOME", tmp_path / "older")
    return root


@pytest.mark.parametrize("ref", ["", "v9.1.0", "HEAD~1"])
def test_an_older_version_is_checked_out_with_the_environment_of_this_one(repository, ref):
    (repository / "scripts" / "imprint.py").write_text("not committed")
    found = versions.older(ref)
    assert found.name == f"{PRESENT} {ref or 'v9.1.0'}"
    assert (found.root / "scripts" / "imprint.py").read_text() == "old"
    assert (found.root / ".venv").resolve() == versions.Path(sys.prefix).resolve()
    assert list(found.root.parent.iterdir()) == [found.root]
    assert versions.older(ref) == found
    assert [version.name for version in versions.versions(ref)] == [PRESENT, found.name]


def test_other_requirements_get_an_environment_of_their_own(repository):
    (repository / "scripts" / "requirements.txt").write_text("other")
    assert not (versions.older("v9.1.0").root / ".venv").exists()


def test_without_a_reference_only_this_version_is_measured():
    assert [version.name for version in versions.versions(None)] == [PRESENT]


def test_missing_references_and_a_missing_git_have_a_message(repository, monkeypatch):
    with pytest.raises(versions.NoOlderVersion, match=r"has no 'nowhere'; bench --against needs a commit or a tag"):
        versions.older("nowhere")
    subprocess.run(["git", "-C", repository, "tag", "-d", "v9.1.0"], check=True)
    with pytest.raises(versions.NoOlderVersion, match=rf"has no '{versions.RELEASE}'"):
        versions.older("")
    monkeypatch.setenv("PATH", "")
    with pytest.raises(versions.NoOlderVersion, match="git cannot be started: No such file"):
        versions.older("HEAD")


def test_a_child_answers_fails_and_dies(tmp_path):
    with Child([sys.executable, "-c", CHILD], tmp_path / "log") as child:
        assert child.ask(do="echo", what=[1, 2]) == {"same": {"do": "echo", "what": [1, 2]}}
        with pytest.raises(ChildError, match="^no$"):
            child.ask(do="fail")
        for _ in range(2):
            with pytest.raises(ChildError, match="^the process died: out of ink$"):
                child.ask(do="die")
