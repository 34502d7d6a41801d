# SPDX-License-Identifier: GPL-3.0-or-later
"""The report of a run in engines: whether it shows what it must, pages with pictures, and the manual's table."""

import html
import re

import numpy as np

from addon.core.declarations import bases
from scripts.dev.in_engines import wavy_sheet
from scripts.dev.in_engines.chromium import COLOR, SURFACE
from tests.support import angles

LIMIT = 1.0
"""Degrees at the 99th percentile that an engine may be off with the map for its own basis, away from seams."""
LABELS = {
    **{basis.name: basis.label for basis in bases.BASES},
    "no-tangents": "MikkTSpace, mesh without tangents",
    "bare": "no map",
}
"""What an engine shows, in the table's order."""
HOTTEST = 4.0
"""Degrees that the pictures show in the brightest color."""
COLORS = np.array([(12, 12, 24), (70, 20, 110), (190, 50, 80), (250, 160, 40), (255, 250, 200)], np.float64)
"""From 0 degrees to HOTTEST."""
STEP = 4
"""Pixels of a run for one of a picture, in each direction."""
PLACE = re.compile(r"^(<!-- (engines|made files) -->\n).*?^(<!-- end -->)$", re.MULTILINE | re.DOTALL)


def p99(row: dict, name: str) -> float:
    return row["degrees"][name][2]


def failures(run: dict) -> list[str]:
    """What a run shows that it must not."""
    found = wavy_sheet.failures(run["cases"])
    for row in run["rows"]:
        own, where = p99(row, row["basis"]), f"{row['sample']} in {row['label']}"
        if own > LIMIT:
            found.append(f"{where}: its own map is off by {own:.2f} degrees, and not by {LIMIT} at most")
        for basis in bases.BY_NAME:
            if basis != row["basis"] and p99(row, basis) <= own:
                found.append(f"{where}: the map for {LABELS[basis]} is as good, {p99(row, basis):.2f} degrees")
    return found


def table(run: dict) -> list[str]:
    """The 99th percentiles as lines of Markdown. The engine's own basis is bold."""
    lines = [
        "| Mesh | Engine | " + " | ".join(LABELS.values()) + " |",
        "| --- " * (2 + len(LABELS)) + "|",
    ]
    for row in run["rows"]:
        cells = [f"**{p99(row, name):.2f}**" if name == row["basis"] else f"{p99(row, name):.2f}" for name in LABELS]
        lines.append(f"| {row['sample'].split('_')[0]} | {row['label']} | {' | '.join(cells)} |")
    return lines


def table_of_cases(run: dict) -> list[str]:
    """The 99th percentiles of the normals of each made file as lines of Markdown, and what else was found."""
    rows = run["cases"]
    labels = dict.fromkeys(row["label"] for row in rows)
    lines = ["| File | " + " | ".join(labels) + " |", "| --- " * (1 + len(labels)) + "|"]
    for case in dict.fromkeys(row["case"] for row in rows):
        degrees = {row["label"]: row["normal"] for row in rows if row["case"] == case}
        lines.append(f"| {case} | " + " | ".join(f"{degrees[label]:.2f}" for label in labels) + " |")
    largest = {name: max((row.get(name, 0.0) for row in rows), default=0.0) for name in (COLOR, SURFACE)}
    loaded = sum(row["tangents"] for row in rows)
    return [
        *lines,
        "",
        f"Tangents of the map's UV layer loaded: {loaded} of {len(rows)}. Largest differences at the 99th percentile: of base "
        f"colors {largest[COLOR]:.3f}, of occlusion, roughness and metallic {largest[SURFACE]:.3f}.",
    ]


def conditions(run: dict) -> str:
    """How the figures came about, as a sentence."""
    versions = ", ".join(f"{name} {version}" for name, version in run["packages"].items())
    return (
        f"{run['chromium']} with SwiftShader; {versions}; 8-bit maps of {run['map']} x {run['map']} texels, pictures of "
        f"{run['view']} x {run['view']} pixels from before and behind."
    )


def fill(page: str, run: dict) -> str:
    """The text of the manual's page with the tables of a run between its comments. Raises LookupError without them.

    A table that the run has no rows for stays.
    """
    tables = {"engines": [*table(run), "", conditions(run)] if run["rows"] else [], "made files": []}
    if run["cases"]:
        tables["made files"] = table_of_cases(run)
    if {place[2] for place in PLACE.finditer(page)} != set(tables):
        raise LookupError("the page has no place for the tables")

    def filled(place: re.Match) -> str:
        lines = tables[place[2]]
        return "\n".join([place[1], *lines, "", place[3]]) if lines else place[0]

    return PLACE.sub(filled, page)


def heat(degrees: np.ndarray, there: np.ndarray) -> np.ndarray:
    """A picture (H, W, 3) uint8 of angles (H, W), white where nothing is there."""
    place = np.clip(degrees / HOTTEST, 0.0, 1.0) * (len(COLORS) - 1)
    steps = np.arange(len(COLORS))
    colors = np.stack([np.interp(place, steps, COLORS[:, channel]) for channel in range(3)], axis=-1)
    return np.where(there[..., None], colors, 255.0).round().astype(np.uint8)


def lit(normals: np.ndarray, eye: np.ndarray) -> np.ndarray:
    """A picture (H, W, 3) uint8 of a matte surface with normals (H, W, 3), lit from the eye's upper left."""
    light = eye[:3, :3].T @ (np.array((-0.5, 0.6, 0.8)) / np.linalg.norm((-0.5, 0.6, 0.8)))
    gray = np.where(normals.any(axis=-1), 30.0 + 220.0 * np.clip(normals @ light, 0.0, 1.0), 255.0)
    return np.repeat(gray.round().astype(np.uint8)[..., None], 3, axis=-1)


def strip(found: dict, view: int, eye: np.ndarray) -> np.ndarray:
    """What an engine shows from one eye, from left to right: object space, without a map, and how far each map is off."""
    small = {name: pixels[::STEP, ::STEP] for (name, index), pixels in found.items() if index == view}
    wanted = small["object"]
    there = wanted.any(axis=-1)
    parts = [lit(wanted, eye), lit(small["bare"], eye)]
    parts += [heat(angles.degrees(small[name], wanted), there) for name in LABELS if name != "bare"]
    return np.concatenate(parts, axis=1)


def page(run: dict, pictures: dict[tuple[str, str], list[str]]) -> str:
    """The report as HTML. pictures: by mesh and engine, the names of files beside it."""
    *cases, _, found = table_of_cases(run)
    captions = ["object space", LABELS["bare"], *(label for name, label in LABELS.items() if name != "bare")]
    parts = []
    for row in run["rows"]:
        share = row["compared"] / row["pixels"]
        parts.append(f"<h2>{html.escape(row['sample'])} in {html.escape(row['label'])}</h2>")
        parts.append(f"<p>{row['compared']:,} pixels away from seams, {share:.1%} of all. {' | '.join(captions)}</p>")
        parts += [f'<img src="{name}">' for name in pictures[row["sample"], row["engine"]]]
    decoded = "".join(
        f"<li>{html.escape(name)}: "
        + ", ".join(f"{LABELS[basis]} {value:.4f}" for basis, value in of_basis.items())
        + "</li>"
        for name, of_basis in run["decoded"].items()
    )
    wrong = "".join(f"<li>{html.escape(text)}</li>" for text in failures(run)) or "<li>none</li>"
    return f"""<!doctype html>
<meta charset="utf-8">
<title>Maps in engines</title>
<style>body {{ font: 14px sans-serif; margin: 2em }} td {{ padding: 2px 8px }} img {{ width: 100% }}</style>
<h1>Maps in engines</h1>
<p>Degrees at the 99th percentile between the normals of the engine's own shader with the map of each basis and with the
object-space map, away from seams. {html.escape(conditions(run))} Pictures: black is 0 degrees, the brightest
{HOTTEST:g} and more.</p>
{_table(table(run))}
<h2>Made files</h2>
<p>Degrees at the 99th percentile to the known normals of the high mesh.</p>
{_table(cases)}
<p>{html.escape(found)}</p>
<h2>Failures</h2><ul>{wrong}</ul>
<h2>Maps before their 8 bits, decoded in float64: degrees to the object-space map at the 99th percentile</h2><ul>{decoded}</ul>
{"".join(parts)}
"""


def _table(lines: list[str]) -> str:
    rows = [[cell.strip() for cell in line.strip("|").split("|")] for line in lines]
    return "<table>" + "".join(f"<tr>{''.join(map(_cell, row))}</tr>" for row in (rows[0], *rows[2:])) + "</table>"


def _cell(text: str) -> str:
    bold = re.sub(r"[*]{2}(.*?)[*]{2}", r"<b>\1</b>", html.escape(text))
    return f"<td>{bold}</td>"
