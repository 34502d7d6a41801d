# SPDX-License-Identifier: GPL-3.0-or-later
"""Makes levels of detail in a real Blender window, with Esc, Undo and Redo, among other objects. Not collected by pytest.

    blender --factory-startup --python tests/window/level_button.py

Needs X11 (or Xvfb) and xdotool. It prints what each part found. Blender exits with 1 if one is wrong.
"""

import sys
import time
from pathlib import Path

import bpy

sys.path[:0] = [str(Path(__file__).resolve().parents[2]), str(Path(__file__).resolve().parent)]

import addon  # noqa: E402
from addon.ui import modal  # noqa: E402
from tests.support import window, zoo  # noqa: E402

PATIENCE = 120.0
OBJECTS = {"Hill", "Valley", "Plain"}
LEVELS = {"Hill_LOD1", "Hill_LOD2"}


def press():
    """Press Make Levels of Detail in the panel."""
    with window.at_view():
        bpy.ops.imprint.make_levels("INVOKE_DEFAULT")


def step(press_button=press):
    """Run all parts. Yields the seconds to wait. press_button: starts the operator."""
    addon.register()
    prepare()
    yield 1.0
    _, area, _ = window.view()
    next(region for region in area.regions if region.type == "UI").active_panel_category = "Imprint"
    yield 1.0
    wrong = []
    for name, part in (("Esc", escape), ("levels", whole), ("Undo", undone), ("Redo", redone)):
        found = yield from part(press_button)
        print(f"{name:6} {found or 'as promised'}", flush=True)
        wrong += found
    addon.unregister()
    if wrong:
        raise SystemExit(1)


def prepare():
    """Three objects; Hill is the active one, and Valley is selected as well."""
    with window.at_view():
        bpy.ops.object.select_all(action="SELECT")
        bpy.ops.object.delete()
    for number, name in enumerate(sorted(OBJECTS)):
        obj = zoo.terrain(name, 24)
        obj.location.x = 3.0 * number
        obj.select_set(name != "Plain")
    bpy.context.view_layer.objects.active = bpy.data.objects["Hill"]
    settings = bpy.context.scene.imprint
    settings.width = settings.height = 128
    settings.storage = "MEMORY"
    settings.level_degrees, settings.level_distance = "", "1, 4"
    window.view()[1].spaces.active.show_region_ui = True
    with window.at_view():
        bpy.ops.ed.undo_push(message="prepared")


def escape(press_button):
    """Stop the search by Esc. Nothing may remain."""
    before = contents()
    press_button()
    yield from until(lambda: modal.runner.run is not None)
    yield 1.0
    window.mouse("key", "Escape")
    yield from until(lambda: modal.runner.run is None)
    return [] if contents() == before else [f"{contents()} remain of {before}"]


def whole(press_button):
    """Make the levels. The other objects stay as they are."""
    press_button()
    yield from until(lambda: modal.runner.run is not None)
    yield from until(lambda: modal.runner.run is None)
    yield 0.5
    print(f"       {bpy.context.window_manager.imprint_summary}", flush=True)
    found = [] if {*bpy.data.objects.keys()} == OBJECTS | LEVELS else [f"the objects are {bpy.data.objects.keys()}"]
    if {*bpy.data.collections["Hill_LODs"].objects.keys()} != LEVELS:
        found.append("the collection has other objects")
    return found


def undone(_):
    """One step back: the levels are gone, with their collection."""
    with window.at_view():
        bpy.ops.ed.undo()
    yield 0.5
    names = {*bpy.context.scene.objects.keys()}
    return (
        [] if names == OBJECTS and not bpy.context.scene.collection.children.get("Hill_LODs") else [f"{names} remain"]
    )


def redone(_):
    """One step forward: the levels are there, with their maps."""
    with window.at_view():
        bpy.ops.ed.redo()
    yield 0.5
    names = {*bpy.context.scene.objects.keys()}
    if names != OBJECTS | LEVELS:
        return [f"the objects are {names}"]
    images = {
        node.image.name if node.image else None
        for name in LEVELS
        for node in bpy.data.objects[name].data.materials[0].node_tree.nodes
        if node.type == "TEX_IMAGE"
    }
    return [] if len(images) == 2 and None not in images else [f"the images are {images}"]


def contents():
    """The names of what levels are made of."""
    kinds = (
        bpy.data.objects,
        bpy.data.meshes,
        bpy.data.collections,
        bpy.data.materials,
        bpy.data.images,
        bpy.data.scenes,
    )
    return [sorted(kind.keys()) for kind in kinds]


def until(is_done):
    """Wait for something, at most PATIENCE seconds."""
    end = time.monotonic() + PATIENCE
    while not is_done() and time.monotonic() < end:
        yield 0.05


if __name__ == "__main__":
    window.start(step())
