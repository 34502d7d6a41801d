# SPDX-License-Identifier: GPL-3.0-or-later
"""Writes the report from the measurements, as Markdown."""

from scripts.bench.report import growth_section, other_sections, race_sections, run_sections
from scripts.bench.report.targets import judge
from scripts.bench.report.verdicts import HOLDS, Verdict
from scripts.bench.report.writing import GAP


def markdown(result: dict) -> str:
    """The whole report."""
    lines = ["# Imprint, measured", ""]
    if result["quick"]:
        lines += ["A quick run, with fewer sizes and rounds than a full one.", ""]
    lines += verdicts(judge(result)) + machine(result)
    for part, write in (
        ("pairs", lambda rows: race_sections.paper(rows) + race_sections.contest(rows)),
        ("closed_forms", race_sections.closed_forms),
        ("occlusion", other_sections.occlusion),
        ("growth", growth_section.growth),
        ("live", other_sections.live),
        ("bakes", run_sections.bakes),
        ("storing", run_sections.storing),
        ("start", run_sections.start),
        ("batches", run_sections.batches),
        ("memory", run_sections.memory),
        ("samples", run_sections.samples),
        ("very_large", run_sections.very_large),
        ("limit", lambda found: other_sections.limit(found, result.get("hardware"))),
        ("hardware", other_sections.hardware),
        ("figures", other_sections.figures),
    ):
        if result.get(part):
            lines += write(result[part])
    return "\n".join(lines)


def verdicts(found: list[Verdict]) -> list[str]:
    held = sum(verdict.outcome == HOLDS for verdict in found)
    return [
        f"{held} of {len(found)} targets hold. A target holds if all rounds reach it. If only some rounds do, it is open.",
        "",
        *(f"- **{verdict.outcome}**: {verdict.target}. {verdict.figures}." for verdict in found),
        "",
    ]


def machine(result: dict) -> list[str]:
    about, peers = result["machine"], result["peers"]
    software = ", which draws in software, without a GPU" if about["in_software"] else ""
    others = ", ".join(f"{name} {version}" for name, version in peers.items()) or "none; --peers installs them"
    load = f"load {about['load']} at the start" if about["load"] is not None else "load unknown"
    return [
        f"{about['cores']} cores of {about['processor']}, {about['system']}, {load}; {about['renderer']} by "
        f"{about['backend']}{software}; Blender {about['blender']}. Other bakers: {others}.",
        "",
        f"Figures are medians of {result['repeats']} rounds, with the minimum and maximum of the rounds in brackets. Each "
        "baker bakes once per round; a first bake does not count. Brackets of a ratio are those of the ratios of the rounds. "
        "Times are from the objects, or from arrays for bakers outside Blender, to pixels that can be read. "
        f"{GAP} is a gap: the baker is not installed, or cannot bake the pair. The measurement took {result['seconds']:.0f} s.",
        "",
    ]
