# SPDX-License-Identifier: GPL-3.0-or-later
"""The tables of docs/benchmarks.md, from the figures of a run. In the page, a table stands between two comments."""

import re
from collections.abc import Callable, Sequence

from scripts.bench.contenders.names import CAST, CYCLES, FLATTEN, MULTIRES, OUTERMOST, PEERS
from scripts.bench.report import other_sections, run_sections
from scripts.bench.report.figures_of_a_run import UNLIKE
from scripts.bench.report.statistics_of_rounds import exponents
from scripts.bench.report.targets import judge
from scripts.bench.report.verdicts import GAP as NOT_MEASURED
from scripts.bench.report.verdicts import LARGEST
from scripts.bench.report.writing import milliseconds, ratio, span, table

PLACE = re.compile(r"^(<!-- bench: ([\w-]+) -->\n).*?^(<!-- end -->)$", re.MULTILINE | re.DOTALL)


def fill(text: str, result: dict) -> str:
    """The text of the page with the tables of a run. Tables of parts that the run has not measured stay as they are.

    Raises LookupError for a table that is not in TABLES.
    """

    def filled(place: re.Match) -> str:
        lines = TABLES[place[2]](result)
        body = re.sub(r"\n{3,}", "\n\n", "\n".join(lines).strip())
        return f"{place[1]}\n{body}\n\n{place[3]}" if body else place[0]

    return PLACE.sub(filled, text)


def joined(results: Sequence[dict]) -> dict:
    """The parts of several runs of one machine; of a part that several have, the last. Raises ValueError for other machines."""
    whole = {}
    for result in results:
        if whole and (unlike := [key for key in UNLIKE if result["machine"][key] != whole["machine"][key]]):
            raise ValueError(f"these runs are of different machines: {', '.join(unlike)} differ")
        load = max(run["machine"]["load"] or 0.0 for run in (whole, result) if run)
        repeats = min(run["repeats"] for run in (whole, result) if run)
        whole |= result | {"machine": result["machine"] | {"load": load}, "repeats": repeats}
    return whole


def machine(result: dict) -> list[str]:
    about = result["machine"]
    return [
        f"{about['cores']} cores of {about['processor']}, {about['renderer']}, Blender {about['blender']}; a load of "
        f"{about['load']} at the start; medians of {result['repeats']} rounds or more."
    ]


def targets(result: dict) -> list[str]:
    found = [verdict for verdict in judge(result) if verdict.outcome != NOT_MEASURED]
    return [f"- **{verdict.outcome}**: {verdict.target}. {verdict.figures}." for verdict in found]


def speed(result: dict) -> list[str]:
    rows = [row for row in result.get("pairs", []) if row["samples"] == 1]
    against = ((CYCLES, FLATTEN), (CYCLES, CAST), (CYCLES, OUTERMOST), (PEERS["open3d"], CAST))
    head = ["pair, map", "Flatten", "Cast", "Cast, outermost hits", "Cast against Open3D"]
    return _table(
        [*head, "Flatten, Cast, Cycles in ms"],
        [
            [
                f"{row['pair']}, {row['size']}",
                *(ratio(row, slower, faster) for slower, faster in against),
                ", ".join(milliseconds(row["times"].get(name)).split(" ")[0] for name in (FLATTEN, CAST, CYCLES)),
            ]
            for row in rows
        ],
    )


def other_bakers(result: dict) -> list[str]:
    rows = [row for row in result.get("pairs", []) if row["samples"] == 1]
    names = [CAST, *(name for name in PEERS.values() if any(name in row["times"] for row in rows))]
    lines = [
        [f"{row['pair']}, {row['size']}", *(milliseconds(row["times"].get(name)) for name in names)] for row in rows
    ]
    return _table(["pair, map", *names], lines) if len(names) > 1 else []


def sixteen(result: dict) -> list[str]:
    rows = [row for row in result.get("pairs", []) if row["samples"] > 1]
    return _table(
        ["pair, map", "Flatten, ms", "Cast, ms", "Cycles, ms", "Cast is faster"],
        [
            [f"{row['pair']}, {row['size']}"]
            + [milliseconds(row["times"].get(name)) for name in (FLATTEN, CAST, CYCLES)]
            + [ratio(row, CYCLES, CAST)]
            for row in rows
        ],
    )


def multires(result: dict) -> list[str]:
    rows = [row for row in result.get("closed_forms", []) if MULTIRES in row["times"]]
    return _table(
        ["map", "Flatten, ms", "multires bake, ms", "Flatten is faster"],
        [
            [row["size"], *(milliseconds(row["times"].get(name)) for name in (FLATTEN, MULTIRES))]
            + [ratio(row, MULTIRES, FLATTEN)]
            for row in rows
        ],
    )


def growth(result: dict) -> list[str]:
    """The exponents, and the figures of the largest points."""
    parts = result.get("growth", {})
    lines = []
    for kind, points in parts.items():
        largest = points[-1]
        lines.append(
            [f"{kind}, up to {largest['amount']:,}"]
            + [span(exponents(points, name, LARGEST)) for name in (FLATTEN, CAST)]
            + [milliseconds({"seconds": largest["seconds"][name]}) for name in (FLATTEN, CAST)]
        )
    return _table(["by", "exponent, Flatten", "exponent, Cast", "largest, Flatten, ms", "largest, Cast, ms"], lines)


def _table(head: list[str], lines: list[list]) -> list[str]:
    """A table, or nothing without lines."""
    return table(head, lines) if lines else []


def _of(section: Callable[[list[dict]], list[str]], part: str) -> Callable[[dict], list[str]]:
    """The tables of a section of the report, without its heading and its sentences."""

    def tables(result: dict) -> list[str]:
        lines = section(result[part]) if result.get(part) else []
        return [line for line in lines[2:] if line.startswith("|") or not line]

    return tables


TABLES: dict[str, Callable[[dict], list[str]]] = {
    "machine": machine,
    "targets": targets,
    "speed": speed,
    "other-bakers": other_bakers,
    "samples-16": sixteen,
    "multires": multires,
    "growth": growth,
    "live": _of(other_sections.live, "live"),
    "occlusion": _of(other_sections.occlusion, "occlusion"),
    "older": _of(run_sections.bakes, "bakes"),
    "storing": _of(run_sections.storing, "storing"),
    "start": _of(run_sections.start, "start"),
    "batches": _of(run_sections.batches, "batches"),
    "memory": _of(run_sections.memory, "memory"),
    "samples": _of(run_sections.samples, "samples"),
    "very-large": _of(run_sections.very_large, "very_large"),
}
"""What makes each table: lines, or none if the run did not measure it."""
