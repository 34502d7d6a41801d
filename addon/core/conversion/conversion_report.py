# SPDX-License-Identifier: GPL-3.0-or-later
"""The report of a conversion: numbers and sentences."""

from collections.abc import Iterable
from dataclasses import asdict, dataclass, field, replace


@dataclass(frozen=True)
class ConversionReport:
    """The results of the conversion of a map. Shares are of all texels. Degrees have a median and a maximum."""

    source: str
    """The name of the image that was converted."""
    low: str
    size: tuple[int, int]
    before: dict[str, str]
    """What the source means, by the names in StoredNormals."""
    settings: dict
    """The settings of the new map, by the names in settings.Settings."""
    was: str
    now: str
    """The spaces of both maps, in words."""
    source_depth: int
    """Bits per channel that the values of the source need: 8 or 16, or 32 for floats."""
    source_loss: dict[str, float]
    """Degrees that the rounding of the source may have cost. Empty for floats."""
    loss: dict[str, float]
    """Degrees that the rounding of the new map cost. Empty for floats."""
    coverage: float
    margin: float
    tiles: list[int]
    uv_layer: str
    image: str
    output: list[str]
    seconds: dict[str, float]
    mip_files: dict[str, list[str]] = field(default_factory=dict)
    """As in Report."""
    memory: dict[str, int] = field(default_factory=dict)
    maps: dict[str, dict] = field(default_factory=dict)
    warnings: list[str] = field(default_factory=list)
    method: str = "CONVERT"
    export: dict = field(default_factory=dict)
    """As in Report. Nothing is exported."""

    def with_warnings(self, more: Iterable[str]) -> "ConversionReport":
        """The same report with more warnings."""
        return replace(self, warnings=[*self.warnings, *more])

    def with_memory(self, memory: dict[str, int]) -> "ConversionReport":
        """The same report with the memory that the work needs."""
        return replace(self, memory=memory)

    def with_startup(self, seconds: dict[str, float]) -> "ConversionReport":
        """The same report with the seconds before the work."""
        return replace(self, seconds={**self.seconds, **seconds})

    @property
    def picture(self) -> None:
        """As of Report: a conversion has none."""
        return

    def to_dict(self) -> dict:
        """Plain data for json.dump."""
        return asdict(self)

    def summary(self) -> list[str]:
        """The report in lines."""
        width, height = self.size
        lines = [
            f"Converted {self.source} from {self.was} to {self.now}, {width} x {height}: {self.image}",
            f"{self.coverage:.1%} of the map covered",
        ]
        if self.source_loss:
            lines.append(f"The {self.source_depth} bits of {self.source}: {_degrees(self.source_loss)}")
        if self.loss:
            lines.append(f"Stored: {_degrees(self.loss)}")
        return [*lines, f"{self.seconds['total']:.2f} s"]


def _degrees(loss: dict[str, float]) -> str:
    return f"normals off by {loss['median']:.2g} degrees (median), at most {loss['maximum']:.2g}"
