# SPDX-License-Identifier: GPL-3.0-or-later
"""Decides between Flatten and Cast."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..core.declarations.choices import Method
from ..core.settings import TracingSettings
from ..core.values import ComparedByValue
from ..mesh.inputs import Meshes
from ..mesh.local_space import local_space_of
from . import separation, tree_cache, uv_agreement

FAR_APART = 0.5
"""Share of the low mesh's radius. Meshes whose boxes have a larger gap between them belong together only if most rays hit, as
of a card before a wall."""


@dataclass(frozen=True, eq=False)
class Choice(ComparedByValue):
    """How the high surface is found from the low one.

    Attributes:
        method: FLATTEN or CAST.
        why: A clause; empty where the settings name the method.
        has_rays: Whether FLATTEN casts rays where the UV layouts do not agree.
        separation: The result of separation.sample if the choice needed it, or None.
    """

    method: str
    why: str = ""
    has_rays: bool = False
    separation: np.ndarray | None = None

    @property
    def casts_rays(self) -> bool:
        """Whether rays are cast, for all texels or for some."""
        return self.method == Method.CAST or self.has_rays


def choose_method(meshes: Meshes, tiles: Sequence[int], tracing: TracingSettings) -> Choice:
    """The method of the settings, or that which suits the meshes. meshes: in the order in which they are drawn."""
    if meshes.repeat is not None:
        return Choice(Method.CAST, "the map wraps around")
    if tracing.method != Method.AUTO:
        return Choice(tracing.method)
    if meshes.is_own_base and meshes.highs[0].uv is not None and not meshes.highs[0].instances:
        return Choice(Method.FLATTEN, "the low object is its own high object")
    if meshes.cage is not None:
        return Choice(Method.CAST, "there is a cage")
    agreement = uv_agreement.measure(meshes.low, meshes.drawn_highs, tiles)
    method = Method.FLATTEN if agreement.is_shared else Method.CAST
    has_rays = False
    if agreement.separation is not None and not agreement.is_everywhere:
        has_rays = _can_cast(meshes, agreement.separation)
    return Choice(method, agreement.why, has_rays, agreement.separation)


def _can_cast(meshes: Meshes, texels: np.ndarray) -> bool:
    """Whether rays from the low mesh find what Flatten draws of the high ones. texels: as Choice.separation has them."""
    offset = np.linalg.norm(separation.offset(texels, Method.FLATTEN)) / local_space_of([meshes.low]).size
    return bool(offset < uv_agreement.CLOSE) and tree_cache.fits(meshes.highs) and tree_cache.low_fits(meshes.whole_low)
