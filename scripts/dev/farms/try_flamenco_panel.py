# SPDX-License-Identifier: GPL-3.0-or-later
"""Sends a job by the panel of Flamenco's own add-on in a Blender's window, and bakes it. Linux and macOS.

python3 scripts/dev/farms/try_flamenco_panel.py FOLDER [--blender "blender"] [--picture flamenco_panel.jpg]

FOLDER has the programs flamenco-manager and flamenco-worker of Flamenco 3.9, of which the manager serves its add-on, as those
do that Flamenco's makers publish. --blender is the command that starts Blender, on a virtual screen "xvfb-run -a blender". The
job that it sends must be that of `imprint.py farm`, and be baked. The picture shows the form.
"""

import argparse
import os
import re
import shlex
import subprocess
import sys
import tempfile
from contextlib import ExitStack
from pathlib import Path

import flamenco_manager
import small_sets

SETS = SHARDS = 2
PATIENCE = 120.0
"""Seconds after which the job counts as hung."""
PANEL = Path(__file__).with_name("flamenco_panel.py")


def send(blender, url, jobs, folder, picture):
    """Send a job by the panel. Returns its ID."""
    given = [url, str(jobs), str(SHARDS), small_sets.COMMAND, str(folder / "scene.blend"), str(picture)]
    environment = {**os.environ, "BLENDER_USER_RESOURCES": str(folder / "user")}
    blender = shlex.split(f"{blender} --factory-startup --window-geometry 0 0 1280 1000 --python")
    command = [*blender, str(PANEL), "--", *given]
    done = subprocess.run(
        command, env=environment, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, check=False
    )
    sent = re.search(r"^Job submitted: .* \((.+)\)$", done.stdout, re.MULTILINE)
    if not sent:
        raise SystemExit(f"the panel sent nothing:\n{done.stdout[-3000:]}")
    return sent[1]


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n", maxsplit=1)[0])
    parser.add_argument("programs", type=Path, metavar="FOLDER", help="with flamenco-manager and flamenco-worker")
    parser.add_argument("--blender", default="blender", metavar="COMMAND")
    parser.add_argument("--picture", type=Path, default=Path("flamenco_panel.jpg"))
    options = parser.parse_args()
    with ExitStack() as held:
        folder = Path(held.enter_context(tempfile.TemporaryDirectory(prefix="imprint-panel-"))).resolve()
        jobs = small_sets.write(folder / "batch", SETS)
        farm = held.enter_context(flamenco_manager.Farm(options.programs.resolve(), folder / "farm"))
        job = send(options.blender, farm.url, jobs, folder, options.picture.resolve())
        by_panel, by_command = (farm.get(f"jobs/{each}") for each in (job, farm.submit(jobs, SHARDS)))
        print(f"sent by the panel: {by_panel['name']}, {by_panel['settings']}")
        keys = ("type", "priority", "settings")
        found = [f"the panel sends another {key}" for key in keys if by_panel[key] != by_command[key]]
        farm.add_worker("first")
        status = farm.wait(job, PATIENCE)
        print(f"{status}: {len(farm.tasks(job))} tasks")
        if status != "completed":
            found.append(f"the job is {status}")
        found += small_sets.faults(jobs.parent, SETS, small_sets.reports(jobs) / "report.json", {})
    return small_sets.finish(found)


if __name__ == "__main__":
    sys.exit(main())
