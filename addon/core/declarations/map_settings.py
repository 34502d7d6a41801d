# SPDX-License-Identifier: GPL-3.0-or-later
"""The settings of the panels Map, Channels and Maps, in their order."""

from dataclasses import replace

from .. import map_types
from ..map_types import AO, METALLIC, NORMAL, ONE, ROUGHNESS, SMOOTHNESS, ZERO, Kind
from . import bases, targets
from .choices import (
    DistanceUnit,
    ExactMaterials,
    Fade,
    MarginType,
    Method,
    Modifiers,
    Occluders,
    Pack,
    Space,
    Stacked,
    VertexDomain,
    Wrap,
)
from .kinds import Choice, Distance, Flags, Item, Option, Reach, Setting, Switch, Text, WholeNumber

MIN_SIZE, MAX_SIZE = 16, 16384
MAX_MIPS = 8
MAX_SMOOTH = 1000
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
                "Flatten where the meshes share their UV layout, else Cast",
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
    "targets": Flags(
        label="Target Engines",
        tooltip="Engines for which the report says by how many degrees they are off with this tangent-space map",
        items=tuple(
            Item(target.name, target.label, f"It decodes with the basis {target.basis.label}")
            for target in targets.TARGETS
        ),
        option=Option(explains=False, note=f"Any of {', '.join(target.name for target in targets.TARGETS)}"),
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
        tooltip="Samples per texel: 1 for a preview, 4 or more for the final map. 4 take 2 to 3 times as long and "
        "leave a fifth of the error",
        default=1,
        items=(
            Item(1, "1", "One sample, at the texel's center"),
            *(Item(number, str(number), f"The mean of {number} samples") for number in (2, 4, 8, 16, 64)),
        ),
        option=Option(explains=False),
    ),
    "adaptive": Switch(
        label="Adaptive Sampling",
        tooltip="Take all samples only at borders and where the first ones differ: 99 of 100 texels are within "
        "0.02 degrees of all samples. Flatten and bakes of several maps take all",
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
    "wrap": Choice(
        label="Wrap",
        tooltip="Bake a tile that repeats: what leaves the low mesh on one side comes in on the other, for rays and margins",
        default=Wrap.NONE,
        items=(
            Item(Wrap.NONE, "None", "The map ends at its borders"),
            Item(Wrap.U, "U", "It repeats along U"),
            Item(Wrap.V, "V", "It repeats along V"),
            Item(Wrap.UV, "U and V", "It repeats along both"),
        ),
    ),
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
                "The part whose faces come first in the mesh, as before the copies of Mirror and Array",
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
            Item(
                Modifiers.RENDER, "Render", "What a render sees: its levels, resolutions and visibility, and Simplify"
            ),
            Item(Modifiers.VIEWPORT, "Viewport", "What the viewport shows"),
        ),
    ),
    "rest_pose": Switch(
        label="Rest Pose",
        tooltip="Bake without the poses, shape keys and other deformers that only one of the high and low objects has",
    ),
    "keep_faces": Switch(
        label="Keep Faces",
        tooltip="Take the faces of the high mesh as they are. Otherwise the bake turns over those that point to "
        "the wrong side, and leaves out those that are there twice or hidden behind the surface",
    ),
    "cut_outs": Switch(
        label="Cut-Outs",
        tooltip="Rays pass high meshes where the alpha of their materials is clear: decals, leaves, fences. Off, "
        "they are solid",
        default=True,
        option=Option(word="no-cut-outs", off="Take high meshes as solid where the alpha of their materials is clear"),
    ),
    "smooth_high": WholeNumber(
        label="Smooth High",
        tooltip="How often the normals of the high mesh are averaged with those around them, against noise. Hard "
        "edges stay",
        default=0,
        least=0,
        most=MAX_SMOOTH,
        usual_most=20,
    ),
    "limited": Switch(
        label="Set Limit",
        tooltip="Set the distance between the high and the low surface above which a warning is shown. Without it, "
        "nothing that is deep is a warning",
        empties=False,
        option=None,
    ),
    "limit": Distance(
        label="Limit",
        tooltip="Distance between the high and the low surface above which the check Far counts texels",
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
        option=Option(explains=False),
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


LEAST_RAYS, MOST_RAYS = 16, 1024
THICKNESS_SHARE = 0.1
"""The thickness distance as a share of the diagonal, unless it is set."""
CURVATURE_SHARE = 0.005
"""The curvature radius as a share of the diagonal, unless it is set: half as long as bolts are wide, which would be white
all over."""
PACKABLE = tuple(kind for kind in map_types.OTHERS if kind.kind is Kind.VALUE and kind.is_scalar)
"""The maps that a channel can store."""
PACKABLE_BEFORE = PACKABLE.index(map_types.GRADIENT)
"""So many stand before Smoothness in the lists of channels, and later maps behind it: files of Blender hold their places."""


def _packed(name: str, default: str) -> Choice:
    """What a channel of a packed image stores."""
    items = [Item(kind.name, kind.label, kind.tooltip) for kind in PACKABLE]
    return Choice(
        label=name,
        tooltip=f"What the {name.lower()} channel of the packed image stores",
        default=default,
        items=(
            Item(ZERO, "Black", "0 everywhere"),
            Item(ONE, "White", "1 everywhere"),
            *items[:PACKABLE_BEFORE],
            Item(SMOOTHNESS, "Smoothness", "1 - roughness"),
            *items[PACKABLE_BEFORE:],
        ),
        option=Option(explains=False),
    )


MAPS: dict[str, Setting] = {
    "normal": Switch(
        label="Normal Map",
        tooltip="Bake a normal map",
        default=True,
        option=Option(word="no-normal", off="Store no normal map, only the maps of --maps"),
    ),
    "maps": Flags(
        label="Other Maps",
        tooltip="Maps to bake beside the normal map, each into an image of its own",
        items=tuple(Item(map_type.name, map_type.label, map_type.tooltip) for map_type in map_types.OTHERS),
        also=(NORMAL.name,),
        option=Option(metavar="MAP,MAP..."),
    ),
    "rays": WholeNumber(
        label="Rays",
        tooltip="Rays per texel for ambient occlusion, bent normals, thickness and curvature. "
        "128 leave an error of about 2 of 255 steps, 4 times as many half of it",
        default=128,
        least=LEAST_RAYS,
        most=MOST_RAYS,
    ),
    "distance_unit": Choice(
        label="Distance Unit",
        tooltip="Unit of the AO distance, the thickness distance and the curvature radius",
        default=DistanceUnit.DIAGONAL,
        items=(
            Item(DistanceUnit.DIAGONAL, "Diagonal", "A share of the diagonal of the high meshes' bounding box"),
            Item(DistanceUnit.SCENE, "Scene Units", "Scene units"),
        ),
    ),
    "ao_limited": Switch(label="Set Distance", tooltip="Limit the distance of occluders", empties=False, option=None),
    "ao_distance": Reach(
        label="AO Distance",
        tooltip="Distance beyond which the high surface does not block rays",
        empty="no limit",
        switch="ao_limited",
        shown=0.1,
        usual_most=1.0,
    ),
    "ao_fade": Choice(
        label="AO Fade",
        tooltip="How occlusion fades up to the AO distance. Without a distance, it does not fade",
        default=Fade.LINEAR,
        items=(
            Item(Fade.NONE, "None", "Full occlusion up to the distance"),
            Item(Fade.LINEAR, "Linear", "Occlusion fades evenly"),
            Item(Fade.SMOOTH, "Smooth", "Occlusion fades slowly at both ends"),
        ),
    ),
    "occluders": Choice(
        label="Occluders",
        tooltip="Objects that block rays of ambient occlusion and bent normals",
        default=Occluders.OWN,
        items=(
            Item(Occluders.OWN, "Own", "The high objects of the same low object"),
            Item(Occluders.ALL, "All", "The high objects of all low objects that are baked together"),
            Item(Occluders.SCENE, "Scene", "These, and all other objects that the viewport and renders show"),
        ),
    ),
    "floor": Switch(label="Floor", tooltip="Let a floor under the lowest point of the high meshes block rays"),
    "two_sided": Switch(
        label="Two-Sided",
        tooltip="Let back faces block rays too. Use it for open meshes, such as leaves and cloth",
    ),
    "bias_angle": WholeNumber(
        label="Bias Angle",
        tooltip="Degrees above the horizon in which ambient occlusion casts no rays. It hides the facets of a coarse high mesh",
        default=0,
        least=0,
        most=80,
        usual_most=30,
        option=Option(metavar="DEGREES"),
    ),
    "thickness_limited": Switch(
        label="Set Thickness", tooltip="Set the thickness distance", empties=False, option=None
    ),
    "thickness_distance": Reach(
        label="Thickness Distance",
        tooltip="Length of a ray that stores white in the thickness map",
        empty=f"{THICKNESS_SHARE:.0%} of the diagonal",
        switch="thickness_limited",
        shown=THICKNESS_SHARE,
        usual_most=1.0,
    ),
    "curvature_limited": Switch(label="Set Radius", tooltip="Set the curvature radius", empties=False, option=None),
    "curvature_radius": Reach(
        label="Curvature Radius",
        tooltip="Radius of the ball in which curvature is measured. Small radii find fine edges, large ones find shapes",
        empty=f"{CURVATURE_SHARE:.1%} of the diagonal",
        switch="curvature_limited",
        shown=0.02,  # files do not hold a value that was not changed: those that set the radius keep it
        usual_most=0.2,
    ),
    "attribute": Text(
        label="Attribute",
        tooltip="Name of the attribute of the high meshes for the attribute map",
        empty="the color attribute that is set to render",
    ),
    **map_types.SETTINGS,
    "exact_materials": Choice(
        label="Exact Materials",
        tooltip="Who evaluates inputs of the high meshes' materials that Imprint does not follow, such as noise "
        "and mixes of textures",
        default=ExactMaterials.AUTO,
        items=(
            Item(ExactMaterials.AUTO, "Auto", "Cycles does, at the points that the map shows"),
            Item(ExactMaterials.OFF, "Off", "Nobody: the map has no value there, and the report names them"),
        ),
    ),
    "detail_maps": Switch(
        label="High's Normal Maps",
        tooltip="Count the normal and bump maps of the high meshes' materials into the normal map",
        default=True,
        option=Option(word="no-detail-maps", off="Leave the normal and bump maps of the high meshes' materials out"),
    ),
    "edge_radius": Distance(
        label="Edge Radius",
        tooltip="Radius within which hard edges of the high meshes look round, as by Cycles' Bevel node. 0 leaves them hard",
        default=0.0,
        shown=0.0,
        usual_most=0.1,
        may_be_zero=True,
    ),
    "appearance": Switch(
        label="Shading Error",
        tooltip="Also measure the shading error: the angle between the normals that a viewer sees of the high meshes and of "
        "the low mesh with its normal map, from 40 sides",
    ),
    "pack": Choice(
        label="Pack",
        tooltip="Also pack up to four maps into the channels of one image",
        default=Pack.NONE,
        items=(
            Item(Pack.NONE, "None", "No packed image"),
            Item(Pack.GLTF, "glTF", "Ambient occlusion, roughness, metallic"),
            Item(Pack.UNREAL, "Unreal", "Ambient occlusion, roughness, metallic"),
            Item(Pack.GODOT, "Godot", "Ambient occlusion, roughness, metallic"),
            Item(Pack.URP, "Unity URP", "Metallic in red, smoothness in alpha"),
            Item(Pack.HDRP, "Unity HDRP", "Mask map: metallic, ambient occlusion, detail mask, smoothness"),
            Item(Pack.CUSTOM, "Custom", "The channels below"),
        ),
    ),
    "pack_red": _packed("Red", AO.name),
    "pack_green": _packed("Green", ROUGHNESS.name),
    "pack_blue": _packed("Blue", METALLIC.name),
    "pack_alpha": _packed("Alpha", ONE),
    "texture_sets": Switch(
        label="Texture Sets",
        tooltip="Bake an image for each material of the low mesh. {material} in names stands for the material's name",
    ),
    "vertex_domain": Choice(
        label="To Attributes",
        tooltip="Also store the maps in attributes of the low mesh",
        default=VertexDomain.NONE,
        items=(
            Item(VertexDomain.NONE, "None", "Only images"),
            Item(VertexDomain.CORNER, "Face Corners", "A value for each corner of a face"),
            Item(VertexDomain.POINT, "Vertices", "A value for each vertex"),
        ),
    ),
    "connect_maps": Switch(
        label="Connect Maps",
        tooltip="Put the other maps into the low object's material as well",
    ),
}
