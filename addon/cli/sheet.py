# SPDX-License-Identifier: GPL-3.0-or-later
"""The page of results: HTML with a row and a picture for each bake."""

import base64
import hashlib
import html
import json
import tempfile
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import IO, Any

from ..core.file_formats import PNG
from ..core.file_structure import whole_files
from ..output.atomic_file import check_writable, make_folder, replacing
from . import run_report
from .run_report import Entry, RowFile, State, Totals

COLUMNS = (
    "Number",
    "State",
    "Name",
    "Map, low with map, deviation",
    "Missed %",
    "Unsure %",
    "Overlap %",
    "Deviation p99",
    "Engines p99",
    "Seconds",
    "Maps",
    "Messages",
)
_STYLE = """
:root { color-scheme: light dark; font: 14px system-ui, sans-serif; }
body { margin: 1rem; }
input, select { font: inherit; padding: .2rem .4rem; }
table { border-collapse: collapse; margin-top: .7rem; width: 100%; }
th, td { border-bottom: 1px solid #8884; padding: .3rem .6rem; text-align: left; vertical-align: top; }
td.number { text-align: right; font-variant-numeric: tabular-nums; }
td { overflow-wrap: anywhere; }
td:nth-child(2) { white-space: nowrap; }
th button { all: unset; cursor: pointer; font-weight: bold; }
th[aria-sort=ascending] button::after { content: " \\25B2"; }
th[aria-sort=descending] button::after { content: " \\25BC"; }
tr[data-state=failed] td:nth-child(2), tr[data-state=stopped] td:nth-child(2) { color: #d33; }
tr[data-state=gate] td:nth-child(2) { color: #c70; }
td img { width: 18rem; max-width: 40vw; cursor: zoom-in; }
td img.large { width: auto; max-width: 90vw; cursor: zoom-out; }
"""
_SCRIPT = """
const body = document.querySelector("tbody"), rows = [...body.rows];
const text = document.getElementById("text"), state = document.getElementById("state");
function filter() {
  const wanted = text.value.toLowerCase();
  let count = 0;
  for (const row of rows) {
    row.hidden = (state.value && row.dataset.state !== state.value) || !row.textContent.toLowerCase().includes(wanted);
    count += !row.hidden;
  }
  document.getElementById("count").textContent = count + " of " + rows.length;
}
function value(row, column) {
  const cell = row.cells[column], given = cell.dataset.value;
  return given === undefined ? cell.textContent.toLowerCase() : given === "" ? Infinity : Number(given);
}
for (const head of document.querySelectorAll("th")) {
  head.firstChild.addEventListener("click", () => {
    const up = head.getAttribute("aria-sort") !== "ascending", column = head.cellIndex;
    for (const other of document.querySelectorAll("th")) other.removeAttribute("aria-sort");
    head.setAttribute("aria-sort", up ? "ascending" : "descending");
    rows.sort((one, other) => {
      const a = value(one, column), b = value(other, column);
      return (a < b ? -1 : a > b ? 1 : 0) * (up ? 1 : -1);
    });
    body.append(...rows);
  });
}
body.addEventListener("click", event => {
  if (event.target.tagName === "IMG") event.target.classList.toggle("large");
});
text.addEventListener("input", filter);
state.addEventListener("input", filter);
filter();
"""


def page(report: dict[str, Any], title: str, rows: Iterable[str]) -> Iterator[str]:
    """The page in parts. report: as run_report.document returns it; its bakes may be left out. rows: from `row`."""
    states = "".join(f"<option>{state}</option>" for state in State)
    summary = ", ".join(f"{count} {name}" for name, count in report["summary"].items() if name != "seconds" and count)
    about = (
        f"Imprint {report['imprint']}, Blender {report['blender']}, {report['started']} on {report['host']}; "
        f"{report['planned']} planned: {summary or 'none'}"
    )
    yield f"""<!DOCTYPE html>
<html lang="en"><head><meta charset="utf-8"><title>{html.escape(title)}</title><style>{_STYLE}</style></head>
<body><h1>{html.escape(title)}</h1><p>{html.escape(about)}</p>
<p><input id="text" type="search" placeholder="Filter" aria-label="Filter by text">
<select id="state" aria-label="Filter by state"><option value="">All states</option>{states}</select>
<span id="count"></span></p>
<table><thead><tr>"""
    yield "".join(f'<th><button type="button">{name}</button></th>' for name in COLUMNS)
    yield "</tr></thead><tbody>\n"
    yield from rows
    yield f"</tbody></table><script>{_SCRIPT}</script></body></html>\n"


def row(entry: dict[str, Any], picture: bytes) -> str:
    """The row of a bake. entry: as Entry.to_dict returns it. picture: a PNG file, or nothing."""
    reports = entry["reports"]
    metrics = [
        _worst(100.0 * each["missed"] for each in reports if "missed" in each),
        _worst(100.0 * each["checks"]["unsure"]["share"] for each in reports if "unsure" in each.get("checks", ())),
        _worst(100.0 * each["overlap"] for each in reports if "overlap" in each),
        _worst(each["deviation"]["percentile_99"] for each in reports if each.get("deviation")),
        _worst(
            angles["percentile_99"]
            for each in reports
            for target in each.get("targets", {}).values()
            for angles in (target, target.get("compressed", target))
        ),
        entry["seconds"],
    ]
    maps = [each["path"] for each in entry["files"] if each["what"] == "map"]
    warnings = [text for each in reports for text in each["warnings"]]
    messages = [entry["error"], *entry["gate"], *entry["problems"], *warnings]
    cells = [
        _number(entry["number"], "d"),
        f"<td>{html.escape(entry['state'])}</td>",
        f"<td>{html.escape(entry['name'])}</td>",
        f"<td>{_image(picture, entry['name'])}</td>",
        *(_number(metric, ".3g") for metric in metrics[:-1]),
        _number(metrics[-1], ".2f"),
        f"<td>{'<br>'.join(map(_link, maps))}</td>",
        f"<td>{'<br>'.join(map(html.escape, filter(None, messages)))}</td>",
    ]
    return f'<tr data-state="{html.escape(entry["state"])}">{"".join(cells)}</tr>\n'


def _image(picture: bytes, name: str) -> str:
    if not picture:
        return ""
    data = base64.b64encode(picture).decode()
    return f'<img src="data:image/png;base64,{data}" alt="{html.escape(name)}: map, low with map, deviation">'


def _worst(values: Iterator[float]) -> float | None:
    return max(values, default=None)


def _number(value: float | None, form: str) -> str:
    given = "" if value is None else json.dumps(value)
    return f'<td class="number" data-value="{given}">{"" if value is None else format(value, form)}</td>'


def _link(path: str) -> str:
    """A link to a map, which opens while it is where it was written. Other text than an absolute path could be a script."""
    if not Path(path).is_absolute():
        return html.escape(path)
    return f'<a href="{html.escape(Path(path).as_uri())}">{html.escape(Path(path).name)}</a>'


def picture_path(folder: str, files: Sequence[dict[str, Any]], inputs: Sequence[dict[str, Any]]) -> Path:
    """The absolute path of a bake's picture. What the bake read and wrote is in its name: another map has another picture, and
    a bake that has moved in the job file the same. files, inputs: those of its entry, with their hashes; it has files."""
    read_and_written = "".join(str(each["sha256"]) for each in (*inputs, *files))
    digest = hashlib.sha256(read_and_written.encode()).hexdigest()
    name = run_report.plain_name(Path(files[0]["path"]).stem)
    return Path(folder).absolute() / f"{name}_{digest[:12]}{PNG.endings[0]}"


def keep_picture(folder: str, entry: Entry) -> None:
    """Write the picture of a bake, or find that of a bake that was done before, and note its path in the entry.

    Raises BakeError if it cannot be written.
    """
    if not entry.files:
        return
    path = picture_path(folder, entry.files, entry.inputs)
    if entry.image:
        with replacing(path) as partial:
            partial.write_bytes(entry.image)
    elif not path.is_file():
        return
    entry.picture = str(path)


def read_picture(path: str) -> bytes:
    """A picture, or nothing if it cannot be read or is not whole."""
    try:
        return Path(path).read_bytes() if path and not whole_files.problem(path, is_image=True) else b""
    except OSError:
        return b""


class SheetFile:
    """The page at `path`."""

    def __init__(self, path: Path, head: dict[str, Any]):
        """Raises BakeError if the file cannot be written. head: from run_report.head."""
        check_writable(path)
        self.path, self._head, self._totals = path, head, Totals()
        self._rows = RowFile(str(path), self._start)

    def _start(self) -> IO[bytes]:
        make_folder(self.path.parent)
        return tempfile.TemporaryFile(dir=self.path.parent)  # noqa: SIM115 (see close)

    def close(self) -> None:
        """Forget the rows."""
        self._rows.close()

    def add(self, entry: Entry) -> None:
        """Add a row. `finish` reports a failure: the bakes go on."""
        self._totals.add(entry)
        picture = entry.image or read_picture(entry.picture)
        self._rows.add(entry.number, row(entry.to_dict(), picture).encode(errors="replace"))

    def finish(self) -> None:
        """Write the page. Raises BakeError."""
        rows = map(bytes.decode, self._rows.in_order())
        write(self.path, {**self._head, "summary": self._totals.to_dict()}, rows)
        self.close()


def write(path: Path, report: dict[str, Any], rows: Iterator[str]) -> None:
    """Write a page. report, rows: as in `page`. A byte of a file's name that is no text becomes a question mark.

    Raises BakeError.
    """
    with replacing(path) as partial, partial.open("w", encoding="utf-8", errors="replace") as file:
        file.writelines(page(report, path.stem, rows))
