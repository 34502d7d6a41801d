# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests what the button bakes where several objects are selected: one from the others, or each for itself."""

import bpy
import numpy as np
import pytest

from addon.ui import bake_panel, object_pairs, properties, results, several
from addon.ui.live import live
from tests.support import panel_layout
from tests.support.panel import select, use

pytestmark = pytest.mark.usefixtures("registered", "gpu_context")

SIDE = 64


def cube(name, x=0.0, size=2.0):
    bpy.ops.mesh.primitive_cube_add(location=(x, 0.0, 0.0), size=size)
    bpy.context.object.name = name
    return bpy.context.object


@pytest.fixture
def props():
    """Three cubes side by side, the first of which is active."""
    objects = [cube(name, 2.0 * number) for number, name in enumerate(("lamp", "table", "vase"))]
    select(*objects)
    use(size=SIDE, normal=False, maps={"AO", "POSITION"}, storage="MEMORY", samples="1", rays=16)
    return objects


def chosen():
    return {
        one.low.name: [high.name for high in one.highs] for one in bpy.context.scene.imprint.all_chosen(bpy.context)
    }


def texels(name):
    image = bpy.data.images[name]
    values = np.empty(len(image.pixels), np.float32)
    image.pixels.foreach_get(values)
    return values


def drawn():
    return panel_layout.draw(panels=[bake_panel.IMPRINT_PT_bake])


def test_objects_side_by_side_are_baked_each_onto_itself(props):
    assert chosen() == {name: [name] for name in ("lamp", "table", "vase")}
    labels = drawn().text
    assert (
        "Bakes the materials and the shape of 3 objects, each onto itself: 64 x 64, into images such as 'lamp_position'."
        in labels
    )
    assert bpy.ops.imprint.bake() == {"FINISHED"}
    baked = {obj.name: texels(f"{obj.name}_position") for obj in props}
    for obj in props:
        assert object_pairs.of(obj).is_own
        select(obj)
        assert bpy.ops.imprint.bake() == {"FINISHED"}
        np.testing.assert_array_equal(texels(f"{obj.name}_position"), baked[obj.name])


@pytest.mark.parametrize(
    "says", ["high name", "cage name", "pair", "flatten", "cage", "over", "within reach", "slot", "no mesh"]
)
def test_what_says_that_one_is_high_makes_it_a_pair(props, says):
    lamp, table, vase = props
    settings = bpy.context.scene.imprint
    assert len(chosen()) == 3  # what is kept of it is not what counts afterwards
    if says == "high name":
        table.name = "lamp_high"
    elif says == "cage name":
        table.name = "lamp_cage"
    elif says == "pair":
        lamp.imprint.put([table])
    elif says == "flatten":
        settings.method = "FLATTEN"
    elif says == "cage":
        settings.cage = cube("hull")
        select(*props)
    elif says == "over":
        table.location.x = 0.1
        bpy.context.view_layer.update()
    elif says == "within reach":
        for obj in (lamp, table):
            obj.scale.z = 0.0001
        table.location = (0.0, 0.0, 0.3)
        bpy.context.view_layer.update()
    elif says == "slot":
        settings.low = lamp
    else:
        bpy.ops.mesh.primitive_cube_add(location=(9.0, 0.0, 0.0))
        curve = bpy.data.objects.new("curve", bpy.data.curves.new("curve", "CURVE"))
        bpy.context.scene.collection.objects.link(curve)
        select(*props, curve)
    found = chosen()
    assert list(found) == ["lamp"]
    assert len(found["lamp"]) >= 2 or says == "pair"


def test_what_stands_on_a_ground_is_not_its_high_object(props):
    bpy.ops.mesh.primitive_plane_add(size=30.0, location=(0.0, 0.0, -1.0))
    bpy.context.object.name = "ground"
    select(*props, bpy.context.object)
    assert chosen() == {name: [name] for name in ("lamp", "table", "vase", "ground")}
    select(bpy.data.objects["ground"], *props)
    assert len(chosen()) == 4


def test_a_button_bakes_each_onto_itself_where_they_lie_over_one_another(props):
    props[1].location.x = 0.1
    bpy.context.view_layer.update()
    (button,) = [given for name, given in drawn().given if name == "imprint.bake" and vars(given)]
    assert button.each
    assert bpy.ops.imprint.bake(each=True) == {"FINISHED"}
    assert {obj.name for obj in props if object_pairs.of(obj).is_own} == {"lamp", "table", "vase"}


def test_one_with_a_high_object_and_another_without_are_baked_as_each_is(props):
    lamp, table, vase = props
    lamp.name = "lamp_low"
    high = cube("lamp_high")
    other = cube("shape", 2.0)
    select(table, other)
    assert bpy.ops.imprint.bake() == {"FINISHED"}
    select(*props)
    assert chosen() == {"lamp_low": ["lamp_high"], "table": ["shape"], "vase": ["vase"]}
    assert "Bakes 3 objects, each onto itself or with the detail of its pair" in drawn().text
    high.hide_set(True)
    table.imprint.method = "CAST"
    assert bpy.ops.imprint.bake() == {"FINISHED"}
    reports = {low.name: found[0] for low, found in results.of_scene(bpy.context)}
    assert {name: one.high for name, one in reports.items()} == chosen()
    assert [reports[name].method for name in ("table", "vase")] == ["CAST", "FLATTEN"]


def test_one_without_uvs_is_left_out_and_told(props):
    props[1].data.uv_layers.remove(props[1].data.uv_layers[0])
    panel = drawn()
    assert "'table' has no UV layer: unwrap it first." in panel.text
    assert [given.low for name, given in panel.given if name == "imprint.unwrap"] == ["table"]
    assert "imprint.make_asset" not in panel.buttons  # it takes all that is selected
    assert bpy.ops.imprint.bake() == {"FINISHED"}
    assert [name for name, _ in results.batch().left_out] == ["table"]
    assert bpy.ops.imprint.unwrap(low="table") == {"FINISHED"}
    assert bpy.ops.imprint.bake() == {"FINISHED"}
    assert not results.batch().left_out


def test_one_image_for_all_at_one_texel_density(props):
    settings = bpy.context.scene.imprint
    settings.share_image = True
    assert bpy.ops.imprint.pack_uvs(selected=True) == {"FINISHED"}
    assert bpy.ops.imprint.bake() == {"FINISHED"}
    assert {image.name for image in bpy.data.images if image.name.endswith(("_ao", "_position"))} == {
        "atlas_ao",
        "atlas_position",
    }
    position = texels("atlas_position").reshape(SIDE, SIDE, 4)
    assert np.count_nonzero(position[..., 3] > 0.0) > 0.3 * SIDE * SIDE


def test_live_follows_the_active_one_alone(props):
    assert bpy.ops.imprint.live() == {"FINISHED"}
    try:
        assert live.description == "Live: 'lamp' follows its mesh."
    finally:
        bpy.ops.imprint.live()


def test_textures_are_read_by_their_own_uv_map_after_an_unwrap(props):
    """Six faces fill the map with two materials. Unwrap keeps that UV map for the textures and gives a new one to the bake."""
    lamp, *_ = props
    select(lamp)
    use(size=128, normal=False, maps={"BASE_COLOR", "POSITION"}, depth="32", margin=0)
    image = bpy.data.images.new("ramp", SIDE, SIDE, float_buffer=True)
    image.colorspace_settings.name = "Non-Color"
    v, u = (np.mgrid[:SIDE, :SIDE] + 0.5) / SIDE
    image.pixels.foreach_set(np.dstack([u, v, u * 0.0, u * 0.0 + 1.0]).astype(np.float32).ravel())
    for name in ("one", "two"):
        material = bpy.data.materials.new(name)
        tree = material.node_tree
        texture = tree.nodes.new("ShaderNodeTexImage")
        texture.image = image
        base = tree.nodes["Principled BSDF"].inputs["Base Color"]
        if name == "one":
            tree.links.new(texture.outputs["Color"], base)
        lamp.data.materials.append(material)
    for polygon in lamp.data.polygons:
        polygon.material_index = int(abs(polygon.normal.z) < 0.5)
        for corner in polygon.loop_indices:
            place = lamp.data.vertices[lamp.data.loops[corner].vertex_index].co * 0.5
            lamp.data.uv_layers[0].uv[corner].vector = (place.x + 0.5, place.y + place.z + 0.5)
            if polygon.normal.z > 0.5:
                lamp.data.uv_layers[0].uv[corner].vector = (place.x + 0.5, place.y + 0.5)
    assert bpy.ops.imprint.bake() == {"FINISHED"}
    panel = panel_layout.draw()
    assert "belong to faces of different materials ('one', 'two')" in panel.text
    assert "imprint.unwrap" in [name for name, _ in panel.buttons]
    assert bpy.ops.imprint.unwrap() == {"FINISHED"}
    assert [layer.active_render for layer in lamp.data.uv_layers] == [True, False]
    assert "Bakes the materials and the shape of 'lamp' itself" in drawn().text
    assert bpy.ops.imprint.bake() == {"FINISHED"}
    position, color = (texels(f"lamp_{name}").reshape(128, 128, 4) for name in ("position", "base_color"))
    assert (color[..., 3] > 0.0).mean() > 0.3
    is_top = (position[..., 3] > 0.0) & (position[..., 2] > 0.999) & (np.abs(position[..., :2]) < 0.96).all(axis=-1)
    assert np.count_nonzero(is_top) > 300
    np.testing.assert_allclose(color[is_top, :2], 0.5 + 0.5 * position[is_top, :2], atol=1e-3)


# What a redraw costs


@pytest.fixture
def counted(monkeypatch):
    """How often a redraw measures boxes, and reads the settings."""
    calls = []
    for owner, name in ((several, "boxes"), (properties.ImprintSettings, "to_settings")):
        original = getattr(owner, name)
        monkeypatch.setattr(
            owner,
            name,
            lambda *given, _original=original, _name=name, **how: calls.append(_name) or _original(*given, **how),
        )
    return calls


def test_boxes_are_measured_only_where_an_object_has_changed(props, counted):
    panel_layout.draw()
    panel_layout.draw()
    assert counted.count("boxes") == 1
    props[1].location.x = 0.1
    drawn()
    assert counted.count("boxes") == 3  # now that they lie over one another, whether the pair fits, too
    assert list(chosen()) == ["lamp"]
    props[1].location.x = 2.0
    bpy.context.view_layer.update()
    assert len(chosen()) == 3
    props[2].name = "lamp_high"
    assert list(chosen()) == ["lamp"]


def test_the_settings_of_one_pair_are_read_once_a_panel(props, counted):
    select(props[0])
    drawn()
    assert counted.count("to_settings") == 1
    select(*props)
    counted.clear()
    drawn()
    assert counted.count("to_settings") <= bake_panel.MOST_CHECKED + 1
