# SPDX-License-Identifier: GPL-3.0-or-later
"""The settings of the panel Output, in its order."""

from .. import file_formats, udim
from ..file_formats import USUAL_DEPTH
from ..udim import TOKEN
from .choices import Storage
from .kinds import Choice, FilePath, Item, Option, Setting, Switch, Text, Tiles

OUTPUT: dict[str, Setting] = {
    "image": Text(
        label="Image",
        tooltip="Name of the image to fill. {low} in it stands for the low object's name",
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
        f"{{low}} in the path stands for the low object's name, {TOKEN} for the tile's number",
        option=Option(metavar="MAP", note="For mesh files, {low} is the name of the low mesh's file"),
    ),
    "alpha": Switch(
        label="Alpha",
        tooltip="Files have an alpha channel, which is 0 on the background and where rays hit nothing. Without it they are "
        "smaller",
        default=True,
        option=Option(
            word="no-alpha",
            off="Write files without an alpha channel. Then only the mask shows which texels were missed",
        ),
    ),
    "mip_files": Switch(
        label="Mip Levels",
        tooltip="Also write the smaller mip levels to files, such as rock_normal_mip1.png. They average what the map covers, "
        "and widened roughness keeps what the mean of the normals loses",
    ),
    "material": Switch(
        label="Material",
        tooltip="Add the map to the low object's material",
        default=True,
        option=Option(word="no-material", off="Leave the low object's material as it is"),
    ),
    "export": FilePath(
        label="Export",
        tooltip=f"File for an engine: {file_formats.listed_meshes()}. It gets the low mesh in the triangles that were "
        "baked, with its tangents and its maps. {low} in the path stands for the low object's name",
        option=Option(
            metavar="MESH",
            note="Imprint reads the file back, and reports by how many degrees normals differ from those that were baked",
        ),
    ),
    "single_user": Switch(
        label="Single User",
        tooltip="Copy materials that other objects use as well, so that those objects keep their look",
    ),
    "show_result": Switch(
        label="Show Result",
        tooltip="After a bake, show the map in an open Image Editor and the low mesh with it in the 3D viewport: "
        "with Material Preview instead of Solid, and the high objects hidden",
        default=True,
        option=None,
    ),
}
