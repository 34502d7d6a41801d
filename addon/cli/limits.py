# SPDX-License-Identifier: GPL-3.0-or-later
"""Limits on metrics of a bake, as in --strict "missed<0.1%, deviation.p99<2deg": reads them, and compares the report."""

import operator
import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

from ..core.declarations import targets
from ..core.errors import BakeError
from ..core.naming import did_you_mean

SHARE, DEGREES, COUNT, LENGTH, SECONDS = "%", "deg", "", "units", "s"
"""Units of metrics: shares of texels, degrees, numbers of things, lengths in scene units, and seconds."""
COMPARISONS = {
    "<=": (operator.le, "at most"),
    ">=": (operator.ge, "at least"),
    "<": (operator.lt, "less than"),
    ">": (operator.gt, "more than"),
    "=": (operator.eq, "exactly"),
}
"""The signs, what each compares, and its words."""
PERCENTILES = {"p50": "median", "p95": "percentile_95", "p99": "percentile_99", "max": "maximum"}
"""The ends of the names of metrics, and the keys of the report."""
TEXELS = {
    "uncovered": "texels without a high surface",
    "far": "texels whose high surface is farther away than the limit",
    "unsure": "texels whose hit may be on the wrong layer",
    "gaps": "texels too close to another island, or to the border",
    "backwards": "texels with a z of 0 or less",
}
"""Checks of the report whose metric is a share of texels."""
OTHERS = {
    "outside": "triangles that reach outside the tile",
    "no_area": "triangles without area in UV space",
    "behind": "triangles with shading normals that point behind them",
    "hard_edges": "hard edges without a UV seam",
    "polygons": "faces that are not triangles",
    "uneven": "faces that are not planar",
}
"""Checks of the report whose metric is a number of triangles, edges or faces."""
SEEN = "degrees between the normals that a viewer sees of the high mesh and of the low mesh with its map, from 40 sides"
"""What the shading error is."""
AT_TEXELS = "degrees between the normals that the low mesh shows with its map and those of the high mesh, at texels"
LEFT = "the detail that the map does not show: its mean deviation between texels, of that without a map"
EXPORTED = "degrees between the normals that were baked and those that a target engine shows of the exported file"
APPEARANCES = (
    ("mean", DEGREES, "mean of these degrees"),
    ("silhouette", SHARE, "pixels of outlines, from 40 sides, that only one of high and low mesh covers"),
    ("backs", SHARE, "pixels, from 40 sides, at which the low mesh shows a back face and the high mesh a front"),
    ("distance", SHARE, "distance between high and low mesh along the view, as a share of the diagonal"),
    ("wrong", SHARE, "texels that show the high mesh more than 20 degrees wrong from most sides"),
)
"""The other metrics of what a viewer sees: the ends of their names, which are the keys of the report, and what they are."""
_PART = re.compile(r"\s*([\w.-]+?)\s*(<=|>=|<|>|==|=)\s*(\d+(?:\.\d+)?|\.\d+)\s*([a-z%]*)\s*", re.IGNORECASE)


DEVIATION, APPEARANCE, EXPORT, TARGETS = "deviation", "appearance", "export", "targets"
"""What metrics need."""
COMPRESSED = "compressed"
"""What metrics of targets need that are of what their compressors leave."""


@dataclass(frozen=True)
class Metric:
    """A metric of the report of one bake.

    Attributes:
        unit: One of the constants above.
        meaning: What it is, in words.
        keys: Where it is in a report. `BASIS` stands for the basis of an export.
        needs: The setting without which it is not measured, as "targets" or "export"; empty if it always is.
        missing: Its value where the report does not have it; None if it was not measured then.
        name: As in --strict: `deviation.p99`.
    """

    name: str
    unit: str
    meaning: str
    keys: tuple[str, ...]
    needs: str = ""
    missing: float | None = None

    def of(self, report: dict[str, Any]) -> float | None:
        """Its value in a report; None if it was not measured."""
        value: Any = report
        for key in self.keys:
            value = (value or {}).get(report.get("export", {}).get("basis") if key == BASIS else key)
        value = len(value) if isinstance(value, list) else value
        return self.missing if value is None else value

    @property
    def is_of_conversions(self) -> bool:
        """Whether a conversion has it."""
        return self.name.split(".")[0] in {"coverage", "loss", "warnings", "seconds"}


BASIS = "<basis>"


def _of_angles(start: str, meaning: str, *keys: str, needs: str) -> Iterator[Metric]:
    for end, key in PERCENTILES.items():
        yield Metric(f"{start}.{end}", DEGREES, meaning, (*keys, key), needs)


def _metrics() -> Iterator[Metric]:
    yield Metric("missed", SHARE, "texels of the low mesh whose ray hit nothing", ("missed",))
    yield Metric("coverage", SHARE, "texels of the map that the mesh covers", ("coverage",))
    yield Metric("overlap", SHARE, "texels of the low mesh that several triangles cover", ("overlap",))
    yield from (Metric(name, SHARE, meaning, ("checks", name, "share")) for name, meaning in TEXELS.items())
    yield Metric("mirrored", COUNT, "triangles that are mirrored in UV space", ("mirrored",))
    yield from (Metric(name, COUNT, meaning, ("checks", name, "count")) for name, meaning in OTHERS.items())
    yield Metric("warnings", COUNT, "warnings", ("warnings",))
    yield from _of_angles("deviation", AT_TEXELS, "deviation", needs=DEVIATION)
    yield from _of_angles("between", "the same between texels", "between", needs=DEVIATION)
    yield Metric("between.left", SHARE, LEFT, ("between", "left"), DEVIATION)
    for name, where in (("deviation", "texels"), ("between", "places between texels")):
        meaning = f"{where} where the map is more than 20 degrees off the high surface that they own"
        yield Metric(f"{name}.wrong", SHARE, meaning, (name, "wrong"), DEVIATION)
    yield from _of_angles("appearance", SEEN, "appearance", needs=APPEARANCE)
    for end, unit, meaning in APPEARANCES:
        yield Metric(f"appearance.{end}", unit, meaning, ("appearance", end), APPEARANCE)
    for end in ("p50", "max"):
        meaning = "degrees by which the format of the file turned the normals"
        yield Metric(f"loss.{end}", DEGREES, meaning, ("loss", PERCENTILES[end]), missing=0.0)
    yield from _of_angles("export", EXPORTED, "export", "degrees", BASIS, needs=EXPORT)
    for target in targets.TARGETS:
        start, meaning = f"{TARGETS}.{target.name}", f"degrees by which {target.label} is off"
        yield from _of_angles(start, meaning, "targets", target.name, needs=start)
        if target.compresses:
            meaning += ", at least, once its compressor has encoded the map"
            yield from _of_angles(
                f"{start}.{COMPRESSED}", meaning, "targets", target.name, COMPRESSED, needs=f"{start}.{COMPRESSED}"
            )
    yield Metric("far.p99", LENGTH, "distance to the high surface", ("checks", "far", "percentile_99"))
    yield Metric("far.max", LENGTH, "distance to the high surface", ("checks", "far", "maximum"))
    yield Metric("seconds", SECONDS, "seconds of the bake", ("seconds", "total"))


METRICS = {metric.name: metric for metric in _metrics()}
"""All metrics by their names."""


@dataclass(frozen=True)
class Limit:
    """A limit on a metric.

    Attributes:
        limit: A share from 0 to 1, or in the metric's unit.
        name: The name of its metric.
        sign: One of COMPARISONS.
    """

    name: str
    sign: str
    limit: float

    @property
    def metric(self) -> Metric:
        return METRICS[self.name]

    def over(self, report: dict[str, Any]) -> str:
        """A sentence if the metric in the report of one bake is over the limit, else empty."""
        value = self.metric.of(report)
        if value is None:
            return f"{self.name} was not measured, and must be {self._words}."
        compare, _ = COMPARISONS[self.sign]
        return "" if compare(value, self.limit) else f"{self.name} is {self._shown(value)}, and must be {self._words}."

    @property
    def _words(self) -> str:
        return f"{COMPARISONS[self.sign][1]} {self._shown(self.limit)}"

    def _shown(self, value: float) -> str:
        unit = self.metric.unit
        if unit == SHARE:
            return f"{100.0 * value:.6g} %"
        return f"{value:.6g} {'degrees' if unit == DEGREES else unit}".strip()


def parse(text: str) -> tuple[Limit, ...]:
    """The limits in a text, separated by commas. Raises BakeError."""
    return tuple(_limit(part) for part in text.split(",") if part.strip())


def _limit(text: str) -> Limit:
    match = _PART.fullmatch(text)
    if not match:
        signs = ", ".join(COMPARISONS)
        raise BakeError(
            f"{text.strip()!r} is not a limit, such as missed<0.1%: a metric, one of {signs}, and a number."
        )
    name, sign, number, unit = match[1].lower(), match[2].replace("==", "="), float(match[3]), match[4].lower()
    if name not in METRICS:
        starts = ", ".join(dict.fromkeys(known.split(".")[0] for known in METRICS))
        hint = did_you_mean([name], METRICS) or f": choose one of {starts}."
        raise BakeError(f"{match[1]!r} is not a metric of a bake{hint}")
    own = METRICS[name].unit
    allowed = [unit for unit in ("", own) if unit not in (COUNT, LENGTH)]
    if unit and unit not in allowed:
        are = f"takes {own}, or no unit" if allowed else "takes no unit"
        raise BakeError(f"{text.strip()!r}: {name} {are}, and not {match[4]!r}.")
    limit = number / 100.0 if unit == SHARE else number
    if own == SHARE and limit > 1.0:
        hint = "which is 100 % at most" if unit else f"from 0 to 1: for percent, write {name}{match[2]}{match[3]}%"
        raise BakeError(f"{text.strip()!r}: {name} is a share of texels, {hint}.")
    return Limit(name, sign, limit)


def over(limits: Iterable[Limit], reports: Sequence[dict[str, Any]]) -> list[str]:
    """The metrics of a bake that are over their limits, in sentences. Of several reports, each names its low object."""
    exceeded = []
    for report in reports:
        start = f"{report['low']}: " if len(reports) > 1 else ""
        exceeded += [f"{start}{sentence}" for limit in limits if (sentence := limit.over(report))]
    return exceeded


def needs(limits: Iterable[Limit]) -> set[str]:
    """What the metrics need, as Metric.needs has it."""
    return {limit.metric.needs for limit in limits} - {""}
