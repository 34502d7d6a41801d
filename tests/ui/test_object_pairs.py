# SPDX-License-Identifier: GPL-3.0-or-later
"""The pair of a low object, which the file keeps: high objects, cage, method, distances and the last result."""

import bpy
import numpy as np
import pytest

from addon.core.settings import Settings
from addon.ui import bake_results, object_pairs
from addon.ui.bake_results import results
from addon.ui.live import live
from tests.support import maps, zoo
from tests.support.other_process import elsewhere
from tests.support.panel import select, use
from tests.support.panel_layout import draw

pytestmark = pytest.mark.usefixtures("registered", "gpu_context")

SETTINGS = Settings(method="CAST").flat()


@pytest.fixture
def crate():
    """A baked low object, active, and its high object, which Imprint has hidden."""
    low, high = zoo.plane("crate_low"), zoo.plane("crate_high", slope=1.0)
    use(size=16, method="CAST")
    select(low, high)
    assert bpy.ops.imprint.bake() == {"FINISHED"}
    high.hide_set(True)
    select(low)
    return low, high


def chosen(low=None):
    """The names of the high objects that the panel would bake."""
    return [high.name for high in bpy.context.scene.imprint.chosen(bpy.context, low).highs]


def pair(name="crate_low"):
    return object_pairs.of(bpy.data.objects[name])


def texels(name):
    return maps.pixels(bpy.data.images[name])


def save(path):
    bpy.ops.wm.save_as_mainfile(filepath=str(path))


def open_file(path):
    bpy.ops.wm.open_mainfile(filepath=str(path))


def select_all():
    for obj in bpy.context.view_layer.objects:
        obj.select_set(True)


# Day two


@pytest.mark.slow
def test_another_process_bakes_the_saved_pair(crate, tmp_path):
    """With the low object alone active, and after selecting all, while the high object is still hidden."""
    before = texels("crate_low_normal")
    save(tmp_path / "crate.blend")
    found = elsewhere(
        tmp_path / "crate.blend",
        """
        scene = bpy.context.scene
        found = {"shown": results.of(bpy.context).high, "hidden": [o.name for o in scene.objects if o.hide_get()]}
        for select_all in (False, True):
            for obj in bpy.context.view_layer.objects:
                obj.select_set(select_all or obj == low)
            bpy.data.images.remove(bpy.data.images["crate_low_normal"])
            assert bpy.ops.imprint.bake() == {"FINISHED"}
            found[f"texels {select_all}"] = list(bpy.data.images["crate_low_normal"].pixels)
        assert bpy.ops.imprint.show_high() == {"FINISHED"}
        found["hidden after the eye"] = [o.name for o in scene.objects if o.hide_get()]
        """,
    )
    assert (found["shown"], found["hidden"], found["hidden after the eye"]) == (["crate_high"], ["crate_high"], [])
    for kind in (False, True):
        assert np.array_equal(np.array(found[f"texels {kind}"], np.float32).reshape(before.shape), before)


def test_a_low_object_keeps_its_cage_method_and_distances(tmp_path):
    """Two low objects with other settings than the scene: the panel shows those of the active one, and a bake takes them."""
    settings = use(size=16, method="CAST")
    for number, name in enumerate(("a", "b"), 1):
        select(zoo.plane(name), zoo.plane(f"{name} hi", slope=1.0))
        settings.cage, settings.measure = zoo.plane(f"{name} cage"), False
        settings.cage.location.z = 1.0
        settings.extrusion, settings.max_distance = 0.5 * number, 2.0 * number
        assert bpy.ops.imprint.bake() == {"FINISHED"}
    for obj in ("c", "c hi"):
        zoo.plane(obj)
    select(bpy.data.objects["c"], bpy.data.objects["c hi"])
    settings.method, settings.measure, settings.cage = "FLATTEN", True, None
    save(tmp_path / "two.blend")
    open_file(tmp_path / "two.blend")
    settings = bpy.context.scene.imprint
    for number, name in enumerate(("a", "b"), 1):
        select(bpy.data.objects[name])
        rays = settings.chosen(bpy.context).rays
        assert (rays.method, rays.measure, rays.cage.name) == ("CAST", False, f"{name} cage")
        assert (rays.extrusion, rays.max_distance) == (0.5 * number, 2.0 * number)
        assert bpy.ops.imprint.bake() == {"FINISHED"}
        report = results.of(bpy.context)
        assert (report.method, report.cage, report.distances["max_distance"]) == ("CAST", f"{name} cage", 2.0 * number)
    assert settings.method == "FLATTEN"


def test_a_change_in_the_panel_is_that_of_its_low_object(crate):
    settings = bpy.context.scene.imprint
    assert settings.chosen(bpy.context).rays == pair()
    pair().method = "FLATTEN"
    assert bpy.ops.imprint.bake() == {"FINISHED"}
    assert (results.of(bpy.context).method, settings.method) == ("FLATTEN", "CAST")


def test_what_a_script_sets_in_the_scene_is_taken_for_the_panels_low_object(crate):
    bpy.context.scene.imprint.method = "FLATTEN"
    assert bpy.ops.imprint.bake() == {"FINISHED"}
    assert results.of(bpy.context).method == "FLATTEN"


def test_high_objects_that_are_named_are_baked_with_the_settings_of_the_scene(crate):
    other = zoo.plane("other", slope=-1.0)
    select(other)
    bpy.context.scene.imprint.method = "FLATTEN"
    assert bpy.ops.imprint.bake(low="crate_low", high=[{"name": "other"}]) == {"FINISHED"}
    assert ([high.object.name for high in pair().highs], pair().method) == (["other"], "FLATTEN")


def test_selected_high_objects_win_and_are_remembered(crate):
    low, _ = crate
    other = zoo.plane("other", slope=-1.0)
    select(low, other)
    assert chosen() == ["other"]
    assert bpy.ops.imprint.bake() == {"FINISHED"}
    select(low)
    assert chosen() == ["other"]


def test_selecting_all_that_is_visible_bakes_no_low_object_onto_another(crate):
    """Both high objects are hidden, and only the low ones and the cage can be selected."""
    settings = bpy.context.scene.imprint
    low, high = zoo.plane("barrel_low"), zoo.plane("barrel_high", slope=1.0)
    settings.cage = zoo.plane("cage")
    select(low, high)
    assert bpy.ops.imprint.bake() == {"FINISHED"}
    high.hide_set(True)
    select_all()
    assert low.select_get()
    assert bpy.data.objects["crate_low"].select_get()
    for name in ("barrel", "crate"):
        bpy.context.view_layer.objects.active = bpy.data.objects[f"{name}_low"]
        assert chosen() == [f"{name}_high"]


def test_pairs_by_name_are_remembered():
    for name in ("a", "b"):
        zoo.plane(f"{name}_low")
        zoo.plane(f"{name}_high")
    use(size=16, method="CAST")
    assert bpy.ops.imprint.bake_pairs() == {"FINISHED"}
    for name in ("a", "b"):
        select(bpy.data.objects[f"{name}_low"])
        assert chosen() == [f"{name}_high"]


def test_a_pair_by_name_can_be_left_out_or_have_a_size_of_its_own(tmp_path):
    for name in ("a", "b", "c"):
        zoo.plane(f"{name}_low")
        zoo.plane(f"{name}_high")
    use(size=16, method="CAST")
    bpy.data.objects["a_low"].imprint_is_baked = False
    bpy.data.objects["b_low"].imprint_size = "256"
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "pairs.blend"))
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "pairs.blend"))
    assert bpy.ops.imprint.bake_pairs() == {"FINISHED"}
    sizes = {image.name: tuple(image.size) for image in bpy.data.images if image.name.endswith("_normal")}
    assert sizes == {"b_low_normal": (256, 256), "c_low_normal": (16, 16)}
    for name in ("b", "c"):
        bpy.data.objects[f"{name}_low"].imprint_is_baked = False
    with pytest.raises(RuntimeError, match="No pair is switched on"):
        bpy.ops.imprint.bake_pairs()


def test_a_pair_by_name_can_have_a_distance_of_its_own():
    for name in ("a", "b"):
        zoo.plane(f"{name}_low")
        zoo.plane(f"{name}_high").location.z = 0.5
    use(size=16, method="CAST")
    low, other = bpy.data.objects["a_low"], bpy.data.objects["b_low"]
    low.imprint_distance = 0.75
    assert bpy.ops.imprint.bake_pairs() == {"FINISHED"}
    (report,), (measured,) = (object_pairs.of(obj).reports() for obj in (low, other))
    assert (report.distances, report.measured) == ({"extrusion": 0.75, "max_distance": 1.5}, False)
    assert report.missed == 0.0
    assert measured.measured
    low.imprint_distance = 0.25  # ends before the high mesh
    assert bpy.ops.imprint.bake_pairs() == {"FINISHED"}
    ((name, reason),) = results.batch().left_out
    assert name == "a_low"
    assert "'a_low'" in reason


def test_names_of_maps_leave_out_the_chosen_ending():
    for ending in ("game", "sculpt"):
        zoo.plane(f"rock.{ending}")
    use(size=16, method="CAST", low_suffix=".game", high_suffix=".sculpt", image="T_{name}")
    assert bpy.ops.imprint.bake_pairs() == {"FINISHED"}
    assert [image.name for image in bpy.data.images if image.size[0]] == ["T_rock"]


def test_one_image_for_all_pairs_has_one_size():
    for name in ("a", "b"):
        zoo.plane(f"{name}_low")
        zoo.plane(f"{name}_high")
    use(size=16, method="CAST", share_image=True)
    bpy.data.objects["b_low"].imprint_size = "256"
    assert bpy.ops.imprint.bake_pairs() == {"FINISHED"}
    assert {tuple(image.size) for image in bpy.data.images if image.users and image.size[0]} == {(16, 16)}


def test_live_leaves_a_pair(tmp_path):
    low, high = zoo.plane("lo"), zoo.plane("hi", slope=1.0)
    use(size=16, method="CAST", material=False)
    select(low, high)
    assert bpy.ops.imprint.live() == {"FINISHED"}
    select(low)
    save(tmp_path / "live.blend")
    live.stop()
    assert chosen() == ["hi"]
    assert pair("lo").method == "CAST"


# What an object goes through


def test_renamed_objects_stay_a_pair(crate, tmp_path):
    low, high = crate
    low.name, high.name = "box", "sculpt"
    save(tmp_path / "crate.blend")
    open_file(tmp_path / "crate.blend")
    assert chosen() == ["sculpt"]
    assert results.of(bpy.context).image == "crate_low_normal"
    assert [high.name for high in bake_results.high_objects(results.of(bpy.context))] == ["sculpt"]


def test_a_copy_has_the_pair(crate):
    bpy.ops.object.duplicate()
    copy = bpy.context.active_object
    assert copy.name == "crate_low.001"
    assert chosen() == ["crate_high"]
    assert bpy.ops.imprint.bake() == {"FINISHED"}
    assert "crate_low.001_normal" in bpy.data.images


def test_both_copied_are_a_pair_of_their_own(crate):
    low, high = crate
    high.hide_set(False)
    select(low, high)
    bpy.ops.object.duplicate()
    select(bpy.data.objects["crate_low.001"])
    assert chosen() == ["crate_high.001"]


@pytest.mark.parametrize("link", [False, True])
def test_appended_and_linked_low_objects_bring_their_pair(crate, tmp_path, link):
    save(tmp_path / "crate.blend")
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    use(size=16, method="CAST")
    call = bpy.ops.wm.link if link else bpy.ops.wm.append
    call(directory=f"{tmp_path / 'crate.blend'}/Object/", filename="crate_low")
    low = bpy.data.objects["crate_low"]
    select(low)
    assert chosen() == ["crate_high"]
    high = bpy.data.objects["crate_high"]
    assert (high.library is not None) is link
    if link:  # Blender puts the low object into the scene alone
        assert "'crate_high' is not in scene" in draw(2000).text
        assert "imprint.show_hidden" in dict(draw().buttons)
        assert bpy.ops.imprint.show_hidden() == {"FINISHED"}
    assert bpy.ops.imprint.bake(material=not link) == {"FINISHED"}


@pytest.mark.parametrize(("before", "after"), [(0, 1), (0, 3), (1, 1), (1, 3), (3, 1), (3, 2), (2, 0)])
def test_an_override_keeps_a_pair_of_its_own(tmp_path, before, after):
    """before, after: the number of high objects in the library and in the override; 0 for the object's own modifiers."""
    low = zoo.plane("lo")
    low.modifiers.new("Rounded", "SUBSURF")
    use(size=16, method="CAST")
    if before:
        object_pairs.remember_objects(low, [zoo.plane(f"hi{n}") for n in range(before)], None, SETTINGS, {})
    save(tmp_path / "library.blend")
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    bpy.ops.wm.link(directory=f"{tmp_path / 'library.blend'}/Object/", filename="lo")
    low = bpy.data.objects["lo"].override_create(remap_local_usages=True)
    highs = [zoo.plane(f"own{n}") for n in range(after)] or [low]
    object_pairs.remember_objects(low, highs, None, SETTINGS | {"extrusion": 0.25, "max_distance": 0.75}, {})
    for number in range(3):
        save(tmp_path / f"override{number}.blend")
        open_file(tmp_path / f"override{number}.blend")
    low = next(obj for obj in bpy.data.objects if obj.override_library is not None)
    found = object_pairs.of(low)
    assert [high.name for high in found.found()] == ([f"own{n}" for n in range(after)] or ["lo"])
    assert found.missing() == []
    assert (found.method, found.measure, found.extrusion, found.max_distance) == ("CAST", False, 0.25, 0.75)


def test_undo_and_redo_of_a_bake():
    zoo.plane("lo")
    zoo.plane("hi")
    use(size=16, method="CAST")
    bpy.ops.ed.undo_push(message="before")
    bpy.ops.imprint.bake("EXEC_DEFAULT", True, low="lo", high=[{"name": "hi"}])
    assert pair("lo").is_kept
    bpy.ops.ed.undo()
    assert pair("lo") is None or not pair("lo").is_kept
    bpy.ops.ed.redo()
    assert [high.find().name for high in pair("lo").highs] == ["hi"]


# Deleted high objects


def delete(obj):
    """As X in the viewport does."""
    obj.hide_set(False)
    select(obj)
    bpy.ops.object.delete()


def test_a_deleted_high_object_does_not_stay_in_the_file(crate, tmp_path):
    """Neither by the pair of the low object, nor by the slots."""
    low, high = crate
    settings = bpy.context.scene.imprint
    settings.highs.add().object, settings.low = high, low
    delete(high)
    save(tmp_path / "crate.blend")
    open_file(tmp_path / "crate.blend")
    assert "crate_high" not in bpy.data.objects
    assert "crate_high" not in bpy.data.meshes
    assert "'crate_high' is not in this file" in draw(2000).text
    assert ("imprint.bake", False) in draw().buttons
    with pytest.raises(RuntimeError, match="'crate_high' is not in this file"):
        bpy.ops.imprint.bake()
    assert bpy.ops.imprint.remove_missing(high="crate_high") == {"FINISHED"}
    assert "is not in this file" not in draw(2000).text
    assert "'crate_low' would be baked onto itself: select 'crate_high' as well" in draw(2000).text


def test_a_deleted_high_object_is_named_before_the_file_is_saved(crate):
    low, high = crate
    delete(high)
    select(low)
    assert chosen() == []
    assert "'crate_high' is in no collection" in draw(2000).text
    assert bpy.ops.imprint.remove_missing() == {"FINISHED"}
    assert "crate_high" not in bpy.data.objects
    assert "crate_high" not in bpy.data.meshes or not bpy.data.meshes["crate_high"].users


def test_one_of_two_deleted_high_objects_stops_the_bake(crate):
    low, high = crate
    other = zoo.plane("bolts")
    high.hide_set(False)
    select(low, high, other)
    assert bpy.ops.imprint.bake() == {"FINISHED"}
    before = texels("crate_low_normal")
    delete(other)
    select(low)
    with pytest.raises(RuntimeError, match="'bolts' is in no collection"):
        bpy.ops.imprint.bake()
    assert np.array_equal(texels("crate_low_normal"), before)
    assert bpy.ops.imprint.remove_missing() == {"FINISHED"}
    assert chosen() == ["crate_high"]
    assert results.of(bpy.context).high == ["crate_high", "bolts"]
    assert bpy.ops.imprint.bake() == {"FINISHED"}


def test_undo_after_saving_brings_the_pair_back(crate, tmp_path):
    bpy.ops.ed.undo_push(message="before")
    delete(bpy.data.objects["crate_high"])
    bpy.ops.ed.undo_push(message="deleted")
    save(tmp_path / "crate.blend")
    assert pair().missing() == ["crate_high"]
    bpy.ops.ed.undo()
    assert pair().missing() == []
    assert [high.name for high in pair().found()] == ["crate_high"]


def test_an_object_that_comes_back_by_name_is_the_high_one_and_may_be_renamed(crate, tmp_path):
    low, high = crate
    bpy.data.objects.remove(high)
    save(tmp_path / "crate.blend")
    open_file(tmp_path / "crate.blend")
    select(bpy.data.objects["crate_low"])
    zoo.plane("crate_high", slope=-1.0)
    assert chosen() == ["crate_high"]
    save(tmp_path / "crate.blend")
    bpy.data.objects["crate_high"].name = "again"
    assert chosen() == ["again"]


def test_a_library_that_is_missing_is_named_and_the_pair_stays(tmp_path):
    zoo.plane("hi", slope=1.0)
    save(tmp_path / "library.blend")
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    with bpy.data.libraries.load(str(tmp_path / "library.blend"), link=True) as (_, here):
        here.objects = ["hi"]
    bpy.context.scene.collection.objects.link(here.objects[0])
    use(size=16, method="CAST")
    select(zoo.plane("lo"), here.objects[0])
    assert bpy.ops.imprint.bake() == {"FINISHED"}
    select(bpy.data.objects["lo"])
    save(tmp_path / "scene.blend")
    (tmp_path / "library.blend").rename(tmp_path / "away.blend")
    for _ in range(2):  # the pair also survives saving without the library
        open_file(tmp_path / "scene.blend")
        with pytest.raises(RuntimeError, match=r"'hi' is linked from '.*library.blend', but is not in that file"):
            bpy.ops.imprint.bake()
        save(tmp_path / "scene.blend")
    (tmp_path / "away.blend").rename(tmp_path / "library.blend")
    open_file(tmp_path / "scene.blend")
    assert chosen() == ["hi"]
    assert bpy.ops.imprint.bake() == {"FINISHED"}


def test_deleted_objects_in_the_slots_for_low_and_cage_do_not_stay(tmp_path):
    settings = use(size=16, method="CAST")
    settings.low, settings.cage = zoo.plane("lo"), zoo.plane("cage")
    delete(settings.low)
    delete(settings.cage)
    save(tmp_path / "scene.blend")
    open_file(tmp_path / "scene.blend")
    assert not bpy.data.objects
    assert not bpy.data.meshes


def test_a_low_object_that_was_appended_alone_says_what_is_true(crate, tmp_path):
    """Its high object comes along, into no collection: nobody has deleted it. Linked, it is baked."""
    save(tmp_path / "crate.blend")
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    with bpy.data.libraries.load(str(tmp_path / "crate.blend")) as (_, appended):
        appended.objects = ["crate_low"]
    (low,) = appended.objects
    bpy.context.collection.objects.link(low)
    select(low)
    use(size=16, method="CAST")
    text = draw(2000).text
    assert "'crate_high' is in no collection: bring it back with Undo, link it to one, or remove it." in text
    assert "deleted" not in text
    bpy.context.collection.objects.link(bpy.data.objects["crate_high"])
    assert chosen() == ["crate_high"]
    assert bpy.ops.imprint.bake() == {"FINISHED"}


@pytest.mark.parametrize("is_baked", [True, False])
def test_an_overridden_collection_beside_what_it_overrides_is_one_pair(tmp_path, is_baked):
    """The linked objects have the same names."""
    low, high = zoo.plane("tank_low"), zoo.plane("tank_high", slope=1.0)
    shelf = bpy.data.collections.new("Tank")
    bpy.context.scene.collection.children.link(shelf)
    for obj in (low, high):
        bpy.context.scene.collection.objects.unlink(obj)
        shelf.objects.link(obj)
    use(size=16, method="CAST", material=False)
    select(low, high)
    if is_baked:
        bpy.ops.imprint.bake()
    save(tmp_path / "tank.blend")
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    with bpy.data.libraries.load(str(tmp_path / "tank.blend"), link=True) as (_, linked):
        linked.collections = ["Tank"]
    bpy.context.scene.collection.children.link(linked.collections[0])
    linked.collections[0].override_hierarchy_create(bpy.context.scene, bpy.context.view_layer)
    names = [obj.name for obj in bpy.context.view_layer.objects]
    assert sorted(names) == ["tank_high", "tank_high", "tank_low", "tank_low"]
    settings = use(size=16, method="CAST", material=False)
    assert settings.pairs_by_name(bpy.context)[1] == []
    for obj in bpy.context.view_layer.objects:
        if obj.name == "tank_low":
            select(obj)
            (other,) = settings.chosen(bpy.context).highs
            assert other.library == obj.library
            assert "twice" not in draw(2000).text
    assert bpy.ops.imprint.bake_pairs() == {"FINISHED"}
    (low,) = [obj for obj in bpy.context.view_layer.objects if obj.name == "tank_low" and obj.library is None]
    assert low.imprint.result


def test_slots_of_older_files_have_their_names_after_saving(tmp_path):
    """Version 0.2 stored pointers alone."""
    low, high = zoo.plane("lo"), zoo.plane("hi")
    settings = use(size=16, method="CAST")
    settings.low = low
    settings.highs.add().object = high
    settings.highs[0].property_unset("called")
    assert chosen() == ["hi"]
    delete(high)
    assert "'hi' is in no collection" in draw(2000).text
    save(tmp_path / "scene.blend")
    open_file(tmp_path / "scene.blend")
    assert "hi" not in bpy.data.objects
    assert "'hi' is not in this file" in draw(2000).text


# Hidden high objects


def test_a_hidden_high_object_has_a_button_that_shows_it(crate):
    _, high = crate
    assert "'crate_high' is hidden." in draw(2000).text
    assert "'crate_high' is hidden." not in draw(2000).in_rows  # beside a button, Blender would cut it off
    assert ("imprint.bake", True) in draw().buttons
    assert bpy.ops.imprint.show_hidden() == {"FINISHED"}
    assert high.visible_get()
    assert "hidden" not in draw(2000).text


# High objects by name


@pytest.mark.parametrize("is_hidden", [False, True])
def test_the_low_object_alone_finds_its_high_objects_by_name(crate, is_hidden):
    """Also in files of older versions, which have no pairs."""
    low, high = crate
    first = texels("crate_low_normal")
    low.property_unset("imprint")
    high.hide_set(is_hidden)
    zoo.plane("other_high")
    zoo.plane("crate_high_2").location.z = -5.0
    select(low)
    assert chosen() == ["crate_high", "crate_high_2"]
    assert "Casts rays from 'crate_low' to 'crate_high', 'crate_high_2'" in draw(2000).text
    assert ("imprint.bake", True) in draw().buttons
    assert ("'crate_high' is hidden." in draw(2000).text) == is_hidden
    assert bpy.ops.imprint.bake() == {"FINISHED"}
    assert [item.object.name for item in pair().highs] == ["crate_high", "crate_high_2"]
    np.testing.assert_array_equal(texels("crate_low_normal"), first)


def test_what_is_selected_wins_over_names_and_names_over_modifiers(crate):
    low, _ = crate
    low.property_unset("imprint")
    other = zoo.plane("sculpt")
    low.modifiers.new("Bevel", "BEVEL")
    select(low, other)
    assert chosen() == ["sculpt"]
    select(low)
    assert chosen() == ["crate_high"]
    bpy.context.scene.imprint.high_suffix = "_sculpt"
    assert chosen() == ["crate_low"]
    bpy.context.scene.imprint.high_suffix = "_low"  # as that of low objects: nothing is matched
    assert chosen() == ["crate_low"]


def test_a_light_that_is_called_as_a_high_object_is_none(crate):
    low, high = crate
    low.property_unset("imprint")
    delete(high)
    light = bpy.data.objects.new("crate_high_light", bpy.data.lights.new("light", "POINT"))
    bpy.context.scene.collection.objects.link(light)
    select(low)
    assert chosen() == ["crate_low"]


def test_a_high_object_in_a_hidden_collection_cannot_be_shown(crate):
    _, high = crate
    collection = bpy.data.collections.new("hidden")
    bpy.context.scene.collection.children.link(collection)
    collection.objects.link(high)
    bpy.context.scene.collection.objects.unlink(high)
    bpy.context.view_layer.layer_collection.children["hidden"].exclude = True
    with pytest.raises(RuntimeError, match="'crate_high' is in a hidden collection"):
        bpy.ops.imprint.show_hidden()


# Modifiers of the low object


def test_bevel_and_weighted_normal_do_not_replace_the_remembered_high_object(crate):
    low, high = crate
    before = texels("crate_low_normal")
    low.modifiers.new("Bevel", "BEVEL")
    low.modifiers.new("Weighted Normal", "WEIGHTED_NORMAL")
    for is_hidden in (True, False):
        high.hide_set(is_hidden)
        assert bpy.ops.imprint.bake() == {"FINISHED"}
        assert results.of(bpy.context).high == ["crate_high"]
    assert np.abs(texels("crate_low_normal")[8, 8] - before[8, 8]).max() < 0.01


def test_own_modifiers_are_baked_without_others_or_when_the_low_object_is_in_a_slot(crate, tmp_path):
    low, _ = crate
    low.modifiers.new("Rounded", "SUBSURF")
    bpy.context.scene.imprint.highs.add().object = low
    assert chosen() == ["crate_low"]
    assert bpy.ops.imprint.bake() == {"FINISHED"}
    bpy.context.scene.imprint.highs.clear()
    save(tmp_path / "own.blend")
    open_file(tmp_path / "own.blend")
    assert chosen() == ["crate_low"]
    low = bpy.data.objects["crate_low"]
    delete(low)  # its own pair does not keep it
    assert "crate_low" not in bpy.data.objects
