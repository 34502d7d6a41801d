# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests the check of commits: a made repository, and messages as git gives them to a hook. Needs git."""

import os
import subprocess

import pytest

from scripts.dev import commits

BODY = "\n\nBecause it was slow: 3.2 s, now 1.1.\n"


@pytest.fixture
def repository(tmp_path, monkeypatch):
    """A function that commits with a message, in a repository of its own that has one commit."""
    monkeypatch.chdir(tmp_path)
    for name in ("GIT_CONFIG_GLOBAL", "GIT_CONFIG_SYSTEM"):
        monkeypatch.setenv(name, os.devnull)

    def commit(message, *words):
        git("commit", "--quiet", "--allow-empty", "--message", message, *words)

    git("init", "--quiet", "--initial-branch", "main")
    commit("The first one, long before there was a rule about how subjects are to be written")
    return commit


def git(*words):
    subprocess.run(["git", "-c", "user.name=A", "-c", "user.email=a@example.org", *words], check=True)


def check(capsys, *words):
    code = commits.main(list(words))
    return code, capsys.readouterr().out.splitlines()


def test_each_commit_that_breaks_a_rule_has_a_line(repository, capsys):
    repository("mesh: have one table of edges" + BODY)
    repository("Have one table of edges" + BODY)
    repository("mesh: have one table of edges")
    code, lines = check(capsys, "--since", "HEAD~3")
    assert code == 1
    assert [line.split(" ", 1)[1] for line in lines] == [
        "Have one table of edges: is not `area: what`",
        "mesh: have one table of edges: has no body that says why",
    ]


def test_commits_before_the_rule_and_good_ones_are_right(repository, capsys):
    repository("mesh: have one table of edges" + BODY + "\nChangelog: Faster.\n")
    assert check(capsys, "--since", "HEAD~1") == (0, [])


def test_merges_are_named(repository, capsys):
    git("checkout", "--quiet", "-b", "other")
    repository("mesh: have one table of edges" + BODY)
    git("checkout", "--quiet", "main")
    git("merge", "--quiet", "--no-ff", "--message", "mesh: merge the other", "other")
    code, (line,) = check(capsys, "--since", "HEAD~1")
    assert code == 1
    assert line.endswith("mesh: merge the other: is a merge")


@pytest.mark.parametrize(
    ("subject", "problem"),
    [
        ("mesh, core/levels: have one table of edges", ""),
        ("cli: embed the page", ""),
        ("ui: press a button once", ""),
        ("mesh: need no tree", ""),
        (f"mesh: have {'e' * 50}", "has 61 characters, 60 at most"),
        ("mesh: fixes the table", "is not in the imperative"),
        ("mesh: fixed the table", "is not in the imperative"),
        ("mesh: fixing the table", "is not in the imperative"),
        ("mesh: the table of edges", "is not in the imperative"),
        ("mesh: fix the table.", "ends with a full stop"),
        ("A line of comment fits", "is not `area: what`"),
        ("WIP table", "is unfinished work"),
        ("fixup! mesh: fix the table", "is unfinished work"),
        ("", "is not `area: what`"),
    ],
)
def test_subjects(tmp_path, capsys, subject, problem):
    """In a file with git's comments, as the hook commit-msg has it."""
    path = tmp_path / "COMMIT_EDITMSG"
    path.write_text(f"{subject}{BODY}# On branch main\n", encoding="utf-8")
    assert check(capsys, str(path)) == (int(bool(problem)), [f"The message {problem}."] if problem else [])


def test_a_body_has_an_empty_line_before_it(tmp_path, capsys):
    path = tmp_path / "COMMIT_EDITMSG"
    path.write_text("mesh: fix the table\nBecause it was slow.\n", encoding="utf-8")
    assert check(capsys, str(path)) == (1, ["The message has no empty line below it."])


@pytest.mark.parametrize("rest", ["", "\n\n\n", "\n\n# On branch main\n"])
def test_empty_lines_and_comments_are_no_body(tmp_path, capsys, rest):
    path = tmp_path / "COMMIT_EDITMSG"
    path.write_text(f"mesh: fix the table{rest}", encoding="utf-8")
    assert check(capsys, str(path)) == (1, ["The message has no body that says why."])
