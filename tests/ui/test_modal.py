# SPDX-License-Identifier: GPL-3.0-or-later
"""Tasks in slices, as in the window: with a progress bar and Esc, and with nothing left after any end."""

from types import SimpleNamespace

import bpy
import pytest

import addon
from addon.core import progress
from addon.core.errors import BakeError
from addon.engine import gpu_memory, tree_cache
from addon.passes import target
from addon.ui import bake_operators, fix_buttons, modal, pair_operators, view_panel
from addon.ui.bake_results import results
from addon.ui.live import live
from addon.ui.modal import EVERY, free_if_idle
from addon.ui.progress_display import display
from addon.ui.view_shading import Mode
from addon.ui.views import viewer
from tests.support import zoo
from tests.support.maps import pixels
from tests.support.snapshot import difference, snapshot

pytestmark = pytest.mark.usefixtures("gpu_context", "registered")

TICKS = 2000
"""More ticks than any task here needs."""


@pytest.fixture
def pair():
    low, high = zoo.terrains_in_slots("CAST")
    yield low, high
    modal.runner.stop(bpy.context)
    live.stop()
    viewer.off()


class Button(modal.SlicedOperator):
    """An operator of the add-on, run as a button in the window, in the shortest slices."""

    def __init__(self, operator, **properties):
        for name in ("task", "finish", "show", "request", "wanted", "to_settings"):
            if hasattr(operator, name):
                setattr(self, name, getattr(operator, name).__get__(self))
        self.low, self.cage, self.each = "", "", False
        self.high = ()
        self.options = SimpleNamespace(is_invoke=True)
        self.properties = SimpleNamespace(is_property_set=lambda _: False)
        self.reports = []
        self.__dict__.update(properties)

    def report(self, kind, text):
        self.reports.append((*kind, text))

    def press(self):
        manager = bpy.context.window_manager
        self.context = SimpleNamespace(
            window=manager.windows[0],
            workspace=SimpleNamespace(status_text_set=lambda _: None),
            window_manager=SimpleNamespace(
                windows=manager.windows,
                event_timer_add=manager.event_timer_add,
                event_timer_remove=manager.event_timer_remove,
                modal_handler_add=lambda _: None,
            ),
            scene=bpy.context.scene,
            view_layer=bpy.context.view_layer,
            evaluated_depsgraph_get=bpy.context.evaluated_depsgraph_get,
            active_object=bpy.context.active_object,
            selected_objects=bpy.context.selected_objects,
        )
        return self.invoke(self.context, None)

    def event(self, kind="TIMER"):
        return self.modal(self.context, SimpleNamespace(type=kind))

    def run(self):
        for _ in range(TICKS):
            state = self.event()
            if state != {"RUNNING_MODAL"}:
                return state
        raise AssertionError("the task does not end")


@pytest.fixture
def tiny(monkeypatch):
    """The shortest slices and ticks."""
    monkeypatch.setattr(modal, "TICK", -1.0)
    monkeypatch.setattr(modal, "SLICE", 1e-9)


def is_clean():
    return display.current is None and not display.is_drawn and bpy.ops.imprint.live.poll()


BUTTONS = {
    "live": lambda: Button(bake_operators.IMPRINT_OT_live),
    "view": lambda: Button(view_panel.IMPRINT_OT_view_show, mode="MAP"),
}


@pytest.mark.usefixtures("tiny")
@pytest.mark.parametrize("name", BUTTONS)
def test_a_first_map_is_drawn_in_slices_with_a_progress_bar(pair, name):
    button = BUTTONS[name]()
    assert button.press() == {"RUNNING_MODAL"}
    progress = []
    while button.event() == {"RUNNING_MODAL"}:
        progress.append(display.current.done)
    assert len(progress) > 4
    assert progress == sorted(progress)
    assert is_clean()
    assert button.reports == []
    if name == "live":
        assert live.is_on
        now = pixels(bpy.data.images["lo_normal"])
        live.stop()
        bpy.ops.imprint.live()
        assert (pixels(bpy.data.images["lo_normal"]) == now).all()
    else:
        assert viewer.mode is Mode.MAP


@pytest.mark.usefixtures("tiny")
@pytest.mark.parametrize("name", BUTTONS)
def test_a_task_can_be_stopped_from_another_window(pair, name):
    """A modal operator gets only the keys of its own window."""
    before, button = snapshot(), BUTTONS[name]()
    assert not bpy.ops.imprint.stop.poll()
    button.press()
    assert button.event() == {"RUNNING_MODAL"}
    assert bpy.ops.imprint.stop() == {"FINISHED"}
    assert is_clean()
    assert difference(before, snapshot()) == {}
    assert button.event() == {"CANCELLED"}
    assert not bpy.ops.imprint.stop.poll()


@pytest.mark.usefixtures("tiny")
@pytest.mark.parametrize("name", BUTTONS)
@pytest.mark.parametrize("step", [1, 3, 6])
def test_esc_changes_nothing(pair, name, step):
    before, button = snapshot(), BUTTONS[name]()
    button.press()
    for _ in range(step):
        assert button.event() == {"RUNNING_MODAL"}
    assert button.event("ESC") == {"CANCELLED"}
    assert is_clean()
    assert not live.is_on
    assert viewer.mode is Mode.OFF
    assert difference(before, snapshot()) == {}


@pytest.fixture
def small():
    """Two small pairs."""
    for name in ("one", "two"):
        zoo.terrain(f"{name}_low", 2), zoo.terrain(f"{name}_high", 2)
    yield
    modal.runner.stop(bpy.context)


OF_UVS = {
    "unwrap": lambda: Button(fix_buttons.IMPRINT_OT_unwrap, names=["one_low", "two_low"]),
    "pack": lambda: Button(pair_operators.IMPRINT_OT_pack_uvs, selected=False, anew=False),
}
"""Buttons for both low objects."""


@pytest.mark.usefixtures("tiny")
@pytest.mark.parametrize("name", OF_UVS)
def test_uv_maps_are_made_in_slices_and_esc_changes_nothing(small, name):
    before, steps, state = snapshot(), 1, set()
    scenes = [*bpy.data.scenes]
    while state != {"FINISHED"}:
        button = OF_UVS[name]()
        assert button.press() == {"RUNNING_MODAL"}
        shares = []
        for _ in range(steps):
            state = button.event()
            if display.current is None:
                break
            shares.append(display.current.done)
        assert shares == sorted(shares)
        if state != {"FINISHED"}:
            assert button.event("ESC") == {"CANCELLED"}
            assert button.reports == [("WARNING", "Stopped. Nothing was changed.")]
            assert difference(before, snapshot()) == {}
        assert is_clean() and [*bpy.data.scenes] == scenes
        steps *= 2
    assert steps > 4
    assert [len(bpy.data.objects[each].data.uv_layers) for each in ("one_low", "two_low")] == [2, 2]
    ((kind, said),) = button.reports
    assert kind == "INFO" and "'one_low'" in said


@pytest.mark.usefixtures("tiny")
@pytest.mark.parametrize("name", OF_UVS)
@pytest.mark.parametrize("end", ["file", "extension", "other window"])
def test_uv_maps_that_are_not_finished_leave_nothing_behind(small, name, end):
    button = OF_UVS[name]()
    button.press()
    button.event(), button.event()
    if end == "file":
        bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    elif end == "extension":
        addon.unregister()
        addon.register()
    else:
        assert bpy.ops.imprint.stop() == {"FINISHED"}
    assert is_clean() and len(bpy.data.scenes) == 1
    assert button.event() == {"CANCELLED"}
    assert not [mesh for mesh in bpy.data.meshes if "temporary" in mesh.name]


@pytest.mark.usefixtures("tiny")
def test_esc_in_a_batch_keeps_the_results_of_what_is_done():
    for name in ("a", "b"):
        zoo.plane(f"{name}_low"), zoo.terrain(f"{name}_high", n=8)
    settings = bpy.context.scene.imprint
    settings.size, settings.method, settings.storage = 16, "CAST", "MEMORY"
    button = Button(pair_operators.IMPRINT_OT_bake_pairs)
    button.press()
    for _ in range(TICKS):
        if display.current.finished == 1:
            break
        assert button.event() == {"RUNNING_MODAL"}
    assert button.event("ESC") == {"CANCELLED"}
    assert button.reports == [("WARNING", "Stopped. Finished before, and kept: 1.")]
    assert [low.name for low, _ in results.of_scene(bpy.context)] == ["a_low"]
    assert is_clean()


@pytest.mark.usefixtures("tiny")
def test_esc_keeps_the_previous_view(pair):
    viewer.switch(bpy.context, Mode.MAP)
    own = viewer.own
    button = Button(view_panel.IMPRINT_OT_view_refresh)
    button.press()
    button.event()
    button.event("ESC")
    assert viewer.mode is Mode.MAP
    assert viewer.own is own


@pytest.mark.usefixtures("tiny")
def test_esc_while_the_last_other_maps_are_drawn_leaves_live_on(pair):
    settings = bpy.context.scene.imprint
    settings.maps, settings.rays = {"AO"}, 16
    assert bpy.ops.imprint.live() == {"FINISHED"}
    before, button = snapshot(), Button(bake_operators.IMPRINT_OT_live)
    button.press()
    assert button.event() == {"RUNNING_MODAL"}
    assert display.current.what != "Starting"
    assert button.event("ESC") == {"CANCELLED"}
    assert live.is_on
    assert difference(before, snapshot()) == {}
    button = Button(bake_operators.IMPRINT_OT_live)
    button.press()
    assert button.run() == {"FINISHED"}
    assert not live.is_on
    assert {"lo_normal", "lo_ao"} <= {*bpy.data.images.keys()}


@pytest.mark.usefixtures("tiny")
def test_changes_while_live_starts_are_in_the_map(pair):
    button = Button(bake_operators.IMPRINT_OT_live)
    button.press()
    for _ in range(4):
        button.event()
    pair[1].location.z = 0.01
    bpy.context.view_layer.update()
    button.run()
    assert live.is_on
    assert not live.is_resting


@pytest.mark.usefixtures("tiny")
@pytest.mark.parametrize("name", [*BUTTONS, "bake"])
def test_disabling_the_extension_ends_running_tasks(pair, name):
    button = BUTTONS[name]() if name in BUTTONS else _running_bake()
    button.press()
    button.event()
    addon.unregister()
    addon.register()
    assert is_clean()
    assert bpy.ops.imprint.bake.poll()
    assert button.event() == {"CANCELLED"}
    assert not live.is_on


@pytest.mark.usefixtures("tiny")
@pytest.mark.parametrize("name", [*BUTTONS, "bake"])
def test_opening_another_file_ends_running_tasks(pair, name):
    button = BUTTONS[name]() if name in BUTTONS else _running_bake()
    button.press()
    button.event()
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    assert is_clean()
    assert button.event() == {"CANCELLED"}


def _running_bake():
    steps = (progress.Progress("Baking", number / 10) for number in range(10))
    button = Button(bake_operators.IMPRINT_OT_live)
    button.task = lambda *_: steps
    return button


@pytest.mark.parametrize(
    ("error", "message"),
    [
        (BakeError("It cannot be."), "It cannot be."),
        (MemoryError(), "There is not enough memory: choose a smaller map"),
    ],
)
def test_an_error_is_reported_and_frees_the_window(pair, error, message):
    button = Button(bake_operators.IMPRINT_OT_live)

    def fails(*_):
        yield progress.Progress("Reading", 0.0)
        raise error

    button.task = fails
    button.press()
    assert button.run() == {"CANCELLED"}
    assert is_clean()
    assert button.execute(button.context) == {"CANCELLED"}
    assert [(kind, text[: len(message)]) for kind, text in button.reports] == [("ERROR", message)] * 2


def test_adjust_last_operation_shows_the_summary_and_no_settings(pair):
    assert bpy.ops.imprint.bake() == {"FINISHED"}
    texts = []

    def label(*, text, translate):
        texts.append(text)

    layout = SimpleNamespace(column=lambda *, align: SimpleNamespace(label=label))
    bake_operators.IMPRINT_OT_bake.draw(SimpleNamespace(layout=layout), bpy.context)
    assert "64 x 64" in " ".join(texts)
    assert bpy.ops.imprint.bake.get_rna_type().name == "Bake Maps"  # the box's title, whichever maps were baked
    assert max(map(len, texts)) <= modal.LAST_OPERATION
    assert "REGISTER" not in bake_operators.IMPRINT_OT_live.bl_options


def test_cached_memory_is_freed_when_idle(pair, monkeypatch):
    bpy.ops.imprint.bake()
    gpu_memory.free_if_idle()
    assert len(tree_cache.trees)
    assert len(target.common)
    monkeypatch.setattr(gpu_memory, "IDLE_SECONDS", 0.0)
    monkeypatch.setattr(display, "current", progress.Progress("Baking", 0.5))
    free_if_idle()
    assert len(tree_cache.trees)
    monkeypatch.setattr(display, "current", None)
    assert free_if_idle() == EVERY
    assert not len(tree_cache.trees)
    assert not len(target.common)


@pytest.mark.usefixtures("tiny")
def test_the_picture_stays_until_the_next_one(pair):
    """Rays for other maps take many steps between two pictures."""
    settings = bpy.context.scene.imprint
    settings.maps, settings.rays, settings.show_result = {"AO"}, 64, False
    button = Button(bake_operators.IMPRINT_OT_bake)
    assert button.press() == {"RUNNING_MODAL"}
    assert display.picture is None
    without, is_any = 0, False
    while button.event() == {"RUNNING_MODAL"}:
        is_any |= display.current.picture is not None
        without += is_any and display.current.picture is None
        assert (display.picture is not None) == is_any
    assert without > 0
    assert display.picture is None
