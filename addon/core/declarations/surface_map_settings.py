# SPDX-License-Identifier: GPL-3.0-or-later
"""The settings of the panel Maps, in its order: which maps to bake, and what they need beside the normal map."""

from .. import map_types
from ..map_types import AO, METALLIC, NORMAL, ROUGHNESS, Kind
from .choices import DistanceUnit, Fade, Occluders, Pack, VertexDomain
from .kinds import Choice, Flags, Item, Option, Reach, Setting, Switch, Text, WholeNumber

LEAST_RAYS, MOST_RAYS = 16, 1024
THICKNESS_SHARE = 0.1
"""The thickness distance as a share of the diagonal, unless it is set."""
CURVATURE_SHARE = 0.02
"""The curvature radius as a share of the diagonal, unless it is set."""
ZERO, ONE, SMOOTHNESS = "ZERO", "ONE", "SMOOTHNESS"
"""What a channel of a packed image can store beside a map. SMOOTHNESS is 1 - roughness."""

PACKABLE = tuple(kind for kind in map_types.OTHERS if kind.kind is Kind.VALUE and kind.is_scalar)
"""The maps that a channel can store."""


def _packed(name: str, default: str) -> Choice:
    """What a channel of a packed image stores."""
    return Choice(
        label=name,
        tooltip=f"What the {name.lower()} channel of the packed image stores",
        default=default,
        items=(
            Item(ZERO, "Black", "0 everywhere"),
            Item(ONE, "White", "1 everywhere"),
            *(Item(kind.name, kind.label, kind.tooltip) for kind in PACKABLE),
            Item(SMOOTHNESS, "Smoothness", "1 - roughness"),
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
        tooltip="High objects that block rays",
        default=Occluders.OWN,
        items=(
            Item(Occluders.OWN, "Own", "The high objects of the same low object"),
            Item(Occluders.ALL, "All", "The high objects of all pairs that are baked together"),
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
        empty=f"{CURVATURE_SHARE:.0%} of the diagonal",
        switch="curvature_limited",
        shown=CURVATURE_SHARE,
        usual_most=0.2,
    ),
    "attribute": Text(
        label="Attribute",
        tooltip="Name of the attribute of the high meshes for the attribute map",
        empty="the color attribute that is set to render",
    ),
    "detail_maps": Switch(
        label="High's Normal Maps",
        tooltip="Count the normal and bump maps of the high meshes' materials into the normal map",
        default=True,
        option=Option(word="no-detail-maps", off="Leave the normal and bump maps of the high meshes' materials out"),
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
