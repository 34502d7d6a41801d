#!/usr/bin/env python3
# SPDX-License-Identifier: GPL-3.0-or-later
"""States how long --resume takes for many bakes that are done, without Blender.

    .venv/bin/python scripts/dev/many_done.py [--count 10000]

The meshes are small files of random bytes; the maps and their records are made up.
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent.parent
sys.path.insert(0, str(ROOT))

from addon.cli.done import records  # noqa: E402
from addon.cli.done.contents import Contents  # noqa: E402
from addon.cli.plan import plans  # noqa: E402
from addon.cli.results.run_report import MAP, Entry  # noqa: E402
from addon.cli.usage import job_file  # noqa: E402

LOW, HIGH, OUTPUT = 2_000, 20_000, 5_000
"""Bytes of the files of each bake."""


def make(folder: Path, count: int) -> Path:
    """A job file whose bakes are done."""
    for name in ("in", "out"):
        (folder / name).mkdir()
    sets = []
    for number in range(count):
        low, high, output = f"in/m{number}_low.ply", f"in/m{number}_high.ply", f"out/m{number}.png"
        for path, size in ((low, LOW), (high, HIGH), (output, OUTPUT)):
            (folder / path).write_bytes(os.urandom(size))
        sets.append({"low-file": low, "high-file": high, "output": output})
    jobs = folder / "jobs.json"
    jobs.write_text(json.dumps({"bake": sets}), encoding="utf-8")
    contents = Contents()
    for plan in plans.plans_of(job_file.read(str(jobs)))[0]:
        output = plan.options.output
        entry = Entry(plan.number, plan.name, files=[{"path": output, "bytes": OUTPUT, "sha256": "", "what": MAP}])
        draft = records.Draft(records.record_path(plan.options), plan.name, records.key_of(plan.options, contents))
        records.write_record(draft, entry.to_dict(), [], [output], contents)
    return jobs


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=10_000)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        jobs = make(Path(name), options.count)
        command = [sys.executable, str(ROOT / "scripts" / "bake.py"), "--jobs", str(jobs), "--resume"]
        start = time.perf_counter()
        done = subprocess.run(command, capture_output=True, text=True, check=True)
        seconds = time.perf_counter() - start
    print(done.stdout.splitlines()[-1])
    print(f"{seconds:.1f} s for {options.count:,} bakes")
    return 0


if __name__ == "__main__":
    sys.exit(main())
