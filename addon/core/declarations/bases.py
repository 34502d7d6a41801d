# SPDX-License-Identifier: GPL-3.0-or-later
"""The tangent bases that programs decode maps with. To add one, add it to BASES: no other module names a basis."""

from dataclasses import dataclass
from types import MappingProxyType

AUTO = "AUTO"
"""Instead of a basis: use that of the scene's render engine."""


@dataclass(frozen=True)
class Basis:
    """How a program makes the tangent, bitangent and normal of a pixel from those of a mesh's corners.

    It interpolates all of them over the triangle. The bitangent is sign * cross(normal, tangent).

    Attributes:
        name: In settings and job files.
        label, tooltip: In the interface.
        bitangent_of_vertices: Whether the bitangent is made at the vertices and interpolated, instead of made for each pixel
            from the other two.
        normalizes_tangent, normalizes_bitangent, normalizes_normal: Whether the vector is normalized per pixel; tangent and
            normal are before a bitangent is made of them.
        in_object_space: Whether the object's matrix is applied to the finished normal, and not to normal and tangent, which
            gives other normals where a scale differs by axis.
        tangents_as_normals: Whether tangents are then transformed as normals are, by the inverse transpose, and not as
            directions in the surface.
        engines: Blender's identifiers of the render engines that use it.
        former: Earlier names, which job files may still have.
    """

    name: str
    label: str
    tooltip: str
    bitangent_of_vertices: bool = False
    normalizes_tangent: bool = False
    normalizes_bitangent: bool = False
    normalizes_normal: bool = False
    in_object_space: bool = False
    tangents_as_normals: bool = False
    engines: tuple[str, ...] = ()
    former: tuple[str, ...] = ()

    @property
    def flags(self) -> int:
        """The rules as bits, for shaders/lib/basis_lib.glsl."""
        rules = (
            self.bitangent_of_vertices,
            self.normalizes_tangent,
            self.normalizes_bitangent,
            self.normalizes_normal,
        )
        return sum(rule << bit for bit, rule in enumerate(rules))

    def has_tangents_of(self, other: "Basis") -> bool:
        """Whether both take the same normals and tangents of an unevenly scaled object."""
        rules = "in_object_space", "tangents_as_normals"
        return all(getattr(self, rule) == getattr(other, rule) for rule in rules)


CYCLES = Basis(
    "CYCLES",
    "Cycles",
    "Cycles' Normal Map node, which normalizes only the interpolated normal",
    normalizes_normal=True,
    in_object_space=True,
    engines=("CYCLES",),
    former=("BLENDER",),
)
MIKKTSPACE = Basis(
    "MIKKTSPACE",
    "MikkTSpace",
    "The bitangent is made for each pixel: EEVEE, Material Preview, Unreal Engine, Unity URP and HDRP",
    tangents_as_normals=True,  # as EEVEE does; files for engines have the scale applied
)
MIKKTSPACE_VERTEX = Basis(
    "MIKKTSPACE_VERTEX",
    "MikkTSpace, Vertex",
    "The bitangent is made at the vertices and interpolated: Unity Built-in, Godot 4.4 and later, Babylon.js, CryEngine, "
    "xNormal",
    bitangent_of_vertices=True,
)
NORMALIZED = Basis(
    "NORMALIZED",
    "All Normalized",
    "The bitangent is made at the vertices, and tangent, bitangent and normal are normalized for each pixel: three.js, "
    "Khronos glTF viewer",
    bitangent_of_vertices=True,
    normalizes_tangent=True,
    normalizes_bitangent=True,
    normalizes_normal=True,
)
OF_DISPLACEMENT = Basis(
    "",
    "",
    "Cycles' Vector Displacement node in tangent space, which takes tangent, normal and bitangent in this order",
    normalizes_bitangent=True,
    normalizes_normal=True,
    in_object_space=True,
)
"""Not for normals."""
# Files of Blender hold the place of a basis in this order, after AUTO.
BASES = (CYCLES, MIKKTSPACE, MIKKTSPACE_VERTEX, NORMALIZED)
BY_NAME = MappingProxyType({basis.name: basis for basis in BASES})


def of_name(name: str) -> Basis:
    """The basis of this name. AUTO gives MikkTSpace, for bakes without a render engine."""
    return BY_NAME.get(name, MIKKTSPACE)


def of_engine(engine: str) -> Basis:
    """The basis of a render engine, by Blender's identifier. Engines that no basis lists follow MikkTSpace."""
    return next((basis for basis in BASES if engine in basis.engines), MIKKTSPACE)
