# SPDX-License-Identifier: GPL-3.0-or-later
"""The target engines: programs that read normal maps, and what each needs. To add one, add it to TARGETS: no other module names
a program. CHOICES has what the setting Engine offers, where programs that need the same are one.
"""

from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

from ..naming import NAME, USUAL
from . import bases
from .bases import Basis
from .choices import Pack

UP, DOWN = "+Y", "-Y"
"""What the green channel stores: as OpenGL has it, and as DirectX has it."""
IN_BLENDER = frozenset({"cycles", "eevee"})
"""The names of those that are Blender's own, to which nothing has to be exported."""
OF_SCENE = "Blender"
"""The choice for the render engine of the scene."""


@dataclass(frozen=True)
class TargetEngine:
    """A program that decodes tangent-space normal maps.

    Attributes:
        name: On the command line and in job files.
        label: In the interface and the manual.
        basis: That it decodes with.
        green: UP or DOWN.
        rebuilds_z: Whether it reads red and green alone and makes z of them, so that no normal has a z below 0.
        depth: Bits per channel that it makes use of.
        has_webp: Whether it loads WebP images.
        alpha: Whether its images have alpha, in which packed ones store a map.
        preset: Its name among CHOICES.
        settings: What to set in it, in words.
        names: Of images and files of normal maps, as its users have them.
        pack: The layout of its packed images.
        export: The ending of the files with meshes that it reads best; empty for Blender.
        compresses: The format of blocks (blocks.formats.BY_NAME) in which it stores normal maps that it imports, by its usual
            settings on desktops. Unity's DXT5nm stores red as BC5 does, and green coarser. Empty if it leaves them as they are.
        compresses_others: The same of other maps, by its settings for high quality. By its usual ones it takes BC1 and BC3,
            which lose more.
    """

    name: str
    label: str
    basis: Basis
    preset: str
    settings: str
    green: str = UP
    rebuilds_z: bool = False
    depth: int = 8
    has_webp: bool = False
    alpha: bool = False
    names: str = f"{NAME}_normal"
    pack: str = Pack.NONE
    export: str = ".fbx"
    compresses: str = ""
    compresses_others: str = ""


_LINEAR = "As a normal map, linear"
_WITH_TANGENTS = "Export with *Tangents*; viewers read 8 bits"
_OF_WEB: dict[str, Any] = {"has_webp": True, "pack": Pack.GLTF, "export": ".glb"}
_PAINTER = f"{NAME}_normal_base"
"""Names by which Substance 3D Painter finds its mesh maps: those of other maps follow, see MapType.painter_suffix."""
_OF_UNITY = "Texture type *Normal map*; model: tangents *Calculate Mikktspace* or *Import*"
_BC5, _BC7 = "bc5", "bc7"
_UNMEASURED = ", and not measured"
_OF_GODOT = "Normal map *Enabled* in the texture's import settings; the mesh exported with tangents"

# Files keep the number of a program: a new one goes to the end.
TARGETS = (
    TargetEngine(
        "cycles",
        "Blender Cycles",
        bases.CYCLES,
        "Blender Cycles",
        "Imprint sets up the material",
        depth=16,
        has_webp=True,
        alpha=True,
        names=USUAL,
        export="",
    ),
    TargetEngine(
        "eevee",
        "Blender EEVEE",
        bases.MIKKTSPACE,
        "Blender EEVEE",
        "Imprint sets up the material",
        depth=16,
        has_webp=True,
        alpha=True,
        names=USUAL,
        export="",
    ),
    TargetEngine(
        "unreal",
        "Unreal Engine",
        bases.MIKKTSPACE,
        "Unreal Engine",
        "Compression *Normalmap*; sRGB off; mesh import: tangents *Import Normals and Tangents* or *MikkTSpace*",
        green=DOWN,
        rebuilds_z=True,
        depth=16,
        names="T_{name}_N",
        pack=Pack.UNREAL,
        compresses=_BC5,
        compresses_others=_BC7,
    ),
    TargetEngine(
        "unity",
        "Unity URP",
        bases.MIKKTSPACE,
        "Unity URP",
        _OF_UNITY,
        rebuilds_z=True,
        depth=16,
        alpha=True,
        names="{name}_Normal",
        pack=Pack.URP,
        compresses=_BC5,
        compresses_others=_BC7,
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
        names="{name}_Normal",
        pack=Pack.URP,
        compresses=_BC5,
        compresses_others=_BC7,
    ),
    TargetEngine(
        "godot",
        "Godot 4.4+",
        bases.MIKKTSPACE_VERTEX,
        "Godot",
        _OF_GODOT,
        rebuilds_z=True,
        depth=16,
        has_webp=True,
        pack=Pack.GODOT,
        export=".glb",
        compresses=_BC5,
        compresses_others=_BC7,
    ),
    TargetEngine(
        "godot-old",
        "Godot 3, 4.0-4.3",
        bases.NORMALIZED,
        "Godot 4.3",
        _OF_GODOT,
        rebuilds_z=True,
        depth=16,
        has_webp=True,
        pack=Pack.GODOT,
        export=".glb",
        compresses=_BC5,
        compresses_others=_BC7,
    ),
    TargetEngine("three", "three.js", bases.NORMALIZED, "glTF", _WITH_TANGENTS, **_OF_WEB),
    TargetEngine("khronos", "Khronos glTF viewer", bases.NORMALIZED, "glTF", _WITH_TANGENTS, **_OF_WEB),
    TargetEngine("babylon", "Babylon.js", bases.MIKKTSPACE_VERTEX, "Babylon.js", _WITH_TANGENTS, **_OF_WEB),
    TargetEngine("bevy", "Bevy", bases.MIKKTSPACE, "Bevy and Filament", _WITH_TANGENTS, pack=Pack.GLTF, export=".glb"),
    TargetEngine(
        "filament", "Filament", bases.MIKKTSPACE, "Bevy and Filament", _WITH_TANGENTS, pack=Pack.GLTF, export=".glb"
    ),
    TargetEngine(
        "cryengine",
        "CryEngine",
        bases.MIKKTSPACE_VERTEX,
        "CryEngine",
        "Texture preset for normal maps",
        green=DOWN,
        rebuilds_z=True,
        depth=16,
        names="{name}_ddn",
        compresses=_BC5,
    ),
    TargetEngine("xnormal", "xNormal", bases.MIKKTSPACE_VERTEX, "Substance 3D", _LINEAR, depth=16, names=_PAINTER),
    TargetEngine(
        "substance",
        "Substance 3D",
        bases.MIKKTSPACE_VERTEX,
        "Substance 3D",
        "*Compute tangent space per fragment* off",
        depth=16,
        names=_PAINTER,
    ),
    TargetEngine(
        "substance-per-fragment",
        "Substance (fragment)",
        bases.MIKKTSPACE,
        "Substance (fragment)",
        "*Compute tangent space per fragment* on",
        depth=16,
        names=_PAINTER,
    ),
    TargetEngine("directx", "DirectX", bases.MIKKTSPACE, "DirectX", _LINEAR, green=DOWN, depth=16),
    TargetEngine(
        "unity-hdrp",
        "Unity HDRP",
        bases.MIKKTSPACE,
        "Unity HDRP",
        _OF_UNITY,
        rebuilds_z=True,
        depth=16,
        alpha=True,
        names="{name}_Normal",
        pack=Pack.HDRP,
        compresses=_BC5,
        compresses_others=_BC7,
    ),
    TargetEngine(
        "toolbag",
        "Marmoset Toolbag",
        bases.MIKKTSPACE_VERTEX,
        "Marmoset Toolbag",
        "Tangent space of the mesh: *Mikk / xNormal*. By what others say of it, and not measured",
        depth=16,
    ),
    # The shader of its viewer for PBR materials decodes so. Textures: "2024 Materials Graphics Updates FAQ" of Linden Lab.
    TargetEngine(
        "second-life",
        "Second Life",
        bases.MIKKTSPACE,
        "Second Life",
        f"Upload as a material (glTF PBR). Textures have at most 2048 x 2048 texels. By its viewer's source{_UNMEASURED}",
        pack=Pack.GLTF,
        export=".glb",
    ),
    # Creator documentation, "Texture specifications": normal maps of OpenGL, a file for each map.
    TargetEngine(
        "roblox",
        "Roblox",
        bases.MIKKTSPACE,
        "Roblox",
        "`NormalMap` of a *SurfaceAppearance*; roughness and metallic in files of their own; at most 1024 x 1024 texels. "
        f"By its manual, which tells no basis{_UNMEASURED}",
    ),
    # Avatars have Unity's built-in pipeline. Memory: "Performance Ranks" of its creator documentation.
    TargetEngine(
        "vrchat",
        "VRChat",
        bases.MIKKTSPACE_VERTEX,
        "VRChat",
        f"{_OF_UNITY}; format *BC5*; on PC, an avatar of the rank *Good* has at most 75 MB of textures. By its "
        f"manual{_UNMEASURED}",
        rebuilds_z=True,
        depth=16,
        alpha=True,
        names="{name}_Normal",
        pack=Pack.URP,
        compresses=_BC5,
        compresses_others=_BC7,
    ),
    # Valve Developer Community, "Bump map": tangent space, X+ Y- Z+; "Texture": sizes.
    TargetEngine(
        "source",
        "Valve Source",
        bases.MIKKTSPACE_VERTEX,
        "Valve Source",
        "Write `.tga` files and turn them into VTF; `$bumpmap` in the material; sides are powers of two, at most 2048. By its "
        f"manual, which tells no basis{_UNMEASURED}",
        green=DOWN,
    ),
    # SDK, "Texturing technical information" and "FlightSim material textures"; green as Asobo's add-on for Blender shows it.
    TargetEngine(
        "msfs",
        "Flight Simulator",
        bases.MIKKTSPACE,
        "Flight Simulator",
        "PNG of 16 bits, which packages turn into DDS; sides are multiples of four; the mesh by Asobo's own exporter. By its "
        f"manual, which tells no basis{_UNMEASURED}",
        green=DOWN,
        depth=16,
        pack=Pack.GLTF,
    ),
)
BY_NAME = MappingProxyType({target.name: target for target in TARGETS})


def of_basis(basis: Basis) -> tuple[TargetEngine, ...]:
    """The programs that decode with a basis."""
    return tuple(target for target in TARGETS if target.basis == basis)


def names(basis: Basis) -> str:
    """The programs that decode with a basis, as words."""
    *first, last = (target.label for target in of_basis(basis))
    return f"{', '.join(first)} and {last}" if first else last


@dataclass(frozen=True)
class Engine:
    """What the setting Engine sets.

    Attributes:
        values: Settings by their names, as the properties have them.
        names, export: As of TargetEngine.
    """

    values: dict[str, str | bool]
    names: str = USUAL
    export: str = ""


def _engine(target: TargetEngine) -> Engine:
    values = {
        "red": "+X",
        "green": target.green,
        "blue": "+Z",
        "basis": target.basis.name,
        "depth": str(target.depth),
        "alpha": target.alpha,
        "pack": str(target.pack),
    }
    return Engine(values, target.names, target.export)


def _choices() -> dict[str, Engine]:
    """Programs that share a preset need the same."""
    engines = {target.preset: _engine(target) for target in TARGETS}
    of_scene = engines[BY_NAME["eevee"].preset]
    return {OF_SCENE: Engine({**of_scene.values, "basis": bases.AUTO}), **engines}


CHOICES = MappingProxyType(_choices())
"""What the setting Engine offers, by name."""
