# SPDX-License-Identifier: GPL-3.0-or-later
"""The views of the map: they can be turned on and off, show the objects as they are, and leave nothing when off."""

from types import SimpleNamespace

import bpy
import numpy as np
import pytest
from mathutils import Matrix
from PIL import Image

import addon
from addon.core.errors import BakeError
from addon.core.map_types import WRITTEN
from addon.passes import allocation, target
from addon.ui import progress_display, view_labels, views
from addon.ui.live import live
from addon.ui.view_panel import HEADLIGHT
from addon.ui.view_shading import SHOWN, Mode
from addon.ui.views import viewer
from tests.support import angles, panel_layout, raster, zoo
from tests.support.panel import add
from tests.support.snapshot import difference, snapshot

pytestmark = pytest.mark.usefixtures("gpu_context", "registered")

SIZE = (160, 120)


@pytest.fixture
def pair():
    """A low terrain and a high one, in the slots."""
    low, high = zoo.terrains_in_slots("FLATTEN")
    yield low, high
    live.stop()
    viewer.off()


def view():
    """The settings of the views. After Undo or in a new file, Blender has a new object for them."""
    return bpy.context.scene.imprint_view


def viewport():
    """The window, area and region of a 3D viewport."""
    window = bpy.context.window_manager.windows[0]
    area = next(area for area in window.screen.areas if area.type == "VIEW_3D")
    return {"window": window, "area": area, "region": next(r for r in area.regions if r.type == "WINDOW")}


def region_view():
    """The view of that viewport, which looks down on the origin."""
    data = viewport()["area"].spaces.active.region_3d
    data.view_matrix = Matrix(raster.look_at((1.0, -3.0, 3.0), (0.0, 0.0, 0.0)))
    data.update()
    return data


def drawn_pixels():
    """The pixels that the draw callbacks draw into the viewport: (H, W, 4) float32."""
    region_view()
    into = target.Target(*SIZE, ("RGBA32F", "DEPTH_COMPONENT32F"))
    with bpy.context.temp_override(**viewport()), target.drawing(into):
        into.framebuffer.clear(depth=1.0)
        viewer.draw()
        pixels = np.empty((SIZE[1], SIZE[0], 4), np.float32)
        into.read(pixels)
    return pixels


@pytest.mark.parametrize("mode", SHOWN)
def test_a_view_leaves_nothing_when_turned_off(mode, pair):
    before = snapshot()
    view().mode = mode
    assert view().mode == viewer.mode == mode
    assert drawn_pixels().any()
    view().mode = mode  # a second call does nothing
    view().mode = "OFF"
    assert viewer.is_idle
    assert not difference(before, snapshot())


def test_the_views_differ_and_a_key_shows_the_next_one(pair):
    pictures = []
    for mode in (*SHOWN, "OFF"):
        assert bpy.ops.imprint.view_next() == {"FINISHED"}
        assert viewer.mode == mode
        pictures.append(drawn_pixels() if mode != "OFF" else np.zeros_like(pictures[0]))
    for number, picture in enumerate(pictures):
        assert not any(np.array_equal(picture, other) for other in pictures[:number])


def test_the_deviations_are_shown_as_text(pair):
    view().mode = "MAP"
    assert viewer.deviations is None
    assert view_labels.describe_deviations(viewer.deviations) == []
    view().mode = "BARE_DEVIATION"
    found = viewer.deviations
    assert found.percentile_99 < 0.1
    assert found.bare_mean > 1.0
    assert view_labels.describe_deviations(viewer.deviations) == [
        f"With the map: mean {found.mean:.2f}°, 99 % below {found.percentile_99:.2f}°",
        f"Without: mean {found.bare_mean:.2f}°, 99 % below {found.bare_percentile_99:.2f}°",
    ]


def test_a_view_reads_the_map_as_the_chosen_program_does(pair):
    bpy.context.scene.imprint.basis = "CYCLES"
    view().target = "directx"  # while no view is on
    view().mode = "DEVIATION"
    wrong, seen = viewer.deviations, drawn_pixels()
    view().target = "OWN"
    assert viewer.deviations.percentile_99 < 0.1
    assert wrong.mean > 5.0
    assert not np.array_equal(drawn_pixels(), seen)
    view().target = "directx"
    assert viewer.deviations == wrong
    bpy.context.scene.imprint.space = "OBJECT"
    assert bpy.ops.imprint.view_refresh() == {"FINISHED"}
    assert viewer.deviations.percentile_99 < 0.1  # it has no basis


def test_the_panel_says_that_a_program_reads_green_upside_down(pair):
    bpy.context.scene.imprint.green = "+Y"
    view().mode = "DEVIATION"
    view().target = "unreal"
    assert (
        "Unreal Engine reads green as -Y, and the map stores +Y: the setting Engine: Unreal Engine sets it."
        in panel_layout.draw(width=2000).text
    )
    view().target = "unity"
    assert "reads green" not in panel_layout.draw(width=2000).text
    view().target = "OWN"
    assert "reads green" not in panel_layout.draw(width=2000).text


def test_the_loss_of_the_format_is_that_of_its_file(pair, tmp_path):
    """Also after a bake, when the image has what was stored."""
    settings = bpy.context.scene.imprint
    settings.storage, settings.depth, settings.lossy_normals, settings.quality = "FILE", "8", True, 80
    settings.output = str(tmp_path / "m.jpg")
    assert bpy.ops.imprint.bake() == {"FINISHED"}
    view().mode = "DEVIATION"  # adopts the image
    seen = drawn_pixels()
    view().mode = "FORMAT"
    found = viewer.deviations
    assert not np.array_equal(drawn_pixels(), seen)
    assert view_labels.describe_deviations(found) == [
        f"JPEG, quality 80: mean {found.mean:.2f}°, 99 % below {found.percentile_99:.2f}°"
    ]
    texels, state = viewer.session.normals
    read = np.asarray(Image.open(settings.output).convert("RGB"), float)[::-1] / 255.0
    off = angles.degrees(angles.decode(read), angles.decode(texels))[state == WRITTEN]
    assert found.mean == pytest.approx(off.mean(), rel=1e-3)
    assert found.percentile_99 == pytest.approx(np.percentile(off, 99), rel=1e-3)
    settings.quality = 30
    viewer.catch_up()
    assert viewer.deviations.mean > 1.5 * found.mean
    settings.format, settings.most_degrees = "AUTO", 3.0
    viewer.catch_up()
    assert 1.0 < viewer.deviations.percentile_99 <= 3.0
    view().mode = "DEVIATION"  # what else is shown stays the same
    assert not np.array_equal(drawn_pixels(), np.zeros_like(seen))


def test_unmeasured_deviations_are_shown_as_text(pair):
    _, high = pair
    uv = np.array([corner.vector for corner in high.data.uv_layers[0].uv])
    high.data.uv_layers[0].uv.foreach_set("vector", (uv + (0.3, 0.0)).astype(np.float32).ravel())
    view().mode = "DEVIATION"
    (line,) = view_labels.describe_deviations(viewer.deviations)
    assert line.startswith("Purple: 100.0% shows another place of the high mesh")


def test_a_map_of_the_view_is_as_large_as_fits_on_the_gpu_at_once(pair, monkeypatch):
    monkeypatch.setenv(allocation.VARIABLE, "64")
    bpy.context.scene.imprint.width = bpy.context.scene.imprint.height = 1024
    view().mode = "MAP"
    assert viewer.message == ""
    assert viewer.session.settings.sampling.size == (512, 512)  # 158 bytes a texel
    assert drawn_pixels().any()


def test_the_picture_of_a_bake_is_in_one_part_of_quad_view():
    parts = [SimpleNamespace(type="WINDOW", x=x, y=y, width=300) for x in (20, 320) for y in (400, 10)]
    area = SimpleNamespace(regions=[SimpleNamespace(type="HEADER", x=0, y=0, width=600), *parts])
    assert [part for part in parts if progress_display.is_first(area, part)] == [parts[1]]
    area.regions = parts[:1]  # without Quad View
    assert progress_display.is_first(area, parts[0])


def test_a_view_that_cannot_be_shown_reports_why_and_stays_off(pair):
    bpy.context.scene.imprint.highs.add().object = pair[0]
    view().mode = "MAP"
    assert viewer.message.startswith("'lo' is both the low object and one of several high objects")
    assert viewer.is_idle
    with pytest.raises(RuntimeError, match="'lo' is both"):
        bpy.ops.imprint.view_next()
    with pytest.raises(BakeError, match="'lo' is both"):
        viewer.switch(bpy.context, Mode.SPLIT)
    assert viewer.is_idle
    bpy.context.scene.imprint.highs.remove(1)
    view().mode = "MAP"
    assert (viewer.mode, viewer.message) == ("MAP", "")


def test_views_do_not_depend_on_the_output_settings(pair):
    """A view needs no file, no material and no UDIM tile."""
    settings = bpy.context.scene.imprint
    settings.storage, settings.output, settings.udim = "FILE", "", True
    view().mode = "MAP"
    assert viewer.mode == "MAP"
    assert not bpy.data.images
    assert not pair[0].material_slots


def test_refresh_shows_changes(pair):
    view().mode = "BARE_DEVIATION"
    before = viewer.deviations.bare_mean
    assert not viewer.is_outdated(bpy.context)
    bpy.context.scene.imprint.width = 128
    assert viewer.is_outdated(bpy.context)
    pair[1].scale.z = 2.0
    assert viewer.deviations.bare_mean == before
    assert bpy.ops.imprint.view_refresh() == {"FINISHED"}
    assert not viewer.is_outdated(bpy.context)
    assert viewer.deviations.bare_mean > 1.5 * before
    assert viewer.shading.session.map.width == 128
    bpy.context.scene.imprint.highs.add().object = pair[0]
    with pytest.raises(RuntimeError, match="'lo' is both"):
        bpy.ops.imprint.view_refresh()
    assert viewer.is_idle
    assert not bpy.ops.imprint.view_refresh.poll()


def test_a_view_uses_the_map_of_live_while_it_is_on(pair):
    view().mode = "BARE_DEVIATION"
    before = viewer.deviations.bare_mean
    assert bpy.ops.imprint.live() == {"FINISHED"}
    viewer.catch_up()
    assert viewer.own is None
    assert viewer.shading.session is live.session
    pair[1].scale.z = 2.0
    bpy.context.view_layer.update()
    for _ in range(100):
        live.tick()
    assert viewer.deviations.bare_mean > 1.5 * before
    assert drawn_pixels().any()
    assert bpy.ops.imprint.live() == {"FINISHED"}
    assert not drawn_pixels().any()  # nothing is baked while a view is being drawn
    assert viewer.timer.is_running
    viewer.catch_up()
    assert viewer.own is not None
    assert drawn_pixels().any()
    viewer.off()
    assert viewer.is_idle


def test_a_view_that_cannot_continue_after_live_reports_why(pair):
    assert bpy.ops.imprint.live() == {"FINISHED"}
    view().mode = "MAP"
    assert viewer.own is None
    bpy.data.objects.remove(pair[1])
    bpy.context.view_layer.update()
    bpy.ops.imprint.live()
    viewer.catch_up()
    assert viewer.message.startswith("'hi' is not in this file")
    assert viewer.is_idle


def test_deleted_and_hidden_objects_are_not_drawn(pair):
    view().mode = "MAP"
    assert drawn_pixels().any()
    pair[0].hide_set(True)
    assert not drawn_pixels().any()
    pair[0].hide_set(False)
    assert drawn_pixels().any()
    bpy.data.objects.remove(pair[0])
    for mode in SHOWN:
        view().mode = mode
        assert not drawn_pixels()[40:].any()  # above the legend


def test_a_view_outlives_undo_and_modes(pair):
    bpy.ops.ed.undo_push(message="before")
    pair[0].location.x = 0.5
    bpy.ops.ed.undo_push(message="moved")
    view().mode = "SPLIT"
    moved = drawn_pixels()
    bpy.ops.ed.undo()
    assert viewer.mode == "SPLIT"
    assert drawn_pixels().any()
    assert not np.array_equal(drawn_pixels(), moved)
    bpy.context.view_layer.objects.active = bpy.data.objects["lo"]
    for mode in ("EDIT", "SCULPT", "OBJECT"):
        bpy.ops.object.mode_set(mode=mode)
        assert drawn_pixels().any()
        assert bpy.ops.imprint.view_refresh() == {"FINISHED"}


@pytest.mark.parametrize("kind", ["SUN", "POINT", "SPOT", "AREA"])
def test_a_light_of_the_scene_lights_the_view(kind, pair):
    view().mode = "MAP"
    by_the_view = drawn_pixels()
    light = add("light", bpy.data.lights.new("light", kind))
    light.matrix_world = Matrix(raster.look_at((-2.0, 0.0, 0.5), (0.0, 0.0, 0.0))).inverted()
    bpy.context.view_layer.update()
    view().light = light
    expected = light.matrix_world.col[2 if kind == "SUN" else 3]
    assert np.array_equal(views.eye(region_view(), light, HEADLIGHT).light, expected)
    assert views.eye(region_view(), light, HEADLIGHT).light[3] == (kind != "SUN")
    assert not np.array_equal(drawn_pixels(), by_the_view)
    bpy.data.objects.remove(light)
    assert view().light is None
    assert np.array_equal(drawn_pixels(), by_the_view)


def test_the_line_of_the_split_can_be_moved(pair):
    view().mode = "SPLIT"
    pictures = []
    for split in (0.0, 0.5, 1.0):
        view().split = split
        pictures.append(drawn_pixels())
    assert not np.array_equal(pictures[0], pictures[1])
    assert not np.array_equal(pictures[1], pictures[2])


def test_opening_another_file_turns_the_view_off(pair):
    view().mode = "SPLIT"
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    assert viewer.is_idle
    assert view().mode == "OFF"


def test_disabling_the_add_on_turns_the_view_off(pair):
    view().mode = "DEVIATION"
    addon.unregister()
    try:
        assert viewer.is_idle
        assert not hasattr(bpy.types.Scene, "imprint_view")
    finally:
        addon.register()


def test_a_key_shows_the_next_view():
    keymap = bpy.context.window_manager.keyconfigs.addon.keymaps["3D View"]
    items = [item for item in keymap.keymap_items if item.idname == "imprint.view_next"]
    assert [(item.type, item.ctrl, item.alt) for item in items] == [("N", True, True)]
    addon.unregister()
    try:
        assert not [item for item in keymap.keymap_items if item.idname.startswith("imprint.")]
    finally:
        addon.register()
