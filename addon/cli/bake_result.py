# SPDX-License-Identifier: GPL-3.0-or-later
"""The result of a bake in the process that made it, before it becomes an entry of the report."""

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from ..core.errors import BakeError, NoGpu, sentence
from ..core.levels import ChainReport
from ..core.report import Report
from . import gates, run_report
from .gates import Gate
from .plans import Plan
from .run_report import Cause, Entry, State


@dataclass
class Result:
    """The reports of a bake, or the error that ended it."""

    name: str
    reports: list[Report] = field(default_factory=list)
    problems: list[str] = field(default_factory=list)
    """What is wrong with names, in sentences."""
    error: str = ""
    cause: Cause = Cause.NONE
    seconds: float = 0.0
    are: str = ""
    """What several reports are of, as in the report."""
    chain: ChainReport | None = None
    """The levels that lod has made."""
    is_stopped: bool = False
    """Whether a signal stopped it. Pairs and frames that were done by then are kept."""
    said: list[str] = field(default_factory=list)
    """The warnings that were printed before the bake."""
    inputs: list[dict[str, Any]] = field(default_factory=list)
    """The files that it read, as Content.facts returns them."""
    hashes: Any = None
    """For the files that were written; None if neither a report nor a record wants them."""
    scene: Path | None = None
    """The .blend that was saved."""
    strict: tuple[Gate, ...] = ()
    """The limits for its figures."""

    @property
    def maps(self) -> list[str]:
        """The maps that were written, each once, as absolute paths."""
        return list(dict.fromkeys(path for report in self.reports for path in report.output))

    @property
    def mips(self) -> list[str]:
        """The files of mip levels that were written, each once, as absolute paths."""
        names = (names for report in self.reports for names in report.mip_files.values())
        return list(dict.fromkeys(path for each in names for path in each))

    @property
    def exports(self) -> list[str]:
        """The files for engines that were written, each once, as absolute paths."""
        return list(dict.fromkeys(path for report in self.reports for path in report.export.get("files", ())))

    @property
    def warnings(self) -> list[str]:
        """Sentences."""
        return [*self.problems, *(warning for report in self.reports for warning in report.warnings)]

    @property
    def unsaid(self) -> list[str]:
        """The warnings to print after the bake."""
        return [warning for warning in self.warnings if warning not in self.said]

    @property
    def is_listed(self) -> bool:
        """Whether the report has an entry for it: not if it was stopped before anything was done."""
        return bool(self.reports) or not self.is_stopped

    def entry(self, number: int = 1) -> Entry:
        """The entry in the report. number: of the bake. Reads what was written."""
        from .records import Content

        reports = [report.to_dict() for report in self.reports]
        over = gates.over(self.strict, reports)
        state = State.STOPPED if self.is_stopped else State.FAILED if self.error else State.GATE if over else State.DONE
        files = [(run_report.MAP, path) for path in self.maps]
        files += [(run_report.MIP, path) for path in self.mips]
        files += [(run_report.EXPORT, path) for path in self.exports]
        files += [(run_report.SCENE, str(self.scene))] if self.scene is not None else []
        return Entry(
            number,
            self.name,
            state,
            "It was stopped." if self.is_stopped else self.error,
            self.cause,
            gate=over,
            seconds=self.seconds,
            inputs=self.inputs,
            files=[
                (self.hashes.of(path, what) if self.hashes else Content(path, what)).facts() for what, path in files
            ],
            are=self.are,
            reports=reports,
            chain=self.chain.to_dict() if self.chain else {},
            problems=self.problems,
        )


@dataclass(frozen=True)
class Done:
    """A bake that has ended. warnings: those to print now. is_listed: whether the report has its entry. picture: a PNG file of
    its map, its low mesh with the map, and its deviations; empty if it has none."""

    entry: Entry
    warnings: list[str] = field(default_factory=list)
    is_listed: bool = True
    picture: bytes = b""

    @classmethod
    def of(cls, result: Result, number: int, picture: bytes = b"") -> "Done":
        """From the result of a bake in this process."""
        return cls(result.entry(number), result.unsaid, result.is_listed, picture)

    @classmethod
    def resumed(cls, plan: Plan, entry: dict[str, Any]) -> "Done":
        """A bake that was done before. entry: that of the report of the run that did it, perhaps with other limits."""
        before = Entry.from_dict(entry)
        over = gates.over(plan.options.strict, before.reports)
        state = State.GATE if over else State.RESUMED
        return cls(replace(before, number=plan.number, name=plan.name, state=state, gate=over, seconds=0.0, log=""))


def failure(name: str, error: BakeError | MemoryError) -> Result:
    """The result of a bake that failed."""
    return Result(name, error=sentence(error), cause=cause(error))


def cause(error: BakeError | MemoryError) -> Cause:
    """The cause of a failure, for programs."""
    if isinstance(error, MemoryError):
        return Cause.MEMORY
    return Cause.GPU if isinstance(error, NoGpu) else Cause.INPUT
