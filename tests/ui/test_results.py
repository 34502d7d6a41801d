# SPDX-License-Identifier: GPL-3.0-or-later
"""Results of bakes in the window: each belongs to its low object, and the file keeps it."""

from dataclasses import replace
from functools import partial
from types import SimpleNamespace

import bpy
import pytest

from addon.core.errors import Fix
from addon.jobs import Job, bake_all
from addon.scene.object_checks import ObjectRef
from addon.ui import bake_panel, bake_results, object_pairs, results_panel, texts
from addon.ui.bake_results import results
from tests.export.test_glb import bent_pair
from tests.support import panel_layout, scenes, zoo
from tests.support.panel import area, image_editor, use, window
from tests.support.panel_layout import Layout
from tests.support.snapshot import difference, snapshot

pytestmark = pytest.mark.usefixtures("registered", "gpu_context")


@pytest.fixture
def baked():
    """A low and a high object after a bake that measured distances, the low one in its slot."""
    low, high = zoo.plane("lo"), zoo.plane("hi")
    high.location.z = 0.2
    use(low, size=16, method="CAST")
    assert bpy.ops.imprint.bake(low="lo", high=[{"name": "hi"}]) == {"FINISHED"}
    return low, high


def is_known():
    """Whether the panel has a report of the current low object, and distances to freeze. It must have both or neither."""
    known = results.of(bpy.context) is not None
    assert bpy.ops.imprint.freeze_distances.poll() == known
    assert (bpy.context.window_manager.imprint_found.extrusion > 0.0) == known
    return known


def panel_lines(report):
    """The lines of the panel about a bake."""
    layout = Layout()
    results_panel.draw_result(layout, [report])
    return layout.drawn.labels


# Low object and file of a result


def test_a_result_is_known_in_each_scene_of_its_low_object(baked):
    low, _ = baked
    assert is_known()
    bpy.context.window.scene = bpy.data.scenes.new("other")
    assert not is_known()
    assert not bpy.ops.imprint.show_mask.poll()
    bpy.context.scene.collection.objects.link(low)
    bpy.context.scene.imprint.low = low
    assert is_known()


def test_a_result_belongs_to_its_low_object(baked):
    low, high = baked
    settings = bpy.context.scene.imprint
    settings.low = high
    assert not is_known()
    settings.low = None
    bpy.context.view_layer.objects.active = low
    assert is_known()
    low.name = "renamed"
    assert is_known()
    zoo.plane("lo")
    assert results.named(bpy.context, "renamed") == results.of(bpy.context)
    settings.low = bpy.data.objects["lo"]
    assert not is_known()


def test_a_file_keeps_results(baked, tmp_path):
    """The lines about the session's last bake are cleared, also if Load UI is off, and the window manager stays."""
    path, before = str(tmp_path / "scene.blend"), results.of(bpy.context).to_dict()
    bpy.ops.wm.save_as_mainfile(filepath=path)
    bpy.ops.wm.open_mainfile(filepath=path, load_ui=False)
    assert bpy.context.scene.imprint.low.name == "lo"
    assert is_known()
    assert results.of(bpy.context).to_dict() == before
    manager = bpy.context.window_manager
    assert (manager.imprint_summary, manager.imprint_warnings) == ("", "")


def test_a_deleted_map_is_reported_as_missing(baked):
    report = results.of(bpy.context)
    name, line = panel_lines(report)
    assert (name, line.split(",")[0]) == ("lo_normal", "1 warning")
    bpy.data.images.remove(bpy.data.images["lo_normal"])
    assert panel_lines(report) == ["lo_normal", "The image was undone, renamed or deleted"]


def test_a_result_outlives_undo():
    zoo.plane("lo")
    zoo.plane("hi").location.z = 0.2
    use(bpy.data.objects["lo"], size=16, method="CAST")
    bpy.ops.ed.undo_push(message="before")
    bpy.ops.imprint.bake("EXEC_DEFAULT", True, low="lo", high=[{"name": "hi"}])
    bpy.data.objects["lo"].location.x = 1.0
    bpy.ops.ed.undo_push(message="moved")
    bpy.ops.ed.undo()
    assert is_known()


# The list of results


@pytest.fixture
def batch():
    """Three low objects that were baked: the second one with a warning, since half of it has no high triangle."""
    for number, name in enumerate(("a", "b", "c")):
        low, high = zoo.plane(f"{name}_low", 2), zoo.terrain(f"{name}_high", n=8)
        for obj in (low, high):
            obj.location.x = 3.0 * number
        if name == "b":
            high.scale.x = 0.5
    use(size=16, method="CAST", material=False, maps={"HEIGHT"})
    assert bpy.ops.imprint.bake_pairs() == {"FINISHED"}
    bpy.context.view_layer.objects.active = bpy.data.objects["a_low"]


def listed():
    """The names in the list of the panel, and the text of the panel."""
    drawn = panel_layout.draw(width=2000, panels=[results_panel.IMPRINT_PT_results])
    rows = [given.low for name, given in drawn.given if name == "imprint.select_result"]
    return rows, drawn


def test_the_list_says_which_results_are_wrong_and_why(batch):
    rows, drawn = listed()
    assert rows == ["b_low", "a_low", "c_low"]  # the wrong one first
    assert drawn.text.count("'b_high' and 'b_low' differ in place or size") == 1
    assert "'a_low'" not in drawn.text
    signs = [results_panel.sign(reports) for _, reports in results.of_scene(bpy.context)]
    assert signs == ["CHECKMARK", "ERROR", "CHECKMARK"]
    assert drawn.text.count("2 maps, ") == 3


def test_a_batch_bakes_what_can_be_baked_and_names_the_others(batch):
    """One low object has no UVs and one no high object: the list says so at the top, and a set before the bake."""
    low, _ = zoo.plane("d_low", 2), zoo.terrain("d_high", n=8)
    low.data.uv_layers.remove(low.data.uv_layers[0])
    zoo.plane("e_low", 2)
    reason = "'d_low' has no UV layer"
    bpy.ops.imprint.set_add(by_name=True)
    one = bpy.context.scene.imprint_sets[0]
    one.active_part = bpy.context.view_layer.objects.find("d_low")
    shown = panel_layout.draw(width=2000, panels=[bake_panel.IMPRINT_PT_bake])
    assert shown.text.count(reason) == 1
    assert ("imprint.unwrap", True) in shown.buttons
    bpy.context.scene.imprint.bakes = "SELECTION"
    bpy.context.view_layer.objects.active = bpy.data.objects["a_low"]
    assert bpy.ops.imprint.bake_pairs() == {"FINISHED"}
    rows, drawn = listed()
    assert rows == ["d_low", "b_low", "a_low", "c_low"]
    assert drawn.text.count(reason) == 1
    assert "'e_low' has no high object" in drawn.text
    assert drawn.labels.count("not baked") == 1
    low.data.uv_layers.new()
    assert bpy.ops.imprint.bake(low="d_low", high=[{"name": "d_high"}]) == {"FINISHED"}
    assert "'e_low'" in listed()[1].text
    assert "not baked" not in listed()[1].labels
    results.forget()
    assert results.batch().left_out == []


def test_the_main_panel_says_after_a_batch_what_is_wrong(batch):
    """Of five pairs, two are left out and one has a warning: a box below the button says which and why, until another bake."""
    low, _ = zoo.plane("d_low", 2), zoo.terrain("d_high", n=8)
    low.data.uv_layers.remove(low.data.uv_layers[0])
    zoo.plane("e_low", 2)

    def main():
        return panel_layout.draw(width=2000, panels=[bake_panel.IMPRINT_PT_bake])

    bpy.context.view_layer.objects.active = bpy.data.objects["a_low"]
    assert bpy.ops.imprint.bake_pairs() == {"FINISHED"}
    labels = main().labels
    start = labels.index("Not baked: 2 of 5 low objects")
    assert labels[start + 1].startswith("'e_low' has no high object")
    assert labels[start + 2] == "'d_low' has no UV layer: unwrap it first."
    assert labels[start + 3] == "With warnings: 1 of 5 low objects"
    assert "'b_high' and 'b_low' differ in place or size" in labels[start + 4]
    assert not any("c_low" in label for label in labels[start:])
    for number in range(8):
        zoo.plane(f"z{number}_low", 2)
    assert bpy.ops.imprint.bake_pairs() == {"FINISHED"}
    labels = main().labels
    start = labels.index("Not baked: 10 of 13 low objects")
    assert (
        labels[start + 1] == "In 9 low objects: 'e_low' has no high object: none is called 'e_high'."
    )  # equal ones are one
    assert labels[start + 2].startswith("'d_low' has no UV layer")
    assert bpy.ops.imprint.bake(low="a_low", high=[{"name": "a_high"}]) == {"FINISHED"}
    assert not {"Not baked: 10 of 13 low objects", "With warnings: 1 of 13 low objects"} & {*main().labels}
    assert len(results.batch().left_out) == 10


def make_empty(high):
    """Leave no face of an object, which shows when it is read."""
    high.vertex_groups.new(name="none")
    high.modifiers.new("Mask", "MASK").vertex_group = "none"


def test_a_pair_that_fails_while_it_is_baked_does_not_end_the_batch(batch):
    make_empty(bpy.data.objects["b_high"])
    for name in "ac":
        bpy.data.images.remove(bpy.data.images[f"{name}_low_height"])
    assert bpy.ops.imprint.bake_pairs() == {"FINISHED"}
    assert [name for name, _ in results.batch().left_out] == ["b_low"]
    assert "a_low_height" in bpy.data.images and "c_low_height" in bpy.data.images
    for name in "ac":
        make_empty(bpy.data.objects[f"{name}_high"])
    with pytest.raises(RuntimeError, match="c_high"):  # what the last one says, if all fail
        bpy.ops.imprint.bake_pairs()


def test_a_batch_without_any_pair_that_can_be_baked_says_why():
    zoo.plane("a_low").data.uv_layers.remove(bpy.data.meshes["a_low"].uv_layers[0])
    zoo.plane("a_high")
    use(size=16, method="CAST")
    with pytest.raises(RuntimeError, match="'a_low' has no UV layer"):
        bpy.ops.imprint.bake_pairs()


def test_the_list_is_kept_with_the_file(batch, tmp_path):
    before = listed()[0], listed()[1].labels
    path = str(tmp_path / "scene.blend")
    bpy.ops.wm.save_as_mainfile(filepath=path)
    bpy.ops.wm.open_mainfile(filepath=path)
    assert (listed()[0], listed()[1].labels) == before


def test_a_click_in_the_list_selects_the_object_and_shows_its_maps(batch):
    low = bpy.data.objects["b_low"]
    low.hide_set(True)
    settings = use(bpy.data.objects["a_low"], bpy.data.objects["a_high"])
    bpy.ops.object.mode_set(mode="EDIT")
    assert bpy.ops.imprint.select_result(low="b_low") == {"FINISHED"}
    assert bpy.context.active_object == low
    assert bpy.context.selected_objects == [low]
    assert bpy.context.mode == "OBJECT"
    chosen = settings.chosen(bpy.context)
    assert (chosen.low, chosen.highs) == (low, [bpy.data.objects["b_high"]])
    shown = [given.image for name, given in listed()[1].given if name == "imprint.show_map"]
    assert shown == ["b_low_normal", "b_low_height"]


def test_a_fix_in_the_list_is_for_its_own_low_object(batch):
    for name in "ab":
        low = bpy.data.objects[f"{name}_low"]
        low.imprint.measure = False
        reports = [
            replace(report, warnings=[Fix.MEASURE.after(f"Missed{' once' * (name == 'a')}.")])
            for report in results.all_of(bpy.context, low)
        ]
        object_pairs.keep_reports(low, reports)
    pair = bpy.data.objects["b_low"].imprint
    (given,) = [given for name, given in listed()[1].given if name == "imprint.fix" and given.low == "b_low"]
    assert bpy.ops.imprint.fix(kind=given.kind, low=given.low) == {"FINISHED"}
    assert pair.measure
    assert not bpy.data.objects["a_low"].imprint.measure


def test_a_result_whose_image_is_gone_is_worth_a_look(batch):
    reports = results.all_of(bpy.context)
    assert results_panel.sign(reports) == "CHECKMARK"
    bpy.data.images.remove(bpy.data.images["a_low_height"])
    assert results_panel.sign(reports) == "INFO"


def test_a_map_opens_beside_the_viewport_and_then_there():
    first, second = (bpy.data.images.new(name, 4, 4) for name in ("first", "second"))
    opened = bpy.context.window_manager.windows[0]
    before = {one.as_pointer(): one.type for one in opened.screen.areas}
    with bpy.context.temp_override(window=opened):
        bake_results.show_image_beside(bpy.context, first)
        (editor,) = [one for one in opened.screen.areas if one.as_pointer() not in before]
        assert len(bpy.context.window_manager.windows) == 1
        assert {one.as_pointer(): one.type for one in opened.screen.areas if one != editor} == before
        assert (editor.type, editor.spaces.active.image) == ("IMAGE_EDITOR", first)
        bake_results.show_image_beside(bpy.context, second)
        assert editor.spaces.active.image == second
        assert len(opened.screen.areas) == len(before) + 1
        editor.type = "VIEW_3D"  # in the background, Blender cannot close it


# The viewport after a bake


def view(shading, size=100):
    return area("VIEW_3D", size, shading=SimpleNamespace(type=shading, show_xray=False))


def context(*areas, at=None):
    """A context of a window with these areas. at: the area with the mouse."""
    opened = window(*areas)
    return SimpleNamespace(
        window=opened,
        window_manager=SimpleNamespace(windows=[opened]),
        area=at,
        scene=bpy.context.scene,
        view_layer=bpy.context.view_layer,
    )


def shading(viewport):
    return viewport.spaces.active.shading.type


def test_a_bake_shows_the_low_mesh_with_its_map(baked):
    low, high = baked
    views, editor = [view("SOLID"), view("SOLID", 200)], image_editor(None)
    bake_results.show_bake(context(*views, editor), [results.of(bpy.context)])
    assert editor.spaces.active.image == bpy.data.images["lo_normal"]
    assert [shading(each) for each in views] == ["SOLID", "MATERIAL"]  # the largest, if the mouse is in none of them
    assert (low.visible_get(), high.visible_get()) == (True, False)
    bake_results.show_bake(context(*views, at=views[0]), [results.of(bpy.context)])
    assert shading(views[0]) == "MATERIAL"


def test_a_view_that_is_not_solid_stays(baked):
    _, high = baked
    for kind, sees_high in (("WIREFRAME", True), ("RENDERED", False), ("MATERIAL", False)):
        high.hide_set(False)
        viewport = view(kind)
        bake_results.show_bake(context(viewport), [results.of(bpy.context)])
        assert (shading(viewport), high.visible_get()) == (kind, sees_high)


def test_a_map_without_a_material_does_not_change_the_viewport(baked):
    _, high = baked
    bpy.ops.imprint.bake(low="lo", high=[{"name": "hi"}], material=False)
    viewport = view("SOLID")
    bake_results.show_bake(context(viewport), [results.of(bpy.context)])
    assert (shading(viewport), high.visible_get()) == ("SOLID", True)


def test_without_a_3d_viewport_nothing_is_hidden(baked):
    bake_results.show_bake(context(), [results.of(bpy.context)])
    assert baked[1].visible_get()


def test_a_low_object_that_is_its_own_high_one_stays():
    low = zoo.plane("lo")
    low.modifiers.new("Rounded", "SUBSURF")
    settings = bpy.context.scene.imprint
    settings.width = settings.height = 16
    settings.low = low
    bpy.ops.imprint.bake(low="lo", high=[{"name": "lo"}])
    bake_results.show_bake(context(view("SOLID")), [results.of(bpy.context)])
    assert low.visible_get()
    assert not bpy.ops.imprint.show_high.poll()


def test_scripts_do_not_change_viewports(baked, monkeypatch):
    views = []
    monkeypatch.setattr(bake_results, "show_bake", lambda *arguments: views.append(arguments))
    bpy.ops.imprint.bake("EXEC_DEFAULT", low="lo", high=[{"name": "hi"}])
    bpy.ops.imprint.bake("INVOKE_DEFAULT", low="lo", high=[{"name": "hi"}])  # in the background, there is no window
    assert views == []


# Hidden high objects


def test_high_objects_of_the_last_bake_are_used_if_none_are_chosen(baked):
    low, high = baked

    def chosen():
        return bpy.context.scene.imprint.chosen(bpy.context).highs

    assert chosen() == [high]
    other = zoo.plane("other")
    other.select_set(True)
    assert chosen() == [other]
    other.select_set(False)
    low.modifiers.new("Rounded", "SUBSURF")
    for is_hidden in (False, True):
        bake_results.hide_high(bpy.context, results.of(bpy.context), hide=is_hidden)
        assert chosen() == [high]  # modifiers such as Bevel belong to many a low object
    bpy.context.scene.imprint.highs.add().object = low
    assert chosen() == [low]


def test_high_objects_are_hidden_and_shown_in_turn(baked):
    _, high = baked
    for is_visible in (False, True, False):
        assert bpy.ops.imprint.show_high() == {"FINISHED"}
        assert high.visible_get() == is_visible
    bpy.data.objects.remove(high)
    assert not bpy.ops.imprint.show_high.poll()


def test_objects_with_the_name_of_a_high_object_stay_visible(baked, tmp_path):
    low, high = baked
    bpy.data.libraries.write(str(tmp_path / "l.blend"), {high})
    with bpy.data.libraries.load(str(tmp_path / "l.blend"), link=True) as (_, here):
        here.objects = ["hi"]
    (linked,) = here.objects
    bpy.context.scene.collection.objects.link(linked)
    for own, other in ((high, linked), (linked, high)):
        report = SimpleNamespace(high=["hi"], refs=[ObjectRef.of(low), ObjectRef.of(own)])
        bake_results.hide_high(bpy.context, report, hide=True)
        assert (own.visible_get(), other.visible_get()) == (False, True)
        bake_results.hide_high(bpy.context, report, hide=False)


# Connect maps


@pytest.fixture
def low():
    """A low object in its slot, with a high one."""
    low, high = zoo.plane("lo"), zoo.plane("hi")
    high.location.z = 0.2
    use(low, size=16, method="CAST", material=False)
    return low


def bake(**settings):
    for name, value in settings.items():
        setattr(bpy.context.scene.imprint, name, value)
    assert bpy.ops.imprint.bake(low="lo", high=[{"name": "hi"}]) == {"FINISHED"}


def displacement(low):
    return low.active_material.node_tree.nodes["Material Output"].inputs["Displacement"]


def test_the_button_needs_a_map_that_a_material_takes(low):
    assert not bpy.ops.imprint.connect_maps.poll()
    bake(maps={"DISTANCE"})
    assert not bpy.ops.imprint.connect_maps.poll()
    bake(maps={"HEIGHT"})
    assert bpy.ops.imprint.connect_maps.poll()


def test_a_bake_leaves_the_material_to_the_button(low):
    bake(maps={"HEIGHT"})
    assert len(low.material_slots) == 0
    assert bpy.ops.imprint.connect_maps() == {"FINISHED"}
    assert displacement(low).is_linked


def test_a_shared_material_is_copied_as_the_setting_says(low):
    material = bpy.data.materials.new("Skin")
    for obj in (low, bpy.data.objects["hi"]):
        obj.data.materials.append(material)
    bake(maps={"HEIGHT"}, single_user=True)
    assert bpy.ops.imprint.connect_maps() == {"FINISHED"}
    assert low.active_material.name == "Skin.001"
    assert displacement(low).is_linked
    assert not displacement(bpy.data.objects["hi"]).is_linked


def test_an_image_that_is_gone_is_a_warning(low):
    bake(maps={"HEIGHT"})
    bpy.data.images.remove(bpy.data.images["lo_height"])
    assert bpy.ops.imprint.connect_maps() == {"FINISHED"}
    assert len(low.material_slots) == 0


@pytest.mark.parametrize("pack", ["NONE", "CUSTOM"])
def test_a_map_without_a_value_is_a_warning(low, pack):
    material = bpy.data.materials.new("Noisy")
    tree = material.node_tree
    noise = tree.nodes.new("ShaderNodeTexNoise").outputs[0]
    shader = tree.nodes["Principled BSDF"]
    for name in ("Base Color", "Metallic"):
        tree.links.new(noise, shader.inputs[name])
    bpy.data.objects["hi"].data.materials.append(material)
    maps = {"BASE_COLOR", "METALLIC", "ROUGHNESS"}
    bake(maps=maps, exact_materials="OFF", pack=pack, pack_red="METALLIC", connect_maps=True)
    found = low.active_material.node_tree.nodes["Principled BSDF"].inputs
    assert [name for name in ("Base Color", "Metallic", "Roughness") if found[name].is_linked] == ["Roughness"]
    (report,) = results.all_of(bpy.context)
    assert "Maps without a value are not connected: Base Color, Metallic." in report.warnings
    assert [name for name, how in report.maps.items() if how.get("empty")] == ["base_color", "metallic"]


def test_undo_takes_attributes_and_links_away_in_one_step(low):
    settings = bpy.context.scene.imprint
    settings.maps, settings.vertex_domain, settings.connect_maps = {"HEIGHT"}, "CORNER", True
    bpy.ops.ed.undo_push(message="before")
    before = snapshot()
    bpy.ops.imprint.bake("EXEC_DEFAULT", True, low="lo", high=[{"name": "hi"}])
    assert "height" in low.data.attributes
    assert displacement(low).is_linked
    assert bpy.ops.ed.undo() == {"FINISHED"}
    assert difference(before, snapshot()) == {}


def test_undo_of_the_button_leaves_the_images(low):
    bake(maps={"HEIGHT"})
    bpy.ops.ed.undo_push(message="before")
    before = snapshot()
    assert bpy.ops.imprint.connect_maps("EXEC_DEFAULT", True) == {"FINISHED"}
    assert bpy.ops.ed.undo() == {"FINISHED"}
    assert difference(before, snapshot()) == {}
    assert "lo_height" in bpy.data.images


def colored(obj):
    """Give an object two materials."""
    for name in ("red", "blue"):
        obj.data.materials.append(bpy.data.materials.new(name))
    obj.data.polygons.foreach_set("material_index", [number % 2 for number in range(len(obj.data.polygons))])


@pytest.mark.parametrize("way", ["setting", "button", "copy"])
def test_undo_brings_all_materials_back_in_one_step(low, way):
    low.data = zoo.plane("finer", n=2).data
    colored(low)
    settings = bpy.context.scene.imprint
    settings.maps, settings.one_material = {"ROUGHNESS"}, way == "setting"
    bake = partial(bpy.ops.imprint.bake, "EXEC_DEFAULT", True, low="lo", high=[{"name": "lo"}])
    if way != "setting":
        bake()
    bpy.ops.ed.undo_push(message="before")
    before = snapshot()
    if way == "setting":
        bake()
    else:
        assert bpy.ops.imprint.one_material("EXEC_DEFAULT", True, on_copies=way == "copy") == {"FINISHED"}
    shown = bpy.data.objects["lo.001" if way == "copy" else "lo"]
    assert [slot.material.name for slot in shown.material_slots] == [shown.name]
    assert len(bpy.data.objects["lo"].material_slots) == (2 if way == "copy" else 1)
    assert bpy.ops.ed.undo() == {"FINISHED"}
    assert difference(before, snapshot()) == {}
    assert list(bpy.data.objects["lo"].data.materials.keys()) == ["red", "blue"]


def test_a_script_names_the_object(low):
    zoo.plane("other")
    with pytest.raises(RuntimeError, match="poll"):
        bpy.ops.imprint.one_material(low="lo")
    bake(maps={"ROUGHNESS"})
    with pytest.raises(RuntimeError, match="'other' was not baked: bake it first"):
        bpy.ops.imprint.one_material(low="other")
    scenes.select(bpy.data.objects["other"])
    assert bpy.ops.imprint.one_material(low="lo") == {"FINISHED"}
    assert [slot.material.name for slot in low.material_slots] == ["lo"]


def test_the_button_takes_all_objects_of_the_image(low):
    other = zoo.plane("other")
    for obj in (low, other):
        colored(obj)
    scenes.move_uvs(low, scale=(0.4, 1.0))
    scenes.move_uvs(other, scale=(0.4, 1.0), offset=(0.5, 0.0))
    jobs = [Job(obj, [obj]) for obj in (low, other)]
    results.remember(bake_all(bpy.context, jobs, scenes.settings(maps=("ROUGHNESS",), image="both"), share_image=True))
    assert bpy.ops.imprint.one_material(join=True) == {"FINISHED"}
    assert "other" not in bpy.data.objects
    assert len(low.data.polygons) == 2
    assert [slot.material.name for slot in low.material_slots] == ["atlas"]


def test_the_button_connects_each_texture_set_with_its_own_material(low):
    low.data = zoo.plane("finer", n=2).data
    low.data.materials.append(bpy.data.materials.new("First"))
    low.data.materials.append(bpy.data.materials.new("Second"))
    low.data.polygons.foreach_set("material_index", [number % 2 for number in range(len(low.data.polygons))])
    bake(maps={"HEIGHT"}, texture_sets=True)
    assert bpy.ops.imprint.connect_maps() == {"FINISHED"}
    images = []
    for name in ("First", "Second"):
        node = bpy.data.materials[name].node_tree.nodes["Material Output"].inputs["Displacement"].links[0].from_node
        images.append(node.inputs["Height"].links[0].from_node.image.name)
    assert images == ["lo_First_height", "lo_Second_height"]


# Export operator


@pytest.fixture
def low_object():
    low_object, high = zoo.plane("lo"), zoo.plane("hi", slope=0.2)
    settings = bpy.context.scene.imprint
    settings.low, settings.method, settings.width, settings.height = low_object, "FLATTEN", 64, 64
    settings.highs.add().object = high
    return low_object


def test_there_is_nothing_to_export_before_a_bake(low_object):
    assert not bpy.ops.imprint.export.poll()


def test_the_button_writes_the_file_of_the_panel(low_object, tmp_path):
    bpy.ops.imprint.bake()
    bpy.context.scene.imprint.export = str(tmp_path / "{low}.glb")
    assert bpy.ops.imprint.export() == {"FINISHED"}
    assert (tmp_path / "lo.glb").is_file()
    (report,) = results.all_of(bpy.context, low_object)
    assert report.export["files"] == [str(tmp_path / "lo.glb")]
    assert "lo.glb: 2 triangles, read back" in "\n".join(report.summary())


def test_an_error_is_told(low_object, tmp_path):
    bpy.ops.imprint.bake()
    with pytest.raises(RuntimeError, match=r"is no file for an engine: .glb"):
        bpy.ops.imprint.export(filepath=str(tmp_path / "lo.obj"))
    with pytest.raises(RuntimeError, match="No file is set"):
        bpy.ops.imprint.export()


def test_the_panel_keeps_the_warnings_of_the_file(tmp_path):
    """Two triangles of a bent quad have other tangents than the quad."""
    low_object, high = bent_pair()
    settings = bpy.context.scene.imprint
    settings.low, settings.method, settings.width, settings.height = low_object, "FLATTEN", 64, 64
    settings.highs.add().object = high
    bpy.ops.imprint.bake()
    bpy.ops.imprint.export(filepath=str(tmp_path / "lo.fbx"))
    assert "Engines make their own tangents of this file" in panel_layout.draw(width=2000).text
    bpy.ops.imprint.export(filepath=str(tmp_path / "lo.glb"))
    assert "Engines make their own tangents of this file" not in panel_layout.draw(width=2000).text


def test_paragraphs_are_as_wide_as_there_is_room():
    size = texts.font_size(1.0)
    text = "WWWW " * 20 + "iiii " * 20 + "/a/path/without/a/space" * 6
    lines = texts.wrapped(text, 200.0, size)
    assert "".join(lines).replace(" ", "") == text.replace(" ", "")
    widths = [texts.text_width(line, size) for line in lines]
    assert max(widths) <= 200.0
    assert sum(widths) > 0.75 * 200.0 * len(lines)
    assert texts.wrapped("", 200.0, size) == []
