# SPDX-License-Identifier: GPL-3.0-or-later
"""Live: the map follows the objects, reads and draws nothing twice, and leaves nothing when it is off."""

import ctypes
import gc

import bpy
import numpy as np
import pytest

import addon
from addon.core import progress
from addon.core.settings import Settings
from addon.jobs import Job, live_session
from addon.scene import mesh_reader
from addon.scene.object_checks import ObjectRef
from addon.ui import live_following
from addon.ui.live import LiveState, live
from tests.support import cut_scenes, zoo
from tests.support.following import follow, follows, fresh, is_fresh, move, shown, switch
from tests.support.panel import instance_of, select, shelve, use

pytestmark = pytest.mark.usefixtures("gpu_context", "registered")


HANDLERS = (
    "depsgraph_update_post",
    "frame_change_post",
    "undo_post",
    "redo_post",
    "save_pre",
    "save_post",
    "load_pre",
    "load_post",
)


@pytest.fixture
def pair(monkeypatch):
    """A low terrain and a high one, small maps, and no waiting for a pause in editing."""
    low, high = zoo.terrain("lo", n=8), zoo.terrain("hi", n=24, height=0.15)
    use(low, high, size=64, method="FLATTEN")
    monkeypatch.setattr(live, "rest", 0.0)
    yield low, high
    live.stop()


def handlers():
    """The number of handlers."""
    return {name: len(getattr(bpy.app.handlers, name)) for name in HANDLERS}


def test_live_bakes_when_it_is_turned_on(pair):
    low, _ = pair
    switch(True)
    image = bpy.data.images["lo_normal"]
    assert is_fresh()
    nodes = low.data.materials[0].node_tree.nodes
    assert image in {node.image for node in nodes if node.bl_idname == "ShaderNodeTexImage"}


@pytest.mark.parametrize("method", ["FLATTEN", "CAST", "AUTO"])
@pytest.mark.parametrize("which", ["hi", "lo"])
def test_live_follows_vertices_and_transforms(pair, method, which):
    bpy.context.scene.imprint.method = method
    switch(True)
    obj = bpy.data.objects[which]
    turn = (0.02, 0.0, 0.01)
    follows(lambda: move(obj, 1), lambda: setattr(obj, "rotation_euler", turn), method=live.session.plan.method)


@pytest.mark.parametrize("method", ["FLATTEN", "CAST"])
def test_live_rounds_edges(pair, method):
    _, high = pair
    high.data.polygons.foreach_set("use_smooth", [False] * len(high.data.polygons))
    settings = use(method=method, edge_radius=0.1)
    switch(True)
    round_map = shown()
    follows(lambda: move(high, 1), method=method)
    settings.edge_radius = 0.0
    follow()
    assert is_fresh() and not np.array_equal(shown(), round_map)


@pytest.mark.parametrize("is_hidden", [False, True], ids=["shown", "hidden by the eye"])
@pytest.mark.parametrize("how", ["collection", "nested", "vertices"])
def test_live_follows_objects_shown_as_instances(pair, how, is_hidden):
    _, high = pair
    settings = use(method="CAST", measure=False, extrusion=0.5, max_distance=1.0)
    if how == "vertices":
        shown_by = zoo.build("dot", [(0.0, 0.0, 0.0)], np.empty((0, 3), int))
        high.parent, shown_by.instance_type = shown_by, "VERTS"
    else:
        shown_by = instance_of(shelve(high, is_linked=False), "shown")
        if how == "nested":
            shown_by = instance_of(shelve(shown_by, is_linked=False), "shown again")
    settings.highs[0].object = shown_by
    shown_by.hide_set(is_hidden)
    switch(True)
    for change in (
        lambda: move(high, 1),
        lambda: setattr(high.rotation_euler, "z", 0.1),
        lambda: setattr(shown_by.rotation_euler, "x", 0.1),
    ):
        follows(change)
        assert shown_by.hide_get() == is_hidden


@pytest.mark.parametrize("how", ["excluded", "collection", "object"])
def test_objects_that_blender_does_not_evaluate_are_refused(pair, how):
    """For such objects, Blender returns an old mesh, or one without modifiers."""
    _, high = pair
    shelf = shelve(high)
    if how == "excluded":
        bpy.context.view_layer.layer_collection.children["Shelf"].exclude = True
    else:
        {"collection": shelf, "object": high}[how].hide_viewport = True
    with pytest.raises(RuntimeError, match="'hi' is hidden in viewports"):
        bpy.ops.imprint.live()


@pytest.mark.parametrize("method", ["FLATTEN", "CAST"])
def test_live_follows_an_alpha_that_is_connected_and_painted(pair, method):
    clear = zoo.terrain("clear", n=8, height=0.3)
    clear.location.z = 0.05
    use(None, clear, method=method)
    material = cut_scenes.color_over(clear, np.tile(np.repeat([0.0, 1.0], 4), (8, 1)))
    tree = material.node_tree
    image = next(node for node in tree.nodes if node.type == "TEX_IMAGE")
    link = next(link for link in tree.links if link.from_node == image)
    alpha, shader = link.from_socket, link.to_socket
    tree.links.remove(link)
    switch(True)
    follow()

    def paint():
        image.image.pixels.foreach_set(np.tile(np.float32([1, 1, 1, 0, 1, 1, 1, 1]), 32))
        image.image.update_tag()

    follows(lambda: setattr(shader, "default_value", 0.0), lambda: tree.links.new(alpha, shader), paint)


def test_live_follows_a_collection_hidden_with_the_eye(pair):
    _, high = pair
    shelve(high)
    bpy.context.view_layer.layer_collection.children["Shelf"].hide_viewport = True
    modifier = high.modifiers.new("Lift", "DISPLACE")
    modifier.strength = 0.0
    switch(True)
    modifier.texture, modifier.strength = bpy.data.textures.new("Clouds", "CLOUDS"), 0.3
    follow()
    assert is_fresh()


def test_live_follows_modifiers_shape_keys_and_frames(pair):
    _, high = pair
    modifier = high.modifiers.new("Wave", "DISPLACE")
    modifier.texture = bpy.data.textures.new("Clouds", "CLOUDS")
    high.shape_key_add(name="Basis")
    key = high.shape_key_add(name="Up")
    points = np.empty(len(high.data.vertices) * 3, np.float32)
    key.data.foreach_get("co", points)
    points[2::3] *= 3.0
    key.data.foreach_set("co", points)
    switch(True)
    follows(lambda: setattr(modifier, "strength", 0.3), lambda: setattr(key, "value", 0.7))
    key.keyframe_insert("value", frame=1)
    key.value = 0.1
    key.keyframe_insert("value", frame=11)
    follows(lambda: bpy.context.scene.frame_set(6))


def test_live_follows_a_mesh_in_edit_mode(pair):
    import bmesh  # available only after bpy is imported

    low, high = pair
    switch(True)
    select(high)
    bpy.ops.object.mode_set(mode="EDIT")
    follow()
    edited = bmesh.from_edit_mesh(high.data)
    for vertex in edited.verts:
        vertex.co.z *= 2.0
    bmesh.update_edit_mesh(high.data)
    follow()
    now = shown()
    assert high.mode == "EDIT"
    bpy.ops.object.mode_set(mode="OBJECT")
    follow()
    assert is_fresh()
    assert np.array_equal(now, fresh())
    # A new topology.
    bpy.ops.object.mode_set(mode="EDIT")
    bpy.ops.mesh.select_all(action="SELECT")
    bpy.ops.mesh.subdivide(smoothness=1.0)
    follow()
    now = shown()
    bpy.ops.object.mode_set(mode="OBJECT")
    assert np.array_equal(now, fresh())
    assert low.mode == "OBJECT"


def test_live_follows_modifiers_on_their_own_base_mesh(pair):
    low, _ = pair
    settings = bpy.context.scene.imprint
    settings.highs.clear()
    low.modifiers.new("Subdivision", "SUBSURF").levels = 2
    displace = low.modifiers.new("Detail", "DISPLACE")
    displace.texture = bpy.data.textures.new("Clouds", "CLOUDS")
    smoothing = low.modifiers["Subdivision"].uv_smooth
    switch(True)
    displace.strength = 0.2
    follow()
    # The bake reads a surface that was subdivided again: its normals differ in the last digits.
    assert np.abs(shown() - fresh()).max() < 5e-6
    assert low.modifiers["Subdivision"].uv_smooth == smoothing
    follow()
    assert live.state is LiveState.IDLE  # reading must not count as a change


def test_live_waits_for_multires_detail(pair):
    """In Sculpt Mode, Blender returns the base mesh instead. Its map would have no detail."""
    low, _ = pair
    bpy.context.scene.imprint.highs.clear()
    select(low)
    low.modifiers.new("Multires", "MULTIRES")
    for _ in range(2):
        bpy.ops.object.multires_subdivide(modifier="Multires", mode="CATMULL_CLARK")
    switch(True)
    before = shown()
    bpy.ops.object.mode_set(mode="SCULPT")
    low.update_tag()
    follow()
    assert "leaves Sculpt Mode" in live.message
    assert np.array_equal(shown(), before)
    bpy.ops.object.mode_set(mode="OBJECT")
    low.update_tag()
    follow()
    assert live.message == ""


def test_live_follows_the_settings(pair):
    switch(True)
    settings = bpy.context.scene.imprint
    for name, value in (("width", 32), ("green", "-Y"), ("space", "OBJECT"), ("samples", "4"), ("method", "CAST")):
        setattr(settings, name, value)
        follow()
        assert is_fresh(), name
    for name, value, problem in (("udim", True, "turn UDIM Tiles off"), ("tiles", "x", "is not a list of UDIM tiles")):
        before = getattr(settings, name)
        setattr(settings, name, value)
        follow()
        assert problem in live.message
        setattr(settings, name, before)
        follow()
        assert live.message == ""


def test_a_change_that_is_not_stored_yet_is_stored_before_the_settings_change(pair, monkeypatch):
    _, high = pair
    switch(True)
    monkeypatch.setattr(live, "rest", 1000.0)
    move(high, 1)
    bpy.context.view_layer.update()
    while not live.is_resting and live.session.drawn < 2:
        live.tick()
    expected = fresh()
    assert not np.array_equal(shown(), expected)
    bpy.context.scene.imprint.image = "another"
    monkeypatch.setattr(live, "rest", 0.0)
    follow()
    assert np.array_equal(shown(), expected)
    assert np.array_equal(shown("another"), expected)


@pytest.mark.parametrize("margin_type", ["EXTEND", "ADJACENT_FACES"])
@pytest.mark.parametrize("which", ["lo", "hi"])
def test_live_follows_uvs_with_their_margin(pair, which, margin_type):
    low, high = pair
    for obj in pair:  # both fill two parts of the map, so that there is a margin, and a seam
        move_right_half(obj, 0.2)
        scale_uvs(obj, 0.5)
    bpy.context.scene.imprint.margin, bpy.context.scene.imprint.margin_type = 3, margin_type
    switch(True)
    follows(lambda: scale_uvs(low if which == "lo" else high, 1.5))


@pytest.mark.parametrize("method", ["FLATTEN", "CAST"])
def test_live_follows_parts_that_are_stacked_and_the_choice_of_the_part(pair, method):
    bpy.context.scene.imprint.method = method
    switch(True)
    first = shown()
    follows(
        lambda: [move_right_half(obj, -0.5) for obj in pair],
        lambda: setattr(bpy.context.scene.imprint, "stacked", "LAST"),
        lambda: [move_right_half(obj, 0.5) for obj in pair],
    )
    assert np.array_equal(shown(), first)


def move_right_half(obj, by):
    """Move the UVs of the right half along u."""
    layer = obj.data.uv_layers[0].uv
    for face in obj.data.polygons:
        for corner in face.loop_indices if face.center.x > 0.0 else ():
            layer[corner].vector.x += by
    obj.data.update()
    obj.update_tag()


def scale_uvs(obj, factor):
    """Scale the UVs about the middle of the map."""
    layer = obj.data.uv_layers[0].uv
    uv = np.empty(2 * len(layer), np.float32)
    layer.foreach_get("vector", uv)
    layer.foreach_set("vector", 0.5 + factor * (uv - np.float32(0.5)))
    obj.data.update()
    obj.update_tag()


def test_files_are_written_when_live_is_turned_off(pair, tmp_path):
    _, high = pair
    use(storage="FILE", output=str(tmp_path / "map.exr"), depth="32")
    switch(True)
    assert list(tmp_path.iterdir()) == []
    move(high, 5)
    follow()
    expected = shown()
    switch(False)
    image = bpy.data.images["lo_normal"]
    assert image.source == "FILE"
    assert np.array_equal(shown(), expected)
    assert [path.name for path in tmp_path.iterdir()] == ["map.exr"]


def test_the_map_is_packed_when_live_is_turned_off(pair):
    switch(True)
    assert bpy.data.images["lo_normal"].packed_file is None
    switch(False)
    assert bpy.data.images["lo_normal"].packed_file is not None


def test_a_file_saved_during_live_has_the_map(pair, tmp_path):
    _, high = pair
    switch(True)
    move(high, 9)
    follow()
    expected = shown()
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "scene.blend"))
    assert live.is_on
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "scene.blend"))
    assert np.allclose(shown(), expected, atol=1e-6)


def test_changes_of_an_interrupted_map_are_in_the_next_map(pair, monkeypatch):
    _, high = pair
    other = zoo.terrain("other", n=24, height=0.1)
    other.location.x = 0.5
    bpy.context.scene.imprint.highs.add().object = other
    switch(True)
    follow()
    monkeypatch.setattr(live, "budget", 0.0)
    for changed in (other, high):  # on shared texels, the map shows the later of the two
        move(changed, 5)
        bpy.context.view_layer.update()
        live.tick()  # begins a map and does not finish it
        assert live.state is LiveState.DRAWING
    follow()
    assert is_fresh()


def test_live_does_not_change_in_another_scene(pair):
    switch(True)
    session = live.session
    other = bpy.data.scenes.new("Other")
    with bpy.context.temp_override(scene=other):
        live.tick()
    assert live.session is session
    bpy.data.scenes.remove(other)


def test_bake_is_disabled_while_live_is_on(pair):
    switch(True)
    with pytest.raises(RuntimeError, match="Stop Live first"):
        bpy.ops.imprint.bake()
    switch(False)
    assert bpy.ops.imprint.bake() == {"FINISHED"}


def test_live_waits_for_a_base_mesh_to_leave_edit_mode(pair):
    low, _ = pair
    bpy.context.scene.imprint.highs.clear()
    low.modifiers.new("Subdivision", "SUBSURF").levels = 2
    select(low)
    switch(True)
    bpy.ops.object.mode_set(mode="EDIT")
    low.update_tag()
    follow()
    assert "leaves Edit Mode" in live.message
    bpy.ops.object.mode_set(mode="OBJECT")
    move(low, 3)
    follow()
    assert live.message == ""


def test_an_unexpected_error_turns_live_off(pair, monkeypatch):
    before = handlers()
    switch(True)
    monkeypatch.setattr(live.session, "advance", lambda *_: 1 / 0)
    move(pair[1], 3)
    bpy.context.view_layer.update()
    with pytest.raises(ZeroDivisionError):
        live.tick()
    assert not live.is_on
    assert handlers()["undo_post"] == before["undo_post"]


def test_rays_show_a_coarse_map_first(pair, monkeypatch):
    """The preview shows the coarse map. The image never gets it."""
    _, high = pair
    bpy.context.scene.imprint.method = "CAST"
    switch(True)
    before = shown()
    monkeypatch.setattr(live, "budget", 0.0)
    move(high, 3)
    bpy.context.view_layer.update()
    sizes = []
    while not sizes or live.state is LiveState.DRAWING:
        live.tick()
        sizes.append(live.session.map.width)
        assert np.array_equal(shown(), before)
    assert 16 in sizes and sizes[-1] == 64
    follow()
    assert is_fresh()


def test_a_change_that_interrupts_reading_reads_all_objects(pair, monkeypatch):
    """Another change stops the map before the object was read."""
    low, high = pair
    switch(True)
    move(high, 5)
    bpy.context.view_layer.update()
    with monkeypatch.context() as patch:
        patch.setattr(live, "budget", 0.0)
        live.tick()
    assert live.state is LiveState.DRAWING
    low.location.x = 0.01
    follow()
    assert is_fresh()


@pytest.mark.parametrize("seed", [7])
def test_fifty_edits_undos_and_redos(pair, seed):
    rng = np.random.default_rng(seed)
    bpy.ops.ed.undo_push(message="start")
    switch(True)
    for number in range(50):
        action = rng.choice(["move", "turn", "undo", "redo", "scale"], p=[0.4, 0.2, 0.2, 0.1, 0.1])
        obj = bpy.data.objects[rng.choice(["hi", "lo"], p=[0.7, 0.3])]
        if action == "undo" and bpy.ops.ed.undo.poll():
            bpy.ops.ed.undo()
        elif action == "redo" and bpy.ops.ed.redo.poll():
            bpy.ops.ed.redo()
        else:
            if action == "turn":
                obj.rotation_euler.z += 0.01
            elif action == "scale":
                obj.scale.z *= 1.1
            else:
                move(obj, 1000 * seed + number)
            bpy.ops.ed.undo_push(message=f"edit {number}")
        if rng.random() < 0.5:
            follow()
            assert live.is_on
    follow()
    assert is_fresh()


def test_nothing_remains_when_live_is_off(pair):
    before = handlers()
    for _ in range(3):
        switch(True)
        switch(False)
        assert not live.timer.is_running
        assert handlers() == before
        assert live.tick() is None


@pytest.mark.slow
def test_a_thousand_updates_leave_as_many_objects_as_one(pair):
    """Counts objects in Python and on the GPU. There is only one handler after any number of updates."""
    _, high = pair
    switch(True)
    before = handlers()
    counts = []
    for number in range(1000):
        if number % 10 == 0:
            move(high, number)
        else:
            high.location.x = 1e-3 * number
        follow()
        if number in (100, 999):
            gc.collect()
            counts.append(sum(type(item).__module__ == "gpu.types" for item in gc.get_objects()))
    assert counts[0] == counts[1]
    assert handlers() == before
    assert len(bpy.data.images) == 1


@pytest.mark.parametrize("name", ["hi", "lo"])
@pytest.mark.parametrize("way", ["from the file", "from the scene"])
def test_live_waits_for_a_deleted_object(pair, name, way):
    """If it is deleted in the viewport, a slot of the panel keeps it in the file."""
    bpy.ops.ed.undo_push(message="before")
    switch(True)
    bpy.ops.ed.undo_push(message="live")
    obj = bpy.data.objects[name]
    if way == "from the file":
        bpy.data.objects.remove(obj)
    else:
        bpy.context.scene.collection.objects.unlink(obj)
    bpy.ops.ed.undo_push(message="deleted")
    bpy.context.view_layer.update()
    live.tick()
    assert live.message.startswith(f"{name!r} was deleted")
    assert repr(name) in live.description
    live.tick()
    assert live.is_on
    bpy.ops.ed.undo()
    follow()
    assert live.message == ""
    move(bpy.data.objects[name], 4)
    follow()
    assert is_fresh()


def test_an_object_that_is_linked_again_is_read_again(pair):
    """Blender does not report changes from the time when it was unlinked."""
    _, high = pair
    switch(True)
    objects = bpy.context.scene.collection.objects
    objects.unlink(high)
    bpy.context.view_layer.update()
    live.tick()
    move(high, 6)
    bpy.context.view_layer.update()
    handlers = bpy.app.handlers.depsgraph_update_post
    kept = list(handlers)
    handlers.clear()  # independent of Blender's reports about it
    objects.link(high)
    bpy.context.view_layer.update()
    handlers.extend(kept)
    follow()
    assert is_fresh()


def test_states_of_live_in_order(pair, monkeypatch):
    low, high = pair
    assert live.state is LiveState.OFF
    settings = bpy.context.scene.imprint.to_settings()
    starting = live.starting(bpy.context, Job(low, [high]), settings, progress.Pace(has_picture=False))
    next(starting)
    assert live.state is LiveState.STARTING
    progress.finish(starting)
    assert live.state is LiveState.IDLE
    monkeypatch.setattr(live, "budget", 0.0)
    move(high, 3)
    bpy.context.view_layer.update()
    live.tick()
    assert live.state is LiveState.DRAWING
    bpy.context.scene.imprint.udim = True
    live.tick()
    assert (live.state, bool(live.message)) == (LiveState.REFUSED, True)
    bpy.context.scene.imprint.udim = False
    follow()
    assert (live.state, live.message) == (LiveState.IDLE, "")
    live.stop()
    assert live.state is LiveState.OFF


def test_live_follows_the_render_engine_of_the_scene(pair):
    """The render engine decides the basis of the map."""
    low, _ = pair
    low.data.vertices[0].co.z = 0.5  # on a plane, all bases agree
    switch(True)
    for engine, basis in (("CYCLES", "CYCLES"), ("BLENDER_EEVEE", "MIKKTSPACE")):
        bpy.context.scene.render.engine = engine
        follow()
        assert live.session.settings.map.basis == basis
        assert is_fresh()


def test_disabling_the_extension_ends_live(pair):
    switch(True)
    addon.unregister()
    try:
        assert not live.is_on
    finally:
        addon.register()


def test_maps_are_right_after_shaders_are_freed(pair):
    """Blender identifies the bound shader by its address, and a new shader may get the same address."""
    low, high = pair
    settings = Settings(method="FLATTEN", width=64, height=64, storage="MEMORY", material=False)
    maps = []
    for _ in range(60):
        session = live_session.Session(bpy.context, Job(low, [high]), settings, progress.Pace())
        session.run(bpy.context)
        session.free()
        maps.append(session.texels)
        addon.free()
    assert all(np.array_equal(texels, maps[0]) for texels in maps)


def test_opening_another_file_ends_live(pair, tmp_path):
    before = handlers()
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "scene.blend"))
    switch(True)
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "scene.blend"))
    assert not live.is_on
    assert handlers() == before


def test_live_reports_a_problem_and_continues_after_it(pair):
    _, high = pair
    switch(True)
    layer = high.data.uv_layers[0].name
    bpy.context.scene.imprint.highs[0].object.data.uv_layers.remove(high.data.uv_layers[0])
    high.data.update()
    high.update_tag()
    follow()
    assert "unwrap it first" in live.message
    high.data.uv_layers.new(name=layer)
    move(high, 3)
    high.update_tag()
    follow()
    assert "unwrap it first" not in live.message


def test_live_does_not_start_with_objects_that_cannot_be_baked(pair):
    bpy.context.scene.imprint.udim = True
    with pytest.raises(RuntimeError, match="Live draws only one tile"):
        bpy.ops.imprint.live()
    assert not live.is_on


def sculpt(obj, seed=None):
    """Act as a stroke in Sculpt Mode, or one that moves nothing: move vertices, and let Blender report a change."""
    if seed is not None:
        size = len(obj.data.vertices) * 3
        values = (ctypes.c_float * size).from_address(obj.data.vertices[0].as_pointer())
        points = np.ctypeslib.as_array(values).reshape(-1, 3)
        # Upwards: Blender updates the triangles of folded quads only when it leaves Sculpt Mode.
        points[:, 2] += np.random.default_rng(seed).normal(0, 0.002, len(points))
    obj.color[0] = 0.5 if obj.color[0] == 1.0 else 1.0
    bpy.context.view_layer.update()


def enter_sculpt_mode(obj):
    bpy.context.view_layer.objects.active = obj
    bpy.ops.object.mode_set(mode="SCULPT")
    follow()


@pytest.mark.parametrize("method", ["FLATTEN", "CAST"])
@pytest.mark.parametrize("which", ["hi", "lo"])
def test_live_follows_strokes(pair, method, which):
    """During strokes, Blender reports no change of geometry, and the evaluated mesh and its normals are old."""
    bpy.context.scene.imprint.method = method
    obj = bpy.data.objects[which]
    switch(True)
    enter_sculpt_mode(obj)
    for seed in (1, 2):
        follows(lambda seed=seed: sculpt(obj, seed))
        assert obj.mode == "SCULPT"


def test_a_stroke_that_moves_no_vertex_starts_no_bake(pair):
    _, high = pair
    switch(True)
    enter_sculpt_mode(high)
    texels = live.session.texels
    for _ in range(3):
        sculpt(high)
        follow()
    assert live.session.texels is texels


def test_a_bake_from_sculpt_mode_has_the_normals_of_its_mesh(pair):
    """Blender keeps the normals from before the stroke when it leaves the mode."""
    _, high = pair
    enter_sculpt_mode(high)
    mesh_reader.surface(high.data, "UVMap", "", np.eye(4))  # computes the normals
    sculpt(high, 3)
    texels = fresh()
    copy = high.data.copy()
    mesh_reader.reset_normals(copy)
    bpy.ops.object.mode_set(mode="OBJECT")
    high.data = copy
    assert np.array_equal(texels, fresh())


def test_dyntopo_strokes_are_applied_once(pair, monkeypatch):
    """Blender reports updates as an answer, which must not count as new strokes."""
    _, high = pair
    switch(True)
    enter_sculpt_mode(high)
    bpy.ops.sculpt.dynamic_topology_toggle()
    follow()
    asked, ask = [], live_following.Strokes.apply_delayed
    monkeypatch.setattr(
        live_following.Strokes, "apply_delayed", lambda self: (asked.append(1), ask(self), sculpt(high))
    )
    monkeypatch.setattr(live_following, "ANSWER", -1.0)
    sculpt(high)
    monkeypatch.setattr(live_following, "ANSWER", 1e6)
    follow()
    assert asked == [1]
    live.on_undo()
    follow()
    assert asked == [1, 1]


def test_strokes_are_not_applied_during_a_stroke(pair, monkeypatch):
    _, high = pair
    switch(True)
    enter_sculpt_mode(high)
    bpy.ops.sculpt.dynamic_topology_toggle()
    follow()
    asked = []
    monkeypatch.setattr(live_following.Strokes, "apply_delayed", lambda _: asked.append(1))
    monkeypatch.setattr(live_following, "is_stroke_drawn", lambda: True)
    live.tick()
    live.tick()
    assert asked == []
    monkeypatch.setattr(live_following, "is_stroke_drawn", lambda: False)
    follow()
    assert asked == [1]


def test_sculpting_an_instance_does_not_end_live(pair):
    low, inner = pair
    use(method="CAST").highs[0].object = instance_of(shelve(inner), "shows")
    switch(True)
    before = live.session.texels
    enter_sculpt_mode(inner)
    follow()
    sculpt(inner, 3)
    follow()
    assert live.is_on
    bpy.ops.object.mode_set(mode="OBJECT")
    follow()
    assert not np.array_equal(live.session.texels, before)


def test_live_overwrites_no_file_that_the_scene_uses(pair, tmp_path):
    image = bpy.data.images.new("shape", 4, 4)
    image.filepath_raw, image.file_format = str(tmp_path / "shape.png"), "PNG"
    image.save()
    bpy.data.textures.new("shape", "IMAGE").image = image
    use(storage="FILE", output=str(tmp_path / "shape.png"))
    with pytest.raises(RuntimeError, match="overwrite the image 'shape'"):
        bpy.ops.imprint.live()
    assert not live.is_on


def test_live_looks_up_its_objects_once_per_change(pair, monkeypatch):
    """Blender searches all objects for each look-up: fifty times a second, this is too slow in large scenes."""
    switch(True)
    follow()
    looked, resolve = [], live_following.uids_in_scenes
    monkeypatch.setattr(live_following, "uids_in_scenes", lambda: (looked.append(1), resolve())[1])
    monkeypatch.setattr(ObjectRef, "resolve", lambda ref: pytest.fail(f"{ref.name} was looked for"))
    for _ in range(5):
        live.tick()
    assert looked == []
    bpy.context.scene.objects["lo"].color[0] = 0.5
    bpy.context.view_layer.update()
    for _ in range(5):
        live.tick()
    assert looked == [1]


# Live weights


@pytest.fixture
def low(monkeypatch):
    """A low cube inside a larger one, of which rays reach some sides, with groups of neutral weights."""
    low, high = zoo.cube("lo"), zoo.sphere("hi", latitude=85.0)
    high.scale = (1.5, 1.7, 1.9)
    for name in ("far", "turned"):
        low.vertex_groups.new(name=name).add(range(8), 0.5, "REPLACE")
    use(low, high, size=64, method="CAST", measure=False, extrusion=0.6, max_distance=1.2)
    use(hit="OUTERMOST", show_result=False, offset_group="far", straight_group="turned")
    monkeypatch.setattr(live, "rest", 0.0)
    assert bpy.ops.imprint.live() == {"FINISHED"}
    yield low
    live.stop()


@pytest.mark.parametrize(("name", "weight"), [("far", 0.25), ("far", 1.0), ("turned", 0.0), ("turned", 1.0)])
def test_live_follows_weights(low, name, weight):
    before = shown()
    follows(lambda: low.vertex_groups[name].add([0, 1, 2], weight, "REPLACE"))
    low.vertex_groups[name].add([0, 1, 2], 0.5, "REPLACE")
    follow()
    assert np.array_equal(shown(), before)


def test_live_waits_for_a_group_that_is_renamed_or_removed(low):
    low.vertex_groups["far"].add([0], 1.0, "REPLACE")
    follow()
    before = shown()
    low.vertex_groups["far"].name = "other"
    follow()
    assert "'lo' has no vertex group 'far'" in live.message
    assert live.is_on
    bpy.context.scene.imprint.offset_group = "other"
    follow()
    assert live.message == ""
    assert np.array_equal(shown(), before)
    low.vertex_groups.remove(low.vertex_groups["other"])
    follow()
    assert "'lo' has no vertex group 'other'" in live.message
    bpy.context.scene.imprint.offset_group = ""
    follow()
    assert live.message == ""
    assert not np.array_equal(shown(), before)
    assert is_fresh()


def test_live_follows_proposed_weights(low):
    settings = bpy.context.scene.imprint
    bpy.ops.imprint.live()
    settings.extrusion = 0.3
    bpy.ops.imprint.bake()
    bpy.ops.imprint.live()
    before = shown()
    assert bpy.ops.imprint.propose_weights() == {"FINISHED"}
    assert any(group.weight == 1.0 for vertex in low.data.vertices for group in vertex.groups)
    follow()
    assert not np.array_equal(shown(), before)
    assert is_fresh()
