# SPDX-License-Identifier: GPL-3.0-or-later
"""The panels of the settings: map, channels, output, rays. The panel of the maps stands by itself."""

import bpy

from ...core.declarations.choices import Method, Space, Storage
from ...core.declarations.map_settings import ADAPTIVE_FROM
from .. import map_size
from ..presets import IMPRINT_PT_conventions
from ..viewport.cage_overlay import overlay
from . import maps_panel
from .sidebar import SettingsPanel, split_layout


class IMPRINT_PT_map(SettingsPanel, bpy.types.Panel):
    """Settings of the map."""

    bl_idname = "IMPRINT_PT_map"
    bl_parent_id = "IMPRINT_PT_bake"
    bl_label = "Map"

    def draw_header_preset(self, _context: bpy.types.Context) -> None:
        IMPRINT_PT_conventions.draw_panel_header(self.layout)

    def draw(self, context: bpy.types.Context) -> None:
        layout = split_layout(self.layout)
        settings = context.scene.imprint
        low, highs = settings.chosen_objects(context)
        rays = settings.rays_of(low, highs)
        layout.prop(rays, "method")
        layout.prop(settings, "space")
        if settings.space == Space.TANGENT:
            layout.prop(settings, "basis")
        if low is not None and low.type == "MESH":
            layout.prop_search(settings, "uv_layer", low.data, "uv_layers", icon="GROUP_UVS")
        map_size.draw(layout, settings)
        layout.prop(settings, "samples")
        row = layout.row()
        row.active = rays.method != Method.FLATTEN and int(settings.samples) >= ADAPTIVE_FROM
        row.prop(settings, "adaptive")
        column = layout.column(align=True)
        column.prop(settings, "margin_type")
        row = column.row(align=True)
        row.active = not settings.unlimited
        row.prop(settings, "margin")
        column.prop(settings, "unlimited")
        column.prop(settings, "mips")
        layout.prop(settings, "stacked")
        layout.prop(settings, "modifiers")
        column = layout.column(align=True)
        column.prop(settings, "limited")
        if settings.limited:
            column.prop(settings, "limit")


class IMPRINT_PT_channels(SettingsPanel, bpy.types.Panel):
    """The content of each channel. The presets in the header of the Map panel set it."""

    bl_idname = "IMPRINT_PT_channels"
    bl_parent_id = "IMPRINT_PT_map"
    bl_label = "Channels"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context: bpy.types.Context) -> None:
        layout = split_layout(self.layout)
        column = layout.column(align=True)
        for name in ("red", "green", "blue"):
            column.prop(context.scene.imprint, name)


class IMPRINT_PT_readers(SettingsPanel, bpy.types.Panel):
    """The programs that the report answers for."""

    bl_idname = "IMPRINT_PT_readers"
    bl_parent_id = "IMPRINT_PT_map"
    bl_label = "Readers"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context: bpy.types.Context) -> None:
        settings = context.scene.imprint
        column = self.layout.column(align=True)
        column.active = settings.space == Space.TANGENT
        column.prop(settings, "readers")


class IMPRINT_PT_output(SettingsPanel, bpy.types.Panel):
    """Where the map is stored."""

    bl_idname = "IMPRINT_PT_output"
    bl_parent_id = "IMPRINT_PT_bake"
    bl_label = "Output"

    def draw(self, context: bpy.types.Context) -> None:
        layout = split_layout(self.layout)
        settings = context.scene.imprint
        # A name for a new image is not among those that exist, and a search field would be red.
        layout.prop_search(settings, "image", bpy.data, "images", results_are_suggestions=True)
        layout.prop(settings, "depth", expand=True)
        if settings.depth == "8":
            layout.prop(settings, "dither")
        layout.prop(settings, "udim")
        if settings.udim:
            layout.prop(settings, "tiles")
        layout.prop(settings, "storage")
        if settings.storage == Storage.FILE:
            layout.prop(settings, "output")
            layout.prop(settings, "alpha")
            layout.prop(settings, "mip_files")
        layout.prop(settings, "material")
        row = layout.row()
        row.enabled = settings.material
        row.prop(settings, "single_user")
        layout.prop(settings, "show_result")
        layout.prop(settings, "export")


class IMPRINT_PT_rays(SettingsPanel, bpy.types.Panel):
    """Where rays start and end."""

    bl_idname = "IMPRINT_PT_rays"
    bl_parent_id = "IMPRINT_PT_bake"
    bl_label = "Rays"

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        settings = context.scene.imprint
        return settings.rays_of(*settings.chosen_objects(context)).method != Method.FLATTEN

    def draw(self, context: bpy.types.Context) -> None:
        layout = split_layout(self.layout)
        settings = context.scene.imprint
        low, highs = settings.chosen_objects(context)
        rays = settings.rays_of(low, highs)
        found = context.window_manager.imprint_found
        layout.prop(settings, "hit")
        layout.prop(rays, "cage")
        layout.prop(rays, "measure")
        column = layout.column(align=True)
        if rays.measure:
            column.enabled = False
            column.prop(found, "extrusion")
            column.prop(found, "max_distance")
            layout.operator("imprint.freeze_distances", icon="FREEZE")
        else:
            column.prop(rays, "extrusion")
            column.prop(rays, "max_distance")
        layout.operator("imprint.show_cage", icon="MESH_UVSPHERE", depress=overlay.is_on)
        layout.prop(settings, "directions")
        if low is not None and low.type == "MESH":
            for name in ("offset_group", "straight_group"):
                layout.prop_search(settings, name, low, "vertex_groups", icon="GROUP_VERTEX")
            layout.operator("imprint.propose_weights", icon="MOD_VERTEX_WEIGHT")
        layout.prop(settings, "facing_only")
        layout.prop(settings, "missed")
        layout.prop(settings, "mask")


# Blender draws them in the order of registration.
CLASSES = (
    IMPRINT_PT_map,
    IMPRINT_PT_channels,
    IMPRINT_PT_readers,
    *maps_panel.CLASSES,
    IMPRINT_PT_output,
    IMPRINT_PT_rays,
)
register, unregister = bpy.utils.register_classes_factory(CLASSES)
