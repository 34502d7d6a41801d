# SPDX-License-Identifier: GPL-3.0-or-later
"""Results of bakes in the window: each belongs to its low object, and the file keeps it."""

from types import SimpleNamespace

import bpy
import pytest

from addon.scene.object_checks import ObjectRef
from addon.ui import bake_panel, bake_results
from addon.ui.bake_results import results
from tests.support import zoo
from tests.support.panel import area, image_editor, use, window
from tests.support.panel_layout import Layout

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
    bake_panel.draw_result(layout, [report])
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
