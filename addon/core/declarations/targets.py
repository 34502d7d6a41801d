# SPDX-License-Identifier: GPL-3.0-or-later
"""The target engines: programs that read normal maps, and what each needs. To add one, add it to TARGETS: no other module names
a program.
"""

from dataclasses import dataclass
from types import MappingProxyType

from ..naming import USUAL
from . import bases
from .bases import Basis

UP, DOWN = "+Y", "-Y"
"""What the green channel stores: as OpenGL has it, and as DirectX has it."""
IN_BLENDER = frozenset({"cycles", "eevee"})
"""The names of those that are Blender's own, to which nothing has to be exported."""
OF_SCENE = "Blender"
"""The preset for the render engine of the scene."""


@dataclass(frozen=True)
class TargetEngine:
    """A program that decodes tangent-space normal maps.

    name: on the command line and in job files. label: in the interface and the manual. basis: that it decodes with. green: UP
    or DOWN. rebuilds_z: whether it reads red and green alone and makes z of them, so that no normal has a z below 0. depth:
    bits per channel that it makes use of. alpha: whether its images have alpha, in which packed ones store a map. preset: the
    file below presets/imprint that is made for it. settings: what to set in it, in words. names: of images and files of normal
    maps, as its users have them.
    """

    name: str
    label: str
    basis: Basis
    preset: str
    settings: str
    green: str = UP
    rebuilds_z: bool = False
    depth: int = 8
    alpha: bool = False
    names: str = USUAL


_LINEAR = "As a normal map, linear"
_WITH_TANGENTS = "Export with *Tangents*; viewers read 8 bits"
_OF_UNITY = "Texture type *Normal map*; model: tangents *Calculate Mikktspace* or *Import*"
_OF_GODOT = "Normal map *Enabled* in the texture's import settings; the mesh exported with tangents"

TARGETS = (
    TargetEngine(
        "cycles", "Blender Cycles", bases.CYCLES, "Blender Cycles", "Imprint sets up the material", depth=16, alpha=True
    ),
    TargetEngine(
        "eevee",
        "Blender EEVEE",
        bases.MIKKTSPACE,
        "Blender EEVEE",
        "Imprint sets up the material",
        depth=16,
        alpha=True,
    ),
    TargetEngine(
        "unreal",
        "Unreal Engine",
        bases.MIKKTSPACE,
        "Unreal",
        "Compression *Normalmap*; sRGB off; mesh import: tangents *Import Normals and Tangents* or *MikkTSpace*",
        green=DOWN,
        rebuilds_z=True,
        depth=16,
        names="T_{low}_N",
    ),
    TargetEngine(
        "unity",
        "Unity URP, HDRP",
        bases.MIKKTSPACE,
        "Unity",
        _OF_UNITY,
        rebuilds_z=True,
        depth=16,
        alpha=True,
        names="{low}_Normal",
    ),
    TargetEngine(
        "unity-built-in",
        "Unity Built-in",
        bases.MIKKTSPACE_VERTEX,
        "Unity Built-in",
        _OF_UNITY,
        rebuilds_z=True,
        depth=16,
        alpha=True,
        names="{low}_Normal",
    ),
    TargetEngine(
        "godot",
        "Godot 4.4+",
        bases.MIKKTSPACE_VERTEX,
        "Godot",
        _OF_GODOT,
        rebuilds_z=True,
        depth=16,
    ),
    TargetEngine(
        "godot-old",
        "Godot 3, 4.0-4.3",
        bases.NORMALIZED,
        "Godot 4.3",
        _OF_GODOT,
        rebuilds_z=True,
        depth=16,
    ),
    TargetEngine("three", "three.js", bases.NORMALIZED, "glTF", _WITH_TANGENTS),
    TargetEngine("khronos", "Khronos glTF viewer", bases.NORMALIZED, "glTF", _WITH_TANGENTS),
    TargetEngine("babylon", "Babylon.js", bases.MIKKTSPACE_VERTEX, "Babylon.js", _WITH_TANGENTS),
    TargetEngine("bevy", "Bevy", bases.MIKKTSPACE, "Bevy and Filament", _WITH_TANGENTS),
    TargetEngine("filament", "Filament", bases.MIKKTSPACE, "Bevy and Filament", _WITH_TANGENTS),
    TargetEngine(
        "cryengine",
        "CryEngine",
        bases.MIKKTSPACE_VERTEX,
        "CryEngine",
        "Texture preset for normal maps",
        green=DOWN,
        rebuilds_z=True,
        depth=16,
        names="{low}_ddn",
    ),
    TargetEngine("xnormal", "xNormal", bases.MIKKTSPACE_VERTEX, "Substance and xNormal", _LINEAR, depth=16),
    TargetEngine(
        "substance",
        "Substance 3D",
        bases.MIKKTSPACE_VERTEX,
        "Substance and xNormal",
        "*Compute tangent space per fragment* off",
        depth=16,
    ),
    TargetEngine(
        "substance-per-fragment",
        "Substance 3D per fragment",
        bases.MIKKTSPACE,
        "Substance per fragment",
        "*Compute tangent space per fragment* on",
        depth=16,
    ),
    TargetEngine("directx", "DirectX", bases.MIKKTSPACE, "DirectX", _LINEAR, green=DOWN, depth=16),
)
BY_NAME = MappingProxyType({target.name: target for target in TARGETS})


def of_basis(basis: Basis) -> tuple[TargetEngine, ...]:
    """The programs that decode with a basis."""
    return tuple(target for target in TARGETS if target.basis == basis)


def names(basis: Basis) -> str:
    """The programs that decode with a basis, as words."""
    *first, last = (target.label for target in of_basis(basis))
    return f"{', '.join(first)} and {last}" if first else last


def presets() -> dict[str, dict[str, str | bool]]:
    """The settings of each preset, by its name and theirs. Programs that share a preset need the same."""
    of_scene = {"basis": bases.AUTO, "green": UP, "depth": "16", "alpha": True, "names": USUAL}
    of_targets = {
        target.preset: {
            "basis": target.basis.name,
            "green": target.green,
            "depth": str(target.depth),
            "alpha": target.alpha,
            "names": target.names,
        }
        for target in TARGETS
    }
    return {OF_SCENE: of_scene, **of_targets}
