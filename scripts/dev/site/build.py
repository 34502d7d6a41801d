#!/usr/bin/env python3
# SPDX-License-Identifier: GPL-3.0-or-later
"""Builds the manual as a site with a search, of docs/, the README, CONTRIBUTING and the changelog. A broken link is an error.

    python3 scripts/dev/site/build.py [--output out/site] [--environment out/site-environment]

MkDocs comes from requirements.txt beside this, into an environment that is made once. To write pages while a browser shows
them, run out/site-environment/bin/mkdocs serve --config-file scripts/dev/site/mkdocs.yml.
"""

import argparse
import os
import subprocess
import sys
from pathlib import Path

HERE = Path(__file__).resolve().parent
ROOT = HERE.parents[2]


def environment(folder: Path, requirements: Path = HERE / "requirements.txt") -> Path:
    """The Python of an environment, with MkDocs unless other requirements are given, which is made or updated by them."""
    python = folder / ("Scripts/python.exe" if os.name == "nt" else "bin/python")
    stamp = folder / "requirements.txt"
    if not stamp.exists() or stamp.read_bytes() != requirements.read_bytes():
        sys.path.insert(0, str(ROOT))
        from scripts.imprint import Failure, empty  # here, since a complete environment does not need it

        try:
            empty(folder)
        except Failure as error:
            sys.exit(f"build.py: {error}")
        subprocess.run([sys.executable, "-m", "venv", str(folder)], check=True)
        subprocess.run([str(python), "-m", "pip", "install", "--quiet", "-r", str(requirements)], check=True)
        stamp.write_bytes(requirements.read_bytes())
    return python


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--output", type=Path, default=ROOT / "out" / "site")
    parser.add_argument("--environment", type=Path, default=ROOT / "out" / "site-environment")
    given = parser.parse_args()
    python = environment(given.environment.resolve())
    options = ["--strict", "--config-file", str(HERE / "mkdocs.yml"), "--site-dir", str(given.output.resolve())]
    return subprocess.run([str(python), "-m", "mkdocs", "build", *options], check=False).returncode


if __name__ == "__main__":
    sys.exit(main())
