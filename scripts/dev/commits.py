#!/usr/bin/env python3
# SPDX-License-Identifier: GPL-3.0-or-later
"""Checks the messages of commits: a subject `area: what` in the imperative, of at most 60 characters, and a body that says why.

    python3 scripts/dev/commits.py                 # those since the rule
    python3 scripts/dev/commits.py --since v0.3.0
    python3 scripts/dev/commits.py FILE            # one message, as git gives it to the hook commit-msg

Prints a line for each commit that breaks a rule, and ends with 1 if there is one. As a hook:
ln -s ../../scripts/dev/commits.py .git/hooks/commit-msg
"""

import argparse
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

RULED_SINCE = "225d7526"
"""The last commit before the rule."""
MOST_CHARACTERS = 60
"""Of a subject: what `git log --oneline` shows on a terminal of 72 columns."""
SUBJECT = re.compile(r"[a-z0-9_./, -]+: (?P<what>\S.*)")
NOT_IMPERATIVE = re.compile(r"(the|an?|this|it|no|not|\w+ing|\w+[^e]ed|\w+[^s]s)\b")
"""The beginning of what describes a change instead of asking for it, as "fixes", "fixed", "fixing" or "the fix"."""
IMPERATIVE = {"bring", "ping", "string", "ring", "embed", "shed", "bias", "alias", "focus", "canvas"}
"""Verbs that look otherwise."""
UNFINISHED = re.compile(r"fixup!|squash!|amend!|wip\b", re.IGNORECASE)


def problems(message: str) -> Iterator[str]:
    """What breaks the rules in a message, without the comments that git writes into it."""
    lines = [line for line in message.splitlines() if not line.startswith("#")]
    subject = lines[0].rstrip() if lines else ""
    if UNFINISHED.match(subject):
        yield "is unfinished work"
        return
    if len(subject) > MOST_CHARACTERS:
        yield f"has {len(subject)} characters, {MOST_CHARACTERS} at most"
    parts = SUBJECT.fullmatch(subject)
    if not parts:
        yield "is not `area: what`"
    elif NOT_IMPERATIVE.match(parts["what"].lower()) and parts["what"].split()[0] not in IMPERATIVE:
        yield "is not in the imperative"
    if subject.endswith("."):
        yield "ends with a full stop"
    if len(lines) > 1 and lines[1].strip():
        yield "has no empty line below it"
    if not any(line.strip() for line in lines[1:]):
        yield "has no body that says why"


def git(*words: str) -> str:
    return subprocess.run(["git", *words], check=True, capture_output=True, text=True, encoding="utf-8").stdout


def commits(since: str) -> Iterator[tuple[str, bool, str]]:
    """Those that are not in `since`, oldest first: the name, whether it is a merge, and the message."""
    for record in git("log", "--reverse", "--format=%h%x00%p%x00%B%x01", f"{since}..HEAD").split("\x01"):
        if record.strip():
            name, parents, message = record.strip("\n").split("\0")
            yield name, " " in parents, message


def lines_of(since: str) -> Iterator[str]:
    """A line for each commit that breaks a rule."""
    for name, is_merge, message in commits(since):
        wrong = ["is a merge"] if is_merge else list(problems(message))
        if wrong:
            yield f"{name} {message.splitlines()[0]}: {'; '.join(wrong)}"


def main(words: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("message", nargs="?", type=Path, metavar="FILE", help="check the message in this file")
    parser.add_argument("--since", default=RULED_SINCE, metavar="REV", help="check the commits after this one")
    options = parser.parse_args(words)
    if options.message:
        found = [f"The message {problem}." for problem in problems(options.message.read_text(encoding="utf-8"))]
    else:
        found = list(lines_of(options.since))
    print("\n".join(found), end="\n" if found else "")
    return int(bool(found))


if __name__ == "__main__":
    sys.exit(main())
