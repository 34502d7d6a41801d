# SPDX-License-Identifier: GPL-3.0-or-later
"""Looks at the high meshes before a bake: what they are, and what the bake will change of them."""

from dataclasses import dataclass

import numpy as np

from ..core.errors import Length, plain_length
from ..core.parts_turned import PartTurned
from ..core.progress import Timings
from ..core.settings import Settings
from ..mesh import corner_normals
from ..mesh.inputs import Meshes
from ..mesh.triangle_mesh import Mesh
from . import orienting, planning
from .high_patches import HighPatches

MOST_FOR_NOISE = 300_000
"""Triangles of a mesh in which noise is measured: one run of them in their order."""
MANY = 4096
"""Triangles whose distance to the low mesh is measured."""


@dataclass(frozen=True)
class HighLook:
    """What high meshes are.

    Attributes:
        triangles, parts, closed: How many; parts are connected, closed ones have no open edge.
        mended: As core.report.Report has it.
        noise: By how many degrees one round of smoothing turns the normals, in the median.
        distances: Between the high meshes and the low one, in scene units: median, 99th percentile, and the diagonal of the low
            mesh.
        notes: Sentences.
        largest: As Mended has it.
    """

    triangles: int
    parts: int
    closed: int
    mended: dict[str, float]
    noise: float
    distances: tuple[float, float, float]
    notes: tuple[str, ...]
    largest: tuple[PartTurned, ...] = ()

    def lines(self, length: Length = plain_length) -> list[str]:
        """Lines for the user. length: a length in scene units as text."""
        mended = self.mended
        lines = [counts(self.triangles, self.parts, self.closed)]
        if mended.get("turned"):
            share = mended["turned"] / max(1, mended["of"])
            lines.append(
                f"{mended['parts']:,} of {mended['of_parts']:,} parts, {share:.1%} of the faces, will be turned over"
            )
            lines += [part.sentence for part in self.largest]
        else:
            lines.append("No face will be turned over")
        if self.closed < self.parts:
            lines.append("Parts that are not closed have holes or borders: texels of the low mesh over a hole miss")
        if mended.get("hidden") or mended.get("twice"):
            lines.append(
                f"{mended['hidden']:,} triangles behind the surface and {mended['twice']:,} in the place of others will be "
                "left out"
            )
        lines.append(f"One round of smoothing turns the normals by {self.noise:.2g} degrees (median)")
        median, most, diagonal = self.distances
        lines.append(
            f"Distance to the low mesh: {length(median)} (median, {median / max(diagonal, 1e-300):.1%} of its diagonal), "
            f"{length(most)} (99th percentile)"
        )
        return [*lines, *self.notes]


def counts(triangles: int, parts: int, closed: int) -> str:
    """A line with how many triangles and connected parts there are, and how many of these have no open edge."""
    return f"{triangles:,} triangles in {parts:,} connected parts, {closed:,} of them closed"


def look(meshes: Meshes, settings: Settings) -> HighLook:
    """Look at the high meshes of a bake, as they were read. Needs the GPU where it decides sides by rays."""
    patches = HighPatches(meshes)
    patches.compare(MANY)
    far = [np.linalg.norm(some.places - some.on_low, axis=1) for some in patches.samples]
    areas = np.concatenate([some.weights for some in patches.samples])
    distances = _percentiles(np.concatenate(far) * patches.space.size, areas, (0.5, 0.99))
    smooth = [corner_normals.smoothed(_some(high), 1)[1] for high in meshes.highs]
    told = planning.decided(meshes, settings.traced(smooth_high=0), Timings()).told
    return HighLook(
        triangles=sum(len(high.triangles) for high in meshes.highs),
        parts=patches.count,
        closed=sum(int(np.count_nonzero(one.is_closed)) for one in patches.of),
        mended=told.to_dict() if told is not None else {},
        noise=float(np.median(np.concatenate(smooth))),
        distances=(distances[0], distances[1], 2.0 * patches.space.size),
        notes=tuple(orienting.notes(meshes, told)),
        largest=told.largest if told is not None else (),
    )


def _some(mesh: Mesh) -> Mesh:
    """A run of the triangles of a mesh. Meshes have triangles beside each other about in their order."""
    begin = max(0, (len(mesh.triangles) - MOST_FOR_NOISE) // 2)
    return mesh.with_triangles(slice(begin, begin + MOST_FOR_NOISE))


def _percentiles(values: np.ndarray, weights: np.ndarray, shares: tuple[float, ...]) -> tuple[float, ...]:
    """The values below which these shares of the weights are."""
    order = np.argsort(values)
    sums = np.cumsum(weights[order])
    places = np.searchsorted(sums, np.array(shares) * sums[-1])
    return tuple(float(values[order[min(place, len(order) - 1)]]) for place in places)
