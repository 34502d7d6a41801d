# SPDX-License-Identifier: GPL-3.0-or-later
"""All settings by the panels that show them: here those of Output, Rays, Imprint, pairs, levels and assets."""

from dataclasses import dataclass

from .. import asset_limits, file_formats, levels, udim
from ..file_formats import USUAL_DEPTH
from ..naming import Suffixes
from ..udim import TOKEN
from .choices import Compression, Directions, Format, Hit, Storage, Symmetry
from .kinds import (
    Amount,
    Choice,
    Color,
    Distance,
    FilePath,
    Item,
    ObjectSlot,
    ObjectSlots,
    Option,
    Setting,
    Switch,
    Text,
    Tiles,
    WholeNumber,
)
from .map_settings import CHANNELS, CONVERT, MAP, MAPS

_USUAL = Suffixes()

BAKE: dict[str, Setting] = {
    "highs": ObjectSlots(
        label="High",
        tooltip="High-poly objects, which have the detail: meshes, curves, text, or objects that show instances",
        empty="the selected objects",
        option=Option(word="high", default="the low object with its modifiers", note="The option may be repeated"),
    ),
    "low": ObjectSlot(
        label="Low",
        tooltip="Low-poly mesh, which gets the map",
        empty="the active object",
        option=Option(
            default="",
            note="The option may be repeated: each is then baked from what is called as it is, or onto itself",
        ),
    ),
    "live_every_time": Switch(
        label="Write Every Map",
        tooltip="While Live is on, write each map to the image at once, and not only when editing pauses",
        option=None,
    ),
}
PAIRS: dict[str, Setting] = {
    "low_suffix": Text(
        label="Low", tooltip="Ending of the names of low objects, in any case", default=_USUAL.low, option=None
    ),
    "high_suffix": Text(
        label="High",
        tooltip="Ending of the names of high objects, in any case. An underscore and more may follow it",
        default=_USUAL.high,
        option=None,
    ),
    "cage_suffix": Text(
        label="Cage", tooltip="Ending of the names of cages, in any case", default=_USUAL.cage, option=None
    ),
    "share_image": Switch(label="One Image", tooltip="Bake all pairs into one image, an atlas", option=None),
}
LEVELS: dict[str, Setting] = {
    "level_triangles": Text(
        label="Triangles",
        tooltip="For each level, its number of triangles, or its share of those of the mesh, as 50 %, 25 %, 500",
        empty="as few as the degrees and the distance allow",
        option=None,
    ),
    "level_degrees": Text(
        label="Degrees",
        tooltip="For each level, the largest angle between its normals with its map and those of the mesh, on 99 % "
        "of the texels",
        default=levels.DEGREES,
        option=None,
    ),
    "level_distance": Text(
        label="Distance (%)",
        tooltip="The largest distance of the levels from the mesh, in percent of the longest side of its box: "
        "one number for all levels, or one for each",
        default=levels.PERCENT,
        option=None,
    ),
    "level_beside": Switch(
        label="Side by Side",
        tooltip="Put the levels in a row beside the mesh, and not into it. Exported files have all of them in one place",
        option=None,
    ),
}
ASSET: dict[str, Setting] = {
    "asset_triangles": Text(
        label="Triangles",
        tooltip="How many triangles the low mesh has. With degrees or a distance it is the most, and empty stands for no limit",
        default=str(asset_limits.TRIANGLES),
        option=None,
    ),
    "asset_degrees": Text(
        label="Degrees",
        tooltip="The shading error that 99 % of the pixels may have, seen from all sides: the fewest triangles within it are "
        "searched",
        empty="no limit",
        option=None,
    ),
    "asset_distance": Text(
        label="Distance (%)",
        tooltip="How far the low mesh may be from the high one, in percent of the size: the fewest triangles within it are "
        "searched",
        empty="no limit",
        option=None,
    ),
    "asset_crumbs": Text(
        label="Crumbs (%)",
        tooltip="Parts below this percentage of the largest are left out, floating ones below 6 times it",
        default=str(asset_limits.CRUMBS),
        option=None,
    ),
    "asset_holes": Text(
        label="Holes (%)",
        tooltip="Holes below this percentage of the largest part are filled, ragged ones below 6 times it",
        default=str(asset_limits.HOLES),
        option=None,
    ),
    "asset_symmetry": Choice(
        label="Symmetry",
        tooltip="Make the low mesh equal its mirror image along an axis of the world",
        default=Symmetry.AUTO,
        items=(
            Item(Symmetry.AUTO, "Auto", "If the high mesh does and it looks no worse"),
            Item(Symmetry.NONE, "None", "Both sides differ"),
            Item(Symmetry.X, "X", "Left and right"),
            Item(Symmetry.Y, "Y", "Front and back"),
            Item(Symmetry.Z, "Z", "Top and bottom"),
        ),
        option=None,
    ),
    "asset_fits_size": Switch(
        label="Size by Detail",
        tooltip="Make the maps as large as it takes for texels as small as the triangles of the high objects, from "
        f"{asset_limits.SIZES[0]} to {asset_limits.SIZES[1]}",
        option=None,
    ),
    "asset_levels": WholeNumber(
        label="Levels of Detail",
        tooltip="How many coarser levels are made: each has half the triangles of the one before it, or twice its limits",
        default=0,
        least=0,
        most=asset_limits.MOST_LEVELS,
        option=None,
    ),
    "asset_keeps": Switch(
        label="Keep Triangles",
        tooltip="Give the mesh itself UVs and maps, and make no low mesh",
        option=None,
    ),
    "asset_quads": Switch(
        label="Quads",
        tooltip="Make the low mesh of quads: better to edit, with a larger error",
        option=None,
    ),
    "asset_own_textures": Switch(
        label="Own Textures",
        tooltip="Give each level a UV map and textures of its own, in place of those of the low mesh",
        option=None,
    ),
    "asset_stack_mirrored": Switch(
        label="Stack Mirrored",
        tooltip="Unwrap mirrored halves and equal parts onto the same place, also by the button Unwrap",
        option=None,
    ),
    "asset_density_group": Text(
        label="Density Group",
        tooltip="Vertex group whose mean weight on a UV island scales its texel density: 0 halves it, 0.5 changes nothing, and "
        "1 doubles it, also by the button Unwrap",
        empty="the same density everywhere",
        option=None,
    ),
}


OUTPUT: dict[str, Setting] = {
    "image": Text(
        label="Image",
        tooltip="Name of the image to fill. {low} in it stands for the low object's name, {name} for that without _low",
        empty="an image named after the low object",
    ),
    "depth": Choice(
        label="Depth",
        tooltip="Bits per channel. OpenEXR files of maps in scene units, and of attributes, always have 32",
        default=USUAL_DEPTH,
        items=(
            Item(8, "8", "Smallest. May show steps on smooth surfaces"),
            Item(16, "16", "Smooth: 16-bit PNG or TIFF, half-float OpenEXR, or a float image inside Blender"),
            Item(32, "32", "Exact: float OpenEXR, or a float image inside Blender"),
        ),
        option=Option(default=f"{USUAL_DEPTH}, or the most below that the format has"),
    ),
    "dither": Switch(
        label="Dither", tooltip="Hide the steps of 8 bits in fine noise, instead of rounding to the nearest value"
    ),
    "range_limited": Switch(
        label="Set Range",
        tooltip="Set what black and white stand for in maps of heights, distances and positions, so that several "
        "bakes fit together",
        empties=False,
        option=None,
    ),
    "value_range": Distance(
        label="Range",
        tooltip="In integer formats, the value of white in maps of heights, distances and positions, and below 0 that of "
        "black. Larger values are cut off",
        empty="the largest value of each bake",
        switch="range_limited",
        shown=0.1,
        shown_least=1e-6,
        usual_most=2.0,
    ),
    "udim": Switch(
        label="UDIM Tiles",
        tooltip="Bake a map for each UDIM tile that the low mesh covers",
        option=Option(note=f"{TOKEN} in --output does the same"),
    ),
    "tiles": Tiles(
        label="Tiles",
        tooltip="UDIM tiles to bake, such as 1001, 1003",
        empty=f"all tiles that the low mesh covers, {udim.MOST_BAKED} at most",
    ),
    "storage": Choice(
        label="Store",
        tooltip="Where to keep the map",
        default=Storage.PACK,
        items=(
            Item(Storage.PACK, "Packed", "Inside the .blend file"),
            Item(Storage.FILE, "File", "In an image file"),
            Item(Storage.MEMORY, "Memory", "In memory until the .blend file is saved, which packs the map"),
        ),
        option=None,  # the command line writes files
    ),
    "output": FilePath(
        label="File",
        tooltip=f"Image file to write: {file_formats.listed()}. Missing folders are created. "
        f"{{low}} in the path stands for the low object's name, {{name}} for that without _low, {TOKEN} for the tile's number",
        option=Option(metavar="MAP", note="For mesh files, {low} is the name of the low mesh's file"),
    ),
    "alpha": Switch(
        label="Alpha",
        tooltip="Files have an alpha channel, which is 0 on the background and where rays hit nothing",
        default=True,
        option=Option(
            word="no-alpha",
            off="Write files without an alpha channel. Then only the mask shows which texels were missed",
        ),
    ),
    "mip_files": Switch(
        label="Mip Levels",
        tooltip="Also write the smaller mip levels to files, such as rock_normal_mip1.png. They average what the "
        "map covers. DDS and KTX2 files always have them inside",
    ),
    "format": Choice(
        label="Format",
        tooltip="How the bits per channel, the blocks, the quality and the steps of files are chosen. Auto also chooses an "
        "ending that File lacks",
        default=Format.FIXED,
        items=(
            Item(Format.FIXED, "Fixed", "As Depth, Compression and Quality say"),
            Item(
                Format.AUTO,
                "Auto",
                "For each map, the smallest that keeps the limits below and that the target engines read. Maps of lengths, "
                "emission, attributes and labels stay as with Fixed",
            ),
        ),
    ),
    "most_degrees": Amount(
        label="Most Degrees",
        tooltip="How far 99 % of the normals that Format Auto stores are off the bake at most",
        default=1.0,
        least=0.01,
        most=90.0,
    ),
    "most_steps": Amount(
        label="Most Steps",
        tooltip="How far 99 % of the texels that Format Auto stores of other maps are off the bake at most, in steps of 255",
        default=2.0,
        least=0.1,
        most=255.0,
    ),
    "compression": Choice(
        label="Compression",
        tooltip="Format of the blocks of 4 x 4 texels in DDS and KTX2 files. Maps that do not fit into it have that of Auto",
        default=Compression.AUTO,
        items=(
            Item(
                Compression.AUTO,
                "Auto",
                "BC5 for normal maps in tangent space, BC4 for maps of one value, BC6H for emission, positions and vector "
                "displacement, BC7 for all others",
            ),
            Item(Compression.BC4, "BC4", "One channel, 4 bits a texel"),
            Item(Compression.BC5, "BC5", "Red and green, 8 bits a texel. Readers of normals rebuild blue"),
            Item(Compression.BC6H, "BC6H", "Red, green and blue as floats, 8 bits a texel"),
            Item(Compression.BC7, "BC7", "Red, green, blue and alpha, 8 bits a texel"),
        ),
    ),
    "quality": WholeNumber(
        label="Quality",
        tooltip="Quality of WebP and JPEG files. At 100, WebP keeps all colors but those where alpha is 0, JPEG nearly all. "
        "Normal maps have 100 unless Lossy Normals is on",
        default=100,
        least=1,
        most=100,
    ),
    "lossy_normals": Switch(
        label="Lossy Normals",
        tooltip="Quality also holds for normal maps. Losses that no color shows turn reflections",
    ),
    "material": Switch(
        label="Material",
        tooltip="Add the map to the low object's material",
        default=True,
        option=Option(word="no-material", off="Leave the low object's material as it is"),
    ),
    "one_material": Switch(
        label="One Material",
        tooltip="Replace all materials of the low object by one with the maps. Objects in one image share it",
    ),
    "export": FilePath(
        label="Export",
        tooltip=f"File for an engine: {file_formats.listed_meshes()}. It gets the low mesh in the triangles that were "
        "baked, with its tangents and its maps. {low} in the path stands for the low object's name, {name} for that without "
        "_low",
        option=Option(
            metavar="MESH",
            note="Imprint reads the file back, and reports by how many degrees normals differ from those that were baked",
        ),
    ),
    "export_webp": Switch(
        label="WebP Textures",
        tooltip="Maps in an exported .glb are WebP, which its readers must know, in place of PNG. Quality and Lossy Normals "
        "hold for them, too",
    ),
    "export_ktx2": Switch(
        label="KTX2 Textures",
        tooltip="Maps in an exported .glb are KTX2, in which GPUs keep them small, in place of PNG: UASTC, or ETC1S below "
        "Quality 100. Blender 5.3 and later",
    ),
    "single_user": Switch(
        label="Single User",
        tooltip="Copy materials that other objects use as well, so that those objects keep their look",
    ),
    "show_result": Switch(
        label="Show Result",
        tooltip="After a bake, show the map in an open Image Editor and on the low mesh in the 3D viewport, and "
        "hide the high objects",
        default=True,
        option=None,
    ),
}


RAYS: dict[str, Setting] = {
    "hit": Choice(
        label="Hit",
        tooltip="Which of the high surfaces along a ray the map shows",
        default=Hit.OWN,
        items=(
            Item(
                Hit.OWN,
                "Own",
                "The outermost surface that belongs to the texel: the texel is at the closest point of the low mesh, or next "
                "to it. Rays pass through other layers",
            ),
            Item(Hit.OUTERMOST, "Outermost", "The first surface from outside"),
            Item(Hit.NEAREST, "Nearest", "The surface nearest to the low mesh, inside or outside"),
        ),
    ),
    "cage": ObjectSlot(label="Cage", tooltip="Mesh on which the rays start. It must have the topology of the low mesh"),
    "measure": Switch(
        label="Measure Distances",
        tooltip="Measure how far the high surface lies from the low one, instead of using the distances below",
        default=True,
        empties=True,
        option=None,
    ),
    "extrusion": Distance(
        label="Extrusion",
        tooltip="Distance outside the low mesh at which the rays start",
        empty="measured",
        switch="measure",
        may_be_zero=True,
        shown=0.05,
        usual_most=1.0,
    ),
    "max_distance": Distance(
        label="Max Distance",
        tooltip="Length of the rays, from where they start",
        empty="measured",
        switch="measure",
        shown=0.1,
        usual_most=2.0,
    ),
    "directions": Choice(
        label="Directions",
        tooltip="Normals of the low mesh that the rays follow",
        default=Directions.BLENDED,
        items=(
            Item(
                Directions.BLENDED,
                "Blended",
                "Smooth at hard edges, which leaves no gaps, and straight away from them, which skews nothing",
            ),
            Item(Directions.SMOOTH, "Smooth", "Smooth vertex normals. Hard edges leave no gaps"),
            Item(Directions.SPLIT, "Split", "The mesh's own normals, with hard edges and custom normals"),
        ),
    ),
    "offset_group": Text(
        label="Offset Group",
        tooltip="Vertex group of the low mesh that scales the extrusion: with a weight of 0 rays start on the surface, "
        "0.5 changes nothing, and with 1 they start twice as far out",
        empty="the same extrusion everywhere",
    ),
    "straight_group": Text(
        label="Straight Group",
        tooltip="Vertex group of the low mesh that turns the rays: with a weight of 0 they follow smooth normals, "
        "0.5 changes nothing, and with 1 they follow the mesh's own normals",
        empty="the chosen directions everywhere",
    ),
    "facing_only": Switch(
        label="Ignore Backfaces", tooltip="Let the rays pass through faces of the high mesh that point away from them"
    ),
    "missed": Color(
        label="Miss Color",
        tooltip="Color of texels whose ray hits nothing. Their alpha is 0",
        default=(0.5, 0.5, 1.0),
    ),
    "mask": Switch(label="Miss Mask", tooltip="Also make an image that is white where the rays hit nothing"),
}


@dataclass(frozen=True)
class PanelSettings:
    """A panel's title, and its settings by their names."""

    title: str
    settings: dict[str, Setting]


PANELS = {
    "bake": PanelSettings("Imprint", BAKE),
    "map": PanelSettings("Map", MAP),
    "channels": PanelSettings("Channels", CHANNELS),
    "maps": PanelSettings("Maps", MAPS),
    "output": PanelSettings("Output", OUTPUT),
    "rays": PanelSettings("Rays", RAYS),
    "pairs": PanelSettings("Pairs by Name", PAIRS),
    "levels": PanelSettings("Levels of Detail", LEVELS),
    "asset": PanelSettings("Game Asset", ASSET),
    "convert": PanelSettings("Convert Map", CONVERT),
}
"""In the order of the sidebar."""
DECLARED: dict[str, Setting] = {name: value for panel in PANELS.values() for name, value in panel.settings.items()}
"""All settings by name."""
