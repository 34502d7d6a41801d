# SPDX-License-Identifier: GPL-3.0-or-later
"""Lists a job file of many sets, each with meshes of its own, and prints the seconds. Needs no Blender.

.venv/bin/python scripts/dev/long_list.py 100000
"""

import argparse
import contextlib
import io
import json
import sys
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

from addon.cli.plan import listing  # noqa: E402
from addon.cli.usage import arguments, job_file  # noqa: E402

MESH = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"


def make(folder: Path, count: int, ending: str) -> Path:
    """A job file in the folder, with the meshes of its sets."""
    sets = []
    for number in range(count):
        one = {
            "low-file": f"a{number:06}_low.obj",
            "high-file": f"a{number:06}_high.obj",
            "output": f"maps/a{number:06}.png",
        }
        for key in ("low-file", "high-file"):
            (folder / one[key]).write_text(MESH)
        one |= {"size": 512 << number % 3} | ({"maps": "ao,curvature"} if number % 5 == 0 else {})
        sets.append(one)
    path = folder / f"jobs{ending}"
    if ending == ".json":
        path.write_text(json.dumps({"bake": sets}))
    else:
        lines = ("[[bake]]\n" + "".join(f"{key} = {json.dumps(one[key])}\n" for key in one) for one in sets)
        path.write_text("\n".join(lines))
    return path


def seconds(path: Path, count: int) -> tuple[float, float]:
    """The seconds until the job file is read, and until it is listed."""
    start = time.perf_counter()
    options, more = arguments.split_jobs(["--jobs", str(path), "--list"])
    sets = job_file.read(str(path), more)
    middle = time.perf_counter()
    with contextlib.redirect_stdout(io.StringIO()) as text:
        code = listing.list_bakes(options, sets, "imprint")
    assert (code, text.getvalue().count("\n")) == (0, count)
    return middle - start, time.perf_counter() - start


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("count", type=int, nargs="?", default=100_000, help="number of sets (default: 100000)")
    count = parser.parse_args().count
    with tempfile.TemporaryDirectory(prefix="imprint-list-") as folder:
        for ending in (".json", ".toml"):
            read, listed = seconds(make(Path(folder), count, ending), count)
            print(f"{count} sets in {ending}: read in {read:.2f} s, listed and checked in {listed:.2f} s")


if __name__ == "__main__":
    main()
