# SPDX-License-Identifier: GPL-3.0-or-later
"""What is known before a bake: the memory that it needs, and whether the boxes of low and high meshes fit."""

import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from .declarations.choices import MarginType, Method, Space
from .map_types import BY_NAME, Family, Kind
from .settings import Settings

PROGRAM = 560 * 10**6
"""Bytes that Blender and its graphics driver take without a scene."""
TRIANGLE, TRIANGLE_ON_GPU, TRIANGLE_IN_TREE = 250, 112, 190
"""Bytes for each triangle: of Blender's mesh and the arrays that are read from it, of the tables on the GPU, and while the tree
is built."""
LARGE, TRIANGLE_OF_LARGE = 2**24, 120
"""From so many triangles on, meshes are read array by array, and take so many bytes for each triangle, with Blender's mesh."""
FLAT_TRIANGLE_ON_GPU, FLAT_PART = 60, 250 * 10**6
"""Bytes for each triangle that Flatten uploads for a normal map alone, and for a part of a mesh that is as LARGE."""
TEXEL, TEXEL_STORED = 17, 17
"""Bytes for each texel of the normal map: read from the GPU, and while one map is stored: the file is written in parts, so that
this is little more than its texels."""
OTHER_TEXEL = 36
"""Those of each other map that are read from the GPU."""
TEXTURE_PIXEL, TEXTURE_PIXEL_ON_GPU = 25, 10
"""Bytes for each pixel of the largest image of the high meshes: one is in memory at a time."""
EXACT_POINTS, EXACT_POINT = 2**19, 1900
"""The points at a time at which Cycles evaluates materials, and bytes for each, in Blender and Cycles."""
GIGABYTE = 10**9


@dataclass(frozen=True)
class Amounts:
    """The sizes of a bake.

    Attributes:
        triangles: Of all meshes.
        texels: Of one map.
        band_texels: That are drawn at once.
        texel_bytes: Of each of these, see the function.
        other_maps: Beside the normal map.
        texture_pixels: Of the largest image that the maps show.
        is_flat: Whether Flatten draws the normal map alone, without a tree.
        is_exact: Whether Cycles evaluates materials.
    """

    triangles: int
    texels: int
    band_texels: int
    texel_bytes: int
    other_maps: int = 0
    texture_pixels: int = 0
    is_flat: bool = False
    is_exact: bool = False


@dataclass(frozen=True)
class Need:
    """Bytes that a bake needs. Building the tree, drawing maps with a texture, and storing them come one after the other, so
    that `peak` is less than the sum.
    """

    program: int
    """Blender and its modules."""
    meshes: int
    """Of the arrays of all meshes."""
    tree: int
    maps: int
    storing: int
    texture: int
    on_gpu: int
    """Those of the above that are on the GPU."""
    exact: int = 0
    """What Cycles takes that evaluates materials, beside the maps."""

    @classmethod
    def of(cls, amounts: Amounts) -> "Need":
        """The memory for these amounts."""
        maps_on_gpu = amounts.band_texels * amounts.texel_bytes
        meshes_on_gpu, texture_on_gpu = _meshes_on_gpu(amounts), amounts.texture_pixels * TEXTURE_PIXEL_ON_GPU
        return cls(
            program=PROGRAM,
            meshes=_meshes(amounts) + meshes_on_gpu,
            tree=0 if amounts.is_flat else amounts.triangles * TRIANGLE_IN_TREE,
            maps=amounts.texels * (TEXEL + amounts.other_maps * OTHER_TEXEL) + maps_on_gpu,
            storing=amounts.texels * TEXEL_STORED,
            texture=amounts.texture_pixels * TEXTURE_PIXEL + texture_on_gpu,
            on_gpu=meshes_on_gpu + maps_on_gpu + texture_on_gpu,
            exact=min(amounts.texels, EXACT_POINTS) * EXACT_POINT * amounts.is_exact,
        )

    @property
    def peak(self) -> int:
        """The most bytes at once, on the machine and on the GPU together."""
        return self.program + self.meshes + max(self.tree, self.maps + max(self.texture, self.storing, self.exact))

    def of_machine(self, *, is_software: bool) -> int:
        """The most bytes at once in the machine's memory. is_software: whether the GPU is a program on the CPU."""
        if is_software:
            return self.peak
        return max(self.program + self.meshes + self.tree, self.peak - self.on_gpu)


_FLOATS = 16
"""Bytes for each texel of a texture of four floats."""
_HIT = 2 * _FLOATS
_MARGIN = _FLOATS + 1 + 2 + 4
"""What is stored, its state, and the offset and the row of the nearest written texel."""
_ACROSS_SEAMS, _BESIDE, _SOME = 8, 5, 5
"""Depths with the border of a seam, with the texels beside the low mesh, and with those that take no more samples."""
_DEPTH = 8
"""What Blender adds to an offscreen, see passes.target."""
_PACKETS = 2


def texel_bytes(settings: Settings, method: str, *, has_detail: bool) -> int:
    """The bytes on the GPU that the targets of a bake take for each texel that is drawn at once.

    Args:
        method: FLATTEN, CAST, or AUTO for one that may draw both.
        has_detail: whether high meshes have normal or bump maps of their own, or rounded edges.
    """
    sampling, maps = settings.sampling, [BY_NAME[name] for name in settings.map.drawn_maps]
    families = {each.family for each in maps}
    is_tangent, has_sums = settings.map.space == Space.TANGENT, sampling.samples > 1
    has_hits = method != Method.FLATTEN or bool(maps) or has_detail
    per_texel = _FLOATS + _MARGIN + (_HIT - _FLOATS) * has_hits
    if method == Method.FLATTEN:
        per_texel += _DEPTH * (not has_detail) + 2 * _FLOATS * (Family.POINTS in families)
        per_texel += _FLOATS * has_sums * (1 + bool(maps))
    else:
        per_texel += 2 * _FLOATS + _PACKETS + 3 * _FLOATS * (method == Method.AUTO)
        if sampling.are_adaptive(method) and not (maps or has_detail):
            per_texel += (_FLOATS + 1) + _HIT + _FLOATS + _SOME
        else:
            per_texel += _FLOATS * has_sums * (2 if method == Method.AUTO and maps else 1)
    per_texel += _ACROSS_SEAMS * (sampling.margin_type == MarginType.ADJACENT_FACES and sampling.margin != 0)
    per_texel += (_FLOATS + _BESIDE) * is_tangent
    return per_texel + _bytes_of_maps(settings, is_tangent=is_tangent, has_sums=has_sums)


def _bytes_of_maps(settings: Settings, *, is_tangent: bool, has_sums: bool) -> int:
    """The part of `texel_bytes` that maps other than the normal map take."""
    maps = [BY_NAME[name] for name in settings.map.drawn_maps]
    families = {each.family for each in maps}
    per_texel = _FLOATS * bool(maps)
    for each in maps:
        per_texel += _FLOATS * (each.family.shows_materials or (has_sums and not each.family.casts_rays))
        per_texel += _FLOATS * (each.kind is Kind.NORMAL and is_tangent)
    per_texel += _FLOATS * sum(family.casts_rays for family in families)
    per_texel += 2 * _FLOATS * (Family.POINTS in families or (Family.SLOPES in families and not is_tangent))
    return per_texel + (2 + 1 + is_tangent) * _FLOATS * (Family.SLOPES in families)


def _meshes(amounts: Amounts) -> int:
    """The bytes of meshes outside the GPU."""
    return amounts.triangles * (TRIANGLE if amounts.triangles < LARGE else TRIANGLE_OF_LARGE)


def _meshes_on_gpu(amounts: Amounts) -> int:
    if not amounts.is_flat:
        return amounts.triangles * TRIANGLE_ON_GPU
    return FLAT_PART if amounts.triangles >= LARGE else amounts.triangles * FLAT_TRIANGLE_ON_GPU


def memory_sentence(need: Need, free: int | None, *, is_software: bool) -> str:
    """What a bake needs, and what is free. free: bytes for this process, or None where the system does not say."""
    wanted = need.of_machine(is_software=is_software)
    gpu = "" if is_software else f", and {_size(need.on_gpu)} on the GPU"
    if free is None:
        return f"The bake needs about {_size(wanted)} of memory{gpu}."
    if wanted <= free:
        return f"The bake needs about {_size(wanted)} of memory{gpu}; {_size(free)} are free."
    return f"The bake needs about {_size(wanted)} of memory, and {_size(free)} are free: {_way_out(need)}."


def _way_out(need: Need) -> str:
    """What to change so that less memory is needed: the largest part of it."""
    parts = (
        (need.program, "program"),
        (need.meshes + need.tree, "meshes"),
        (need.maps + need.storing, "maps"),
        (need.texture, "texture"),
    )
    largest = max(parts)[1]
    if largest == "program":
        return "close other programs"
    if largest == "maps":
        return "choose a smaller map, or bake fewer maps at a time"
    if largest == "texture":
        return "reduce the largest image of the high meshes to half its size"
    return "simplify the high mesh, or split both meshes and bake the parts one after the other"


def _size(count: int) -> str:
    return f"{count / GIGABYTE:.1f} GB"


UNITS = (10.0, 100.0, 1000.0, 0.3048, 0.0254)
"""Ratios between units that programs mix up: meters to deci-, centi- and millimeters, feet and inches."""
ALIKE = 0.05
"""How much the sides of a low and a high mesh may differ. A simplified mesh is a little smaller."""
FLAT_SIDE = 0.01
"""A side this much shorter than the longest one is not compared: the meshes may be flat."""
FAR_DIAGONALS = 10.0
"""A distance in diagonals at which meshes belong to different coordinate systems."""
COARSE = 1e-5
"""The steps of single precision as a share of a mesh's size, above which its details suffer."""


def placement_hint(low: np.ndarray, high: np.ndarray) -> str:
    """Why two meshes may not fit, as a sentence; empty if nothing is known. low, high: the boxes (2, 3), in one space."""
    low_sides, high_sides = low[1] - low[0], high[1] - high[0]
    diagonal = float(np.linalg.norm(high_sides))
    if not (low_sides.any() and high_sides.any() and np.isfinite([*low_sides, *high_sides]).all()):
        return ""
    for unit in (*UNITS, *(1.0 / unit for unit in UNITS)):
        if _are_alike(low_sides * unit, high_sides):
            times = unit if unit > 1.0 else 1.0 / unit
            return (
                f"The high mesh is {times:.4g} times as {'large' if unit > 1.0 else 'small'} as the low one: "
                "they seem to have different units. Export both with the same unit."
            )
    if not _are_alike(low_sides, high_sides) and _are_alike(low_sides[[0, 2, 1]], high_sides):
        return (
            "The high mesh seems to be turned by 90 degrees about X: one of the files has Z up where its format has Y up. "
            "Export both with the same axis up."
        )
    distance = float(np.linalg.norm(np.maximum(np.maximum(low[0] - high[1], high[0] - low[1]), 0.0)))
    if distance > FAR_DIAGONALS * max(diagonal, float(np.linalg.norm(low_sides))):
        centers = (_place(low.mean(axis=0)), _place(high.mean(axis=0)))
        return (
            f"The low mesh lies around {centers[0]} and the high one around {centers[1]}: "
            "they seem to be exported with different offsets."
        )
    return ""


def rounding_hint(box: np.ndarray, location: np.ndarray) -> str:
    """A sentence about coordinates that single precision has rounded; empty if the mesh is near the origin.

    box (2, 3): of the mesh, in its object's space. location (3,): of the object.
    """
    size = float(np.linalg.norm(box[1] - box[0]))
    # Whole numbers are exact: they are offsets that were chosen to be.
    inexact = location[location != np.round(location)]
    largest = max(np.abs(box).max(), np.abs(inexact).max(initial=0.0))
    if not (np.isfinite(largest) and size > 0.0):
        return ""
    step = float(np.spacing(np.float32(largest)))
    if step <= COARSE * size:
        return ""
    return (
        f"lies {largest:.3g} from its origin, where single precision rounds coordinates to {step:.2g}. "
        "Export it with an offset, or as .obj, or as .ply in double precision."
    )


def _are_alike(first: np.ndarray, second: np.ndarray) -> bool:
    """Whether two boxes have the same sides (3,), nearly."""
    longest = max(first.max(), second.max())
    matters = np.maximum(first, second) > FLAT_SIDE * longest
    return bool((np.abs(first - second) <= ALIKE * np.maximum(first, second))[matters].all())


def _place(point: Iterable[float]) -> str:
    return f"({', '.join(f'{value:.6g}' if math.isfinite(value) else '?' for value in point)})"
