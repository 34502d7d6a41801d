# SPDX-License-Identifier: GPL-3.0-or-later
"""The settings of the panels Map and Channels, in their order."""

from dataclasses import replace

from . import bases, readers
from .choices import MarginType, Method, Modifiers, Space, Stacked
from .kinds import Choice, Distance, Flags, Item, Option, Setting, Switch, Text, WholeNumber

MIN_SIZE, MAX_SIZE = 16, 16384
MAX_MIPS = 8
ADAPTIVE_FROM = 4
"""Rays with fewer samples take them all: adaptive samples would not be faster on all meshes."""

MAP: dict[str, Setting] = {
    "method": Choice(
        label="Method",
        tooltip="How the detail of the high mesh gets into the map",
        default=Method.AUTO,
        items=(
            Item(
                Method.AUTO,
                "Auto",
                "Flatten where the meshes share their UV layout, else Cast. "
                "The report says which method was used, and why",
            ),
            Item(Method.FLATTEN, "Flatten", "Draw the high mesh in UV space. Both meshes must share their UV layout"),
            Item(
                Method.CAST,
                "Cast",
                "Cast rays from the low mesh to the high mesh. The meshes must lie in the same place",
            ),
        ),
    ),
    "space": Choice(
        label="Space",
        tooltip="Space of the normals",
        default=Space.TANGENT,
        items=(
            Item(Space.TANGENT, "Tangent", "Relative to the low surface. The mesh may deform, and the map may tile"),
            Item(Space.OBJECT, "Object", "Relative to the low object. The object may move, its mesh may not deform"),
            Item(Space.WORLD, "World", "Relative to the scene. The object may not move"),
        ),
    ),
    "basis": Choice(
        label="Basis",
        tooltip="Tangent basis that the map is decoded with. Renderers differ by a few degrees on coarse meshes",
        default=bases.AUTO,
        items=(
            Item(
                bases.AUTO,
                "Scene's Engine",
                "The basis that the scene's render engine uses: Cycles its own, all others MikkTSpace",
            ),
            *(Item(basis.name, basis.label, basis.tooltip, basis.former) for basis in bases.BASES),
        ),
        option=Option(note="Mesh files have no scene: for them, auto means mikktspace"),
    ),
    "readers": Flags(
        label="Target Programs",
        tooltip="Programs for which the report says by how many degrees they are off when they read this tangent-space map",
        items=tuple(
            Item(reader.name, reader.label, f"It decodes with the basis {reader.basis.label}")
            for reader in readers.READERS
        ),
        option=Option(explains=False, note=f"Any of {', '.join(reader.name for reader in readers.READERS)}"),
    ),
    "uv_layer": Text(
        label="UV Map", tooltip="UV map of the low mesh", empty="the active one", option=Option(word="uv")
    ),
    "size": WholeNumber(
        label="Size",
        tooltip="Width and height of the map, in texels",
        default=2048,
        least=MIN_SIZE,
        most=MAX_SIZE,
        option=Option(metavar="2048|2k|4096x1024"),
    ),
    "width": WholeNumber(
        label="Width",
        tooltip="Width of the map, in texels",
        default=2048,
        least=MIN_SIZE,
        most=MAX_SIZE,
        option=None,  # --size sets both
    ),
    "height": WholeNumber(
        label="Height",
        tooltip="Height of the map, in texels",
        default=2048,
        least=MIN_SIZE,
        most=MAX_SIZE,
        option=None,
    ),
    "square": Switch(label="Square", tooltip="Use one size for width and height", default=True, option=None),
    "samples": Choice(
        label="Samples",
        tooltip="Samples per texel, for antialiasing. Use 1 for a preview, and 4 or more for the final map: "
        "4 samples take 2 to 3 times as long and leave a fifth of the error",
        default=1,
        items=(
            Item(1, "1", "One sample, at the texel's center"),
            *(Item(number, str(number), f"The mean of {number} samples") for number in (2, 4, 8, 16, 64)),
        ),
        option=Option(explains=False),
    ),
    "adaptive": Switch(
        label="Adaptive Sampling",
        tooltip="Take all samples only at borders and where the first ones differ. In 99 of 100 texels, the normal is within "
        "0.02 degrees of the mean of all samples. Flatten and bakes of several maps take all samples everywhere",
        default=True,
        option=Option(
            word="no-adaptive",
            off="Take all samples in every texel. Without this, a normal map alone has adaptive samples by Cast "
            f"from {ADAPTIVE_FROM} on",
        ),
    ),
    "margin_type": Choice(
        label="Margin Type",
        tooltip="How the margin is filled",
        default=MarginType.EXTEND,
        items=(
            Item(MarginType.EXTEND, "Extend", "Repeat the nearest texel of an island"),
            Item(
                MarginType.ADJACENT_FACES,
                "Adjacent Faces",
                "Continue the neighboring face across the seam, with normals rotated to fit",
            ),
        ),
    ),
    "margin": WholeNumber(
        label="Margin",
        tooltip="Width of the margin around UV islands, in texels. It keeps the background from showing at seams",
        default=16,
        least=0,
        most=MAX_SIZE,
        usual_most=64,
        none_word="unlimited",
        switch="unlimited",
        option=Option(metavar="TEXELS|unlimited"),
    ),
    "unlimited": Switch(label="Unlimited", tooltip="Fill the whole background", empties=True, option=None),
    "mips": WholeNumber(
        label="Clean Mips",
        tooltip="Number of mip levels on which UV islands may not mix, for the checks. "
        "1 level takes 2 texels between islands, 2 take 4, 3 take 8, and half as many to the border",
        default=3,
        least=0,
        most=MAX_MIPS,
        option=Option(metavar="LEVELS"),
    ),
    "stacked": Choice(
        label="Stacked UVs",
        tooltip="Which part of the low mesh gets its own detail where several parts share texels. The others show the same",
        default=Stacked.FIRST,
        items=(
            Item(
                Stacked.FIRST,
                "First Part",
                "The part whose faces come first in the mesh, as what was modeled before the copies of Mirror and Array",
            ),
            Item(
                Stacked.LAST, "Last Part", "The part whose faces come last in the mesh, as the last copy of a modifier"
            ),
        ),
    ),
    "modifiers": Choice(
        label="Modifiers",
        tooltip="Which settings of modifiers to use",
        default=Modifiers.RENDER,
        items=(
            Item(Modifiers.RENDER, "Render", "Levels and visibility as set for rendering"),
            Item(Modifiers.VIEWPORT, "Viewport", "Levels and visibility as set for the viewport"),
        ),
    ),
    "limited": Switch(
        label="Set Limit",
        tooltip="Set the distance between the high and the low surface above which a warning is shown. Without it, the check "
        "Far counts from 5 % of the low mesh's radius on, and warns of nothing that is deep",
        empties=False,
        option=None,
    ),
    "limit": Distance(
        label="Limit",
        tooltip="Distance between the high and the low surface above which the check Far counts texels. Where it is set, a "
        "warning names them",
        empty="5 % of the low mesh's radius",
        switch="limited",
        shown=0.1,
        shown_least=1e-6,
        usual_most=2.0,
    ),
}

_AXES = {
    "+Y": ("+Y (OpenGL)", "The normal's Y. In the green channel: Blender, Unity, Godot, glTF"),
    "-Y": ("-Y (DirectX)", "The normal's Y, inverted. In the green channel: Unreal, DirectX, CryEngine"),
}


def _channel(name: str, usual: str, more: str = "") -> Choice:
    """A channel that usually stores the axis `usual`, which comes first."""
    items = []
    for axis in sorted(("+X", "-X", "+Y", "-Y", "+Z", "-Z"), key=lambda axis: axis[1] != usual):
        inverted = ", inverted" if axis[0] == "-" else ""
        items.append(Item(axis, *_AXES.get(axis, (axis, f"The normal's {axis[1]}{inverted}"))))
    return Choice(
        label=name,
        tooltip=f"Axis of the normal that the {name.lower()} channel stores{more}",
        default=f"+{usual}",
        items=tuple(items),
        option=Option(metavar="AXIS", explains=False, note=f"One of {', '.join(item.value.lower() for item in items)}"),
    )


CHANNELS: dict[str, Setting] = {
    "red": _channel("Red", "X"),
    "green": _channel("Green", "Y", ": +Y for OpenGL, -Y for DirectX"),
    "blue": _channel("Blue", "Z"),
}

_BASES = tuple(Item(basis.name, basis.label, basis.tooltip, basis.former) for basis in bases.BASES)


def _stored_axis(name: str, usual: str) -> Choice:
    """A channel of a map to convert."""
    own = _channel(name, usual)
    return replace(
        own,
        label=f"{name} Stores",
        tooltip=f"Axis of the normal that the {name.lower()} channel of the map to convert stores",
    )


CONVERT: dict[str, Setting] = {
    "from_space": Choice(
        label="From Space",
        tooltip="Space of the normals in the map to convert",
        default=Space.TANGENT,
        items=(
            Item(Space.TANGENT, "Tangent", "Relative to the low surface"),
            Item(Space.OBJECT, "Object", "Relative to the low object"),
            Item(Space.WORLD, "World", "Relative to the scene, with the low object where it is now"),
        ),
    ),
    "from_basis": Choice(
        label="From Basis",
        tooltip="Tangent basis that the map to convert was made for",
        default=bases.MIKKTSPACE.name,
        items=(Item(bases.AUTO, "Scene's Engine", "The basis that the scene's render engine uses"), *_BASES),
    ),
    "from_red": _stored_axis("Red", "X"),
    "from_green": _stored_axis("Green", "Y"),
    "from_blue": _stored_axis("Blue", "Z"),
}
