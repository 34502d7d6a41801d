# SPDX-License-Identifier: GPL-3.0-or-later
"""Casts rays at high meshes in slices."""

from collections.abc import Iterator

from ...core.progress import Pace
from ...passes import target
from ...passes.adaptive import Active
from ...passes.bake import cast
from ...passes.bake.owners import Owners


def traced(
    hits: target.Target,
    drawn: target.Target,
    tables: cast.Tables,
    owners: Owners | None,
    *,
    pace: Pace,
    some: Active | None = None,
    **options,
) -> Iterator[range]:
    """Cast the rays in `drawn` as cast.trace does, in slices. Yields the rows that are done; with `some`, rows of its list."""
    height, work = (some.rows, "some texels") if some else (drawn.height, "")
    for rows in pace.slices(height, work):
        cast.trace(hits, drawn, tables, owners, rows=rows, some=some, **options)
        hits.finish()
        yield rows
