# SPDX-License-Identifier: GPL-3.0-or-later
"""Counts the normal and bump maps of the high meshes' own materials into the normals at the hits."""

from collections.abc import Sequence

from ...core.progress import Task
from .family import Sample


class OwnNormals:
    """The normal and bump maps of the high meshes."""

    def apply(self, drawn: Sequence[Sample]) -> Task[None]:
        """Change the normals of these samples in place."""
        raise NotImplementedError
