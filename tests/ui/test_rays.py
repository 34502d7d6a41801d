# SPDX-License-Identifier: GPL-3.0-or-later
"""Buttons and panels for rays: measured distances, pairs by name, the shells in the viewport, freeing trees."""

import bpy
import mathutils
import numpy as np
import pytest

import addon
from addon.core.settings import Settings
from addon.engine import tree_cache
from addon.passes import target
from addon.scene import mesh_elements
from addon.ui import cage_overlay, object_pairs
from addon.ui.bake_results import results
from addon.ui.cage_overlay import CageState, RayLengths, Subject, overlay
from addon.ui.live import live
from tests.support import maps, zoo
from tests.support.panel import use

pytestmark = pytest.mark.usefixtures("registered", "gpu_context")


NAMES = {"low": "lo", "high": [{"name": "hi"}]}
"""A low and a high object, as arguments of the operators."""


@pytest.fixture(autouse=True)
def small():
    return use(size=16, method="CAST", storage="MEMORY")


def test_measured_distances_are_shown_and_can_be_frozen(small):
    bpy.context.view_layer.objects.active = zoo.plane("lo")
    high = zoo.plane("hi")
    high.location.z = 0.2
    assert not bpy.ops.imprint.freeze_distances.poll()
    assert bpy.ops.imprint.bake(**NAMES) == {"FINISHED"}
    found = bpy.context.window_manager.imprint_found
    assert 0.2 < found.extrusion < 0.5
    bpy.ops.imprint.freeze_distances()
    pair = object_pairs.of(bpy.data.objects["lo"])
    assert not pair.measure
    assert (pair.extrusion, pair.max_distance) == (found.extrusion, found.max_distance)
    assert small.chosen(bpy.context).settings.tracing.extrusion == found.extrusion
    assert small.measure  # the distances of other low objects are measured as before


def test_distances_set_by_a_script_need_no_switch(small):
    zoo.plane("lo")
    zoo.plane("hi").location.z = 0.2
    assert bpy.ops.imprint.bake(**NAMES, extrusion=0.5, max_distance=0.75) == {"FINISHED"}
    assert "extrusion 50 cm and max distance 75 cm" in bpy.context.window_manager.imprint_summary


def test_a_cage_by_name(small):
    zoo.plane("lo", n=2)
    zoo.plane("cage", n=2).location.z = 0.5
    zoo.plane("hi").location.z = 0.4
    assert bpy.ops.imprint.bake(**NAMES, cage="cage") == {"FINISHED"}
    with pytest.raises(RuntimeError, match="The cage 'cage' is for rays"):
        bpy.ops.imprint.bake(**NAMES, cage="cage", method="FLATTEN")
    small.cage = bpy.data.objects["cage"]  # in the slot, which is hidden then, it does no harm
    other = zoo.plane("other")  # without a pair, it has the method of the scene
    assert small.chosen(bpy.context, other).cage == small.cage
    small.method = "FLATTEN"
    assert small.chosen(bpy.context, other).cage is None
    small.method = "CAST"
    assert bpy.ops.imprint.bake(**NAMES, method="FLATTEN") == {"FINISHED"}


def test_pairs_by_name(small):
    for name, slope in (("a", 0.0), ("b", 0.5)):
        zoo.plane(f"{name}_low")
        zoo.plane(f"{name}_high", slope=slope)
    zoo.plane("c_low")
    assert bpy.ops.imprint.bake_pairs() == {"FINISHED"}
    assert (maps.pixels(bpy.data.images["a_low_normal"])[..., 0] == 0.5).all()
    lean = 0.5 - 0.5 * 0.5 / np.hypot(0.5, 1.0)
    assert np.allclose(maps.pixels(bpy.data.images["b_low_normal"])[..., 0], lean, atol=1e-3)
    assert "c_low_normal" not in bpy.data.images


def test_no_pairs(small):
    zoo.plane("a")
    with pytest.raises(RuntimeError, match="a name that ends in '_low'"):
        bpy.ops.imprint.bake_pairs()
    small.high_suffix = "_LOW"
    with pytest.raises(RuntimeError, match="must all be different"):
        bpy.ops.imprint.bake_pairs()


def test_the_shells_leave_nothing_when_hidden():
    def handlers():
        found = bpy.app.handlers
        return tuple(len(each) for each in (found.depsgraph_update_post, found.frame_change_post, found.undo_post))

    before = handlers()
    bpy.ops.imprint.show_cage()
    assert overlay.is_on
    overlay.show()  # a second call does nothing
    assert handlers() == before
    bpy.ops.imprint.show_cage()
    assert not overlay.is_on
    assert handlers() == before
    bpy.ops.imprint.show_cage()
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    assert not overlay.is_on
    assert handlers() == before


def test_trees_are_freed_when_another_file_is_opened():
    zoo.plane("lo")
    zoo.plane("hi")
    bpy.ops.imprint.bake(**NAMES)
    assert len(tree_cache.trees)
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    assert not len(tree_cache.trees)
    assert addon.before_loading in bpy.app.handlers.load_pre  # the tree outlives the file


def test_the_switch_may_be_set_by_a_script(small):
    zoo.plane("lo")
    zoo.plane("hi").location.z = 0.2
    small.extrusion, small.max_distance = 0.5, 0.75
    assert bpy.ops.imprint.bake(measure=False, **NAMES) == {"FINISHED"}
    assert "extrusion 50 cm and max distance 75 cm" in bpy.context.window_manager.imprint_summary
    small.measure = False
    assert bpy.ops.imprint.bake(measure=True, **NAMES) == {"FINISHED"}
    assert "extrusion 50 cm" not in bpy.context.window_manager.imprint_summary


def test_set_distances_are_not_shown_as_measured(small):
    small.low = zoo.plane("lo")
    zoo.plane("hi").location.z = 0.2
    bpy.ops.imprint.bake(**NAMES, extrusion=0.7, max_distance=1.4)
    assert bpy.context.window_manager.imprint_found.extrusion == 0.0
    assert not bpy.ops.imprint.freeze_distances.poll()


def test_distances_are_those_of_the_current_low_object(small):
    for name, height in (("a", 0.5), ("b", 0.01)):
        zoo.plane(f"{name}_low")
        zoo.plane(f"{name}_high").location.z = height
    bpy.ops.imprint.bake_pairs()
    found = bpy.context.window_manager.imprint_found
    small.low = bpy.data.objects["a_low"]
    assert found.extrusion > 0.5
    small.low = bpy.data.objects["b_low"]
    assert 0.0 < found.extrusion < 0.5


def test_names_are_not_remembered_by_operators(small):
    for name in ("lo", "hi", "lo2"):
        zoo.plane(name)
    bpy.ops.imprint.bake("EXEC_DEFAULT", True, **NAMES)
    small.low, small.highs.add().object = bpy.data.objects["lo2"], bpy.data.objects["hi"]
    bpy.ops.imprint.bake("INVOKE_DEFAULT", True)
    assert "lo2_normal" in bpy.data.images


def test_a_file_set_by_a_script_is_written(small, tmp_path):
    zoo.plane("lo")
    zoo.plane("hi")
    path = tmp_path / "map.png"
    assert bpy.ops.imprint.bake(**NAMES, output=str(path)) == {"FINISHED"}
    assert path.is_file()


def test_shells_of_rays_that_were_never_cast_are_measured(small):
    small.low, high = zoo.cube("lo"), zoo.cube("hi")
    high.scale = (1.1, 1.1, 1.1)
    small.highs.add().object = high
    small.storage = "FILE"  # no file is set, and none is needed
    bpy.ops.imprint.show_cage()
    small.storage = "MEMORY"
    try:
        figures = overlay.lengths(bpy.context, small.low)
        assert figures.extrusion > 0.1
        assert figures.blend_width > 0.0
        assert not bpy.data.images
        bpy.ops.imprint.bake()
        assert overlay.lengths(bpy.context, small.low) == figures
        small.measure, small.extrusion, small.max_distance = False, 0.5, 0.75
        assert overlay.lengths(bpy.context, small.low) == RayLengths(0.5, 0.75, figures.blend_width)
        high.scale = (1.3, 1.3, 1.3)
        small.measure = True
        bpy.ops.imprint.live("EXEC_DEFAULT")
        assert overlay.lengths(bpy.context, small.low).extrusion > 2.0 * figures.extrusion
    finally:
        live.stop()
        overlay.hide()


def test_shells_of_a_mesh_alone_are_those_of_its_bake(small):
    """It is its own high object."""
    small.low = zoo.cube("lo")
    bpy.ops.imprint.show_cage()
    try:
        measured = overlay.lengths(bpy.context, small.low)
        assert measured.extrusion > 0.0
        assert bpy.ops.imprint.bake() == {"FINISHED"}
        assert overlay.lengths(bpy.context, small.low) == measured
        overlay.hide()
        high = zoo.cube("hi")
        small.highs.add().object = high
        high.location.x = 1000.0
        bpy.ops.imprint.show_cage()
        assert overlay.is_on
    finally:
        overlay.hide()


def subject(low):
    return Subject.of_panel(bpy.context, low, 0.0)


def test_shells_are_read_again_only_when_the_low_object_the_cage_or_a_setting_of_theirs_changes(small):
    low, cage, other = zoo.plane("lo"), zoo.plane("cage"), zoo.plane("other")
    low.vertex_groups.new(name="far").add([0], 1.0, "REPLACE")
    small.cage = cage
    overlay.show()

    def is_read_again(change):
        overlay.mesh_of(subject(low))
        overlay.catch_up()
        overlay.timer.stop()
        assert overlay.mesh_of(subject(low)) is not None
        assert overlay.state is CageState.SHOWN
        change()
        bpy.context.view_layer.update()
        overlay.mesh_of(subject(low))
        return overlay.state is CageState.READING

    def lift(obj):
        obj.data.vertices[0].co.z = 1.0
        obj.data.update()

    try:
        assert not is_read_again(lambda: None)
        assert not is_read_again(lambda: setattr(other.location, "x", 1.0))
        assert not is_read_again(lambda: setattr(low, "name", "renamed"))
        assert not is_read_again(lambda: setattr(small, "extrusion", 0.5))
        assert is_read_again(lambda: setattr(low.location, "x", 1.0))
        assert is_read_again(lambda: lift(low))
        assert is_read_again(lambda: lift(cage))
        assert is_read_again(lambda: low.modifiers.new("Lift", "DISPLACE"))
        assert is_read_again(lambda: setattr(small, "directions", "SPLIT"))
        assert is_read_again(lambda: setattr(small, "offset_group", "far"))
        assert is_read_again(lambda: low.vertex_groups["far"].add([1], 0.5, "REPLACE"))
        assert is_read_again(lambda: setattr(small, "cage", None))
        assert overlay.mesh_of(subject(other)) is None
    finally:
        overlay.hide()
    assert not overlay.timer.is_running


# Cage shells


SIZE, REACH = 256, 3.0
"""Pixels of the picture, which shows -REACH..REACH along x and z."""
PIXEL = 2.0 * REACH / SIZE
SHEAR = 0.03
"""How much x and z of the picture grow with y: no face is seen edge-on."""
NEAR = 3.0 * PIXEL
OUT = 0.6


def outline(low, cage=None, *, scale=OUT, offset=0.0, blend_width=0.0, **settings):
    """Which pixels (SIZE, SIZE) the shell covers; rows go up along z."""
    bpy.context.view_layer.update()
    depsgraph = bpy.context.evaluated_depsgraph_get()
    batch = cage_overlay.upload_shells(
        low, cage, depsgraph, Settings(method="CAST", **settings), blend_width=blend_width, is_own_base=False
    )
    front = mathutils.Matrix(((1, SHEAR, 0, 0), (0, SHEAR, 1, 0), (0, 0.1, 0, 0), (0, 0, 0, REACH))) * (1.0 / REACH)
    picture = target.Target(SIZE, SIZE, ("RGBA32F",))
    with picture.bound() as framebuffer:
        framebuffer.clear(color=(0.0, 0.0, 0.0, 0.0))
        cage_overlay.draw_cage_shell(batch, front, (1.0, 1.0, 1.0, 1.0), scale=scale, offset=offset)
    texels = np.empty((SIZE, SIZE, 4), np.float32)
    picture.read(texels)
    return texels[..., 0] > 0.0


def box(mask):
    """The extents of the covered pixels: -x, x, -z, z."""
    found = []
    for axis in (0, 1):
        covered = np.flatnonzero(mask.any(axis=axis))
        found += [(covered[0]) * PIXEL - REACH, (covered[-1] + 1) * PIXEL - REACH]
    return np.array(found)


def is_covered(mask, x, z):
    return mask[int((z + REACH) / PIXEL), int((x + REACH) / PIXEL)]


def square(half):
    return np.array([-half, half, -half, half])


def test_smooth_directions_fan_out():
    """A ray from a corner goes along the diagonal, and one from the middle of a face straight out."""
    mask = outline(zoo.cube("lo"), directions="SMOOTH")
    assert np.allclose(box(mask), square(1.0 + OUT), atol=NEAR)
    assert is_covered(mask, 1.3, 1.3)
    assert not is_covered(mask, 1.5, 1.3)
    assert not is_covered(mask, 1.0 + OUT - PIXEL, 0.75)


def test_blended_directions_fan_out_at_edges_alone():
    mask = outline(zoo.cube("lo"), directions="BLENDED", blend_width=0.2)
    assert np.allclose(box(mask), square(1.0 + OUT), atol=NEAR)
    assert is_covered(mask, 1.3, 1.3)
    assert not is_covered(mask, 1.5, 1.3)
    assert is_covered(mask, 1.0 + OUT - PIXEL, 0.75)


@pytest.mark.parametrize("where", [(0.0, 0.0, 0.0), (0.0, 0.0, 1.0)])
def test_with_a_cage_rays_start_on_it(where):
    low, cage = zoo.cube("lo"), zoo.cube("cage")
    low.location = cage.location = where
    cage.scale = (1.5, 1.5, 1.5)
    z = where[2]
    extents = np.array([-1.5, 1.5, z - 1.5, z + 1.5])
    assert np.allclose(box(outline(low, cage, scale=1.0)), extents, atol=NEAR)
    # Rays that are as long as the distance to the cage's corners end on the low mesh, elsewhere inside it.
    inner = outline(low, cage, scale=1.0, offset=-0.5 * np.sqrt(3.0))
    assert np.allclose(box(inner), np.array([-1.0, 1.0, z - 1.0, z + 1.0]), atol=NEAR)


def test_a_group_that_is_missing_counts_as_unpainted():
    low = zoo.cube("lo")
    plain = outline(low, directions="SPLIT")
    assert np.array_equal(outline(low, directions="SPLIT", offset_group="far"), plain)


# Weight operators


@pytest.fixture
def settings():
    """A low plane whose rays reach only half of the high surface."""
    settings = use(zoo.plane("lo", n=4), size=32, method="CAST", storage="MEMORY", show_result=False)
    for side, height in ((-1.0, 0.1), (1.0, 0.5)):
        high = zoo.plane("hi")
        high.scale.x, high.location.x, high.location.z = 0.5, 0.5 * side, height
        settings.highs.add().object = high
    return use(measure=False, extrusion=0.3, max_distance=0.6)


def weights(name):
    low = bpy.data.objects["lo"]
    return mesh_elements.weights(low, low.data, [name], outside=-1.0)[0]


def test_the_groups_are_created_named_and_used_by_the_next_bake(settings):
    assert not bpy.ops.imprint.propose_weights.poll()
    bpy.ops.imprint.bake()
    assert results.of(bpy.context).missed > 0.4
    assert bpy.ops.imprint.propose_weights() == {"FINISHED"}
    assert (settings.offset_group, settings.straight_group) == ("Imprint Offset", "Imprint Straight")
    assert settings.low.vertex_groups.active.name == "Imprint Offset"
    assert set(weights("Imprint Offset")) == {0.5, 1.0}
    assert (weights("Imprint Straight") == 0.5).all()
    bpy.ops.imprint.bake()
    assert results.of(bpy.context).missed == 0.0
    assert bpy.ops.imprint.propose_weights() == {"FINISHED"}  # nothing is better, and nothing changes
    assert set(weights("Imprint Offset")) == {0.5, 1.0}


def test_groups_with_other_names_are_filled(settings):
    settings.low.vertex_groups.new(name="mine")
    settings.offset_group = "mine"
    bpy.ops.imprint.bake()
    bpy.ops.imprint.propose_weights()
    assert settings.offset_group == "mine"
    assert [group.name for group in settings.low.vertex_groups] == ["mine", "Imprint Straight"]
    assert set(weights("mine")) == {0.5, 1.0}


def test_undo_takes_the_weights_back(settings):
    bpy.ops.imprint.bake()
    bpy.ops.ed.undo_push(message="before")
    bpy.ops.imprint.propose_weights()
    bpy.ops.ed.undo_push(message="after")
    assert bpy.ops.ed.undo() == {"FINISHED"}
    assert not bpy.data.objects["lo"].vertex_groups
    assert bpy.context.scene.imprint.offset_group == ""


def test_no_weights_in_edit_mode_or_without_rays(settings):
    bpy.ops.imprint.bake(method="FLATTEN")
    with pytest.raises(RuntimeError, match="poll"):
        bpy.ops.imprint.propose_weights()
    bpy.ops.imprint.bake(method="CAST")
    assert bpy.ops.imprint.propose_weights.poll()
    bpy.context.view_layer.objects.active = settings.low
    bpy.ops.object.mode_set(mode="EDIT")
    assert not bpy.ops.imprint.propose_weights.poll()
    bpy.ops.object.mode_set(mode="WEIGHT_PAINT")
    assert bpy.ops.imprint.propose_weights() == {"FINISHED"}
    assert np.ptp(weights("Imprint Offset")) == 0.5


def test_an_object_that_was_deleted_is_an_error(settings):
    bpy.ops.imprint.bake()
    bpy.data.objects.remove(settings.highs[0].object)
    with pytest.raises(RuntimeError, match="was deleted"):
        bpy.ops.imprint.propose_weights()
    assert not settings.low.vertex_groups
