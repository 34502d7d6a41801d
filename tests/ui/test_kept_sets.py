# SPDX-License-Identifier: GPL-3.0-or-later
"""Sets in the file: saved, appended, linked, overridden, copied, undone; and parts that come and go."""

import random

import bpy
import numpy as np
import pytest

from addon.core.progress import Pace
from addon.ui import set_operators, sets, signs
from tests.support import maps, zoo
from tests.support.other_process import elsewhere
from tests.support.panel import add, refusal, select, use

pytestmark = pytest.mark.usefixtures("registered", "gpu_context")


@pytest.fixture
def props():
    """Three pairs by name in a set, which has its own size and engine."""
    for name in "abc":
        zoo.plane(f"{name}_low")
        zoo.plane(f"{name}_high", slope=0.5)
    use(size=16, method="CAST", storage="MEMORY")
    select(*bpy.data.objects)
    assert bpy.ops.imprint.set_add() == {"FINISHED"}
    one = current()
    one.name = "Prop"
    one.own.engine = "Unreal Engine"
    one.own.size, one.own.storage = 32, "PACK"
    return one


def current():
    return sets.active(bpy.context)


def parts(one=None):
    return [low.name for low in sets.lows(bpy.context, one or current())]


def save(path):
    bpy.ops.wm.save_as_mainfile(filepath=str(path))


def open_file(path):
    bpy.ops.wm.open_mainfile(filepath=str(path))


def press(operator, **values):
    """As a button does: with a step for Undo."""
    assert operator("EXEC_DEFAULT", True, **values) == {"FINISHED"}


@pytest.mark.slow
def test_another_process_bakes_the_saved_set(props, tmp_path):
    press(bpy.ops.imprint.bake_sets, name="Prop")
    before = maps.pixels(bpy.data.images["T_a_N"])
    for image in [image for image in bpy.data.images if image.size[0]]:
        bpy.data.images.remove(image)
    bpy.data.objects["b_low"].name = "lid_low"
    save(tmp_path / "prop.blend")
    found = elsewhere(
        tmp_path / "prop.blend",
        """
        one = sets.active(bpy.context)
        found = {"name": one.name, "own": one.own.names_of_own(), "lows": [low.name for low in sets.lows(bpy.context, one)]}
        assert bpy.ops.imprint.bake_sets() == {"FINISHED"}
        found["texels"] = list(bpy.data.images["T_a_N"].pixels)
        """,
    )
    assert (found["name"], found["own"], found["lows"]) == ("Prop", props.own.names_of_own(), parts())
    np.testing.assert_array_equal(np.array(found["texels"], np.float32).reshape(before.shape), before)


def test_undo_and_redo(props):
    bpy.ops.ed.undo_push(message="made")
    press(bpy.ops.imprint.set_duplicate)
    press(bpy.ops.imprint.set_own, setting="size")
    assert [(one.name, one.is_own("size")) for one in bpy.context.scene.imprint_sets] == [
        ("Prop", True),
        ("Prop.001", False),
    ]
    bpy.ops.ed.undo()
    assert current().is_own("size")
    bpy.ops.ed.undo()
    assert [one.name for one in bpy.context.scene.imprint_sets] == ["Prop"]
    bpy.ops.ed.redo()
    bpy.ops.ed.redo()
    assert not current().is_own("size")
    press(bpy.ops.imprint.set_remove)
    bpy.ops.ed.undo()
    assert parts() == ["a_low", "b_low", "c_low"]


@pytest.mark.parametrize("is_saved", [False, True])
def test_a_deleted_part_comes_back_with_undo(props, tmp_path, is_saved):
    bpy.ops.ed.undo_push(message="made")
    select(bpy.data.objects["b_low"])
    bpy.ops.object.delete()
    bpy.ops.ed.undo_push(message="deleted")
    if is_saved:
        save(tmp_path / "prop.blend")
        assert "b_low" not in bpy.data.objects
    assert parts() == ["a_low", "c_low"]
    bpy.ops.ed.undo()
    assert parts() == ["a_low", "b_low", "c_low"]


@pytest.mark.parametrize("source", ["PARTS", "COLLECTION", "NAMES"])
@pytest.mark.parametrize("removed", ["a_low", "a_high"])
def test_a_script_removes_an_object_of_a_part(props, source, removed):
    """Blender's view layer has None in its place until it is updated."""
    one, shown = current(), bpy.data.collections.new("Prop")
    bpy.context.scene.collection.children.link(shown)
    for obj in bpy.data.objects:
        shown.objects.link(obj)
    one.source, one.collection = source, shown
    bpy.context.view_layer.update()
    bpy.data.objects.remove(bpy.data.objects[removed])
    assert None in [*bpy.context.view_layer.objects]
    there = ["a_low", "b_low", "c_low"] if removed == "a_high" and source != "NAMES" else ["b_low", "c_low"]
    assert parts() == [low.name for low, *_ in sets.jobs(bpy.context, one)] == there
    assert [job.low.name for job in sets.resolve(bpy.context, one).jobs][-2:] == ["b_low", "c_low"]
    assert signs.of_set(bpy.context, one).text
    signs.looks.advance(bpy.context, 10.0)


def test_a_deleted_part_is_found_by_its_name_in_the_saved_file(props, tmp_path):
    select(bpy.data.objects["b_low"])
    bpy.ops.object.delete()
    save(tmp_path / "prop.blend")
    open_file(tmp_path / "prop.blend")
    assert [part.title for part in current().parts] == ["a_low", "b_low", "c_low"]
    assert parts() == ["a_low", "c_low"]
    zoo.plane("b_low")
    assert parts() == ["a_low", "b_low", "c_low"]


def test_a_collection_is_kept_true(props):
    outer, inner = bpy.data.collections.new("Outer"), bpy.data.collections.new("Inner")
    bpy.context.scene.collection.children.link(outer)
    outer.children.link(inner)
    props.source, props.collection = "COLLECTION", outer
    assert parts() == []
    for name in ("a_low", "a_high"):
        inner.objects.link(bpy.data.objects[name])
    for name in ("shell", "cage"):
        outer.objects.link(zoo.plane(name))
    bpy.data.objects["a_low"].imprint.put([bpy.data.objects["a_high"]])
    bpy.data.objects["a_low"].imprint.cage = bpy.data.objects["cage"]
    outer.objects.link(add("empty"))
    assert parts() == ["shell", "a_low"]
    bpy.data.objects["a_low"].name, outer.name = "box", "Props"
    assert parts() == ["shell", "box"]
    inner.objects.unlink(bpy.data.objects["box"])
    assert parts() == ["shell"]
    assert bpy.data.objects["a_high"] in inner.objects[:]


def test_names_are_kept_true(props):
    props.source = "NAMES"
    bpy.data.objects["b_high"].name = "detail"
    zoo.plane("d_low")
    zoo.plane("d_high")
    bpy.context.view_layer.update()
    assert parts() == ["a_low", "c_low", "d_low"]
    assert [reason for name, reason in sets.resolve(bpy.context, props).left_out] == [
        "'b_low' has no high object: none is called 'b_high'."
    ]


def test_a_high_object_by_hand(props):
    low, bolt = bpy.data.objects["a_low"], zoo.plane("bolt")
    told = refusal(bpy.ops.imprint.set_high_remove, low="a_low", high="a_high")
    assert told == "'a_high' is called as 'a_low' is: rename it, or add another high object first."
    highs = lambda: [high.name for high in sets.resolve(bpy.context, props).jobs[0].highs]  # noqa: E731
    assert highs() == ["a_high"]
    assert bpy.ops.imprint.set_high_add(low="a_low", high="bolt") == {"FINISHED"}
    assert highs() == ["a_high", "bolt"]
    bolt.name = "screw"
    assert highs() == ["a_high", "screw"]
    assert bpy.ops.imprint.set_high_remove(low="a_low", high="a_high") == {"FINISHED"}
    assert highs() == ["screw"]
    select(low, bpy.data.objects["a_high"])
    assert bpy.ops.imprint.set_high_add() == {"FINISHED"}
    assert highs() == ["screw", "a_high"]
    assert refusal(bpy.ops.imprint.set_high_add, low="a_low", high="a_low").startswith("No high object")


def test_a_copy_is_equal_and_on_its_own(props):
    props.textures, props.parts[0].object.imprint_size = "ONE", "256"
    assert bpy.ops.imprint.set_duplicate() == {"FINISHED"}
    first, copy = bpy.context.scene.imprint_sets
    assert (copy.name, copy.textures, parts(copy)) == ("Prop.001", "ONE", parts(first))
    assert copy.settings == first.settings
    copy.own.size, copy.textures = 64, "PART"
    copy.parts.remove(0)
    assert (first.settings.sampling.size, first.textures, parts(first)) == (
        (32, 32),
        "ONE",
        ["a_low", "b_low", "c_low"],
    )
    assert bpy.ops.imprint.set_move(direction="UP") == {"FINISHED"}
    assert [one.name for one in bpy.context.scene.imprint_sets] == ["Prop.001", "Prop"]
    assert current().name == "Prop.001"


def test_names_of_sets_are_unique(props):
    for _ in range(2):
        bpy.ops.imprint.set_duplicate()
    names = [one.name for one in bpy.context.scene.imprint_sets]
    assert names == ["Prop", "Prop.002", "Prop.001"] or sorted(names) == ["Prop", "Prop.001", "Prop.002"]
    current().name = "Prop"
    assert current().name != "Prop"
    current().name = "  "
    assert current().name == sets.NEW


def test_an_appended_scene_brings_its_sets(props, tmp_path):
    save(tmp_path / "prop.blend")
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    bpy.ops.wm.append(directory=f"{tmp_path / 'prop.blend'}/Scene/", filename="Scene")
    bpy.context.window.scene = next(scene for scene in bpy.data.scenes if len(scene.imprint_sets))
    assert (current().name, parts()) == ("Prop", ["a_low", "b_low", "c_low"])
    assert bpy.ops.imprint.bake_sets() == {"FINISHED"}


def test_appended_objects_bring_no_set(props, tmp_path):
    save(tmp_path / "prop.blend")
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    bpy.ops.wm.append(directory=f"{tmp_path / 'prop.blend'}/Object/", filename="a_low")
    assert len(bpy.context.scene.imprint_sets) == 0


def test_sets_of_a_linked_scene_are_shown_and_not_changed(props, tmp_path):
    save(tmp_path / "prop.blend")
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    bpy.ops.wm.link(directory=f"{tmp_path / 'prop.blend'}/Scene/", filename="Scene")
    bpy.context.window.scene = next(scene for scene in bpy.data.scenes if scene.library)
    assert (current().name, parts()) == ("Prop", ["a_low", "b_low", "c_low"])
    for operator in (bpy.ops.imprint.set_add, bpy.ops.imprint.set_remove, bpy.ops.imprint.set_own):
        assert not operator.poll()


@pytest.mark.parametrize("is_override", [False, True])
def test_linked_and_overridden_parts(props, tmp_path, is_override):
    save(tmp_path / "library.blend")
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    use(size=16, method="CAST", storage="MEMORY")
    for name in ("a_low", "a_high"):
        bpy.ops.wm.link(directory=f"{tmp_path / 'library.blend'}/Object/", filename=name)
    low, high = (bpy.data.objects[name] for name in ("a_low", "a_high"))
    if is_override:
        low, high = (obj.override_create(remap_local_usages=True) for obj in (low, high))
    zoo.plane("d_low")
    zoo.plane("d_high", slope=0.5)
    select(low, high, bpy.data.objects["d_low"], bpy.data.objects["d_high"])
    assert bpy.ops.imprint.set_add() == {"FINISHED"}
    save(tmp_path / "prop.blend")
    open_file(tmp_path / "prop.blend")
    assert parts() == ["a_low", "d_low"]
    assert [part.object.library is None for part in current().parts] == [is_override, True]
    current().own.material = False
    assert bpy.ops.imprint.bake_sets() == {"FINISHED"}
    assert {"a_low_normal", "d_low_normal"} <= {image.name for image in bpy.data.images}
    new = zoo.plane("own")
    select(bpy.data.objects["a_low"], new)
    if is_override:
        assert bpy.ops.imprint.set_high_add() == {"FINISHED"}
    else:
        with pytest.raises(RuntimeError, match="is linked from another file"):
            bpy.ops.imprint.set_high_add()


@pytest.mark.parametrize("kind", ["FULL_COPY", "LINK_COPY"])
def test_a_copied_scene_has_sets_of_its_own(props, kind):
    first = bpy.context.scene
    bpy.ops.scene.new(type=kind)
    second = bpy.context.scene
    assert first != second
    assert (current().name, len(parts())) == ("Prop", 3)
    assert all(low.name in second.objects for low in sets.lows(bpy.context, current()))
    current().name, current().own.size = "Other", 64
    assert bpy.ops.imprint.bake_sets() == {"FINISHED"}
    bpy.context.window.scene = first
    assert (current().name, current().settings.sampling.size) == ("Prop", (32, 32))
    assert parts() == ["a_low", "b_low", "c_low"]


def test_a_file_that_is_reverted_while_its_sets_are_baked(props, tmp_path):
    save(tmp_path / "prop.blend")
    chosen = list(zip(sets.resolve_all(bpy.context, [props]), [set_operators.Wants()], strict=True))
    task = set_operators.bake_sets(bpy.context, chosen, Pace())
    while not next(task).report:
        pass
    task.close()  # as before another file is opened
    open_file(tmp_path / "prop.blend")
    assert parts() == ["a_low", "b_low", "c_low"]
    assert bpy.ops.imprint.bake_sets() == {"FINISHED"}


def pick(chance):
    """Select some objects, perhaps none."""
    objects = list(bpy.context.view_layer.objects)
    some = chance.sample(objects, min(len(objects), chance.randrange(4)))
    bpy.ops.object.select_all(action="DESELECT")
    if some:
        select(*some)
    return some


def press_one(chance):
    """One button, after a selection."""
    ops = bpy.ops.imprint
    pick(chance)
    chance.choice([ops.set_add, ops.set_add, ops.set_part_add, ops.set_high_add, ops.set_duplicate, ops.set_remove])()
    setting = chance.choice(["size", "engine", "extrusion", "measure", "maps", "names"])
    bpy.ops.imprint.set_own(setting=setting)
    bpy.ops.imprint.set_move(direction=chance.choice(["UP", "DOWN"]))


def edit_set(chance):
    scene, one = bpy.context.scene, current()
    scene.imprint.active_set = chance.randrange(5)
    if one is not None:
        one.name = chance.choice(["", "Prop", "Prop.001", "x" * 90])
        one.source = chance.choice(["PARTS", "COLLECTION", "NAMES"])
        one.textures, one.collection = (
            chance.choice(["PART", "ONE", "MATERIAL"]),
            chance.choice([None, *bpy.data.collections]),
        )


def edit_objects(chance):
    for obj in pick(chance)[:1]:
        obj.imprint_is_baked, obj.imprint_size = chance.random() < 0.5, chance.choice(["0", "256"])
        obj.name = chance.choice(["a_low", "a_high", "b_low", "rock", "b_cage"])
        if chance.random() < 0.3:
            bpy.ops.object.delete()
    zoo.plane(chance.choice(["a_low", "a_high", "c_low", "rock"]))


def go_back(chance):
    chance.choice([bpy.ops.ed.undo, lambda: bpy.ops.ed.undo_push(message="step"), sets.settle])()


@pytest.mark.parametrize("seed", range(8))
def test_whatever_is_done_sets_stay_whole(seed):
    """Each name once, no part of what is deleted, and nothing but sentences about what is wrong."""
    chance = random.Random(seed)
    for name in ("a_low", "a_high", "b_low", "b_high", "rock"):
        zoo.plane(name)
    bpy.data.collections.new("Shelf").objects.link(bpy.data.objects["rock"])
    bpy.ops.ed.undo_push(message="start")
    for _ in range(60):
        try:
            chance.choice([press_one, edit_set, edit_objects, go_back])(chance)
        except RuntimeError as error:
            assert "Traceback" not in str(error), error
        bpy.context.view_layer.update()
        every = bpy.context.scene.imprint_sets
        assert len({one.name for one in every}) == len(every)
        for one, made in zip(every, sets.resolve_all(bpy.context, list(every)), strict=True):
            assert (made.name, one.settings) == (one.name, made.settings)
            there = {*bpy.context.scene.objects, *(obj for shelf in bpy.data.collections for obj in shelf.objects)}
            assert set(sets.lows(bpy.context, one)) <= there
            assert bool(made.jobs) or bool(made.left_out)
            assert one.own.whole.size == one.settings.sampling.width
