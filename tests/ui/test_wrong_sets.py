# SPDX-License-Identifier: GPL-3.0-or-later
"""Wrong sets: each mistake is a sentence at its row, and everything else is baked. Right sets give no sentence."""

import json
import math

import bpy
import pytest

from addon.core.progress import Pace
from addon.ui import set_operators
from tests.support.panel import use

pytestmark = pytest.mark.usefixtures("registered", "gpu_context")

SIDE = 16


def cube(name, x=0.0, size=2.0):
    bpy.ops.mesh.primitive_cube_add(location=(x, 0.0, 0.0), size=size)
    bpy.context.object.name = name
    return bpy.context.object


@pytest.fixture(autouse=True)
def props(tmp_path):
    """Three pairs by name: a, b and c."""
    objects = {}
    for number, name in enumerate("abc"):
        objects[f"{name}_low"] = cube(f"{name}_low", 4.0 * number)
        objects[f"{name}_high"] = cube(f"{name}_high", 4.0 * number, 1.9)
    use(size=SIDE, storage="MEMORY", samples="1", output=str(tmp_path / "{low}.png"))
    return objects


def new_set(name, *lows, **values):
    one = bpy.context.scene.imprint_sets.add()
    one.name = name
    for low in lows:
        one.parts.add().object = bpy.data.objects[low]
    for key, value in values.items():
        setattr(one, key, value)
    return one


def bake(**arguments):
    """The lows that a bake of sets bakes, and what it leaves out."""
    for obj in bpy.data.objects:
        if obj.is_property_set("imprint"):
            obj.imprint.baked = ""
    try:
        bpy.ops.imprint.bake_sets(**arguments)
    except RuntimeError as error:
        assert "Traceback" not in str(error)
        assert str(error).count("\n") <= 1
    baked = {obj.name for obj in bpy.data.objects if obj.is_property_set("imprint") and obj.imprint.baked}
    left_out = json.loads(bpy.context.window_manager.imprint_batch or '{"left_out": []}')["left_out"]
    return baked, dict(map(tuple, left_out))


def test_two_sets_that_fill_one_image():
    new_set("One", "a_low", "b_low")
    second = new_set("Two", "b_low", "c_low")
    baked, left_out = bake()
    assert baked == {"a_low", "b_low", "c_low"}
    assert list(left_out) == ["b_low"]
    assert left_out["b_low"].startswith("The sets 'One' and 'Two' would both fill the image 'b_low_normal': ")
    assert bake(name="Two") == ({"c_low"}, left_out)
    assert bake(name="One") == ({"a_low", "b_low"}, {})
    second.own.image = "{low}_NORMAL"  # one image on some file systems
    assert bake(name="Two") == ({"c_low"}, {"b_low": left_out["b_low"].replace("b_low_normal", "b_low_NORMAL")})
    second.is_on, second.own.image = False, ""
    assert bake() == ({"a_low", "b_low"}, {})
    assert bake(name="Two") == ({"b_low", "c_low"}, {})


def test_two_sets_that_write_one_file(tmp_path):
    use(storage="FILE", output=str(tmp_path / "map.png"))
    new_set("One", "a_low", textures="ONE")
    new_set("Two", "b_low", textures="ONE").own.image = "other"
    new_set("Three", "c_low", textures="ONE").own.output = str(tmp_path / "third.png")
    baked, left_out = bake()
    assert baked == {"a_low", "c_low"}
    assert list(left_out) == [""]
    assert "'One' and 'Two' would both write the file" in left_out[""]
    assert str(tmp_path / "map.png") in left_out[""]


def test_a_part_in_two_sets_with_other_uv_maps(props):
    props["a_low"].data.uv_layers.new(name="Second")
    new_set("One", "a_low", "b_low")
    second = new_set("Two", "a_low", "c_low")
    second.own.image, second.own.uv_layer = "{low}_second", "Second"
    props["c_low"].data.uv_layers[0].name = "Second"
    baked, left_out = bake(name="Two")
    assert (baked, list(left_out)) == ({"c_low"}, ["a_low"])
    assert "is also a part of the set 'One', by the UV map 'UVMap' and not 'Second'" in left_out["a_low"]
    second.own.material = False  # files of a light map, say
    assert bake(name="Two") == ({"a_low", "c_low"}, {})


def test_a_high_that_is_a_low_of_the_same_set(props):
    props["a_low"].imprint.put([props["b_low"]])
    new_set("One", "a_low", "b_low")
    baked, left_out = bake()
    assert baked == {"b_low"}
    assert left_out == {
        "a_low": "'b_low' is a high object of 'a_low' and also a part of the set 'One': remove it from one of the two."
    }


def test_a_deleted_part(props):
    new_set("One", "a_low", "b_low")
    bpy.data.objects.remove(props["a_low"])
    new_set("Two")
    baked, left_out = bake()
    assert baked == {"b_low"}
    assert list(left_out) == ["", "a_low"] or list(left_out) == ["a_low", ""]
    assert left_out["a_low"].startswith("'a_low' is not in this file")
    assert left_out[""] == "The set 'Two' has no part: add low objects."


def test_a_part_that_blender_keeps_but_is_in_no_collection(props):
    new_set("One", "a_low", "b_low")
    bpy.context.scene.collection.objects.unlink(props["a_low"])
    baked, left_out = bake()
    assert (baked, list(left_out)) == ({"b_low"}, ["a_low"])
    assert left_out["a_low"].startswith("'a_low' is in no collection")
    bpy.context.scene.collection.objects.link(props["a_low"])
    assert bake() == ({"a_low", "b_low"}, {})


def test_a_deleted_high(props):
    props["a_low"].imprint.put([props["a_high"]])
    new_set("One", "a_low", "b_low")
    bpy.context.scene.collection.objects.unlink(props["a_high"])
    baked, left_out = bake()
    assert (baked, list(left_out)) == ({"b_low"}, ["a_low"])
    assert left_out["a_low"].startswith("'a_high' is in no collection")


def test_an_object_moved_to_another_scene(props):
    new_set("One", "a_low", "b_low")
    other = bpy.data.scenes.new("Other")
    bpy.context.scene.collection.objects.unlink(props["a_low"])
    other.collection.objects.link(props["a_low"])
    baked, left_out = bake()
    assert (baked, list(left_out)) == ({"b_low"}, ["a_low"])
    assert "scene" in left_out["a_low"]


def test_a_collection_that_is_gone_and_an_empty_one():
    collection = bpy.data.collections.new("Lows")
    new_set("One", source="COLLECTION", collection=collection)
    new_set("Two", "b_low")
    assert bake() == ({"b_low"}, {"": "The collection 'Lows' of the set 'One' has no low object: add one."})
    bpy.data.collections.remove(collection)
    assert bake() == ({"b_low"}, {"": "The collection of the set 'One' is gone: choose another one."})


def test_parts_that_are_all_off(props):
    new_set("One", "a_low")
    new_set("Two", "b_low")
    props["a_low"].imprint_is_baked = False
    told = "All parts of the set 'One' are off: switch one on."
    assert bake() == ({"b_low"}, {"": told})
    props["a_low"].data.uv_layers.remove(props["a_low"].data.uv_layers[0])  # which says nothing while it is off
    assert bake() == ({"b_low"}, {"": told})


def test_parts_that_are_all_off_and_high_objects_of_each_other(props):
    new_set("One", "a_low", "b_low")
    for low, high in (("a_low", "b_low"), ("b_low", "a_low")):
        props[low].imprint.put([props[high]])
        props[low].imprint_is_baked = False
    with pytest.raises(RuntimeError, match="All parts of the set 'One' are off"):
        bpy.ops.imprint.bake_sets()


def test_a_part_without_uvs_in_one_image(props):
    new_set("One", "a_low", "b_low", "c_low", textures="ONE")
    props["b_low"].data.uv_layers.remove(props["b_low"].data.uv_layers[0])
    baked, left_out = bake()
    assert (baked, list(left_out)) == ({"a_low", "c_low"}, ["b_low"])


def test_a_part_whose_maps_cannot_be_stored(props, tmp_path):
    """What a check of the storing finds ends no other part."""
    use(storage="FILE", output=str(tmp_path / "{low}" / "map.png"))
    (tmp_path / "a_low").write_text("a file, and no folder")
    new_set("One", "a_low", "b_low")
    baked, left_out = bake()
    assert (baked, list(left_out)) == ({"b_low"}, ["a_low"])


def test_an_object_that_is_deleted_while_sets_are_baked(props):
    """It ends its set, and the others are baked."""
    for name in "abc":
        new_set(name, f"{name}_low")
    task = set_operators.bake_sets(bpy.context, set_operators.chosen(bpy.context, ""), Pace())
    while not next(task).report:
        pass
    bpy.data.objects.remove(props["b_low"])
    with pytest.raises(StopIteration) as end:
        while True:
            next(task)
    done = end.value.value
    assert [report.low for report in done.reports] == ["a_low", "c_low"]
    assert [reason for _, reason in done.left_out] == [
        "'b_low' was deleted: bring it back with Undo, or choose another object."
    ]


def test_a_lack_of_memory_keeps_what_is_done(props, monkeypatch):
    for name in "ab":
        new_set(name, f"{name}_low")
    work, begun = set_operators.set_jobs.work, []

    def failing(context, set_job, pace, **more):
        begun.append(set_job.name)
        if len(begun) > 1:
            raise MemoryError
        return work(context, set_job, pace, **more)

    monkeypatch.setattr(set_operators.set_jobs, "work", failing)
    assert bake()[0] == {"a_low"}


def test_nothing_but_mistakes_is_an_error():
    with pytest.raises(RuntimeError, match="No set is on"):
        bpy.ops.imprint.bake_sets()
    with pytest.raises(RuntimeError, match="There is no set 'x'"):
        bpy.ops.imprint.bake_sets(name="x")
    new_set("One")
    with pytest.raises(RuntimeError, match="'One' has no part"):
        bpy.ops.imprint.bake_sets()
    assert json.loads(bpy.context.window_manager.imprint_batch)["left_out"] == [
        ["", "The set 'One' has no part: add low objects."]
    ]
    new_set("Two", "a_low")
    assert bake() == ({"a_low"}, {"": "The set 'One' has no part: add low objects."})


RIGHT = [
    {"textures": textures, "source": source}
    for textures in ("PART", "MATERIAL", "ONE")
    for source in ("PARTS", "COLLECTION", "NAMES")
]


def plane(name, x, height, cuts=0):
    """A square with UVs in the middle of its own third of the map, and high bumps with `cuts`."""
    bpy.ops.mesh.primitive_grid_add(x_subdivisions=1 + cuts, y_subdivisions=1 + cuts, location=(x, 0.0, height))
    obj = bpy.context.object
    obj.name = name
    for vertex in obj.data.vertices if cuts else ():
        vertex.co.z += 0.03 * math.sin(3.0 * vertex.co.x) * math.cos(2.0 * vertex.co.y)
    bpy.ops.object.shade_smooth()
    for loop in obj.data.uv_layers[0].uv:
        loop.vector = (0.04 + 0.25 * loop.vector[0] + 0.08 * x, 0.3 + 0.25 * loop.vector[1])
    return obj


@pytest.fixture
def right(props):
    """Three pairs without a mistake, whose low objects are in a collection."""
    for obj in props.values():
        bpy.data.objects.remove(obj)
    collection = bpy.data.collections.new("Lows")
    bpy.context.scene.collection.children.link(collection)
    for number, name in enumerate("abc"):
        plane(f"{name}_high", 4.0 * number, 0.0, cuts=24)
        collection.objects.link(plane(f"{name}_low", 4.0 * number, 0.0))
    use(size=128)
    return collection


@pytest.mark.parametrize("is_shared", [False, True], ids=["own material", "shared material"])
@pytest.mark.parametrize("values", RIGHT, ids=lambda values: "-".join(values.values()).lower())
def test_right_sets_give_no_sentence(values, is_shared, right):
    material = bpy.data.materials.new("Wood")
    for low in right.objects if is_shared and values["textures"] != "PART" else ():
        low.data.materials.append(material)
    new_set("One", "a_low", "b_low", "c_low", collection=right, **values)
    assert bake() == ({"a_low", "b_low", "c_low"}, {})
    assert bpy.context.window_manager.imprint_warnings == ""


def test_a_material_that_objects_outside_show(right):
    """They are told of where the map shows on them, and not the parts of the set that have it on purpose."""
    material = bpy.data.materials.new("Wood")
    for low in (*right.objects, cube("chair")):
        low.data.materials.append(material)
    new_set("One", "a_low", "b_low", "c_low", textures="MATERIAL")
    assert bake() == ({"a_low", "b_low", "c_low"}, {})
    told = set(bpy.context.window_manager.imprint_warnings.split("\n"))
    assert told == {'Material "Wood" is also on 1 other object ("chair"); the map shows there too.'}
