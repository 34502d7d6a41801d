# SPDX-License-Identifier: GPL-3.0-or-later
"""A layout that records what the panels draw."""

from types import SimpleNamespace

import bpy

import addon
from addon.ui import check_panel
from addon.ui.texts import SidebarPanel


class Layout:
    """A layout that records what a panel draws, and checks that its properties, operators and icons exist."""

    context = None
    """Of what is drawn, which lists and menus get, too."""
    ICONS = set(bpy.types.UILayout.bl_rna.functions["label"].parameters["icon"].enum_items.keys())

    def __init__(self, drawn=None, is_in_row=False, enabled=True, active=True):
        self.drawn = (
            drawn
            if drawn is not None
            else SimpleNamespace(
                labels=[],
                in_rows=[],
                icons=[],
                buttons=[],
                given=[],
                properties=[],
                bright=[],
                dim=[],
                files=[],
                red=[],
                order=[],
                rows=[],
            )
        )
        self._is_above_enabled = self._is_enabled = enabled
        self.is_in_row = is_in_row
        self.active = active

    @property
    def enabled(self):
        return self._is_enabled

    @enabled.setter
    def enabled(self, is_enabled):
        self._is_enabled = is_enabled and self._is_above_enabled

    def _part(self, **_):
        return Layout(self.drawn, self.is_in_row, self.enabled, self.active)

    column = box = split = grid_flow = _part

    def row(self, **_):
        return Layout(self.drawn, is_in_row=True, enabled=self.enabled, active=self.active)

    def panel(self, _name, **_):
        return self._part(), self._part()

    def icon(self, image):
        assert image.id_type == "IMAGE"
        return 1

    def template_icon(self, icon_value, scale):
        assert icon_value
        self.drawn.icons.append("picture")

    def progress(self, factor, text, translate=True):
        assert 0.0 <= factor <= 1.0
        self.drawn.labels.append(text)

    def menu(self, name, icon="NONE", **_):
        assert icon in self.ICONS
        getattr(bpy.types, name).draw(SimpleNamespace(layout=self), self.context)

    def popover(self, panel, icon="NONE", **_):
        assert icon in self.ICONS
        assert hasattr(bpy.types, panel)

    def separator(self, **_):
        pass

    def label(self, text="", icon="NONE", translate=True):
        assert icon in self.ICONS
        if not text:
            return
        self.drawn.labels.append(text)
        self.drawn.icons.append(icon)
        if self.is_in_row:
            self.drawn.in_rows.append(text)

    def prop(self, data, name, **_):
        assert name in data.bl_rna.properties
        self.drawn.properties.append(name)
        self._note(name)

    def _note(self, name):
        """Note that a property or a button is drawn here, and whether it looks on."""
        self.drawn.order.append(name)
        if not self.active:
            self.drawn.dim.append(name)
        if self.enabled:
            self.drawn.bright.append(name)

    def prop_search(self, data, name, source, collection, *, results_are_suggestions=False, **_):
        self.prop(data, name)
        assert collection in source.bl_rna.properties
        value = getattr(data, name)
        if value and value not in getattr(source, collection) and not results_are_suggestions:
            self.drawn.red.append(name)

    def template_ID(self, data, name, open, **_):
        self.prop(data, name)
        group, operator = open.split(".")
        getattr(getattr(bpy.ops, group), operator).get_rna_type()  # raises an error without it
        self.drawn.files.append((name, open))

    def template_list(self, list_type, _, data, name, active_data, active_name, *, rows=5, **__):
        """All items, also those that Blender would draw when the list is scrolled."""
        kind = LISTS[list_type]
        assert {name} <= set(data.bl_rna.properties.keys())
        self._note(name)
        self.drawn.rows.append((name, rows))
        assert {active_name} <= set(active_data.bl_rna.properties.keys())
        shown, items = SimpleNamespace(bitflag_filter_item=1, filter_name=""), list(getattr(data, name))
        flags = kind.filter_items(shown, self.context, data, name)[0] if hasattr(kind, "filter_items") else []
        for item in (item for item, flag in zip(items, flags or [1] * len(items), strict=True) if flag):
            kind.draw_item(None, self.context, Layout(self.drawn), data, item, 0, active_data, active_name)

    def operator(self, name, icon="NONE", **_):
        assert icon in self.ICONS
        bpy.ops.imprint.bake.get_rna_type()
        getattr(getattr(bpy.ops, name.split(".")[0]), name.split(".")[1]).get_rna_type()  # raises an error without it
        self.drawn.buttons.append((name, self.enabled))
        self.drawn.order.append(name)
        self.drawn.given.append((name, SimpleNamespace()))
        return self.drawn.given[-1][1]


class Drawn:
    """A panel while it is drawn, with its other methods."""

    def __init__(self, panel, layout):
        self.panel, self.layout = panel, layout

    def __getattr__(self, name):
        found = getattr(self.panel, name)
        return found.__get__(self) if callable(found) else found


PANELS = [
    cls
    for module in addon.modules()
    for cls in getattr(module, "CLASSES", ())
    if issubclass(cls, SidebarPanel) and cls is not check_panel.IMPRINT_PT_checks
]
"""The panels in the order in which they are registered, without that of the checks."""
LISTS = {
    cls.__name__: cls
    for module in addon.modules()
    for cls in getattr(module, "CLASSES", ())
    if issubclass(cls, bpy.types.UIList)
}


def context_of(width, ui_scale=1.0):
    """The context of a sidebar of this width: in the background there is none."""
    bpy.context.view_layer.update()
    return SimpleNamespace(
        scene=bpy.context.scene,
        window_manager=bpy.context.window_manager,
        view_layer=bpy.context.view_layer,
        evaluated_depsgraph_get=bpy.context.evaluated_depsgraph_get,
        active_object=bpy.context.active_object,
        selected_objects=bpy.context.selected_objects,
        preferences=SimpleNamespace(system=SimpleNamespace(ui_scale=ui_scale), addons={}),
        region=SimpleNamespace(width=width),
    )


def draw(width=240, ui_scale=1.0, panels=PANELS):
    """Draw panels as the sidebar does. Returns what was drawn."""
    layout, context = Layout(), context_of(width, ui_scale)
    Layout.context = context
    for panel in panels:
        if hasattr(panel, "poll") and not panel.poll(context):
            continue
        panel.draw(Drawn(panel, Layout(layout.drawn)), context)
    for name, given in layout.drawn.given:
        group, operator = name.split(".")
        assert vars(given).keys() <= set(getattr(getattr(bpy.ops, group), operator).get_rna_type().properties.keys())
    layout.drawn.text = " ".join(layout.drawn.labels)
    return layout.drawn


def fixes(drawn):
    """The kinds of the buttons that fix something, in the order in which they were drawn."""
    kinds = {"imprint.fix": lambda given: given.kind, "imprint.unwrap": lambda _: "UNWRAP"}
    return [kinds[name](given) for name, given in drawn.given if name in kinds]
