# SPDX-License-Identifier: GPL-3.0-or-later
"""Judges whether an image is a normal map of the low object, and what a conversion cannot keep."""

from collections.abc import Iterator, Sequence
from dataclasses import replace

from ...audit import checks, severity
from ...core.conversion import StoredNormals
from ...core.declarations.choices import Space
from ...core.errors import BakeError
from ...core.settings import Settings
from ...engine.converting.converted_map import Fit
from ...mesh.triangle_mesh import Mesh

LEAST_UNIT = 0.75
"""The share of a normal map's texels whose vectors have a length near 1, at least. In photos, few have."""
MOST_AWAY = 0.25
"""The share of a map's texels whose normals may point into the low mesh. In a map of another space, about half do."""
MANY_MISSED, MOST_MISSED = 0.05, 0.9
"""The shares of the covered texels with alpha 0 above which there is a warning, and above which the map is another mesh's."""


def not_on(low: str, image: str) -> str:
    """A sentence about an image on which the low mesh has no texels."""
    return f"No triangle of {low!r} lies on {image!r}: its UVs are outside the map, or empty."


def check(fit: Fit, low: str, image: str, before: StoredNormals) -> None:
    """Raise BakeError for an image that is no normal map of the low object."""
    if not fit.covered:
        raise BakeError(not_on(low, image))
    if fit.missed > fit.covered * MOST_MISSED:
        raise BakeError(
            f"{fit.missed / fit.covered:.0%} of the texels of {image!r} on {low!r} have alpha 0: it is no map of it."
        )
    if fit.unit < (fit.covered - fit.missed) * LEAST_UNIT:
        share = fit.unit / fit.covered
        raise BakeError(
            f"{image!r} is no normal map of {low!r}: only {share:.0%} of its texels on the mesh hold a unit vector."
        )
    if fit.away > fit.directed * MOST_AWAY:
        raise BakeError(
            f"{fit.away / fit.directed:.0%} of the normals in {image!r} point into {low!r} when read in "
            f"{before.from_space.lower()} space: choose another From Space, or the axes that the channels store."
        )


def missing(fit: Fit, image: str) -> Iterator[str]:
    """A sentence if the map lacks many texels of the mesh."""
    if fit.missed > fit.covered * MANY_MISSED:
        yield f"{fit.missed / fit.covered:.0%} of the texels of {image!r} on the mesh have alpha 0, and stay so."


def overlapping(low: Mesh, before: StoredNormals, settings: Settings, tiles: Sequence[int]) -> Iterator[str]:
    """A sentence if triangles of the mesh share texels of the map that mean another normal on each.

    settings, tiles: of the new map.
    """
    spaces = {before.from_space, settings.map.space}
    if Space.TANGENT not in spaces:  # the triangle does not matter
        return
    # Stacked parts share a tangent-space map. In the other spaces, each part has normals of its own.
    (space,) = spaces - {Space.TANGENT} or {Space.TANGENT}
    overlap = checks.overlap(low, settings.sampling.size, tiles)
    if severity.rate("overlap", overlap, replace(settings, space=space)) == severity.WRONG:
        yield (
            f"{overlap['share']:.2%} of the texels of {low.name!r} belong to two or more of its triangles (overlapping UVs): "
            "the new map can be right on only one of them."
        )
