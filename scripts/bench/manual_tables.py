# SPDX-License-Identifier: GPL-3.0-or-later
"""Fills the tables of docs/benchmarks.md with the figures of one run, or of several with different parts. Needs no Blender.

.venv/bin/python scripts/bench/manual_tables.py out/bench/bench.json
"""

import argparse
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

from scripts.bench.report import compare, manual  # noqa: E402

PAGE = ROOT / "docs" / "benchmarks.md"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n", maxsplit=1)[0])
    parser.add_argument("results", nargs="+", type=Path, metavar="BENCH.json")
    options = parser.parse_args()
    try:
        result = manual.joined([compare.read(path) for path in options.results])
    except (compare.NoRun, ValueError) as error:
        sys.exit(str(error))
    PAGE.write_text(manual.fill(PAGE.read_text(encoding="utf-8"), result), encoding="utf-8")


if __name__ == "__main__":
    main()
