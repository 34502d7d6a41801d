# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests that objects are read as renders see them, and that reading leaves nothing behind."""

import bpy
import numpy as np
import pytest

from addon.core.errors import BakeError
from addon.core.settings import Settings
from addon.scene import reading, render_view
from tests.support import geometry_nodes, scenes, zoo
from tests.support.render_scenes import SCENES, SLOW
from tests.support.snapshot import difference, snapshot


def positions(corners):
    """The triangles (T, 3, 3) as a set of positions of corners, rounded, whichever comes first and however they turn."""
    rounded = np.round(np.asarray(corners, np.float64), 4) + 0.0
    return sorted(tuple(sorted(map(tuple, triangle))) for triangle in rounded.tolist())


class _Renderer(bpy.types.RenderEngine):
    """An engine that only notes what a render is given of objects: triangles in the world, by object and material."""

    bl_idname, bl_label = "TEST_RENDERER", "Test"
    found: dict = {}

    def render(self, depsgraph):
        for item in depsgraph.object_instances:
            obj = item.object
            if obj.type != "MESH" or not item.show_self:
                continue
            owner = item.parent if item.is_instance else obj
            slots = [slot.material.name if slot.material else "" for slot in obj.material_slots] or [""]
            data = obj.data
            data.calc_loop_triangles()
            matrix = np.array(item.matrix_world)
            points = np.array([vertex.co for vertex in data.vertices]).reshape(-1, 3) @ matrix[:3, :3].T + matrix[:3, 3]
            for triangle in data.loop_triangles:
                slot = min(triangle.material_index, len(slots) - 1)
                key = owner.original.name, slots[slot]
                _Renderer.found.setdefault(key, []).append(points[list(triangle.vertices)])


def rendered(names):
    """What a render of the scene shows of objects, as triangles by the object's and the material's name."""
    scene = bpy.context.scene
    for name in names:  # a hidden object is read as well
        obj = bpy.data.objects[name]
        obj.hide_render = False
        if obj.name not in scene.collection.objects:
            scene.collection.objects.link(obj)
    bpy.utils.register_class(_Renderer)
    _Renderer.found = {}
    before = scene.render.engine
    try:
        scene.camera = bpy.data.objects.new("camera", bpy.data.cameras.new("camera"))
        scene.render.engine = _Renderer.bl_idname
        scene.render.resolution_x = scene.render.resolution_y = 4
        bpy.ops.render.render()
    finally:
        scene.render.engine = before
        bpy.utils.unregister_class(_Renderer)
    return {key: positions(found) for key, found in _Renderer.found.items() if key[0] in names}


def as_read(low, highs):
    """The same, of what Imprint reads."""
    settings = Settings(method="CAST", maps=("MATERIAL_ID",))
    meshes = reading.read(bpy.context, low, highs, None, settings)
    found = {}
    for mesh, high in zip(meshes.highs, highs, strict=True):
        points = mesh.positions.astype(np.float64) @ mesh.to_world[:3, :3].T + mesh.to_world[:3, 3]
        corners = points[mesh.vertices[mesh.triangles]]
        for number in np.unique(mesh.labels[:, 1]).astype(int):
            key = meshes.materials[number - 1].key
            name = next((each.name for each in bpy.data.materials if each.session_uid == key), "")
            found[high.name, name] = positions(corners[mesh.labels[:, 1] == number])
    return found


ALL = [pytest.param(name, marks=[pytest.mark.slow] if name in SLOW else [], id=name) for name in SCENES]


@pytest.mark.parametrize("name", ALL)
def test_what_a_render_shows_is_read(name):
    zoo.plane("low")
    highs = SCENES[name]()
    low = bpy.data.objects["low"]
    bpy.context.view_layer.update()
    found = as_read(low, highs)
    expected = rendered({high.name for high in highs})
    assert set(found) == set(expected)
    for key, triangles in expected.items():
        assert len(found[key]) == len(triangles), key
        assert np.allclose(found[key], triangles, rtol=0.0, atol=2e-4), key
    assert sum(map(len, expected.values()))


def counted(high):
    """How many triangles are read of an object."""
    low = bpy.data.objects["low"]
    return len(reading.read(bpy.context, low, [high], None, Settings(method="CAST")).highs[0].triangles)


def noted():
    """A handler in each list of Blender's, and what they note."""
    calls = []
    for name in dir(bpy.app.handlers):
        handlers = getattr(bpy.app.handlers, name)
        if isinstance(handlers, list):
            handlers.append(lambda *_, name=name: calls.append(name))
    return calls


def kinds_of_scenes():
    """Objects that are read in a copy of the scene, with all that renders show, and in the scene itself."""
    names = (
        "subdivision",
        "hidden_in_renders",
        "in_an_excluded_collection",
        "particles_of_which_the_viewport_shows_some",
    )
    return [*names, "a_rigid_body_at_a_frame", "a_linked_object"]


@pytest.mark.parametrize("name", kinds_of_scenes())
@pytest.mark.parametrize("fails", [False, True])
def test_reading_leaves_nothing_and_calls_no_handlers(name, fails, monkeypatch):
    zoo.plane("low")
    (high,) = SCENES[name]()
    bpy.context.view_layer.update()
    assert counted(high)  # what Blender makes once, as caches of particles, is there now
    if fails:

        def broken(*_, **_named):
            raise KeyError("broken")

        monkeypatch.setattr(reading, "_read", broken)
    before, users = snapshot(), {obj.name_full: obj.users for obj in bpy.data.objects}
    was_dirty = bpy.data.is_dirty
    calls = noted()
    if fails:
        with pytest.raises(KeyError, match="broken"):
            counted(high)
    else:
        assert counted(high)
    assert calls == []
    assert difference(before, snapshot()) == {}
    assert {obj.name_full: obj.users for obj in bpy.data.objects} == users
    assert bpy.data.is_dirty == was_dirty
    assert "Render Result" not in bpy.data.images


def test_reading_tells_the_viewport_of_no_change():
    """Live would draw its map again."""
    zoo.plane("low")
    (high,) = SCENES["subdivision"]()
    assert counted(high)
    updates = []
    bpy.app.handlers.depsgraph_update_post.append(
        lambda _scene, depsgraph: updates.extend(
            each.id.name
            for each in depsgraph.updates
            if isinstance(each.id, bpy.types.Object | bpy.types.Mesh)
            if each.is_updated_geometry or each.is_updated_transform
        )
    )
    assert counted(high)
    bpy.context.view_layer.update()
    assert updates == []


def test_a_render_result_and_its_slots_stay(tmp_path):
    zoo.plane("low")
    (high,) = SCENES["subdivision"]()
    scene = bpy.context.scene
    scene.camera = scenes.link(bpy.data.objects.new("camera", bpy.data.cameras.new("camera")))
    scene.render.engine, scene.cycles.samples = "CYCLES", 1
    for side in (4, 8):
        scene.render.resolution_x = scene.render.resolution_y = side
        bpy.ops.render.render()
        image = bpy.data.images["Render Result"]
        if side == 4:
            image.render_slots.new(name="second")
            image.render_slots.active_index = len(image.render_slots) - 1

    def saved():
        found = []
        for slot in (0, len(image.render_slots) - 1):
            image.render_slots.active_index = slot
            image.save_render(str(tmp_path / "slot.png"))
            found.append((tmp_path / "slot.png").read_bytes())
        return found

    before = saved()
    assert before[0] != before[1]
    image.render_slots.active_index = 0  # not that of the last render
    names = [slot.name for slot in image.render_slots]
    assert counted(high)
    assert image.render_slots.active_index == 0
    assert [slot.name for slot in image.render_slots] == names
    assert saved() == before


def test_a_render_that_runs_is_told(monkeypatch):
    zoo.plane("low")
    (high,) = SCENES["subdivision"]()
    monkeypatch.setattr(render_view, "is_busy", lambda: True)
    with pytest.raises(BakeError, match="a render or a bake of Blender runs"):
        counted(high)
    low = bpy.data.objects["low"]
    settings = Settings(method="CAST", modifiers="VIEWPORT")
    assert len(reading.read(bpy.context, low, [high], None, settings).highs[0].triangles) == 2


def test_objects_are_read_while_another_engine_renders():
    """Blender 4.5 draws in the background only like this. An engine that is unregistered meanwhile would end Blender."""
    zoo.plane("low")
    (high,) = SCENES["subdivision"]()
    found = []

    class Outer(bpy.types.RenderEngine):
        bl_idname, bl_label = "TEST_OUTER", "Test"

        def render(self, _depsgraph):
            found.append(counted(high))
            self.update_stats("still", "there")

    scene = bpy.context.scene
    scene.camera = scenes.link(bpy.data.objects.new("camera", bpy.data.cameras.new("camera")))
    bpy.utils.register_class(Outer)
    try:
        scene.render.engine = Outer.bl_idname
        scene.render.resolution_x = scene.render.resolution_y = 4
        bpy.ops.render.render()
    finally:
        bpy.utils.unregister_class(Outer)
    assert found == [32]


@pytest.mark.parametrize("is_hidden", [False, True])
def test_errors_of_nodes_are_told_also_of_objects_that_the_viewport_hides(is_hidden):
    low, high = zoo.plane("low"), zoo.plane("high")
    tree = geometry_nodes.Tree(high)
    said = tree.add("GeometryNodeWarning", {"Show": True, "Message": "no scatter"}, warning_type="ERROR")
    tree.end(tree.add("GeometryNodeSetPosition", {"Geometry": tree.geometry, "Selection": said}))
    high.hide_viewport = is_hidden
    (sentence,) = reading.read(bpy.context, low, [high], None, Settings(method="CAST")).lacks
    assert "No scatter" in sentence


def test_what_blender_says_against_it_is_told(monkeypatch):
    zoo.plane("low")
    (high,) = SCENES["subdivision"]()

    def refuse(**_):
        raise RuntimeError("Error: No.\n")

    monkeypatch.setattr(render_view, "_call_engine", refuse)
    with pytest.raises(BakeError, match="since Blender says: No: wait"):
        counted(high)
    monkeypatch.setattr(render_view, "_call_engine", lambda **_: None)
    with pytest.raises(BakeError, match="since Blender did not call the engine"):
        counted(high)


def test_an_object_of_300_is_evaluated_alone():
    """Otherwise each bake of many pairs would evaluate all of them."""
    zoo.plane("low")
    (high,) = SCENES["subdivision"]()
    others = [zoo.plane(f"other {number}") for number in range(20)]
    seen = render_view.read(
        bpy.context, [high], lambda depsgraph: [each.evaluated_get(depsgraph).is_evaluated for each in others]
    )
    assert not any(seen)


def test_what_registers_classes_is_done_outside_of_the_engine():
    """Cycles is loaded by the first material that needs it. Within the engine, that would end Blender."""
    zoo.plane("low")
    (high,) = SCENES["subdivision"]()
    calls = []

    def work(depsgraph):
        render_view.outside(lambda: calls.append(hasattr(render_view._Engine, "call")))
        return depsgraph.mode

    assert render_view.read(bpy.context, [high], work) == "RENDER"
    assert calls == [False]
    render_view.outside(lambda: calls.append("at once"))
    assert calls == [False, "at once"]
