#!/usr/bin/env python3
# SPDX-License-Identifier: GPL-3.0-or-later
"""Runs hundreds of bakes that crash, hang and are killed, in parts and at once, and checks what they leave. Linux.

    .venv/bin/python scripts/dev/endure.py [--trials failures,kills,shards,isolation] [--sets N] [--seed 0] [--workers 1]

failures: 300 bakes, of which three crash, two take all memory and one hangs. All others are done, those six have their causes
in the report, and memory does not grow.
kills: the same, while workers and the parent are killed at ten random moments, each followed by --resume. The files are those
of an undisturbed run, and no bake with a record is done again.
shards: 60 bakes in four parts on one folder, of which one is done twice. Files and the merged report are those of one run.
isolation: 200 bakes in a worker are at most a tenth slower than in the run's own process, in the median of five pairs each with
and without --resume, which take turns.

Ends with 1 if something is wrong. --keep DIR keeps the files.
"""

import argparse
import sys
import tempfile
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

from scripts.dev.endurance import failing_bakes, isolation, kills, shared_folder  # noqa: E402

SETS = {"failures": 300, "kills": 300, "shards": 60, "isolation": 200}
"""The bakes of each trial."""


def run(trial: str, folder: Path, count: int, seed: int, workers: int) -> tuple[list[str], list[str]]:
    """Lines with figures, and what is wrong."""
    match trial:
        case "failures":
            return failing_bakes.run(folder, count, seed, workers)
        case "kills":
            return kills.run(folder, count, seed, workers=workers)
        case "shards":
            return shared_folder.run(folder, count, seed)
    return isolation.run(folder, count, seed)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--trials", default=",".join(SETS))
    parser.add_argument("--sets", type=int)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--workers", type=int, default=1)
    parser.add_argument("--keep", type=Path)
    options = parser.parse_args()
    code = 0
    with tempfile.TemporaryDirectory() as name:
        for trial in options.trials.split(","):
            folder = (options.keep or Path(name)).absolute() / trial
            lines, wrong = run(trial, folder, options.sets or SETS[trial], options.seed, options.workers)
            print("\n".join([f"{trial}: {lines[0]}", *lines[1:], *(f"  WRONG: {each}" for each in wrong)]), flush=True)
            code = code or bool(wrong)
    return int(code)


if __name__ == "__main__":
    sys.exit(main())
