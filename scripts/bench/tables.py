# SPDX-License-Identifier: GPL-3.0-or-later
"""The tables of the benchmark, from the plain data of a run: as a report, and between the comments of docs/benchmarks.md.

    .venv/bin/python scripts/bench/tables.py out/bench/bench.json

fills the page. Of several files, the last one that has a part counts. Needs no Blender.
"""

import argparse
import re
import statistics
import sys
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

from scripts.bench import comparing  # noqa: E402
from scripts.bench.comparing import CAST, CYCLES, FLATTEN, MULTIRES, OUTERMOST, PRESENT  # noqa: E402

PAGE = ROOT / "docs" / "benchmarks.md"
PLACE = re.compile(r"^(<!-- bench: ([\w-]+) -->\n).*?^(<!-- end -->)$", re.MULTILINE | re.DOTALL)
GAP = "–"
LARGEST = 3
"""The exponent of growth is that of so many of the largest points, where the constant cost of a bake hides it least."""


# Numbers


def span(values: Sequence[float], form: str = ",.0f") -> str:
    """A median with the minimum and maximum of its rounds, or a gap."""
    if not values:
        return GAP
    return f"{statistics.median(values):{form}} ({min(values):{form}} to {max(values):{form}})"


def milliseconds(timed: dict | None) -> str:
    return span([1e3 * second for second in timed["seconds"]]) if timed else GAP


def faster(row: dict, slower: str | None, name: str) -> str:
    """How many times faster one baker is than another, with the range of the ratios of the rounds."""
    theirs, ours = (row["times"].get(each, {}).get("seconds") for each in (slower, name))
    if not theirs or not ours:
        return GAP
    each = [a / b for a, b in zip(theirs, ours, strict=True)]
    return f"{statistics.median(theirs) / statistics.median(ours):.2f} ({min(each):.2f} to {max(each):.2f})"


def older(row: dict) -> str | None:
    """The name of the older version of Imprint in a row, if it was measured."""
    return next((name for name in row["times"] if name.startswith(f"{PRESENT} ")), None)


def exponent(points: list[dict], name: str) -> str:
    """The b of seconds = a * amount ** b, by least squares of the logarithms."""
    amounts = np.log([point["amount"] for point in points[-LARGEST:]])
    rounds = np.log([point["seconds"][name] for point in points[-LARGEST:]])
    return span([float(np.polyfit(amounts, column, 1)[0]) for column in rounds.T], ".2f")


def table(head: Sequence[str], rows: Sequence[Sequence]) -> list[str]:
    """A table in Markdown, as lines, or none without rows."""
    lines = (head, ["---"] * len(head), *rows)
    return [f"| {' | '.join(map(str, line))} |" for line in lines] if rows else []


def each_time(rows: list[dict]) -> Iterator[tuple[dict, str, dict]]:
    """The row, the baker's name and its times for each baker of each row."""
    return ((row, name, timed) for row in rows for name, timed in row["times"].items())


def place(row: dict) -> str:
    return f"{row['pair']}, {row['size']}"


# Tables


def machine(about: dict) -> list[str]:
    return [
        f"{about['cores']} cores of {about['processor']}, {about['renderer']}, Blender {about['blender']}; a load of "
        f"{about['load']} at the start."
    ]


def speed(pairs: list[dict]) -> list[str]:
    against = ((CYCLES, FLATTEN), (CYCLES, CAST), (CYCLES, OUTERMOST))
    head = [
        "pair, map",
        "Flatten",
        "Cast",
        "Cast, outermost hits",
        "Flatten, Cast, Cycles in ms",
    ]
    return table(
        head,
        [
            [place(row), *(faster(row, *names) for names in against)]
            + [", ".join(milliseconds(row["times"].get(name)).split(" ")[0] for name in (FLATTEN, CAST, CYCLES))]
            for row in pairs
            if row["samples"] == 1
        ],
    )


def sixteen(pairs: list[dict]) -> list[str]:
    return table(
        ["pair, map", "Flatten, ms", "Cast, ms", "Cycles, ms", "Cast is faster"],
        [
            [place(row), *(milliseconds(row["times"].get(name)) for name in (FLATTEN, CAST, CYCLES))]
            + [faster(row, CYCLES, CAST)]
            for row in pairs
            if row["samples"] > 1
        ],
    )


def multires(closed_forms: list[dict]) -> list[str]:
    return table(
        ["map", "Flatten, ms", "multires bake, ms", "Flatten is faster"],
        [
            [row["size"], milliseconds(row["times"].get(FLATTEN)), milliseconds(row["times"][MULTIRES])]
            + [faster(row, MULTIRES, FLATTEN)]
            for row in closed_forms
            if MULTIRES in row["times"]
        ],
    )


def accuracy(closed_forms: list[dict]) -> list[str]:
    keys = ("median", "percentile_99", "maximum")
    return table(
        ["surface", "triangles", "map", "baker", "ms", "median degrees", "99th percentile", "maximum"],
        [
            [row["pair"], f"{row['high']:,}", row["size"], name, milliseconds(timed)]
            + [f"{row['angles'][name][key]:.4f}" if row["angles"].get(name) else GAP for key in keys]
            for row, name, timed in each_time(closed_forms)
        ],
    )


def occlusion(rows: list[dict]) -> list[str]:
    return table(
        ["pair", "Imprint, s", "Cycles, s", "times faster", "Imprint differs", "Cycles differs"],
        [
            [row["pair"], f"{row['seconds']:.1f}", f"{row['cycles_seconds']:.1f}"]
            + [f"{row['cycles_seconds'] / row['seconds']:.1f}", f"{row['difference']:.2f}"]
            + [f"{row['cycles_difference']:.2f}"]
            for row in rows
        ],
    )


def growth(parts: dict[str, list[dict]]) -> list[str]:
    return table(
        ["by", "exponent, Flatten", "exponent, Cast", "largest, Flatten, ms", "largest, Cast, ms"],
        [
            [f"{kind}, up to {points[-1]['amount']:,}", *(exponent(points, name) for name in (FLATTEN, CAST))]
            + [milliseconds({"seconds": points[-1]["seconds"][name]}) for name in (FLATTEN, CAST)]
            for kind, points in parts.items()
        ],
    )


def live(rows: list[dict]) -> list[str]:
    return table(
        ["triangles", "vertices that move", "map", "update", "image"],
        [
            [f"{row['triangles']:,}", f"{row['touched']:.0%}", row["size"]]
            + [span(row["update_ms"], ",.1f"), span(row["image_ms"], ",.1f")]
            for row in rows
        ],
    )


def against_older(bakes: list[dict]) -> list[str]:
    return table(
        ["method", "pair", "map", "now", "older", "times faster"],
        [
            [row["what"], row["pair"], row["size"], milliseconds(row["times"][PRESENT])]
            + [milliseconds(row["times"].get(older(row))), faster(row, older(row), PRESENT)]
            for row in bakes
        ],
    )


def storing(rows: list[dict]) -> list[str]:
    return table(
        ["format", "version", "stored, ms", "whole bake, ms", "bytes", "times faster than the older version"],
        [
            [row["what"], name, milliseconds(timed), milliseconds({"seconds": row["whole"][name]})]
            + [f"{row['bytes'][name]:,}", faster(row, older(row), name) if name == PRESENT else GAP]
            for row, name, timed in each_time(rows)
        ],
    )


def start(rows: list[dict]) -> list[str]:
    runs = table(
        ["run", "version", "seconds", "times faster than the older version"],
        [
            [
                row["what"],
                name,
                span(timed["seconds"], ".2f"),
                faster(row, older(row), name) if name == PRESENT else GAP,
            ]
            for row, name, timed in each_time(rows)
        ],
    )
    stages = [
        [name, part, stage, f"{1e3 * seconds:.0f}"]
        for row, name, _ in each_time(rows)
        for part in ("startup", "bake")
        for stage, seconds in row[part].get(name, {}).items()
        if seconds
    ]
    return [*runs, "", *table(["version", "part", "stage", "ms"], stages)]


def batches(rows: list[dict]) -> list[str]:
    return table(
        ["job file", "version", "seconds", "bakes a minute", "times faster than the older version"],
        [
            [row["what"], name, span(timed["seconds"], ".2f")]
            + [f"{60 * row['sets'] / statistics.median(timed['seconds']):,.0f}" if timed["seconds"] else timed["gap"]]
            + [faster(row, older(row), name) if name == PRESENT else GAP]
            for row, name, timed in each_time(rows)
        ],
    )


def memory(rows: list[dict]) -> list[str]:
    def gigabytes(amount: float | None) -> str:
        return f"{amount / 1e9:.2f}" if amount else GAP

    return table(
        ["bake", "map", "version", "peak, GB", "before, GB", "first bake, s", "later bakes, s"],
        [
            [row["what"], row["size"], name]
            + [gigabytes(max(row["peak_bytes"].get(name) or [0])), gigabytes(row["held_bytes"].get(name))]
            + [f"{timed['first']:.1f}" if timed["first"] else timed["gap"] or GAP, span(timed["seconds"], ".2f")]
            for row, name, timed in each_time(rows)
        ],
    )


def samples(rows: list[dict]) -> list[str]:
    lines = []
    for row, name, timed in each_time(rows):
        is_adaptive = name == PRESENT and row["samples"] > 1
        angles = row.get("angles", {}) if is_adaptive else {}
        early = row["stopped_early"] if is_adaptive else None
        lines.append(
            [row["what"], row["pair"], row["size"], row["samples"], name, milliseconds(timed)]
            + [f"{early:.1%}" if early is not None else GAP]
            + [f"{angles[key]:.4f}" if angles else GAP for key in ("percentile_99", "percentile_99_9", "maximum")]
            + [f"{angles['unlike']:.4%}" if angles else GAP]
        )
    head = ["method", "pair", "map", "samples", "version", "ms", "stopped early"]
    return table([*head, "99th percentile", "99.9th percentile", "maximum", "covered by one"], lines)


TABLES: dict[str, tuple[str, Callable]] = {
    "machine": ("machine", machine),
    "speed": ("pairs", speed),
    "samples-16": ("pairs", sixteen),
    "multires": ("closed_forms", multires),
    "accuracy": ("closed_forms", accuracy),
    "occlusion": ("occlusion", occlusion),
    "growth": ("growth", growth),
    "live": ("live", live),
    "older": ("bakes", against_older),
    "storing": ("storing", storing),
    "start": ("start", start),
    "batches": ("batches", batches),
    "memory": ("memory", memory),
    "samples": ("samples", samples),
    "very-large": ("very_large", memory),
}
"""The name of each table, the part of the run that it shows, and what makes its lines."""


def lines_of(name: str, result: dict) -> list[str]:
    part, make = TABLES[name]
    return make(result[part]) if result.get(part) else []


def markdown(result: dict) -> str:
    """The report of a run: all tables of what it measured. docs/benchmarks.md says how they are measured."""
    text = "# Imprint, measured\n\nMedians, with the least and the most of the rounds in brackets.\n"
    for name in TABLES:
        lines = lines_of(name, result)
        text += "\n".join(["", f"## {name.replace('-', ' ').capitalize()}", "", *lines, ""]) if lines else ""
    return text


def fill(text: str, result: dict) -> str:
    """The page with the tables of a run. Those of parts that the run has not measured stay as they are."""

    def filled(found: re.Match) -> str:
        body = "\n".join(lines_of(found[2], result))
        return f"{found[1]}\n{body}\n\n{found[3]}" if body else found[0]

    return PLACE.sub(filled, text)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n", maxsplit=1)[0])
    parser.add_argument("results", nargs="+", type=Path, metavar="BENCH.json")
    options = parser.parse_args()
    result = {}
    for path in options.results:
        result |= comparing.read(path)
    PAGE.write_text(fill(PAGE.read_text(encoding="utf-8"), result), encoding="utf-8")


if __name__ == "__main__":
    try:
        main()
    except comparing.NoRun as error:
        sys.exit(str(error))
