# SPDX-License-Identifier: GPL-3.0-or-later
"""What the test of a GPU has found, as text for people, as JSON, and as a row of docs/platforms.md.

It names the machine, and nobody: no names of users or computers, and no paths.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Any

VERSION = 1
"""Of the JSON, which docs/gpu-report.schema.json describes."""


class Verdict(StrEnum):
    """What a test says."""

    RIGHT = "right"
    """A check that the driver passes."""
    EQUAL = "equal"
    """A map that differs by no more than answers are rounded."""
    WITHIN = "within"
    """A map that differs as drivers do."""
    WRONG = "WRONG"


@dataclass(frozen=True)
class Outcome:
    """One check of the driver, or one map.

    Attributes:
        name: Of the check, or of the pair and the map.
        note: What was measured, or what is wrong, in a sentence.
        differing: Of `texels`, those that differ from the answer.
        worst: The largest difference in `unit`, which is "degrees", or empty for plain numbers. All three are None for checks,
            and for maps that could not be drawn.
    """

    name: str
    verdict: Verdict
    note: str = ""
    differing: int | None = None
    texels: int | None = None
    worst: float | None = None
    unit: str = ""

    @property
    def text(self) -> str:
        """A line for people, without the verdict."""
        if self.texels is None:
            return f"{self.name}: {self.note}" if self.note else self.name
        of = f"{self.differing:,} of {self.texels:,} texels differ, by at most {self.worst:.3g} {self.unit}".rstrip()
        return f"{self.name}: {of if self.differing else f'all {self.texels:,} texels'}{f'; {self.note}' if self.note else ''}"

    def to_dict(self) -> dict[str, Any]:
        worst = self.worst if self.worst is not None and math.isfinite(self.worst) else None  # JSON has no infinity
        measured = {"differing": self.differing, "texels": self.texels, "worst": worst, "unit": self.unit}
        return {"name": self.name, "verdict": self.verdict.value, "note": self.note} | (
            {} if self.texels is None else measured
        )


@dataclass(frozen=True)
class Timed:
    """A stage.

    Attributes:
        value: The median, in `unit`.
        note: Of what, in a few words.
        name: Of the stage.
    """

    name: str
    value: float
    unit: str
    note: str = ""

    @property
    def text(self) -> str:
        return f"{self.name}: {self.value:,.3g} {self.unit}{f' ({self.note})' if self.note else ''}"


@dataclass
class GpuReport:
    """What was found.

    Attributes:
        machine, limits: As the system and Blender name them.
        seconds: Of all of it.
    """

    machine: dict[str, str] = field(default_factory=dict)
    limits: dict[str, int | str] = field(default_factory=dict)
    driver_checks: list[Outcome] = field(default_factory=list)
    maps: list[Outcome] = field(default_factory=list)
    times: list[Timed] = field(default_factory=list)
    seconds: float = 0.0

    @property
    def wrong(self) -> list[Outcome]:
        """What is not right."""
        return [each for each in (*self.driver_checks, *self.maps) if each.verdict is Verdict.WRONG]

    @property
    def verdict(self) -> str:
        """A sentence."""
        if self.wrong:
            return (
                f"{len(self.wrong)} of {len(self.driver_checks) + len(self.maps)} tests are wrong: bakes may be, too."
            )
        equal = sum(each.verdict is Verdict.EQUAL for each in self.maps)
        return (
            f"All right: the driver passes {len(self.driver_checks)} checks, and {len(self.maps)} maps are right, {equal} of "
            "them equal to their answers."
        )

    @property
    def text(self) -> str:
        """For people: it fits into an issue."""
        lines = [self.verdict, "", *_columns(self.machine), *_columns(self.limits)]
        lines += ["", "The driver", *_results(self.driver_checks), "", "Maps", *_results(self.maps)]
        lines += ["", "Times", *(f"  {each.text}" for each in self.times), f"  in all: {self.seconds:.1f} s"]
        return "\n".join(lines)

    def to_dict(self) -> dict[str, Any]:
        """For JSON."""
        return {
            "imprint_gpu_report": VERSION,
            "is_right": not self.wrong,
            "verdict": self.verdict,
            "machine": self.machine,
            "limits": self.limits,
            "driver_checks": [each.to_dict() for each in self.driver_checks],
            "maps": [each.to_dict() for each in self.maps],
            "times": [vars(each) for each in self.times],
            "seconds": round(self.seconds, 2),
        }

    @property
    def row(self) -> str:
        """A row of the table of reports in docs/platforms.md."""
        machine, times = self.machine, {each.name: f"{each.value:,.3g} {each.unit}" for each in self.times}
        verdict = ", ".join(each.name for each in self.wrong) or "all right"
        driver = f"{machine['renderer']}; {machine['driver']}"
        cells = machine["system"], machine["blender"], f"{machine['backend']}, {machine['reads']}", driver, verdict
        rates = (times.get(name, "") for name in ("Own hits", "Occlusion"))
        return f"| {' | '.join(_cell(cell) for cell in (*cells, *rates, f'{self.seconds:.0f} s'))} |"


def _cell(text: str) -> str:
    return text.replace("|", "/").replace("\n", " ")


def _columns(values: Mapping[str, object]) -> list[str]:
    return [f"{name.replace('_', ' '):<22} {value}" for name, value in values.items()]


def _results(tests: Sequence[Outcome]) -> list[str]:
    """What is wrong comes first."""
    ordered = sorted(tests, key=lambda each: each.verdict is not Verdict.WRONG)
    return [f"  {each.verdict.value:<6} {each.text}" for each in ordered]
