# SPDX-License-Identifier: GPL-3.0-or-later
"""Adds constants and attributes at the hits to the sums of a map, and counts misses."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ...core.material_feeds import AttributeFeed
from .. import target
from ..program import Program
from .image_look_up import LEVELS, levels
from .material_table import MaterialTable

if TYPE_CHECKING:
    import gpu

    from .corner_tables import CornerValues

ADD_CONSTANTS = Program(
    compute="surface/add_constants_comp.glsl",
    texels=(
        ("RGBA32UI", "UINT_2D", "hits"),
        ("RGBA32F", "FLOAT_2D", "normals"),
        ("RGBA32F", "FLOAT_2D", "labels"),
        ("RGBA32F", "FLOAT_2D", "materials"),
    ),
    images=(("RGBA32F", "FLOAT_2D", "sums", "READ WRITE"),),
    constants=(("INT", "first_row"), ("INT", "is_first")),
)
ADD_ATTRIBUTE = Program(
    compute="surface/add_attribute_comp.glsl",
    texels=(
        ("RGBA32UI", "UINT_2D", "hits"),
        ("RGBA32F", "FLOAT_2D", "labels"),
        ("RGBA32F", "FLOAT_2D", "materials"),
        ("RGBA32F", "FLOAT_2D", "value_triangles"),
        ("RGBA32F", "FLOAT_2D", "values"),
    ),
    images=(("RGBA32F", "FLOAT_2D", "sums", "READ WRITE"),),
    constants=(*LEVELS, ("INT", "first_row"), ("INT", "feed")),
)


def add_constants(
    sums: target.Target,
    hits: target.Target,
    normals: gpu.types.GPUTexture,
    *,
    labels: gpu.types.GPUTexture,
    materials: MaterialTable,
    is_first: bool,
    rows: range | None = None,
) -> None:
    """Add the constants of `materials` to `sums` (RGBA32F), and count misses: once for each sample of each map.

    is_first: replace what the sums held. normals: alpha is -1 for a miss. labels: a data texture with the object and
    material number of each triangle, in the order of the hits' numbers. materials: from material_table.upload.
    """
    target.dispatch(
        ADD_CONSTANTS,
        sums.width,
        rows or range(sums.height),
        sums=sums.texture,
        hits=hits.texture,
        normals=normals,
        labels=labels,
        materials=materials.texture,
        is_first=int(is_first),
    )


def add_attribute(
    sums: target.Target,
    hits: target.Target,
    values: CornerValues,
    feed: AttributeFeed,
    number: int,
    *,
    labels: gpu.types.GPUTexture,
    materials: MaterialTable,
    rows: range | None = None,
) -> None:
    """Add `values`, from corner_tables.upload_values, to `sums` where the hit's material has this feed's `number`.

    Other arguments as in `add_constants`.
    """
    target.dispatch(
        ADD_ATTRIBUTE,
        sums.width,
        rows or range(sums.height),
        sums=sums.texture,
        hits=hits.texture,
        labels=labels,
        value_triangles=values.triangles,
        values=values.values,
        materials=materials.texture,
        feed=number,
        **levels(feed),
    )
