# SPDX-License-Identifier: GPL-3.0-or-later
"""The settings of the views. They do not change the map."""

import bpy
from bpy.props import EnumProperty, FloatProperty, PointerProperty

from ...views.mode_names import ITEMS, READERS, Mode
from ..translations import LABEL
from .view_mode import viewer


def _get_mode(_view: bpy.types.PropertyGroup) -> int:
    return list(Mode).index(viewer.mode)


def _set_mode(_view: bpy.types.PropertyGroup, number: int) -> None:
    viewer.choose(list(Mode)[number])


def _read_again(_view: bpy.types.PropertyGroup, _context: bpy.types.Context) -> None:
    viewer.read_again()


def _is_light(_view: bpy.types.PropertyGroup, obj: bpy.types.Object) -> bool:
    return obj.type == "LIGHT"


class ImprintView(bpy.types.PropertyGroup):
    """Scene.imprint_view: what the 3D viewports show of the map. The mode belongs to the session and is not saved."""

    mode: EnumProperty(
        name="View",
        description="What the 3D viewport shows",
        items=ITEMS,
        get=_get_mode,
        set=_set_mode,
        options=set(),
        translation_context=LABEL,
    )
    reader: EnumProperty(
        name="Reader",
        description="Program as which the view reads a tangent-space map. It shows what the program would show of this map",
        items=READERS,
        update=_read_again,
        options=set(),
        translation_context=LABEL,
    )
    light: PointerProperty(
        type=bpy.types.Object,
        name="Light",
        description="The light that shines on the mesh; without one, a light that follows the view",
        poll=_is_light,
        translation_context=LABEL,
    )
    split: FloatProperty(
        name="Line",
        description="Position of the line between high and low, as a share of the view's width",
        default=0.4,  # left of the middle, because the sidebar covers the right end
        min=0.0,
        max=1.0,
        subtype="FACTOR",
        translation_context=LABEL,
    )
    limit: FloatProperty(
        name="Range",
        description="Degrees at the end of the color scale",
        default=5.0,
        min=0.01,
        max=180.0,
        soft_max=45.0,
        translation_context=LABEL,
    )


CLASSES = (ImprintView,)
_register, _unregister = bpy.utils.register_classes_factory(CLASSES)


def register() -> None:
    _register()
    bpy.types.Scene.imprint_view = PointerProperty(type=ImprintView)


def unregister() -> None:
    del bpy.types.Scene.imprint_view
    _unregister()
