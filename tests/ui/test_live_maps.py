# SPDX-License-Identifier: GPL-3.0-or-later
"""Live draws the other maps when editing pauses: into their images at once, and into files when it is switched off."""

import bpy
import numpy as np
import pytest

from addon.core.errors import BakeError
from addon.core.settings import Settings
from addon.jobs import bake_pair
from addon.ui import bake_results, live_following, results_panel
from addon.ui.live import LiveState, live
from tests.support import panel_layout, zoo
from tests.support.following import follow
from tests.support.maps import pixels
from tests.support.panel import use

pytestmark = pytest.mark.usefixtures("gpu_context", "registered")


@pytest.fixture
def pair(monkeypatch):
    """A low terrain and a high one with a material, small maps, and no waiting for a pause in editing."""
    low, high = zoo.terrain("lo", n=8), zoo.terrain("hi", n=24, height=0.15)
    high.data.materials.append(bpy.data.materials.new("paint"))
    use(low, high, size=32, method="FLATTEN", material=False, rays=16)
    monkeypatch.setattr(live, "rest", 0.0)
    yield low, high
    live.stop()


def baked():
    """The texels of all images after a new bake, by name."""
    live.stop()
    assert bpy.ops.imprint.bake() == {"FINISHED"}
    return images()


def raise_middle(high):
    """Move vertices, as a stroke does."""
    for vertex in high.data.vertices:
        vertex.co.z += 0.2 * max(0.0, 0.4 - vertex.co.xy.length)
    high.data.update()


def images():
    return {image.name: pixels(image) for image in bpy.data.images if image.name.startswith("lo")}


def same(found, expected):
    return found.keys() == expected.keys() and all(np.array_equal(found[name], expected[name]) for name in found)


@pytest.mark.parametrize("method", ["FLATTEN", "CAST"])
def test_other_maps_equal_those_of_a_bake_after_each_change(pair, method):
    _, high = pair
    settings = bpy.context.scene.imprint
    settings.method = method
    settings.maps, settings.pack = {"AO", "CURVATURE", "BASE_COLOR", "HEIGHT"}, "GLTF"
    bpy.ops.imprint.live()
    follow()
    names = {"lo_normal", "lo_ao", "lo_curvature", "lo_base_color", "lo_height", "lo_orm"}
    before = images()
    assert before.keys() == names
    raise_middle(high)
    follow()
    after = images()
    assert not np.array_equal(after["lo_ao"], before["lo_ao"])
    assert not np.array_equal(after["lo_normal"], before["lo_normal"])
    assert same(after, baked())


def test_maps_of_live_have_buttons_too(pair):
    assert bpy.ops.imprint.bake() == {"FINISHED"}
    bpy.context.scene.imprint.maps = {"AO"}
    bpy.ops.imprint.live()
    follow()
    live.stop()
    drawn = panel_layout.draw(panels=[results_panel.IMPRINT_PT_results])
    assert [given.image for name, given in drawn.given if name == "imprint.show_map"] == ["lo_normal", "lo_ao"]


@pytest.mark.parametrize("method", ["FLATTEN", "CAST"])
@pytest.mark.parametrize("was_baked", [False, True], ids=["no bake before", "another bake before"])
def test_after_live_the_results_are_those_of_its_maps(pair, method, was_baked):
    settings = use(method=method)
    if was_baked:
        assert bpy.ops.imprint.bake() == {"FINISHED"}
    settings.space, settings.maps = "OBJECT", {"AO"}
    bpy.ops.imprint.live()
    follow()
    bpy.ops.imprint.live()
    drawn = panel_layout.draw(panels=[results_panel.IMPRINT_PT_results])
    assert [given.image for name, given in drawn.given if name == "imprint.show_map"] == ["lo_normal", "lo_ao"]
    of_live = bake_results.results.of(bpy.context).to_dict()
    assert bpy.ops.imprint.bake(modifiers="VIEWPORT") == {"FINISHED"}
    of_bake = bake_results.results.of(bpy.context).to_dict()
    assert of_live["space"] == "OBJECT"
    differing = {name for name, value in of_bake.items() if of_live[name] != value}
    assert differing <= {"seconds", "settings"}


def test_the_normal_map_comes_first_and_a_change_drops_the_others(pair, monkeypatch):
    _, high = pair
    monkeypatch.setattr(live, "budget", -1.0)
    bpy.context.scene.imprint.maps = {"AO"}
    bpy.ops.imprint.live()
    follow()
    before = images()
    raise_middle(high)
    follow(lambda: not np.array_equal(images()["lo_normal"], before["lo_normal"]))
    assert np.array_equal(images()["lo_ao"], before["lo_ao"])
    assert not live.is_resting
    follow(lambda: live.draws_others)
    raise_middle(high)
    follow(lambda: live.state is LiveState.DRAWING)
    assert not live.draws_others
    follow()
    after = images()
    assert same(after, baked())


def test_another_bake_while_other_maps_are_drawn_does_not_change_them(pair, monkeypatch):
    low, high = pair
    settings = bpy.context.scene.imprint
    settings.method, settings.maps, settings.rays = "CAST", {"AO"}, 256
    bpy.ops.imprint.live()
    monkeypatch.setattr(live, "budget", -1.0)
    follow(lambda: live.draws_others)
    for _ in range(2):
        live.tick()
    assert live.draws_others
    plain = settings.to_settings().flat()
    own = {"image": "other", "storage": "MEMORY", "material": False, "ao_distance": 1e-4}
    bake_pair(bpy.context, low, [high], Settings(**plain | own))
    follow()
    assert same(images(), baked())


def test_other_maps_wait_for_a_longer_pause(pair, monkeypatch):
    bpy.context.scene.imprint.maps = {"HEIGHT"}
    clock = [100.0]
    monkeypatch.setattr(live_following.time, "monotonic", lambda: clock[0])
    monkeypatch.setattr(live, "rest", 1.0)
    bpy.ops.imprint.live()

    def ticks():
        for _ in range(20):
            live.tick()
        return {*images()}

    clock[0] += 1.5
    assert ticks() == {"lo_normal"}
    clock[0] += 1.0
    assert ticks() == {"lo_normal", "lo_height"}


def test_colors_follow_the_material(pair):
    _, high = pair
    bpy.context.scene.imprint.maps = {"BASE_COLOR"}
    bpy.ops.imprint.live()
    follow()
    principled = high.data.materials[0].node_tree.nodes["Principled BSDF"]
    before = images()["lo_base_color"]
    principled.inputs["Base Color"].default_value = (1.0, 0.0, 0.0, 1.0)
    assert follow() > 0
    after = images()["lo_base_color"].reshape(-1, 4)
    assert not np.array_equal(after, before)
    assert np.allclose(after[after[:, 3] > 0][:, :3], (1.0, 0.0, 0.0), atol=1e-3)


def test_a_material_without_color_maps_draws_nothing(pair):
    _, high = pair
    bpy.context.scene.imprint.maps = {"AO"}
    bpy.ops.imprint.live()
    follow()
    high.data.materials[0].node_tree.nodes["Principled BSDF"].inputs["Base Color"].default_value = (1, 0, 0, 1)
    bpy.context.view_layer.update()
    assert live.is_resting


def test_painting_an_image_of_the_material_is_followed(pair):
    _, high = pair
    tree = high.data.materials[0].node_tree
    node = tree.nodes.new("ShaderNodeTexImage")
    node.image = bpy.data.images.new("paint", 8, 8)
    tree.links.new(node.outputs["Color"], tree.nodes["Principled BSDF"].inputs["Base Color"])
    bpy.context.scene.imprint.maps = {"BASE_COLOR"}
    bpy.ops.imprint.live()
    follow()
    node.image.pixels.foreach_set(np.tile(np.float32([0, 1, 0, 1]), 64))
    node.image.update_tag()
    follow()
    after = images()["lo_base_color"].reshape(-1, 4)
    assert np.allclose(after[after[:, 3] > 0][:, :3], (0.0, 1.0, 0.0), atol=1e-3)


def test_switching_off_stores_all_maps_in_files(pair, tmp_path):
    _, high = pair
    settings = bpy.context.scene.imprint
    settings.maps, settings.storage, settings.output = {"AO", "HEIGHT"}, "FILE", str(tmp_path / "{low}.png")
    settings.depth = "8"  # in which heights are encoded
    bpy.ops.imprint.live()
    follow()
    assert list(tmp_path.iterdir()) == []
    raise_middle(high)
    bpy.context.view_layer.update()
    follow()
    bpy.ops.imprint.live()
    assert {path.name for path in tmp_path.iterdir()} == {"lo.png", "lo_ao.png", "lo_height.png"}
    stored = images()
    assert same(stored, baked())


def test_switching_off_before_the_pause_draws_the_other_maps(pair):
    bpy.context.scene.imprint.maps = {"AO"}
    bpy.ops.imprint.live()
    assert {*images()} == {"lo_normal"}
    bpy.ops.imprint.live()
    assert not live.is_on
    assert same(images(), baked())


def test_without_the_normal_map_only_the_others_are_stored(pair):
    settings = bpy.context.scene.imprint
    settings.normal, settings.maps = False, {"AO"}
    bpy.ops.imprint.live()
    follow()
    assert {*images()} == {"lo_ao"}
    bpy.ops.imprint.live()
    assert same(images(), baked())


def test_what_cannot_be_drawn_is_tried_once(pair, monkeypatch):
    _, high = pair
    bpy.context.scene.imprint.maps = {"AO"}
    bpy.ops.imprint.live()
    tries = []

    def refuse(*_):
        tries.append(1)
        raise BakeError("There is no room.")
        yield

    monkeypatch.setattr(live.session.others, "work", refuse)
    follow()
    assert live.is_on
    assert live.message == "There is no room."
    assert tries == [1]
    monkeypatch.undo()
    monkeypatch.setattr(live, "rest", 0.0)
    raise_middle(high)
    follow()
    assert live.message == ""
    assert same(images(), baked())


def test_other_maps_are_drawn_after_the_memory_was_freed(pair):
    bpy.context.scene.imprint.method, bpy.context.scene.imprint.maps = "CAST", {"AO"}
    bpy.ops.imprint.live()
    live.free()
    follow()
    assert same(images(), baked())


def test_live_does_not_draw_texture_sets(pair):
    bpy.context.scene.imprint.texture_sets = True
    with pytest.raises(RuntimeError, match="turn Texture Sets off"):
        bpy.ops.imprint.live()
    assert not live.is_on


@pytest.mark.parametrize("changed", ["hi", "other"])
def test_object_and_material_numbers_stay_when_one_object_changes(pair, changed):
    """An object that is read again keeps its number and those of its materials."""
    _, high = pair
    other = zoo.terrain("other", n=24, height=0.1)
    other.location.x = 1.0
    other.data.materials.append(bpy.data.materials.new("wood"))
    settings = bpy.context.scene.imprint
    settings.highs.add().object = other
    settings.method, settings.maps = "CAST", {"OBJECT_ID", "MATERIAL_ID"}
    bpy.ops.imprint.live()
    follow()
    raise_middle(bpy.data.objects[changed])
    follow()
    found = images()
    assert same(found, baked())
