# SPDX-License-Identifier: GPL-3.0-or-later
"""Blender's properties match the declarations of the settings, in the scene and in operators."""

import bpy
import pytest

from addon.core.declarations import kinds
from addon.core.declarations.all_settings import DECLARED, FORMER
from addon.ui import declared_properties

pytestmark = pytest.mark.usefixtures("registered")

OWN = {"rna_type", "name", "active_high", "convert_image", "names", *declared_properties.MapList.__annotations__}
"""Properties that are not settings, or that stand for a part of one."""


def holders():
    return [bpy.context.scene.imprint.bl_rna, bpy.ops.imprint.bake.get_rna_type()]


def test_a_scene_has_each_setting():
    assert {prop.identifier for prop in bpy.context.scene.imprint.bl_rna.properties} - OWN == {*DECLARED, *FORMER}


@pytest.mark.parametrize("name", DECLARED)
def test_label_limits_and_default_are_those_of_the_declaration(name):
    declared = DECLARED[name]
    for holder in holders():
        prop = holder.properties.get(name)
        if prop is None or (holder.identifier == "IMPRINT_OT_bake" and isinstance(declared, kinds.ObjectSlot)):
            continue  # operators take names of objects
        assert (prop.name, prop.description) == (declared.label, declared.panel_tooltip)
        if isinstance(declared, kinds.Choice):
            found = [(item.identifier, item.name, item.description) for item in prop.enum_items]
            assert found == [(str(item.value), item.label, item.tooltip) for item in declared.items]
        if isinstance(declared, kinds.Flags):
            assert prop.default_flag == set(declared.default)
        elif isinstance(declared, kinds.Choice):
            assert prop.default == str(declared.default)
        elif isinstance(declared, kinds.WholeNumber):
            assert (prop.hard_min, prop.hard_max) == (declared.least, declared.most)
            assert name == "size" or prop.default == declared.default
        elif isinstance(declared, kinds.Distance):
            assert prop.default == pytest.approx(declared.shown)
            # A Reach is a length only in scene units, for which the panel has another property.
            assert prop.subtype == ("NONE" if isinstance(declared, kinds.Reach) else "DISTANCE")
        elif isinstance(declared, kinds.Color):
            assert tuple(prop.default_array) == declared.default
        elif isinstance(declared, kinds.Switch | kinds.Text):
            assert prop.default == declared.default
