# SPDX-License-Identifier: GPL-3.0-or-later
"""Casts rays at high meshes in slices, whether their triangles are in one part or in several."""

from collections.abc import Iterator

import numpy as np

from ...core.declarations.choices import Hit
from ...core.progress import Pace
from ...passes import target
from ...passes.adaptive.active import Active
from ...passes.bake import cast
from ...passes.bake.owners import Owners
from ...passes.parts import part_hits
from .part_tables import PartTables

AnyTables = cast.Tables | PartTables


def traced(
    hits: target.Target,
    drawn: target.Target,
    tables: AnyTables,
    owners: Owners | None,
    *,
    pace: Pace,
    rule: Hit,
    some: Active | None = None,
    **options,
) -> Iterator[range]:
    """Cast the rays in `drawn` as cast.trace does, in slices. Yields the rows that are done; with `some`, rows of its list.

    With several parts, a range is empty and stops at the share of rows that is done, until all of them are.
    """
    height, work = (some.rows, "some texels") if some else (drawn.height, "")
    if isinstance(tables, cast.Tables):
        for rows in pace.slices(height, work):
            cast.trace(hits, drawn, tables, owners, rule=rule, rows=rows, some=some, **options)
            hits.finish()
            yield rows
        return
    of_part, found = target.get("hits of a part", hits.width, hits.height, "RGBA32UI"), _found(hits)
    for number, part in enumerate(tables.parts()):
        for rows in pace.slices(height, work):
            cast.trace(of_part, drawn, part.tables, owners, rule=rule, rows=rows, some=some, **options)
            part_hits.merge(
                hits,
                found,
                of_part,
                part.tables,
                first_triangle=part.first,
                is_first=number == 0,
                rule=rule,
                rows=rows,
                some=some,
            )
            hits.finish()
            done = int((number + rows.stop / height) / tables.count * height)
            yield range(done, done)
    yield range(height)


def look_up(
    into: target.Target,
    hits: target.Target,
    drawn: target.Target,
    tables: AnyTables,
    normal_matrix: np.ndarray,
    *,
    rows: range | None = None,
    some: Active | None = None,
) -> None:
    """As cast.look_up. With several parts, `hits` are those that `traced` has found last."""
    if isinstance(tables, cast.Tables):
        cast.look_up(into, hits, drawn, tables, normal_matrix, rows=rows, some=some)
    else:
        part_hits.look_up(into, hits, drawn, _found(hits), normal_matrix, rows=rows, some=some)


def _found(hits: target.Target) -> target.Target:
    """Where the normals at hits on several parts are."""
    return target.get("normals of parts", hits.width, hits.height, "RGBA32F")
