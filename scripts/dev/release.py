#!/usr/bin/env python3
# SPDX-License-Identifier: GPL-3.0-or-later
"""Checks that a tag may become a release, and makes the files of it: the zip, the Python package as a wheel and as source, the
SHA-256 of each, and notes from the changelog.

    python3 scripts/dev/release.py v0.3.0 [--prepare DATE | --check] [--output dist]

The tag is "v" and the version. blender_manifest.toml, pyproject.toml and CITATION.cff have the same version, and the changelog
a section for it with a date, and nothing that is unreleased. What is wrong is printed, a line each, and the exit code is 1.
With --prepare, the version and the date are written into these files and the README, and what was unreleased is their section.
"""

import argparse
import datetime
import hashlib
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

from scripts import imprint  # noqa: E402
from scripts.dev.site import build  # noqa: E402

VERSIONED = ("blender_manifest.toml", "pyproject.toml", "CITATION.cff")
"""The files with the version of the next release."""
VERSION = r'^(version(?: = |: )"?)([^"\n]+)("?)$'
"""Their line with it: what comes before the version, that, and what comes after."""


def sections(root: Path = ROOT) -> dict[str, str]:
    """The sections of the changelog by their headings, such as "0.2.0 - 2026-11-22"."""
    parts = re.split(r"^## (.+)$", (root / "CHANGELOG.md").read_text(encoding="utf-8"), flags=re.MULTILINE)
    return {heading: text.strip() for heading, text in zip(parts[1::2], parts[2::2], strict=True)}


def problems(tag: str, root: Path = ROOT) -> Iterator[str]:
    """What keeps a tag from becoming a release, in sentences."""
    version = tag.removeprefix("v")
    if not re.fullmatch(r"v\d+\.\d+\.\d+", tag):
        yield f'{tag} is no tag of a release, such as "v1.2.3".'
    for name in VERSIONED:
        found = re.search(VERSION, (root / name).read_text(encoding="utf-8"), re.MULTILINE)
        if found is None or found[2] != version:
            yield f"{name} has the version {found and found[2]}."
    date = re.search(r"^date-released: (\S+)$", (root / "CITATION.cff").read_text(encoding="utf-8"), re.MULTILINE)
    texts = sections(root)
    if not texts.get(f"{version} - {date and date[1]}"):
        yield f"CHANGELOG.md has no section of {version} with the date in CITATION.cff, which is {date and date[1]}."
    if texts.get("Unreleased"):
        yield "CHANGELOG.md has entries that are unreleased."


def prepare(tag: str, date: str, root: Path = ROOT) -> None:
    """Write the version of a tag and a date, as 2026-01-02, into the files of a checkout."""
    version = tag.removeprefix("v")
    changes = {name: [(VERSION, rf"\g<1>{version}\g<3>")] for name in VERSIONED}
    changes["CITATION.cff"].append((r"^(date-released: ).*$", rf"\g<1>{date}"))
    changes["CHANGELOG.md"] = [(r"^## Unreleased$", f"## Unreleased\n\n## {version} - {date}")]
    changes["README.md"] = [(r"imprint-\d+\.\d+\.\d+\.zip", f"imprint-{version}.zip")]
    for name, replaced in changes.items():
        text = (root / name).read_text(encoding="utf-8")
        for pattern, new in replaced:
            text = re.sub(pattern, new, text, flags=re.MULTILINE)
        (root / name).write_text(text, encoding="utf-8")


def notes(tag: str, root: Path = ROOT) -> str:
    """The changelog's section of a release. Links to files of the repository become plain words: no page is around them."""
    (text,) = (text for heading, text in sections(root).items() if heading.startswith(f"{tag.removeprefix('v')} - "))
    return re.sub(r"\[([^\]]+)\]\((?!https?:)[^)]+\)", r"\1", text) + "\n"


def packages(output: Path, root: Path = ROOT) -> list[Path]:
    """Build the wheel and the source of the Python package from a checkout, and return their paths."""
    requirements = ROOT / "scripts" / "dev" / "package_requirements.txt"
    python = build.environment(ROOT / "out" / "package-environment", requirements)
    with tempfile.TemporaryDirectory() as made:
        command = [str(python), "-m", "hatchling", "build", "--directory", made]
        done = subprocess.run(command, cwd=root, capture_output=True, text=True, check=False)
        if done.returncode:
            raise imprint.Failure(f"the package could not be built: {(done.stdout + done.stderr).strip()}")
        output.mkdir(parents=True, exist_ok=True)
        return [Path(shutil.move(path, output / path.name)) for path in sorted(Path(made).iterdir())]


def make(tag: str, output: Path) -> None:
    """Write the files of a release, and print their paths."""
    archive = imprint.build_zip(imprint.environment(), imprint.SITE_PACKAGES, ROOT, output)
    made = [archive, *packages(output)]
    for path in list(made):
        total = output / f"{path.name}.sha256"
        total.write_text(f"{hashlib.sha256(path.read_bytes()).hexdigest()}  {path.name}\n", encoding="utf-8")
        made.append(total)
    text = output / "notes.md"
    text.write_text(notes(tag), encoding="utf-8")
    print(*made, text, sep="\n")


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("tag")
    parser.add_argument("--output", type=Path, default=ROOT / "dist")
    parser.add_argument("--check", action="store_true", help="make no files")
    parser.add_argument("--prepare", metavar="DATE", type=lambda word: str(datetime.date.fromisoformat(word)))
    given = parser.parse_args()
    if given.prepare:
        prepare(given.tag, given.prepare)
        return 0
    wrong = list(problems(given.tag))
    for line in wrong:
        print(f"release: {line}", file=sys.stderr)
    if not wrong and not given.check:
        make(given.tag, given.output.resolve())
    return int(bool(wrong))


if __name__ == "__main__":
    sys.exit(main())
