# SPDX-License-Identifier: GPL-3.0-or-later
"""The tangent bases that programs decode maps with. To add one, add it to BASES: no other module names a basis."""

from dataclasses import dataclass
from types import MappingProxyType

AUTO = "AUTO"
"""Instead of a basis: use that of the scene's render engine."""


@dataclass(frozen=True)
class Basis:
    """One basis: the interpolated tangent, bitangent = sign * cross(normal, tangent), and the interpolated normal.

    name: in settings and job files. label, tooltip: in the interface. readers: which programs read its maps exactly, and
    which do not. normalizes_normal: whether the interpolated normal is normalized. index: in shaders/lib/map_lib.glsl.
    engines: Blender's identifiers of the render engines that use it.
    """

    name: str
    label: str
    tooltip: str
    readers: str
    normalizes_normal: bool
    index: int
    engines: tuple[str, ...] = ()


MIKKTSPACE = Basis(
    "MIKKTSPACE",
    "MikkTSpace",
    "EEVEE, Material Preview, and game engines that follow MikkTSpace",
    "MikkTSpace, as EEVEE and game engines read it; Cycles reads its own",
    normalizes_normal=False,
    index=2,
)
BASES = (
    Basis(
        "BLENDER",
        "Cycles",
        "Cycles' Normal Map node, which normalizes only the interpolated normal",
        "Cycles; EEVEE, Material Preview and game engines read MikkTSpace",
        normalizes_normal=True,
        index=3,
        engines=("CYCLES",),
    ),
    MIKKTSPACE,
)
BY_NAME = MappingProxyType({basis.name: basis for basis in BASES})


def of_name(name: str) -> Basis:
    """The basis of this name. AUTO gives MikkTSpace, for bakes without a render engine."""
    return BY_NAME.get(name, MIKKTSPACE)


def of_engine(engine: str) -> Basis:
    """The basis of a render engine, by Blender's identifier. Engines that no basis lists follow MikkTSpace."""
    return next((basis for basis in BASES if engine in basis.engines), MIKKTSPACE)
