# SPDX-License-Identifier: GPL-3.0-or-later
"""What makes maps survive in files: the low object is a user of its maps, and maps in memory are packed."""

import bpy
from bpy.app.handlers import persistent
from bpy.props import CollectionProperty, PointerProperty

from ..output import datablocks
from .translations.lookup import LABEL


class ImprintMap(bpy.types.PropertyGroup):
    """Object.imprint_maps: an image that was baked for the object, which takes it along into other files."""

    image: PointerProperty(
        type=bpy.types.Image,
        name="Image",
        description="Image that was baked for the object",
        translation_context=LABEL,
    )


@persistent  # it stays for the next file
def before_saving(*_) -> None:
    """Called by Blender before it saves a file, which would have an empty image in place of a map in memory."""
    datablocks.pack_unpacked()


CLASSES = (ImprintMap,)
_register, _unregister = bpy.utils.register_classes_factory(CLASSES)


def register() -> None:
    _register()
    bpy.types.Object.imprint_maps = CollectionProperty(type=ImprintMap, name="Maps", translation_context=LABEL)
    bpy.app.handlers.save_pre.append(before_saving)


def unregister() -> None:
    bpy.app.handlers.save_pre.remove(before_saving)
    del bpy.types.Object.imprint_maps
    _unregister()
