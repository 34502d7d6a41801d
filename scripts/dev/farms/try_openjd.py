# SPDX-License-Identifier: GPL-3.0-or-later
"""Checks the OpenJD bundle by openjd-cli, and runs its steps on this machine. Linux and macOS.

python3 scripts/dev/farms/try_openjd.py [--sets 16] [--shards 4]

openjd-cli is installed into a temporary folder if it is missing. All maps must be there, the merged report must have all
bakes, and the page of results their pictures. A second run must find them done.
"""

import argparse
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import small_sets

TEMPLATE = small_sets.FARM / "openjd" / "template.yaml"


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n", maxsplit=1)[0])
    parser.add_argument("--sets", type=int, default=16)
    parser.add_argument("--shards", type=int, default=4)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="imprint-openjd-") as name:
        folder = Path(name).resolve()
        openjd = small_sets.program("openjd", "openjd-cli", folder / "tools")
        found = [] if subprocess.call([openjd, "check", str(TEMPLATE)]) == 0 else ["the template has mistakes"]
        batch = folder / "a batch"
        small_sets.write(batch, options.sets)
        values = {
            "Folder": batch,
            "Jobs": "jobs.json",
            "Shards": options.shards,
            "Options": f'--pictures "{batch / "pictures"}"',
            "Command": small_sets.COMMAND,
        }
        given = [word for key, value in values.items() for word in ("--job-param", f"{key}={value}")]
        before = {}
        for _ in range(2):
            since = time.monotonic()
            run = [openjd, "run", str(TEMPLATE), "--step", "Merge", "--run-dependencies", *given]
            done = subprocess.run(run, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, check=False)
            print(f"{options.shards + 2} tasks, exit code {done.returncode}, {time.monotonic() - since:.0f} s")
            if done.returncode:
                found.append(f"openjd run: exit code {done.returncode}\n{done.stdout[-3000:]}")
            found += small_sets.faults(batch, options.sets, batch / "reports" / "report.json", before)
            pictures = (batch / "reports" / "report.html").read_text(encoding="utf-8").count("data:image/")
            print(f"page of results: {pictures} pictures")
            found += [] if pictures == options.sets else [f"the page has {pictures} pictures"]
            before = small_sets.maps(batch)
    return small_sets.finish(found)


if __name__ == "__main__":
    sys.exit(main())
