# SPDX-License-Identifier: GPL-3.0-or-later
"""Compares Imprint with other bakers, known normals and the limits of the machine, and writes a report.

python3 scripts/imprint.py bench [--quick] [--pairs DIR] [--peers] [--output out/bench]
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
from scripts.bench.contenders import peers  # noqa: E402
from scripts.bench.parts import (  # noqa: E402
    closed_forms,
    figures,
    growth,
    limit,
    live_updates,
    machine,
    occlusion,
    pairs,
    shaders_alone,
)
from scripts.bench.report import compare, growth_section, report, verdicts  # noqa: E402

PARTS = ("pairs", "closed_forms", "occlusion", "growth", "live", "hardware", "figures")


def parse() -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="imprint.py bench", description=__doc__.split("\n", maxsplit=1)[0])
    parser.add_argument("--quick", action="store_true", help="fewer sizes and rounds: a few minutes")
    parser.add_argument("--pairs", type=Path, metavar="DIR", help="folder of .blend files with objects 'hi' and 'lo'")
    parser.add_argument(
        "--peers", action="store_true", help="install Open3D, pymeshlab and moderngl in out/bench/peers"
    )
    parser.add_argument("--only", choices=PARTS, nargs="+", default=PARTS, metavar="PART", help=", ".join(PARTS))
    parser.add_argument("--output", type=Path, default=ROOT / "out" / "bench", metavar="DIR", help="default: out/bench")
    parser.add_argument(
        "--compare",
        type=Path,
        nargs="+",
        metavar="OLD.json",
        help="also show what became slower than in an older bench.json, and end with 1 if that is more than the spread; "
        "with a second file, compare the two and measure nothing",
    )
    options = parser.parse_args()
    if options.compare and len(options.compare) > 2:
        parser.error("--compare takes one or two files")
    if options.pairs and not options.pairs.is_dir():
        parser.error(f"{options.pairs} is not a folder")
    return options


def bench(options: argparse.Namespace, scratch: Path) -> dict:
    """Run the chosen measurements and return plain data. scratch: a temporary folder."""
    start, quick, only = time.perf_counter(), options.quick, options.only
    repeats = 3 if quick else 5

    def log(text: str) -> None:
        print(f"bench: {time.perf_counter() - start:4.0f} s  {text}", file=sys.stderr, flush=True)

    result = {"quick": quick, "repeats": repeats, "machine": machine.machine()}
    with peers.Peers(scratch) as others:
        result["peers"] = others.versions
        if "pairs" in only:
            result["pairs"] = []
            for number, (build, sizes) in enumerate(pairs.chosen(options.pairs, quick)):
                pair = build()
                log(pair.name)
                result["pairs"] += pairs.time_pair(pair, sizes, repeats, others, quick)
                if not (quick and number):
                    result["pairs"].append(pairs.time_samples(pair, 1024, repeats))
            large = next(row for row in result["pairs"] if row["is_terrain"] and row["size"] == 2048)
            result["limit"] = limit.limit(large, result["machine"]["copy_gigabytes_per_second"])
        if "closed_forms" in only:
            log("surfaces with known normals")
            result["closed_forms"] = closed_forms.closed_forms(quick, repeats, others)
    if "occlusion" in only:
        log("ambient occlusion")
        result["occlusion"] = list(occlusion.compare(options.pairs, quick))
    if "growth" in only:
        result["growth"] = growth.growth(quick, repeats, log)
        growth_section.plot(result["growth"], options.output / "growth.png")
    if "live" in only:
        log("live")
        result["live"] = live_updates.measure()
    if "hardware" in only and "moderngl" in result["peers"]:
        log("shaders alone")
        result["hardware"] = shaders_alone.hardware(options.pairs, scratch, quick)
    if "figures" in only:
        log("figures")
        result["figures"] = figures.make(options.output, scratch, quick)
    result["seconds"] = time.perf_counter() - start
    return result


def main() -> int:
    options = parse()
    try:
        compared = [compare.read(path) for path in options.compare or ()]
    except compare.NoRun as error:
        print(f"bench: {error}", file=sys.stderr)
        return 2
    if len(compared) < 2:
        result = measure(options)
        compared = compared and [*compared, result]
    if not compared:
        return 0
    comparison = compare.compare(*compared)
    print(*comparison.lines(), sep="\n")
    return int(comparison.has_slower)


def measure(options: argparse.Namespace) -> dict:
    """Run the measurements, write the report, and print the verdicts, missed targets first."""
    options.output = options.output.absolute()
    options.output.mkdir(parents=True, exist_ok=True)
    if options.peers:
        peers.install()
    with tempfile.TemporaryDirectory(prefix="scratch-", dir=options.output) as scratch:
        result = bench(options, Path(scratch))
    text = report.markdown(result)
    (options.output / "bench.json").write_text(json.dumps(result, indent=2) + "\n", encoding="utf-8")
    (options.output / "bench.md").write_text(text, encoding="utf-8")
    for verdict in verdicts.judge(result):
        print(f"{verdict.outcome}: {verdict.target}. {verdict.figures}.")
    print(options.output / "bench.md")
    return result


if __name__ == "__main__":
    try:
        code = main()
    finally:
        addon.free()
    sys.exit(code)
