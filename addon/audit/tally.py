# SPDX-License-Identifier: GPL-3.0-or-later
"""Counts the texels of a map by their state, tile by tile."""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from ..core.declarations.choices import Space
from ..core.map_types import MARGIN, MISSED, WRITTEN, Map, states_of_raw
from ..core.settings import MapSettings
from ..engine import normal_space
from ..engine.coverage import sampled

LEANING_Z = 0.5 * np.cos(np.radians(0.1))
"""Half the z of a normal that differs by 0.1 degrees from the low mesh's. Smaller differences are invisible."""
COMPARED = np.s_[::4, ::4]
"""The texels whose normals are compared with the low mesh's."""


@dataclass
class Tally:
    """The numbers of texels in all tiles of a map.

    Attributes:
        written, margin, missed: By state, of all `texels`.
        compared: Normals that were compared with the low mesh's.
        turned_away: Those that point into the low mesh.
        leaning: Those that differ from its normal.
        backwards: Texels whose z is 0 or less.
    """

    written: int = 0
    margin: int = 0
    missed: int = 0
    texels: int = 0
    compared: int = 0
    turned_away: int = 0
    leaning: int = 0
    backwards: int = 0
    states: list[np.ndarray] = field(default_factory=list)
    """For each tile, the states of the texels that `sampled` selects."""

    def add(self, stored: Map, map_settings: MapSettings) -> None:
        """Count a tile of the normal map as it is stored."""
        texels, state = stored
        self._add_state(state)
        if map_settings.space == Space.TANGENT:
            self._add_upwards(state, lambda which: normal_space.upwards(texels[which], map_settings))
            self.backwards += normal_space.backwards(texels, state, map_settings)

    def add_raw(self, normals: np.ndarray, map_settings: MapSettings) -> None:
        """Count a tile of normals as baking.Renderer.raw returns them."""
        alpha = normals[..., 3]
        state = states_of_raw(alpha)
        self._add_state(state)
        if map_settings.space == Space.TANGENT:
            self._add_upwards(state, lambda which: 0.5 * normals[which][..., 2])
            self.backwards += int(np.count_nonzero((normals[..., 2] <= 0.0) & (alpha > 0.0)))

    def _add_state(self, state: np.ndarray) -> None:
        self.written += int(np.count_nonzero(state == WRITTEN))
        self.margin += int(np.count_nonzero(state == MARGIN))
        self.missed += int(np.count_nonzero(state == MISSED))
        self.texels += state.size
        columns, rows = sampled(state.shape[::-1]).steps
        self.states.append(state[::rows, ::columns].copy())

    def _add_upwards(self, state: np.ndarray, upwards: Callable[[tuple[slice, ...]], np.ndarray]) -> None:
        """upwards: half the component along the low mesh's normals of the normals of some texels, such as COMPARED."""
        is_written = state[COMPARED] == WRITTEN
        upward = upwards(COMPARED)[is_written]
        self.compared += int(np.count_nonzero(is_written))
        self.turned_away += int(np.count_nonzero(upward < 0.0))
        self.leaning += int(np.count_nonzero(upward < LEANING_Z))
        if not self.leaning:  # a few bolts can lie between the compared texels
            self.leaning += int(np.count_nonzero(upwards(np.s_[:, :])[state == WRITTEN] < LEANING_Z))
