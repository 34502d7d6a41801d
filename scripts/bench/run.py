# SPDX-License-Identifier: GPL-3.0-or-later
"""Compares Imprint with other bakers, known normals and older versions, and writes a report.

python3 scripts/imprint.py bench [--quick] [--pairs DIR] [--against [REF]] [--compare OLD.json]
"""

import argparse
import json
import sys
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

import addon  # noqa: E402
from scripts.bench import (  # noqa: E402
    comparing,
    measuring,
    tables,
    versions,  # noqa: E402
)


def parse() -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="imprint.py bench", description=__doc__.split("\n", maxsplit=1)[0])
    parser.add_argument("--quick", action="store_true", help="fewer sizes and rounds: a few minutes")
    parser.add_argument("--pairs", type=Path, metavar="DIR", help="folder of .blend files with objects 'hi' and 'lo'")
    parser.add_argument(
        "--against",
        nargs="?",
        const="",
        metavar="REF",
        help="also measure an older version of Imprint, a tag or commit of this repository; without REF the last release",
    )
    parser.add_argument(
        "--compare",
        type=Path,
        nargs="+",
        metavar="OLD.json",
        help="also show what became slower than in an older bench.json, and end with 1 if that is more than the spread; "
        "with a second file, compare the two and measure nothing",
    )
    parser.add_argument(
        "--only",
        choices=measuring.PARTS,
        nargs="+",
        default=measuring.USUAL,
        metavar="PART",
        help=f"{', '.join(measuring.PARTS)}; default: all but {', '.join(measuring.OPTIONAL)}",
    )
    parser.add_argument("--output", type=Path, default=ROOT / "out" / "bench", metavar="DIR", help="default: out/bench")
    options = parser.parse_args()
    if options.pairs and not options.pairs.is_dir():
        parser.error(f"{options.pairs} is not a folder")
    if options.compare and len(options.compare) > 2:
        parser.error("--compare takes one or two files")
    return options


def main() -> int:
    """Returns the exit code: 1 if something became slower, 2 if a file or an older version is missing."""
    options = parse()
    try:
        compared = [comparing.read(path) for path in options.compare or ()]
        if len(compared) < 2:
            compared.append(measure(options, versions.versions(options.against)))
    except (comparing.NoRun, versions.NoOlderVersion) as error:
        print(f"bench: {error}", file=sys.stderr)
        return 2
    if len(compared) < 2:
        return 0
    print(*comparing.lines(*compared), sep="\n")
    return int(any(change.is_slower for change in comparing.changes(*compared)))


def measure(options: argparse.Namespace, of: list[versions.Version]) -> dict:
    """Run the measurements, and write the report and the plain data."""
    options.output = options.output.absolute()
    options.output.mkdir(parents=True, exist_ok=True)
    start = time.perf_counter()

    def log(text: str) -> None:
        print(f"bench: {time.perf_counter() - start:4.0f} s  {text}", file=sys.stderr, flush=True)

    with tempfile.TemporaryDirectory(prefix="scratch-", dir=options.output) as scratch:
        folder = options.pairs and options.pairs.absolute()
        bench = measuring.Bench(of, folder, Path(scratch), options.quick, log)
        result = measuring.measure(bench, options.only)
    result["seconds"] = time.perf_counter() - start
    text = tables.markdown(result)
    (options.output / "bench.json").write_text(json.dumps(result, indent=2) + "\n", encoding="utf-8")
    (options.output / "bench.md").write_text(text, encoding="utf-8")
    print(options.output / "bench.md")
    return result


if __name__ == "__main__":
    try:
        code = main()
    finally:
        addon.free()
    sys.exit(code)
