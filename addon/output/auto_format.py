# SPDX-License-Identifier: GPL-3.0-or-later
"""Chooses how a file stores a map: the smallest way that keeps a limit, by what is read back of each that was tried.

The ending of the file stays, since it says what its readers load, unless it is left open. What may change is the depth, the
format of the blocks, the quality, or the steps to which values are rounded.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from ..core import file_formats
from ..core.declarations import targets
from ..core.declarations.choices import Compression, Space, Storage
from ..core.map_types import BY_NAME, Kind, MapType, Range
from ..core.settings import MapSettings, Settings, StorageSettings
from . import map_names, value_encoding

QUALITIES = (30, 40, 50, 60, 70, 75, 80, 85, 90, 93, 95, 97, 98, 99, 100)
"""Those that are tried. Between them files differ by less than a tenth."""
ROUNDINGS = (16, 12, 10, 8, 6, 5, 4, 3, 2)
"""The steps of 255 to which values of files without losses are rounded."""
DEGREES, STEPS = "degrees", "steps"


@dataclass(frozen=True)
class Limit:
    """What 99 % of the covered texels of a map keep.

    Attributes:
        unit: DEGREES, or STEPS of 255, of the channel that is off by most.
        most: In that unit.
    """

    unit: str
    most: float


class Way(NamedTuple):
    """A way to store a map.

    Attributes:
        step: To multiples of which values are rounded, in steps of 255; 1 for all that the depth has.
    """

    storing: StorageSettings
    step: int = 1


class Trial(NamedTuple):
    """What is read of a map that was stored in one way.

    Attributes:
        texels: (height, width, 4) float32, as they were given.
        size: Bytes.
        blocks: Of level 0, if it has some.
    """

    texels: np.ndarray
    size: int
    blocks: np.ndarray | None = None


@dataclass(frozen=True)
class Chosen:
    """How one file stores its map.

    Attributes:
        mean, percentile_99: Of the error of covered texels, in the unit of the limit.
        trial: What is read of it, for as long as somebody asks.
    """

    way: Way
    limit: Limit
    mean: float
    percentile_99: float
    trial: Trial | None

    @property
    def keeps_limit(self) -> bool:
        return self.percentile_99 <= self.limit.most

    def without_trial(self) -> "Chosen":
        return replace(self, trial=None)

    def to_dict(self) -> dict[str, float | str]:
        """Plain data, for the report."""
        limit, mean, most = self.limit, self.mean, self.percentile_99
        return {
            "format": label_of(self.way),
            "unit": limit.unit,
            "limit": limit.most,
            "mean": mean,
            "percentile_99": most,
        }


def label_of(way: Way) -> str:
    """How a map is stored, in words, such as "WebP, quality 90". way: of the map."""
    steps = f", steps of {way.step}" if way.step > 1 else ""
    return _label(way.storing) + steps


def _label(storing: StorageSettings) -> str:
    if storing.storage != Storage.FILE:
        return "32-bit floats" if storing.is_float else "8 bits"
    file_format = file_formats.of(storing.output)
    if file_format.is_blocks:
        return f"{file_format.label}, {storing.compression}"
    if not file_format.has_quality:
        return f"{file_format.label}, {storing.depth} bits"
    return f"{file_format.label}, {f'quality {storing.quality}' if storing.is_lossy else 'lossless'}"


def limit_of(settings: Settings, map_type: MapType) -> Limit | None:
    """What a map keeps if its format is looked for; None for one whose format stays as it is set.

    That is one whose values have no range of 255 steps, or no mean. settings: of the map.
    """
    storing = settings.storing
    if not storing.is_auto:
        return None
    if map_type.kind is Kind.NORMAL:
        return Limit(DEGREES, storing.most_degrees)
    return Limit(STEPS, storing.most_steps) if has_steps(map_type) else None


def has_steps(map_type: MapType) -> bool:
    """Whether the values of a map go from 0 to 1, and have a mean."""
    return map_type.kind is Kind.VALUE and map_type.range is Range.UNIT and not map_type.is_unbounded


def smallest(
    texels: np.ndarray,
    is_covered: np.ndarray,
    settings: Settings,
    map_type: MapType,
    store: Callable[[Way], Trial],
    *,
    endings: Sequence[str] = (),
) -> Chosen:
    """The smallest way to store a map that keeps its limit, or else the most exact one.

    Args:
        texels: (height, width, 4) float32 as they are stored, before they are rounded or encoded.
        is_covered: (height, width) bool: the texels that count. Without any, all count.
        settings: of the map, which has a limit.
        store: tries a way.
        endings: from which that of the file is chosen; none for that of the settings.
    """
    limit = limit_of(settings, map_type)
    assert limit is not None
    where = is_covered if is_covered.any() else np.ones_like(is_covered)
    before = _shown(texels[where], settings, map_type)
    best: list[Chosen] = []
    """One at most, since each has the texels of a map."""
    tried: set[Way] = set()

    def errors(after: np.ndarray) -> np.ndarray:
        return _errors(before, _shown(after[where], settings, map_type), limit.unit)

    def keeps(way: Way) -> bool:
        trial = store(way)
        off = errors(trial.texels)
        chosen = Chosen(way, limit, float(off.mean()), float(np.percentile(off, 99.0)), trial)
        best[:] = [min(*best, chosen, key=_rank)] if best else [chosen]
        tried.add(way)
        return chosen.keeps_limit

    def keeps_rounded(way: Way) -> bool:
        rounded = value_encoding.in_steps(texels, way.step, is_normal=limit.unit == DEGREES, with_alpha=True)
        return bool(np.percentile(errors(rounded), 99.0) <= limit.most)

    for storing in [_with_ending(settings.storing, ending) for ending in endings] or [settings.storing]:
        if file_formats.of(storing.output).has_quality:
            _search([Way(replace(storing, quality=quality)) for quality in QUALITIES], keeps)
            exact = Way(replace(storing, quality=QUALITIES[-1]))
            if exact not in tried:  # flat maps are smallest without losses
                keeps(exact)
        else:
            next(filter(keeps, map(Way, _ways(storing, settings, map_type))), None)
        if roundings := _roundings(storing):
            coarsest = _search(roundings, keeps_rounded)
            first = roundings.index(coarsest) if coarsest else len(roundings)
            for way in roundings[first : first + 2]:  # of few values, coarser ones need not be smaller
                keeps(way)
    return best[0]


def _with_ending(storing: StorageSettings, ending: str) -> StorageSettings:
    path = map_names.with_ending(storing.output, ending)
    depth = min(storing.depth, file_formats.of(path).depths[-1])
    return replace(storing, output=path, depth=depth)


def _roundings(storing: StorageSettings) -> list[Way]:
    """The ways to round values to steps of 255, the coarsest first; none for formats that do not store these exactly, and
    for maps whose steps are to be hidden."""
    file_format = file_formats.of(storing.output)
    exact = replace(storing, depth=8, quality=QUALITIES[-1])
    if 8 not in file_format.depths or file_format.is_blocks or exact.is_lossy or storing.dither:
        return []
    return [Way(exact, step) for step in ROUNDINGS]


def _rank(chosen: Chosen) -> tuple[bool, float, float]:
    """What keeps its limit comes first, the smallest before others; of what does not, the most exact."""
    size = chosen.trial.size if chosen.trial else 0
    if chosen.keeps_limit:
        return False, size, chosen.percentile_99
    return True, chosen.percentile_99, size


def _search(ways: Sequence[Way], keeps: Callable[[Way], bool]) -> Way | None:
    """The first of these ways, the smallest first, that keeps the limit; None without one. They are tried in halves: those
    after one that keeps it are taken to keep it, too."""
    first, last = 0, len(ways)
    while first < last:
        middle = (first + last) // 2
        first, last = (first, middle) if keeps(ways[middle]) else (middle + 1, last)
    return ways[first] if first < len(ways) else None


def _ways(storing: StorageSettings, settings: Settings, map_type: MapType) -> list[StorageSettings]:
    """The ways to store a map without a quality that the target engines read, the smallest first."""
    file_format = file_formats.of(storing.output)
    engines = [targets.BY_NAME[name] for name in settings.map.targets]
    if not file_format.is_blocks:
        most = max((engine.depth for engine in engines), default=file_format.depths[-1])
        depths = [depth for depth in file_format.depths if depth <= most] or file_format.depths[:1]
        return [replace(storing, depth=depth) for depth in depths]
    fits = [Compression.BC7]
    if map_type.kind is Kind.NORMAL and _points_up(settings.map) and all(engine.rebuilds_z for engine in engines):
        fits.insert(0, Compression.BC5)
    elif map_type.is_gray and map_type.name in BY_NAME:
        fits.insert(0, Compression.BC4)
    return [replace(storing, compression=each) for each in fits]


def _points_up(settings: MapSettings) -> bool:
    """Whether z can be made from x and y."""
    return settings.space == Space.TANGENT and settings.blue == "+Z"


def _shown(texels: np.ndarray, settings: Settings, map_type: MapType) -> np.ndarray:
    """The channels of texels (N, 4) that the map has, as displays have them: colors in floats are linear."""
    if value_encoding.color_space(map_type, settings.storing) == value_encoding.LINEAR:
        return value_encoding.to_srgb(texels[:, :3])
    return texels[:, : 3 if map_type.name in BY_NAME else 4]


def _errors(before: np.ndarray, after: np.ndarray, unit: str) -> np.ndarray:
    """The errors (N,) of texels (N, 3 or 4)."""
    if unit == DEGREES:
        return value_encoding.angles_between(np.insert(before, 3, 1.0, axis=1), after)
    return np.abs(after - before).max(axis=1) * np.float32(255.0)
