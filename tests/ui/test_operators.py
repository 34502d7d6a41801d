# SPDX-License-Identifier: GPL-3.0-or-later
"""The operators, called as in scripts, and their panel."""

from types import SimpleNamespace

import bpy
import numpy as np
import pytest

from addon import flamenco
from addon.core import map_types, naming, progress
from addon.core.errors import BakeError
from addon.scene import mesh_reader
from addon.ui import bake_panel, pair_operators, preferences, properties, sets_panel
from addon.ui.bake_results import results
from addon.ui.live import live
from addon.ui.progress_display import display, time_left
from scripts.imprint import ROOT
from tests.support import glb, maps, quick_assets, zoo
from tests.support.manual import blocks
from tests.support.panel import add, refusal, select, use
from tests.support.panel_layout import draw
from tests.support.snapshot import difference, snapshot

pytestmark = pytest.mark.usefixtures("registered", "gpu_context")


NAMES = {"low": "lo", "high": [{"name": "hi"}]}
"""The objects of `pair`, as arguments of the operators."""


@pytest.fixture
def pair():
    """A low and a high object, neither selected nor active, and small maps."""
    low, high = zoo.plane("lo"), zoo.plane("hi", slope=1.0)
    use(size=16, method="FLATTEN")  # the high object is so steep that Auto would not choose Flatten
    return low, high


def bake(**arguments):
    """Run the operator. Returns the texels of the image in its message."""
    assert bpy.ops.imprint.bake(**arguments) == {"FINISHED"}
    summary = bpy.context.window_manager.imprint_summary
    return maps.pixels(bpy.data.images[summary.split("\n")[0].rpartition(": ")[2]])


def leans(texels):
    """Whether the map shows the sloped plane."""
    return texels[8, 8, 0] < 0.2


# Which objects


def test_the_active_object_is_the_low_one(pair):
    low, high = pair
    select(low, high)
    assert leans(bake())
    assert "lo_normal" in bpy.data.images
    select(high, low)
    bake(space="OBJECT")
    assert "hi_normal" in bpy.data.images


@pytest.mark.parametrize(
    ("in_slots", "selected", "arguments"),
    [
        ("lo hi", "other another", {}),
        ("lo", "hi", {}),
        ("other another", "", NAMES),
        ("other hi", "", {"low": "lo"}),
        ("", "hi", {"low": "lo"}),
    ],
)
def test_arguments_go_before_slots_and_slots_before_the_selection(pair, in_slots, selected, arguments):
    zoo.cube("other"), zoo.cube("another")
    use(*(bpy.data.objects[name] for name in in_slots.split()))
    if selected:
        select(*(bpy.data.objects[name] for name in selected.split()))
    assert leans(bake(**arguments))


def test_one_object_with_modifiers(pair):
    low, _ = pair
    low.vertex_groups.new(name="right").add([v.index for v in low.data.vertices if v.co.x > 0], 1.0, "REPLACE")
    low.modifiers.new("Lift", "DISPLACE").vertex_group = "right"
    select(low)
    assert bake()[8, 8, 0] < 0.4


def test_several_high_arguments(pair):
    assert "'hi' is twice in the high objects" in refusal(
        bpy.ops.imprint.bake, low="lo", high=[{"name": "hi"}, {"name": "hi"}]
    )
    zoo.plane("third", slope=-1.0)
    assert bake(low="lo", high=[{"name": "hi"}, {"name": "third"}])[8, 8, 0] > 0.8  # the last one is on top


@pytest.mark.parametrize("arguments", [{"low": "lol"}, {"low": "lo", "high": [{"name": "hih"}]}])
def test_typos_get_a_hint(pair, arguments):
    assert "did you mean" in refusal(bpy.ops.imprint.bake, **arguments)


# Settings


def test_arguments_override_the_settings_of_the_scene(pair):
    settings = bpy.context.scene.imprint
    settings.space, settings.green, settings.image, settings.margin = "OBJECT", "-Y", "Scene", 3
    texels = bake(**NAMES, width=32, image="Mine")
    assert texels.shape[:2] == (16, 32)  # the height comes from the scene
    assert "Mine" in bpy.data.images
    assert "object space" in bpy.context.window_manager.imprint_summary
    assert "Scene" not in bpy.data.images


def test_a_margin_that_a_script_sets_is_used_though_the_scene_has_no_limit(pair):
    bpy.context.scene.imprint.unlimited = True
    bake(**NAMES)
    assert results.named(bpy.context, "lo").settings["margin"] is None
    bake(**NAMES, margin=2)
    assert results.named(bpy.context, "lo").settings["margin"] == 2


def test_an_argument_may_be_the_default_value(pair):
    bpy.context.scene.imprint.storage = "MEMORY"
    bake(**NAMES, storage="PACK")
    assert bpy.data.images["lo_normal"].packed_file is not None


def test_settings_that_do_not_fit_together(pair, tmp_path):
    output = str(tmp_path / "map.png")
    assert "8 or 16 bits" in refusal(bpy.ops.imprint.bake, **NAMES, storage="FILE", output=output, depth="32")


def test_a_targa_has_8_bits_unless_more_are_set(pair, tmp_path):
    settings = bpy.context.scene.imprint
    settings.storage, settings.output = "FILE", str(tmp_path / "new" / "panel.tga")
    bake(**NAMES)
    bake(**NAMES, output=str(tmp_path / "script.tga"))
    assert sorted(path.name for path in tmp_path.rglob("*.tga")) == ["panel.tga", "script.tga"]
    assert "8 bits per channel, not 16" in refusal(bpy.ops.imprint.bake, **NAMES, depth="16")
    settings.depth = "16"
    assert "8 bits per channel, not 16" in refusal(bpy.ops.imprint.bake, **NAMES)
    settings.output = "//map.png"
    bake(**NAMES, output=str(tmp_path / "again.tga"))


def test_the_result_is_reported(pair):
    low, high = pair
    high.data.uv_layers[0].uv[0].vector = (-0.5, 0)
    select(low, high)
    bake()
    manager = bpy.context.window_manager
    for word in ("Flatten", "16 x 16", "lo_normal", "covered", " s ("):
        assert word in manager.imprint_summary
    assert "outside the UV tile" in manager.imprint_warnings


def test_a_file_beside_the_saved_scene(pair, tmp_path, recwarn):
    """A path from Blender's file selector. Blender warns if a property does not support such paths."""
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "scene.blend"))
    settings = bpy.context.scene.imprint
    settings.storage, settings.output = "FILE", "//map.png"
    assert [str(warning.message) for warning in recwarn] == []
    assert leans(bake(**NAMES))
    assert (tmp_path / "map.png").is_file()


# Undo


OF_SCULPT_MODE = ("brushes", "libraries")
"""Data that Blender restores by itself after Sculpt Mode was used in this process."""


def test_undo_is_one_step(pair):
    low, high = pair
    bpy.ops.ed.undo_push(message="before")
    before = snapshot(without=OF_SCULPT_MODE)
    bpy.ops.imprint.bake("EXEC_DEFAULT", True, **NAMES)
    assert "lo_normal" in bpy.data.images
    assert bpy.ops.ed.undo() == {"FINISHED"}
    assert difference(before, snapshot(without=OF_SCULPT_MODE)) == {}
    assert bpy.ops.ed.redo() == {"FINISHED"}
    assert leans(maps.pixels(bpy.data.images["lo_normal"]))


def test_undo_restores_the_packed_map(pair):
    zoo.cube("third")
    bpy.ops.ed.undo_push(message="before")  # in the background, Undo needs a first step
    bpy.ops.imprint.bake("EXEC_DEFAULT", True, **NAMES)
    first = maps.pixels(bpy.data.images["lo_normal"])
    bpy.ops.imprint.bake("EXEC_DEFAULT", True, low="lo", high=[{"name": "third"}])
    assert not np.array_equal(maps.pixels(bpy.data.images["lo_normal"]), first)
    bpy.ops.ed.undo()
    np.testing.assert_array_equal(maps.pixels(bpy.data.images["lo_normal"]), first)


# Slots


def test_slots_are_filled_from_the_selection(pair):
    low, high = pair
    settings = bpy.context.scene.imprint
    settings.highs.add()  # an old slot
    sun = add("sun", bpy.data.lights.new("sun", "SUN"))
    select(low, high, sun)
    assert bpy.ops.imprint.use_selection() == {"FINISHED"}
    assert settings.low == low
    assert [slot.object for slot in settings.highs] == [high]


@pytest.mark.parametrize("active", [None, "sun"])
def test_only_a_mesh_can_be_the_low_slot(pair, active):
    add("sun", bpy.data.lights.new("sun", "SUN"))
    bpy.context.view_layer.objects.active = bpy.data.objects[active] if active else None
    assert not bpy.ops.imprint.use_selection.poll()


def test_slots_are_added_and_removed(pair):
    settings = bpy.context.scene.imprint
    assert not bpy.ops.imprint.high_remove.poll()
    for _ in range(3):
        bpy.ops.imprint.high_add()
    assert settings.active_high == 2
    settings.highs[0].object, settings.highs[2].object = pair
    bpy.ops.imprint.high_remove(index=1)
    assert [slot.object for slot in settings.highs] == list(pair)
    settings.active_high = 1
    bpy.ops.imprint.high_remove()
    assert [slot.object for slot in settings.highs] == [pair[0]]
    assert settings.active_high == 0
    bpy.ops.imprint.high_remove()
    bpy.ops.imprint.high_add()
    assert len(settings.highs) == 1


# The panel


def can_bake(drawn):
    return dict(drawn.buttons)["imprint.bake"]


def test_the_panel_shows_the_plan(pair):
    low, high = pair
    select(low, high)
    drawn = draw()
    assert can_bake(drawn)
    for word in ("'hi'", "'lo'", "tangent space", "16 x 16", "into a new image 'lo_normal'"):
        assert word in drawn.text
    assert "ERROR" not in drawn.icons


def test_a_light_that_is_selected_too_is_left_out(pair):
    low, high = pair
    select(low, high, add("Sun", bpy.data.lights.new("Sun", "SUN")), add("Camera", bpy.data.cameras.new("Camera")))
    assert bpy.context.scene.imprint.chosen(bpy.context).highs == [high]
    assert can_bake(draw())
    select(low, bpy.data.objects["Sun"])
    assert "itself" in draw().text
    bake(**NAMES)
    assert bpy.context.scene.imprint.chosen(bpy.context).highs == [high]  # the pair of the low object
    assert can_bake(draw())


def test_a_light_that_is_selected_too_leaves_the_low_objects_own_modifiers(pair):
    low, _ = pair
    low.modifiers.new("Bevel", "BEVEL")
    select(low, add("Sun", bpy.data.lights.new("Sun", "SUN")))
    assert bpy.context.scene.imprint.chosen(bpy.context).highs == [low]


@pytest.mark.parametrize("setting", ["offset_group", "straight_group"])
def test_the_panel_names_a_group_that_the_low_object_lacks(pair, setting):
    low, high = pair
    select(low, high)
    settings = bpy.context.scene.imprint
    setattr(settings, setting, "far")
    settings.method = "CAST"
    drawn = draw()
    assert not can_bake(drawn)
    assert "'lo' has no vertex group 'far'" in drawn.text
    settings.method = "FLATTEN"
    assert can_bake(draw())
    settings.method = "AUTO"
    assert not can_bake(draw())
    modifier = low.modifiers.new("Nodes", "NODES")  # which may add the group
    assert can_bake(draw())
    low.modifiers.remove(modifier)
    low.vertex_groups.new(name="far")
    assert can_bake(draw())


def test_a_low_object_with_more_faces_than_the_high_one_raises_a_warning(pair):
    _, high = pair
    fine = zoo.terrain("fine")
    select(high, fine)
    assert "faces than" not in draw().text
    select(fine, high)
    drawn = draw()
    assert can_bake(drawn)  # it may be on purpose
    assert "'fine' has more faces than 'hi'. Are they swapped?" in drawn.text
    assert "INFO" in drawn.icons
    high.modifiers.new("", "SUBSURF")  # only an evaluation shows how many faces it makes
    assert "faces than" not in draw().text


def test_an_object_alone_can_become_an_asset_from_the_box(pair):
    low, high = pair
    made = ("imprint.make_asset", True)
    open_panels = [bake_panel.IMPRINT_PT_bake]
    select(high)
    assert made in draw(panels=open_panels).buttons
    select(low, high)
    assert made not in draw(panels=open_panels).buttons
    high.select_set(False)
    low.select_set(False)
    assert made not in draw(panels=open_panels).buttons
    high.modifiers.new("", "SUBSURF")
    select(high)
    assert made not in draw(panels=open_panels).buttons  # it is baked onto itself
    high.data.uv_layers.remove(high.data.uv_layers[0])
    assert made in draw(panels=open_panels).buttons


def test_the_panel_shows_the_objects_of_live_whatever_is_selected(pair):
    low, high = pair
    select(low, high)
    assert bpy.ops.imprint.live() == {"FINISHED"}
    try:
        select(low)
        drawn = draw()
        assert "Live: 'lo' follows 'hi'." in drawn.text
        assert "No high object" not in drawn.text
        assert "ERROR" not in drawn.icons
    finally:
        live.stop()


def a_camera(low, high):
    select(add("Camera", bpy.data.cameras.new("Camera")), high)


def no_uvs(low, high):
    low.data.uv_layers.remove(low.data.uv_layers[0])
    select(low, high)


def not_finite(low, high):
    low.scale.x = float("nan")
    select(low, high)


def gone_from_the_scene(low, high):
    use(low, high)
    bpy.data.scenes.new("other").collection.objects.link(high)
    bpy.context.scene.collection.objects.unlink(high)


def deleted(low, high):
    use(low, high)
    bpy.context.scene.collection.objects.unlink(high)


MISSING = {
    "nothing": (lambda low, high: None, "No low object"),
    "a camera": (a_camera, "'Camera' is of the type camera"),
    "a camera alone": (
        lambda low, high: (a_camera(low, high), high.select_set(False)),
        "'Camera' is of the type camera",
    ),
    "no UVs": (no_uvs, "'lo' has no UV layer"),
    "not finite": (not_finite, "NaN"),
    "gone from the scene": (gone_from_the_scene, "'hi' is not in scene"),
    "deleted": (deleted, "'hi' is in no collection"),
    "no file named": (lambda low, high: (select(low, high), use(storage="FILE")), "No file is set"),
    "a depth that does not fit the format": (
        lambda low, high: (select(low, high), use(storage="FILE", output="map.exr", depth="8")),
        "16 or 32 bits",
    ),
}


@pytest.mark.parametrize(("make", "reason"), MISSING.values(), ids=MISSING)
def test_the_panel_shows_why_the_button_is_disabled(pair, make, reason):
    make(*pair)
    drawn = draw()
    assert reason in drawn.text
    assert "ERROR" in drawn.icons
    assert not can_bake(drawn)


STATES = {
    "edit mode": lambda low, high: (select(low, high), bpy.ops.object.mode_set(mode="EDIT")),
    "own modifiers": lambda low, high: (low.modifiers.new("Rounded", "SUBSURF"), select(low)),
    "empty slots": lambda low, high: (bpy.context.scene.imprint.highs.add(), select(low, high)),
    "other settings": lambda low, high: (
        use(space="OBJECT", storage="FILE", output="map.png", material=False),
        select(low, high),
    ),
}


@pytest.mark.parametrize("make", STATES.values(), ids=STATES)
def test_the_panel_draws_in_any_state_and_width(pair, make):
    make(*pair)
    for width, ui_scale in ((1, 1.0), (240, 2.0), (4000, 0.5)):
        drawn = draw(width, ui_scale)
        assert can_bake(drawn)
        assert "'lo'" in drawn.text


def test_the_panel_shows_every_setting(pair):
    select(*pair)
    settings = bpy.context.scene.imprint
    settings.storage, settings.method, settings.measure = "FILE", "CAST", False
    settings.depth, settings.udim, settings.limited = "8", True, True
    settings.maps, settings.pack = set(map_types.NAMES), "CUSTOM"
    for name in ("ao_limited", "thickness_limited", "curvature_limited"):
        setattr(settings, name, True)
    names = {prop.identifier for prop in settings.bl_rna.properties}
    shown = {*draw().properties}
    assert not {"width", "height"} & shown
    settings.square, settings.distance_unit = False, "SCENE"
    for settings.output, settings.export in (("//map.dds", ""), ("//map.webp", "//low.glb")):
        shown.update(draw().properties)
    settings.format = "AUTO"
    shown.update(draw().properties)
    select(*(zoo.cube(name) for name in "ab"))
    bpy.data.objects["b"].location.x = 9.0
    shown.update(draw().properties)
    bpy.ops.imprint.set_add(by_name=True)
    shown.update(draw().properties)
    # The list of high objects has the last two, switches stand for the maps, and engines set the names.
    hidden = {"rna_type", "name", "names", "engine_name", "maps", "active_high"}
    assert names - (shown - {"name"}) - {"highs", "active_set"} == hidden  # a set has a name


def test_one_size_for_both_sides(pair):
    settings = bpy.context.scene.imprint
    settings.size = 512
    assert (settings.width, settings.height, settings.size) == (512, 512, 512)
    settings.width = 64  # scripts may set any size
    assert (settings.width, settings.height) == (64, 512)
    assert {"width", "height"} <= set(draw().properties)
    settings.square = True
    assert (settings.width, settings.height) == (64, 64)


@pytest.mark.parametrize(
    ("before", "arguments", "after"),
    [
        ((2048, 2048), {"side": 512}, (512, 512)),
        ((2048, 512), {"side": 8192}, (8192, 2048)),
        ((2048, 512), {"factor": 2.0}, (4096, 1024)),
        ((512, 2048), {"factor": 0.5}, (256, 1024)),
        ((16384, 16), {"factor": 2.0}, (16384, 32)),
        ((16384, 16), {"factor": 0.5}, (8192, 16)),
    ],
)
def test_the_menu_of_sizes(pair, before, arguments, after):
    settings = bpy.context.scene.imprint
    settings.width, settings.height = before
    assert bpy.ops.imprint.resize(**arguments) == {"FINISHED"}
    assert (settings.width, settings.height) == after


# While a bake is running


def test_the_bar_is_where_the_button_is_that_was_pressed(pair, monkeypatch):
    low, high = pair
    low.name, high.name = "a_low", "a_high"
    select(*pair)
    buttons = {name for name, _ in draw().buttons}
    monkeypatch.setattr(display, "current", progress.Progress("Drawing", 0.25))
    for pressed in ("imprint.make_levels", "imprint.convert", "imprint.bake"):
        monkeypatch.setattr(display, "operator", pressed)
        assert buttons - {name for name, _ in draw().buttons} == {pressed}
    for pressed in ("imprint.view_show", "imprint.bake_pairs"):  # no button of a panel draws a bar for it
        monkeypatch.setattr(display, "operator", pressed)
        assert buttons - {name for name, _ in draw().buttons} == {"imprint.bake"}


def test_the_bar_of_a_set_is_where_its_button_is(pair, monkeypatch):
    low, high = pair
    low.name, high.name = "a_low", "a_high"
    bpy.ops.imprint.set_add(by_name=True)
    named = [vars(given) for name, given in draw().given if name == "imprint.bake_sets"]
    monkeypatch.setattr(display, "current", progress.Progress("Drawing", 0.25))
    for pressed in ("imprint.bake_sets", "imprint.bake", "imprint.view_show"):
        monkeypatch.setattr(display, "operator", pressed)
        drawn = draw()
        shown = [vars(given) for name, given in drawn.given if name == "imprint.bake_sets"]
        assert [one for one in named if one not in shown] == [{"name": "Set"}]
        assert "25%" in drawn.text


# Where things are


@pytest.mark.parametrize("make", [case[0] for case in MISSING.values()], ids=MISSING)
def test_the_bake_button_stays_at_its_height(pair, make):
    """Above it are the same rows, whatever the texts say."""

    def above():
        drawn = draw(panels=[bpy.types.IMPRINT_PT_bake])
        of_list = drawn.order.index("imprint.high_add")  # before it, the list has a row for each high object
        return drawn.order[of_list : drawn.order.index("imprint.bake")]

    select(*pair)
    before = above()
    make(*pair)
    assert above() == before


@pytest.mark.parametrize(
    ("done", "seconds", "words"),
    [
        (0.01, 60.0, ""),
        (0.5, 0.5, ""),
        (0.5, 3.0, ", 3 s left"),
        (0.25, 9.0, ", 25 s left"),
        (0.1, 40.0, ", 6 min left"),
        (1.0, 40.0, ", 0 s left"),
    ],
)
def test_the_bar_shows_the_remaining_time(done, seconds, words):
    assert time_left(done, seconds) == words


def test_names_are_matched_again_only_after_a_change(pair, monkeypatch):
    asked = []
    match = naming.match
    monkeypatch.setattr(naming, "match", lambda *names: asked.append(names) or match(*names))
    properties.matched.cache_clear()
    low, high = pair
    bpy.ops.imprint.set_add(by_name=True)
    bpy.context.scene.imprint_sets[0].source = "NAMES"
    for _ in range(3):
        draw()
    assert len(asked) == 1
    low.name, high.name = "a_low", "a_high"
    assert "a_high" in draw().labels
    bpy.context.scene.imprint.low_suffix = "_lp"
    assert "a_high" not in draw().labels
    assert len(asked) == 3


# Game Asset panel


@pytest.mark.parametrize("typed", [False, True])
def test_only_a_number_of_triangles_that_was_typed_has_to_be_reached(typed, monkeypatch):
    quick_assets.quicken(monkeypatch)
    select(zoo.cube("Crate_high"))
    settings = use(size=64, storage="MEMORY")
    if typed:
        settings.asset_triangles = "5000"
    assert bpy.ops.imprint.make_asset() == {"FINISHED"}
    assert ("has 12 triangles, not 5,000" in bpy.context.window_manager.imprint_warnings) == typed


# Levels panel


@pytest.fixture
def settings():
    """The settings of the scene, for small maps of an active terrain."""
    bpy.context.view_layer.objects.active = zoo.terrain("Hill", 12)
    return use(size=64, storage="MEMORY")


def test_the_button_makes_a_level_for_each_limit(settings):
    settings.level_degrees, settings.level_distance = "", "2, 4"
    assert bpy.ops.imprint.make_levels() == {"FINISHED"}
    assert [obj.name for obj in bpy.data.collections["Hill_LODs"].objects] == ["Hill_LOD1", "Hill_LOD2"]
    assert bpy.context.window_manager.imprint_summary.startswith("Hill_LOD1: ")


@pytest.mark.parametrize(
    ("name", "files"), [("hill.glb", ["hill.glb"]), ("{low}.usd", ["Hill_LOD1.usd", "Hill_LOD2.usd"])]
)
def test_the_button_writes_files_for_an_engine(settings, tmp_path, name, files):
    settings.level_degrees, settings.level_distance = "", "2, 4"
    settings.export = str(tmp_path / name)
    assert bpy.ops.imprint.make_levels() == {"FINISHED"}
    assert sorted(path.name for path in tmp_path.glob("*.*")) == files
    assert bpy.context.window_manager.imprint_summary.splitlines()[-1].startswith(f"Wrote {tmp_path / files[0]}")
    if name.endswith(".glb"):
        assert b"MSFT_lod" in (tmp_path / name).read_bytes()


@pytest.mark.parametrize(
    ("path", "text"), [("hill.usd", "put {low} into"), ("hill.obj", "no file for an engine"), ("//hill.glb", "save it")]
)
def test_a_file_that_cannot_take_levels_is_refused_before_they_are_made(settings, path, text):
    settings.level_degrees, settings.level_distance, settings.export = "", "2, 4", path
    with pytest.raises(RuntimeError, match=text):
        bpy.ops.imprint.make_levels()
    assert len(bpy.data.objects) == 1


def test_levels_stay_where_their_file_cannot_be_written(settings, tmp_path):
    settings.level_degrees, settings.level_distance = "", "4"
    (tmp_path / "none").write_text("a file, not a folder")
    settings.export = str(tmp_path / "none" / "hill.glb")
    assert bpy.ops.imprint.make_levels() == {"FINISHED"}
    assert len(bpy.data.objects) == 2
    assert bpy.context.window_manager.imprint_warnings


def test_levels_have_the_numbers_of_triangles_that_are_asked_for(settings):
    settings.level_triangles = "50 %, 60"
    original = bpy.context.active_object
    original.data.calc_loop_triangles()
    count = len(original.data.loop_triangles)
    assert bpy.ops.imprint.make_levels() == {"FINISHED"}
    found = []
    for number in (1, 2):
        data = bpy.data.objects[f"{original.name}_LOD{number}"].data
        data.calc_loop_triangles()
        found.append(len(data.loop_triangles))
    assert found == [pytest.approx(count / 2, abs=2), pytest.approx(60, abs=2)]


def test_levels_stand_side_by_side_and_their_file_has_them_in_one_place(settings, tmp_path):
    settings.level_triangles, settings.level_beside = "50 %, 60", True
    settings.export = str(tmp_path / "hill.glb")
    original = bpy.context.active_object
    original.location.x = 3.0
    bpy.context.view_layer.update()
    assert bpy.ops.imprint.make_levels() == {"FINISHED"}
    levels = [bpy.data.objects[f"{original.name}_LOD{number}"] for number in (1, 2)]
    places = [obj.matrix_world.translation.x for obj in (original, *levels)]
    assert np.diff(places) == pytest.approx([1.2 * original.dimensions.x] * 2)
    assert [obj.matrix_world.translation.yz[:] for obj in levels] == [(0.0, 0.0)] * 2
    tree, _ = glb.parse(tmp_path / "hill.glb")
    assert [node["translation"] for node in tree["nodes"] if "mesh" in node] == [[3.0, 0.0, 0.0]] * 2


@pytest.mark.parametrize(
    ("text", "reason"),
    [("half", "'half' is no number of triangles"), ("3", "cannot be"), ("150 %", "cannot be"), (",", "0 levels")],
)
def test_numbers_of_triangles_that_are_not_possible_are_named(settings, text, reason):
    settings.level_triangles = text
    assert reason in refusal(bpy.ops.imprint.make_levels)


def test_the_usual_limits_are_valid_and_wrong_ones_are_reported(settings):
    assert (settings.level_degrees, settings.level_distance) == ("1, 2, 4", "1")
    settings.level_degrees = "one"
    with pytest.raises(RuntimeError, match="are not degrees"):
        bpy.ops.imprint.make_levels()
    bpy.context.view_layer.objects.active = None
    settings.level_degrees = "1"
    with pytest.raises(RuntimeError, match="No object is active"):
        bpy.ops.imprint.make_levels()
    assert len(bpy.data.objects) == 1


# Game Asset panel


def test_the_button_makes_an_asset_and_its_file(settings, tmp_path, monkeypatch):
    quick_assets.quicken(monkeypatch)
    high = bpy.context.view_layer.objects.active
    select(high)
    settings.asset_triangles, settings.export = "100", str(tmp_path / "{low}.glb")
    assert bpy.ops.imprint.make_asset() == {"FINISHED"}
    low = bpy.data.objects["Hill_low"]
    assert len(low.data.polygons) == pytest.approx(100, abs=2) and len(low.data.uv_layers) == 1
    assert bpy.context.selected_objects == [low] == [bpy.context.view_layer.objects.active]
    assert (tmp_path / "Hill_low.glb").exists()
    assert "Hill_low: 1" in bpy.context.window_manager.imprint_summary
    settings.asset_levels = 1
    for level in (1, 2):  # the low mesh is selected now, and asks for its own asset
        assert bpy.ops.imprint.make_asset() == {"FINISHED"}
        assert sorted(bpy.data.objects.keys()) == ["Hill", "Hill_low", "Hill_low_LOD1"], level


@pytest.mark.parametrize(
    ("values", "reason"),
    [
        ({"asset_triangles": "few"}, "is not a number of triangles"),
        ({"asset_degrees": "0"}, "cannot be a limit"),
        ({"export": "hill.obj"}, "no file for an engine"),
    ],
)
def test_an_asset_that_is_not_possible_is_refused(settings, values, reason):
    select(bpy.context.view_layer.objects.active)
    for name, value in values.items():
        setattr(settings, name, value)
    assert reason in refusal(bpy.ops.imprint.make_asset)


def test_an_asset_of_nothing_is_refused(settings):
    for obj in bpy.context.selected_objects:
        obj.select_set(False)
    assert "No object is selected" in refusal(bpy.ops.imprint.make_asset)


# Sending


@pytest.fixture
def address(monkeypatch):
    """A Flamenco Manager in the preferences."""
    for module in (pair_operators, sets_panel):
        monkeypatch.setattr(module, "flamenco_address", lambda _context: "http://farm")
    return "http://farm"


@pytest.fixture
def sent(monkeypatch):
    """The jobs that are sent, in place of sending them. Blender is online."""
    jobs = []
    monkeypatch.setattr(flamenco, "submit", lambda url, job: jobs.append((url, job)) or f"{url}/app/jobs/1")
    monkeypatch.setattr(pair_operators.bpy, "app", SimpleNamespace(online_access=True), raising=False)
    return jobs


def test_the_button_is_there_if_an_address_is_set(address):
    bpy.context.scene.imprint.bakes = "SETS"
    assert "imprint.send_to_flamenco" in {name for name, _ in draw().buttons}


def test_uv_maps_are_packed_where_pairs_share_an_image():
    lows = [zoo.plane("a_low"), zoo.plane("b_low"), zoo.plane("c_low")]
    for low in lows:
        zoo.terrain(low.name.replace("low", "high"), 4)
    bpy.ops.imprint.set_add(by_name=True)
    assert ("imprint.pack_uvs", False) in draw().buttons
    bpy.context.scene.imprint_sets[0].textures = "ONE"
    assert ("imprint.pack_uvs", True) in draw().buttons
    lows[2].imprint_is_baked = False
    assert bpy.ops.imprint.pack_uvs() == {"FINISHED"}
    assert ["Atlas" in low.data.uv_layers for low in lows] == [True, True, False]
    for low in lows:
        low.imprint_is_baked = False
    with pytest.raises(RuntimeError, match="No low object is switched on"):
        bpy.ops.imprint.pack_uvs()


def test_what_is_off_keeps_its_place_in_the_packed_map():
    """Also if the others are packed anew; with nothing off, all are."""
    lows = [zoo.plane(f"{name}_low") for name in "abc"]
    for low in lows:
        zoo.terrain(low.name.replace("low", "high"), 4)
    lows[2].imprint_is_baked = False
    bpy.ops.imprint.pack_uvs()
    lows[1].scale = lows[2].scale = (0.3, 0.3, 0.3)
    bpy.context.view_layer.update()
    places = [mesh_reader.uvs(low.data, "Atlas") for low in lows[:2]]
    lows[0].imprint_is_baked, lows[2].imprint_is_baked = False, True
    lows[1].imprint_is_baked = False
    bpy.ops.imprint.pack_uvs()
    assert all(np.array_equal(mesh_reader.uvs(low.data, "Atlas"), uv) for low, uv in zip(lows[:2], places, strict=True))
    assert np.ptp(mesh_reader.uvs(lows[2].data, "Atlas"), axis=0).max() < 0.5
    lows[1].imprint_is_baked = True
    bpy.ops.imprint.pack_uvs(anew=True)
    assert np.array_equal(mesh_reader.uvs(lows[0].data, "Atlas"), places[0])
    assert not np.array_equal(mesh_reader.uvs(lows[1].data, "Atlas"), places[1])
    lows[0].imprint_is_baked = True
    bpy.ops.imprint.pack_uvs(anew=True)
    assert not np.array_equal(mesh_reader.uvs(lows[0].data, "Atlas"), places[0])


def test_without_an_address_there_is_no_button():
    assert preferences.flamenco_address(bpy.context) == ""
    bpy.context.scene.imprint.bakes = "SETS"
    assert "imprint.send_to_flamenco" not in {name for name, _ in draw().buttons}


def test_without_online_access_nothing_is_sent(address, sent, monkeypatch, tmp_path):
    monkeypatch.setattr(pair_operators.bpy, "app", SimpleNamespace(online_access=False))
    with pytest.raises(RuntimeError, match="poll"):
        bpy.ops.imprint.send_to_flamenco(filepath=str(tmp_path / "jobs.toml"))
    assert sent == []


def test_a_job_file_is_sent(address, sent, tmp_path):
    path = tmp_path / "props.toml"
    path.touch()
    assert bpy.ops.imprint.send_to_flamenco(filepath=str(path), shards=4) == {"FINISHED"}
    assert sent == [(address, flamenco.Job("props", {"jobs": str(path), "shards": 4}))]


def test_a_missing_file_is_named(address, sent, tmp_path):
    with pytest.raises(RuntimeError, match=r"no file .*none\.toml"):
        bpy.ops.imprint.send_to_flamenco(filepath=str(tmp_path / "none.toml"))
    assert sent == []


def test_what_the_manager_refuses_is_shown(address, sent, tmp_path, monkeypatch):
    def refuse(*_):
        raise BakeError("The Flamenco Manager refuses the job: no")

    path = tmp_path / "props.toml"
    path.touch()
    monkeypatch.setattr(flamenco, "submit", refuse)
    with pytest.raises(RuntimeError, match="refuses the job"):
        bpy.ops.imprint.send_to_flamenco(filepath=str(path))


# Manual examples


def test_the_examples_of_operators_bake(tmp_path):
    zoo.plane("rock_low")
    zoo.plane("rock_high", slope=0.2)
    use(size=32)
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "rock.blend"))
    (example,) = (text for _, text in blocks(ROOT / "docs" / "python.md") if text.startswith("import bpy"))
    exec(example.replace("1024", "32").replace("last=48", "last=2"))
    maps = {"rock.exr", "rock_ao.png", "rock_curvature.png", "rock_001.png", "rock_002.png"}
    assert {path.name for path in tmp_path.iterdir()} == {"rock.blend"} | maps
    assert bpy.data.images["rock_low_normal"].size[:] == (32, 32)
    (slot,) = bpy.data.objects["rock_low"].material_slots
    assert slot.material["imprint"] == "one material"
