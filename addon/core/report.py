# SPDX-License-Identifier: GPL-3.0-or-later
"""The report of a bake, as numbers and as sentences."""

from collections.abc import Iterable
from dataclasses import asdict, dataclass, field, replace

from . import bases, udim
from .declarations.values import Space
from .timings import STAGES, Timings

VERSION = 1
"""Of the report's keys as JSON. It goes up when a key goes or changes its meaning, and stays when one is added."""


@dataclass(frozen=True)
class Report:
    """What is known of a bake that was done. Shares are of all texels. seconds: of each stage, and in total."""

    method: str
    space: str
    size: tuple[int, int]
    low: str
    high: list[str]
    cage: str = ""
    refs: list = field(default_factory=list)
    """A scene.object_refs.ObjectRef of the low object, of each high object and of the cage. Empty in a report from a file."""
    settings: dict = field(default_factory=dict)
    """The settings of the bake, by the names in settings.Settings."""
    uv_layer: str = ""
    why: str = ""
    """Why the bake chose this method; empty where the settings name it."""
    triangles: dict[str, int] = field(default_factory=dict)
    distances: dict[str, float] = field(default_factory=dict)
    """For rays: extrusion and max_distance in scene units, as set or as measured."""
    measured: bool = False
    """Whether one of the two was measured."""
    missed: float = 0.0
    """Share of the low mesh's texels whose ray hit nothing."""
    coverage: float = 0.0
    """Share of the texels that a mesh covers; the margin does not count."""
    margin: float = 0.0
    """Share of the texels that were filled as margin."""
    overlap: float = 0.0
    """Share of the low mesh's texels that two or more of its triangles share."""
    mirrored: int = 0
    """How many of the low mesh's triangles are mirrored in UV space."""
    checks: dict[str, dict[str, float | str]] = field(default_factory=dict)
    """What the audit found, by kind, of the low mesh. count: texels (overlap, uncovered, far, gaps, backwards), triangles
    (mirrored, outside, no_area, behind), edges (hard_edges) or faces (polygons, uneven); of, and share of it: how many were
    looked at. severity: "GOOD", "LOOK" or "WRONG". overlap has the texels that parts share which are stacked on purpose, and
    outside the triangles moved by whole tiles on purpose; mirrored has islands; gaps the texels near the border, and how many
    texels are needed between islands; far has maximum, percentile_99, limit and the offset that was not counted, in scene
    units; uneven whether the low mesh is the base of its own high one."""
    tiles: list[int] = field(default_factory=lambda: [udim.FIRST])
    """The UDIM tiles that were baked."""
    maps: dict[str, dict] = field(default_factory=dict)
    """The maps besides the normal map, by name: the image, and how its numbers are stored: value = (stored - midlevel) *
    scale + offset in scene units, or the colors of its labels."""
    loss: dict[str, float] = field(default_factory=dict)
    """Median and maximum of the degrees by which 8 or 16 bits turned the normals; empty where they are floats."""
    image: str = ""
    output: list[str] = field(default_factory=list)
    """The files that were written, whole paths: of each tile the normal map, then of each other map."""
    backend: str = ""
    renderer: str = ""
    seconds: dict[str, float] = field(default_factory=lambda: Timings().seconds)
    warnings: list[str] = field(default_factory=list)
    version: int = VERSION

    def to_dict(self) -> dict:
        """Plain data for json.dump, of use outside this session as well."""
        values = asdict(self)
        del values["refs"]
        return {"version": values.pop("version"), **values}

    def with_warnings(self, warnings: Iterable[str]) -> "Report":
        """The same report with more warnings."""
        return replace(self, warnings=[*self.warnings, *warnings])

    def summary(self) -> list[str]:
        """Lines for the user: what was baked, and how long it took."""
        width, height = self.size
        stages = ", ".join(f"{stage} {self.seconds[stage]:.2f}" for stage in STAGES if self.seconds[stage])
        how = []
        basis = self.settings.get("basis") if self.space == Space.TANGENT else ""
        if basis in bases.BY_NAME:
            how.append(f"Basis: {bases.BY_NAME[basis].readers}")
        if self.why:
            how.append(f"{self.method.capitalize()} was chosen: {self.why}")
        if self.distances:
            far = " and ".join(f"{name.replace('_', ' ')} {value:.4g}" for name, value in self.distances.items())
            how.append(f"Rays: {far}; {self.missed:.2%} missed")
        far = self.checks.get("far")
        if far and far["offset"] > far["limit"]:
            how.append(f"High and low lie {far['offset']:.4g} apart as a whole, which was not counted as a distance")
        if self.loss:
            how.append(
                f"Stored: normals off by {self.loss['median']:.2g} degrees (median), at most {self.loss['maximum']:.2g}"
            )
        return [
            f"{self.method.capitalize()}, {self.space.lower()} space, {width} x {height}: {self.image}",
            f"{self.triangles['high']:,} triangles onto {self.triangles['low']:,}, {self.coverage:.1%} of the map covered",
            *how,
            f"{self.seconds['total']:.2f} s ({stages})",
        ]
