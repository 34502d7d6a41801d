# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests sets: their parts, their own settings, and that they bake what pairs by name and single bakes do."""

import bpy
import numpy as np
import pytest

from addon.core.errors import BakeError
from addon.ui import sets
from tests.support.panel import select, use

pytestmark = pytest.mark.usefixtures("registered", "gpu_context")

SIDE = 32


def cube(name, x=0.0, size=2.0):
    bpy.ops.mesh.primitive_cube_add(location=(x, 0.0, 0.0), size=size)
    bpy.context.object.name = name
    return bpy.context.object


@pytest.fixture
def props():
    """Two pairs of cubes by name."""
    objects = {}
    for number, name in enumerate(("crate", "lid")):
        for end, size in (("low", 2.0), ("high", 1.9)):
            objects[f"{name}_{end}"] = cube(f"{name}_{end}", 4.0 * number, size)
    bpy.ops.object.select_all(action="DESELECT")
    use(size=SIDE, maps={"AO"}, storage="MEMORY", samples="1", rays=16, occluders="OWN")
    return objects


def texels(name):
    image = bpy.data.images[name]
    values = np.empty(len(image.pixels), np.float32)
    image.pixels.foreach_get(values)
    return values


def new_set(*lows, name="Prop", **values):
    one = bpy.context.scene.imprint_sets.add()
    one.name = name
    for low in lows:
        one.parts.add().object = low
    for key, value in values.items():
        setattr(one, key, value)
    bpy.context.scene.imprint.bakes = "SETS"
    return one


def names_of(one):
    return [low.name for low in sets.lows(bpy.context, one)]


def test_a_set_from_the_selection_has_what_names_call_low(props):
    select(*props.values())
    assert bpy.ops.imprint.set_add() == {"FINISHED"}
    one = sets.active(bpy.context)
    assert (one.name, names_of(one)) == ("crate", ["crate_low", "lid_low"])
    job = sets.resolve(bpy.context, one)
    assert [[high.name for high in each.highs] for each in job.jobs] == [["crate_high"], ["lid_high"]]


def test_sets_bake_the_maps_of_pairs_by_name(props):
    props["lid_low"].imprint_size, props["crate_low"].imprint_distance = "256", 0.3
    assert bpy.ops.imprint.bake_pairs() == {"FINISHED"}
    before = {name: texels(name) for name in ("crate_low_normal", "lid_low_normal", "lid_low_ao")}
    for image in list(bpy.data.images):
        bpy.data.images.remove(image)
    bpy.ops.object.select_all(action="DESELECT")
    assert bpy.ops.imprint.set_add() == {"FINISHED"}
    assert sets.active(bpy.context).source == "NAMES"
    assert bpy.ops.imprint.bake_sets() == {"FINISHED"}
    for name, values in before.items():
        np.testing.assert_array_equal(texels(name), values)


def test_own_settings_count_in_place_of_the_scene(props):
    one, scene = new_set(props["crate_low"]), bpy.context.scene.imprint
    assert one.settings == scene.to_settings()
    one.make_own("size")
    scene.width = scene.height = 512
    assert one.is_own("size") and one.settings.sampling.size == (SIDE, SIDE)
    one.own.size = 64
    assert one.settings.sampling.size == (64, 64)
    assert one.own.whole.width == 64
    one.back("size")
    assert not one.is_own("size") and one.settings == scene.to_settings()
    one.make_own("extrusion")
    one.own.measure, one.own.extrusion = False, 0.25
    assert one.settings.tracing.extrusion == 0.25
    assert one.settings.tracing.max_distance is not None
    one.back("extrusion")
    assert one.own.names_of_own() == []


def test_an_engine_of_a_set_leaves_the_scene_alone(props):
    one, scene = new_set(props["crate_low"]), bpy.context.scene.imprint
    scene.output = "//maps/x.png"
    before = scene.to_settings()
    assert one.own.engine == scene.engine
    one.own.engine = "Unreal Engine"
    assert scene.to_settings() == before
    settings = one.settings
    assert settings.storing.output == "//maps/T_{name}_N.png"
    assert settings.map.green == "-Y"
    assert one.own.engine == "Unreal Engine" != scene.engine
    one.back("engine")
    assert one.own.names_of_own() == []


def test_an_empty_set_says_so(props):
    with pytest.raises(BakeError, match="has no part"):
        sets.resolve(bpy.context, new_set())
