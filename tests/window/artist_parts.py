# SPDX-License-Identifier: GPL-3.0-or-later
"""The parts that tests/window/artist.py plays, each in a Blender of its own with the installed zip. The file of a part is
FOLDER/PART/scene.blend, which an earlier part has saved there.
"""

import json
import math
import os
import sys
import traceback
from collections.abc import Iterator
from pathlib import Path

import bpy

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))
MODULE = "bl_ext.user_default.imprint"
for loaded in [name for name in sys.modules if name.startswith(f"{MODULE}.addon")]:
    sys.modules[loaded.removeprefix(f"{MODULE}.")] = sys.modules[loaded]  # what is imported below is what is installed

import addon  # noqa: E402
from addon.core.declarations import targets  # noqa: E402
from addon.ui import declared_properties, modal, object_pairs  # noqa: E402
from addon.ui.bake_results import results  # noqa: E402
from addon.ui.live import live  # noqa: E402
from addon.ui.progress_display import display  # noqa: E402
from tests.support import saved_scenes, window  # noqa: E402
from tests.support.window import click_row, find, keys, press  # noqa: E402
from tests.window import live_strokes  # noqa: E402

PART, FOLDER = sys.argv[sys.argv.index("--") + 1], Path(sys.argv[sys.argv.index("--") + 2])
PATIENCE = 60.0
"""Seconds to wait for a bake."""
Steps = Iterator[float]
wrong: list[str] = []
"""What is not as promised."""


# The parts


def part_first_day() -> Steps:
    """Two objects selected in the Outliner, three maps, Ctrl S, Ctrl Q."""
    small(maps={"AO", "BASE_COLOR"}, show_result=True, crate=True)
    keep_for("second_day")
    yield from select_pair()
    yield from bake()
    check("three images", mine() == ["crate_low_ao", "crate_low_base_color", "crate_low_normal"])
    check("the high object is hidden", not bpy.data.objects["crate_high"].visible_get())
    yield from saved_by_key()


def part_second_day() -> Steps:
    """The file is as it was, and is baked at once; the eye of the result works."""
    same_as_saved()
    first = contents()
    yield from click_row("crate_low")
    yield from bake()
    check("baked at once", contents() == first)
    yield from keys("a")
    check("only the low object can be selected", [obj.name for obj in bpy.context.selected_objects] == ["crate_low"])
    yield from bake()
    check("baked with all selected", contents() == first)
    for is_shown in (True, False):
        yield from press("imprint.show_high")
        check("the eye of the result", bpy.data.objects["crate_high"].visible_get() == is_shown)
    keep_for("elsewhere")
    yield from saved_by_key()


def part_elsewhere() -> Steps:
    """The file was saved in another folder. Its low object is renamed and copied, and appended and linked to other files."""
    same_as_saved()
    yield from click_row("crate_low")
    first = contents()["crate_low_normal"]
    for key, name in (("shift+d", "crate_low.001"), ("alt+d", "crate_low.002")):
        yield from keys(key, "Escape")
        check(f"{key} makes {name}", bpy.context.object.name == name)
        yield from bake()
        check(f"{name} has the pair", contents()[f"{name}_normal"] == first)
    low, high = bpy.data.objects["crate_low"], bpy.data.objects["crate_high"]
    low.name, high.name = "box", "sculpt"
    yield from click_row("box")
    yield from bake()
    check("renamed objects are a pair", contents()["box_normal"] == first)
    keep_for("library")
    library = bpy.data.filepath
    for way in ("append", "link"):
        start_file()
        small()
        with window.at_view():
            getattr(bpy.ops.wm, way)(directory=f"{library}/Object/", filename="box")
        yield 0.5
        came = "box_normal" if way == "append" else "box_normal of the library"
        check(f"{way}: the image came along", contents()[came] == first)
        yield from click_row("box")
        picture(way)
        if way == "link":
            yield from press("imprint.show_hidden")  # Blender puts the low object into the scene alone
            window.select_only(bpy.data.objects["box"])
            with window.at_view():
                bpy.ops.object.make_override_library("INVOKE_DEFAULT")
            yield 0.5
            check("override", bpy.context.object.override_library is not None)
            bpy.context.scene.imprint.material = False  # it is that of the library
        yield from bake()
        check(f"{way}: baked", contents()["box_normal"] == contents()[came] == first)
        keep_for(way)


def part_append() -> Steps:
    """The low object that was appended, on another day."""
    same_as_saved()
    yield from click_row("box")
    yield from bake()


def part_link() -> Steps:
    """The override of a low object, on another day."""
    same_as_saved()
    yield from bake()


def part_deleted() -> Steps:
    """A high object is deleted by X after Fill from Selection: the file does not keep its mesh."""
    small(crate=True)
    yield from select_pair()
    yield from press("imprint.use_selection")
    yield from bake()
    yield from click_row("crate_high")
    yield from keys("Delete")
    picture("deleted")
    keep_for("without_high")


def part_without_high() -> Steps:
    """The deleted high object is named, and removed by its button."""
    check("no object", "crate_high" not in bpy.data.objects)
    check("no mesh", "crate_high" not in bpy.data.meshes)
    yield from click_row("crate_low")
    picture("missing")
    yield from press("imprint.remove_missing")
    check("no slot", not any(slot.title for slot in bpy.context.scene.imprint.highs))
    picture("removed")


def part_engine() -> Steps:
    """The wheel over the setting Engine, a step, Undo: the engine stays, and goes with the next Undo."""
    small(crate=True)
    yield from click_row("crate_low")
    yield from find("imprint.engine")
    window.mouse("keydown", "ctrl")
    for _ in targets.CHOICES:  # Ctrl and the wheel go from one value to the next
        if bpy.context.scene.imprint.green == "-Y":
            break
        window.mouse("click", 5)
        yield 0.3
    window.mouse("keyup", "ctrl")
    settings = bpy.context.scene.imprint
    picture("engine")
    check("the engine is set", (settings.green, settings.engine) == ("-Y", "Unreal Engine"))
    check("with its names and files", (settings.image, settings.storage) == ("T_{name}_N", "FILE"))
    yield from keys("g", "x", "1", "Return")
    check("moved", bpy.data.objects["crate_low"].location.x == 1.0)
    yield from keys("ctrl+z")
    check("moved back", bpy.data.objects["crate_low"].location.x == 0.0)
    check("the engine stays", bpy.context.scene.imprint.engine == "Unreal Engine")
    for _ in range(len(targets.CHOICES)):
        if bpy.context.scene.imprint.green == "+Y":
            break
        yield from keys("ctrl+z")
    check("the engine is undone", (bpy.context.scene.imprint.green, bpy.context.scene.imprint.image) == ("+Y", ""))


def part_results() -> Steps:
    """A batch of three with a wrong one: the list says which; clicks select it and open its map beside the viewport."""
    addon.modules()
    addon.unregister()
    window.open_alone("IMPRINT_PT_bake", "IMPRINT_PT_pairs", "IMPRINT_PT_results")
    addon.register()
    small(method="CAST")
    for number, name in enumerate("abc"):
        grid(f"{name}_low", 6, x=4.0 * number)
        grid(f"{name}_high", 40, x=4.0 * number + 1.5 * (name == "b"), height=0.2)
    window.select_only()
    yield from press("imprint.bake_pairs")
    yield from finished()
    picture("listed")
    ordered = [low.name for low, _ in results.of_scene(bpy.context)]
    check("three results", ordered == ["a_low", "b_low", "c_low"])
    wrong_ones = [low.name for low, found in results.of_scene(bpy.context) if any(one.warnings for one in found)]
    check("the moved one is wrong", wrong_ones == ["b_low"])
    yield from press("imprint.select_result")  # the first row
    check("a click selects the wrong one", bpy.context.object.name == "b_low")
    whole, viewport, _ = window.view()
    before = {area.as_pointer(): (area.type, area.width) for area in whole.screen.areas}
    with window.at_view():
        bpy.ops.imprint.show_map("INVOKE_DEFAULT", image="b_low_normal")
    yield 1.0
    picture("beside")
    made = [area for area in whole.screen.areas if area.as_pointer() not in before]
    check("a map opens beside the viewport", [area.type for area in made] == ["IMAGE_EDITOR"])
    check("not over it", len(bpy.context.window_manager.windows) == 1 and viewport.width > made[0].width > 300)


def part_seven() -> Steps:
    """A batch of seven with three wrong ones, in panels as they are at first: Results names them and says why."""
    small(method="CAST")
    for number, name in enumerate("abcdefg"):
        grid(f"{name}_low", 6, x=4.0 * number)
        if name != "e":
            grid(f"{name}_high", 40, x=4.0 * number, height=0.2)
    bpy.data.objects["c_low"].data.flip_normals()
    layers = bpy.data.meshes["f_low"].uv_layers
    layers.remove(layers[0])
    window.select_only()
    with window.at_view():
        bpy.ops.imprint.bake_pairs("INVOKE_DEFAULT")
    yield from finished()
    yield from window.open_tab()
    yield 1.0
    picture("seven")
    wrong_ones = [low.name for low, found in results.of_scene(bpy.context) if any(one.warnings for one in found)]
    check("the one that is inside out", wrong_ones == ["c_low"])
    left_out = results.batch().left_out
    check("the one without UVs", ("f_low", "'f_low' has no UV layer: unwrap it first.") in left_out)
    check("the one without a high object", any("'e_low' has no high object" in reason for _, reason in left_out))
    check("the others are right", len(results.of_scene(bpy.context)) == 5)


def part_quick_start() -> Steps:
    """The five steps of the README and the first pages of the quick start, by clicks, on the mesh of $PAIR or on two grids."""
    pair = os.environ.get("PAIR")
    if pair:
        with bpy.data.libraries.load(pair) as (_, into):
            into.objects = ["lo", "hi"]
        for obj, name in zip(into.objects, ("crate_low", "crate_high"), strict=True):
            bpy.context.scene.collection.objects.link(obj)
            obj.name = obj.data.name = name
    else:
        small(crate=True, show_result=True, width=2048, height=2048)
    with window.at_view():
        bpy.ops.view3d.view_all()
    low, high = bpy.data.objects["crate_low"], bpy.data.objects["crate_high"]
    yield from click_row("crate_high")
    yield from click_row("crate_low", "shift")
    check("Shift leaves the high object active", bpy.context.object == high)
    yield from select_pair()
    picture("1 select")
    yield from keys("n")
    yield from click_tab()
    picture("2 panel")
    yield from first_bake(low, high)
    yield from compare(high)
    check("the map is packed", bpy.data.images["crate_low_normal"].packed_file is not None)
    first = contents()["crate_low_normal"]
    yield from bake()
    check("bake again: the same image", contents()["crate_low_normal"] == first and len(mine()) == 1)
    keep_for("quick_start_again")
    yield from saved_by_key()


def part_quick_start_again() -> Steps:
    """The second day: the map is there, a click shows it on the model, and it is baked again."""
    same_as_saved()
    first = contents()["crate_low_normal"]
    yield from click_row("crate_low")
    yield from press("imprint.view_map")
    yield 2.0
    picture("map")
    check("the stored map is shown", bpy.context.scene.imprint_view.mode == "MAP")
    bpy.context.scene.imprint_view.mode = "OFF"
    yield from bake()
    check("baked again", contents()["crate_low_normal"] == first)
    settings = bpy.context.scene.imprint
    settings.width, settings.height = 256, 256
    yield from press(f"imprint.{declared_properties.map_switch('AO')}")
    check("Ambient Occlusion is on", settings.maps == {"AO"})
    yield from bake()
    check("a second map from one press", mine() == ["crate_low_ao", "crate_low_normal"])
    picture("two maps")
    yield from keys("ctrl+z")
    check("Undo takes the bake back", mine() == ["crate_low_normal"] and contents()["crate_low_normal"] == first)


def part_undone() -> Steps:
    """A bake, a change of the high object, another bake; Undo and Redo of each."""
    small(maps={"AO"}, storage="MEMORY", crate=True)
    yield from select_pair()
    yield from bake()
    first = contents()
    yield from click_row("crate_high")
    yield from keys("s", "z", "3", "Return")
    yield from click_row("crate_low")
    yield from bake()
    second = contents()
    check("the second bake is another one", first.keys() == second.keys() and first != second)
    for key, wanted, scale in (("ctrl+z", first, 3.0), ("ctrl+shift+z", second, 3.0), ("ctrl+z", first, 3.0)):
        yield from keys(key)
        check(key, contents() == wanted and bpy.data.objects["crate_high"].scale.z == scale)
    yield from keys("ctrl+z", "ctrl+z")
    check("the change is undone", contents() == first and bpy.data.objects["crate_high"].scale.z == 1.0)
    yield from keys("ctrl+z", "ctrl+z")
    check("the first bake is undone", not contents() and not _baked())
    yield from keys(*["ctrl+shift+z"] * 5)
    check("all is done again", contents() == second and [*_baked()] == ["crate_low"])


def part_bevel() -> Steps:
    """Bevel and Weighted Normal on the low object, after a high object was baked."""
    small(crate=True)
    yield from select_pair()
    yield from bake()
    first = contents()["crate_low_normal"]
    low = bpy.data.objects["crate_low"]
    low.modifiers.new("Bevel", "BEVEL")
    low.modifiers.new("Weighted Normal", "WEIGHTED_NORMAL")
    yield from click_row("crate_low")
    picture("modifiers")
    yield from bake()
    check("the high object is baked", results.of(bpy.context).high == ["crate_high"])
    low.modifiers.clear()
    yield from bake()
    check("as without them", contents()["crate_low_normal"] == first)


def part_names() -> Steps:
    """Pairs by name, with numbers at the end."""
    addon.unregister()
    window.open_alone("IMPRINT_PT_bake", "IMPRINT_PT_pairs")
    addon.register()
    small()
    for number, name in enumerate(("pipe_low", "pipe_high", "pipe_low.001", "pipe_high.001")):
        grid(name, 40 if "high" in name else 6, x=4.0 * (number // 2), height=0.1 + 0.05 * number)
    window.select_only()
    yield from press("imprint.bake_pairs")
    yield from finished()
    for name in ("pipe_low", "pipe_low.001"):
        pair = object_pairs.of(bpy.data.objects[name])
        check(name, [high.name for high in pair.found()] == [name.replace("low", "high")])
    picture("names")
    check("two images", mine() == ["pipe_low.001_normal", "pipe_low_normal"])


def part_live() -> Steps:
    """Live, a stroke, Live off, Ctrl S."""
    small(crate=True)
    keep_for("after_live")
    yield from select_pair()
    yield from press("imprint.live")
    yield from until(lambda: "crate_low_normal" in mine() and live.is_resting)
    first = contents()["crate_low_normal"]
    bpy.data.objects["crate_low"].hide_set(True)
    window.select_only(bpy.data.objects["crate_high"])
    with window.at_view():
        bpy.ops.object.mode_set(mode="SCULPT")
        bpy.ops.view3d.view_axis(type="TOP")
        bpy.ops.view3d.view_selected()
    yield 1.5
    yield from live_strokes.stroke(8)
    yield from until(lambda: live.is_resting)
    picture("live")
    stroke = contents()["crate_low_normal"]
    check("the map follows the stroke", stroke != first)
    yield from press("imprint.live")
    yield from until(lambda: not live.is_on)
    check("the map stays", contents()["crate_low_normal"] == stroke)
    yield from saved_by_key()


def part_after_live() -> Steps:
    """The map of Live, on another day; a bake draws the same."""
    same_as_saved()
    first = contents()["crate_low_normal"]
    with window.at_view():
        bpy.ops.object.mode_set(mode="OBJECT")
    bpy.data.objects["crate_low"].hide_set(False)
    yield from click_row("crate_low")
    yield from bake()
    check("a bake draws the map of Live", contents()["crate_low_normal"] == first)


# What they are made of


def start_file() -> None:
    """An empty scene, beside a tall Outliner."""
    bpy.ops.wm.read_homefile(use_factory_startup=True)
    bpy.context.preferences.view.show_splash = False
    bpy.context.scene.eevee.taa_samples = 1  # or software drivers draw the viewport again and again
    bpy.data.batch_remove([*bpy.data.objects, *bpy.data.meshes])
    for area in bpy.context.window_manager.windows[0].screen.areas:
        if area.type == "PROPERTIES":
            area.type = "OUTLINER"


def small(crate: bool = False, **values) -> None:
    """Settings of a small bake. crate: with a high and a low object."""
    settings = bpy.context.scene.imprint
    settings.width, settings.height, settings.rays, settings.show_result = 256, 256, 32, False
    for name, value in values.items():
        setattr(settings, name, value)
    if crate:
        grid("crate_high", 60, height=0.1).data.materials.append(red())
        grid("crate_low", 6)


def grid(name: str, cuts: int, *, x: float = 0.0, height: float = 0.0) -> bpy.types.Object:
    with window.at_view():
        bpy.ops.mesh.primitive_grid_add(x_subdivisions=cuts, y_subdivisions=cuts, size=3.0, location=(x, 0.0, 0.0))
        obj = bpy.context.object
    obj.name = obj.data.name = name
    for vertex in obj.data.vertices:
        vertex.co.z = height * math.sin(4.0 * vertex.co.x) * math.cos(4.0 * vertex.co.y)
    return obj


def red() -> bpy.types.Material:
    material = bpy.data.materials.new("red")
    material.node_tree.nodes["Principled BSDF"].inputs["Base Color"].default_value = (0.8, 0.1, 0.1, 1.0)
    return material


def select_pair() -> Steps:
    """Select the high and the low object in the Outliner, as the manual says."""
    yield from click_row("crate_high")
    yield from click_row("crate_low", "ctrl")
    selected = sorted(obj.name for obj in bpy.context.selected_objects)
    check("both are selected", selected == ["crate_high", "crate_low"] and bpy.context.object.name == "crate_low")


def first_bake(low: bpy.types.Object, high: bpy.types.Object) -> Steps:
    """A bake that Esc stops, and one to its end, with what the quick start says about its result."""
    slots = len(low.material_slots)
    yield from press("imprint.bake")
    yield from until(lambda: display.current is None or display.current.done > 0.3)
    check("a bake goes on", modal.runner.run is not None)
    picture("3 bake")
    yield from keys("Escape")
    yield from finished()
    check("Esc changes nothing", not mine() and high.visible_get() and len(low.material_slots) == slots)
    yield from bake()
    yield 4.0
    picture("4 result")
    trees = [slot.material.node_tree.nodes for slot in low.material_slots]
    images = [node for nodes in trees for node in nodes if node.type == "TEX_IMAGE"]
    check("Image Texture, Non-Color", [node.image.colorspace_settings.name for node in images] == ["Non-Color"])
    check("Normal Map node", any(node.type == "NORMAL_MAP" for nodes in trees for node in nodes))
    _, area, _ = window.view()
    check("Material Preview", area.spaces.active.shading.type == "MATERIAL")
    check("the high object is hidden", not high.visible_get())


def compare(high: bpy.types.Object) -> Steps:
    """Show, the eye, Split with its line, and the key that shows one after the other."""
    yield from press("imprint.show_hidden")
    check("Show shows it", high.visible_get())
    yield from press("imprint.show_high")
    check("the eye in Results hides it", not high.visible_get())
    yield from press("imprint_view.mode")
    yield 1.0
    picture("5 menu")
    window.mouse("key", "s")  # the underlined letter
    yield 3.0
    check("View: Split", bpy.context.scene.imprint_view.mode == "SPLIT")
    picture("5 split")
    yield from drag_line()
    yield from keys("ctrl+alt+h")
    yield 1.0
    check("Ctrl Alt H: one after the other", bpy.context.scene.imprint_view.mode == "HIGH")
    picture("6 flicker")
    yield from keys("ctrl+alt+h")
    bpy.context.scene.imprint_view.mode = "OFF"


def click_tab() -> Steps:
    """Click the tab Imprint of the sidebar, which is found by clicks on one tab after the other."""
    whole, area, _ = window.view()
    sidebar = next(region for region in area.regions if region.type == "UI")
    top = whole.height - sidebar.y - sidebar.height
    for y in range(top + 30, top + sidebar.height, 30):
        window.mouse("mousemove", sidebar.x + sidebar.width - 12, y, "click", 1)
        yield 0.4
        if sidebar.active_panel_category == "Imprint":
            break
    check("N, and a click on the tab Imprint", sidebar.active_panel_category == "Imprint")


def drag_line() -> Steps:
    """Drag the line of Split to the left."""
    whole, _, region = window.view()
    before = bpy.context.scene.imprint_view.split
    at = region.x + round(before * region.width), whole.height - region.y - region.height // 2
    window.mouse("mousemove", *at)
    yield 0.5
    window.mouse("mousedown", 1)
    for step in range(1, 6):
        yield 0.3
        window.mouse("mousemove", at[0] - 40 * step, at[1])
    yield 0.3
    window.mouse("mouseup", 1)
    yield 1.0
    moved = before - bpy.context.scene.imprint_view.split
    check("the line follows the mouse", abs(moved * region.width - 200.0) < 20.0)


def bake() -> Steps:
    """Press Bake and wait for the end of the bake."""
    before = _baked()
    yield from press("imprint.bake")
    yield from finished()
    check("a bake has ended", _baked() != before)


def _baked() -> dict[str, str]:
    return {whole_name(obj): pair.baked for obj in bpy.data.objects if (pair := object_pairs.of(obj)) is not None}


def whole_name(block: bpy.types.ID) -> str:
    """The name, with that of its library."""
    return block.name if block.library is None else f"{block.name} of the library"


def finished() -> Steps:
    yield 0.3
    yield from until(lambda: modal.runner.run is None)
    yield 0.5


def until(is_there) -> Steps:
    for _ in range(int(PATIENCE / 0.1)):
        if is_there():
            return
        yield 0.1
    raise TimeoutError


def mine() -> list[str]:
    """The images of bakes."""
    return sorted(contents())


def contents() -> dict[str, dict]:
    """A hash of the pixels of each baked image."""
    return {whole_name(image): saved_scenes.content(image) for image in bpy.data.images if image.source != "VIEWER"}


def keep_for(part: str) -> None:
    """Save the file as that of another part."""
    path = FOLDER / part / "scene.blend"
    path.parent.mkdir(exist_ok=True)
    bpy.ops.wm.save_as_mainfile(filepath=str(path))
    _write_state(path)


def saved_by_key() -> Steps:
    """Save by Ctrl S."""
    yield from keys("ctrl+s")
    yield from until(lambda: not bpy.data.is_dirty)
    _write_state(Path(bpy.data.filepath))


def _write_state(path: Path) -> None:
    path.with_suffix(".json").write_text(json.dumps(_state()))


def _state() -> dict:
    """What saved_scenes.state has, without Blender's own materials."""
    state = saved_scenes.state()
    kept = {material.name for material in bpy.data.materials if material.users}
    state["materials"] = {name: tree for name, tree in state["materials"].items() if name in kept}
    state["images"] = {name: image for name, image in state["images"].items() if image["size"] != [0, 0]}
    return json.loads(json.dumps(state))


def same_as_saved() -> None:
    """The file is as it was when it was saved in another process."""
    wanted = json.loads(Path(bpy.data.filepath).with_suffix(".json").read_text())
    for name, found in _state().items():
        check(f"{name} as saved", found == wanted[name])
        if found != wanted[name]:
            print(f"    {found}\n    {wanted[name]}", flush=True)


def check(what: str, is_right: bool) -> None:
    print(f"  {what:45} {'as promised' if is_right else 'WRONG'}", flush=True)
    if not is_right:
        wrong.append(what)
        picture(f"wrong {what}")


def picture(name: str) -> None:
    """A picture of the window, in the folder."""
    window.screenshot(FOLDER / f"{PART} {name}.png")


def play() -> Steps:
    """Play the part, and quit Blender."""
    if not bpy.data.filepath:
        start_file()
    yield 1.0
    is_played = False
    try:
        yield from globals()[f"part_{PART}"]()
        is_played = True
    finally:
        picture("end")
        if not is_played:
            traceback.print_exc()
            raise SystemExit(1)
    if wrong:
        raise SystemExit(1)
    (FOLDER / f"{PART}.done").touch()
    if not bpy.data.is_dirty:
        yield from keys("ctrl+q")


window.start(play())
