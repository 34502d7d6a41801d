# SPDX-License-Identifier: GPL-3.0-or-later
"""The parts that tests/window/artist.py plays, each in a Blender of its own with the installed zip. The file of a part is
FOLDER/PART/scene.blend, which an earlier part has saved there.
"""

import json
import math
import os
import sys
import time
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
from addon.output import containers  # noqa: E402
from addon.ui import bake_queue, declared_properties, modal, object_pairs, sets, signs  # noqa: E402
from addon.ui.bake_results import results  # noqa: E402
from addon.ui.live import live  # noqa: E402
from addon.ui.progress_display import display  # noqa: E402
from addon.ui.views import viewer  # noqa: E402
from tests.support import saved_scenes, window  # noqa: E402
from tests.support.daily_tasks import PRESSES  # noqa: E402
from tests.support.window import click_row, find, keys, mouse, press  # noqa: E402
from tests.window import live_strokes  # noqa: E402

PART, FOLDER = sys.argv[sys.argv.index("--") + 1], Path(sys.argv[sys.argv.index("--") + 2])
PATIENCE = float(sys.argv[sys.argv.index("--") + 3]) / 5.0
"""Seconds to wait for a bake."""
SETS = 40
"""In the queue."""
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
    open_again("bake", "results")
    small(method="CAST")
    for number, name in enumerate("abc"):
        grid(f"{name}_low", 6, x=4.0 * number)
        grid(f"{name}_high", 40, x=4.0 * number + 1.5 * (name == "b"), height=0.2)
    window.select_only()
    yield from by_names()
    yield from press("imprint.bake_sets")
    yield from finished()
    picture("listed")
    ordered = [low.name for low, _ in results.of_scene(bpy.context)]
    check("three results", ordered == ["a_low", "b_low", "c_low"])
    wrong_ones = [low.name for low, found in results.of_scene(bpy.context) if any(one.warnings for one in found)]
    check("the moved one is wrong", wrong_ones == ["b_low"])
    bpy.context.scene.imprint.bakes = "SELECTION"  # the list of parts has such a button, too
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
    seven()
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


def part_files_undone() -> Steps:
    """Bakes of several maps to files, Ctrl Z and Ctrl Shift Z: files and images are those of the step."""
    small(maps={"AO"}, storage="FILE", output=str(FOLDER / PART / "maps" / "{low}.png"), crate=True)
    folder = FOLDER / PART / "maps"
    yield from select_pair()
    yield from bake()
    first = _files(folder), contents()
    check("two files", [*first[0]] == ["crate_low.png", "crate_low_ao.png"])
    yield from click_row("crate_high")
    yield from keys("s", "z", "3", "Return")
    yield from click_row("crate_low")
    yield from bake()
    second = _files(folder), contents()
    check("the second bake is another one", first[0].keys() == second[0].keys() and first[0] != second[0])
    for key, wanted in (("ctrl+z", first), ("ctrl+shift+z", second), ("ctrl+z", first)):
        yield from keys(key)
        check(f"files after {key}", (_files(folder), contents()) == wanted)
    yield from keys(*["ctrl+z"] * 4)
    check("the first bake is undone", not folder.exists() and not contents())
    yield from keys(*["ctrl+shift+z"] * 5)
    check("all is done again", (_files(folder), contents()) == second)
    (folder / "crate_low.png").write_bytes(b"of another program")
    yield from keys("ctrl+z")
    yield 0.5
    check("what changed since stays", (folder / "crate_low.png").read_bytes() == b"of another program")
    check("the rest is undone", _files(folder)["crate_low_ao.png"] == first[0]["crate_low_ao.png"])
    picture("told")


def _files(folder: Path) -> dict[str, bytes]:
    """The bytes of the files in a folder, which may be missing, by their names."""
    paths = sorted(folder.iterdir()) if folder.is_dir() else []
    return {path.name: path.read_bytes() for path in paths}


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
    """A set of pairs by name, with numbers at the end."""
    small()
    for number, name in enumerate(("pipe_low", "pipe_high", "pipe_low.001", "pipe_high.001")):
        grid(name, 40 if "high" in name else 6, x=4.0 * (number // 2), height=0.1 + 0.05 * number)
    window.select_only()
    yield from by_names()
    yield from press("imprint.bake_sets")
    yield from finished()
    for name in ("pipe_low", "pipe_low.001"):
        pair = object_pairs.of(bpy.data.objects[name])
        check(name, [high.name for high in pair.found()] == [name.replace("low", "high")])
    picture("names")
    check("two images", mine() == ["pipe_low.001_normal", "pipe_low_normal"])


def part_crate() -> Steps:
    """A crate of six parts, without the manual: a set of all, one image, packed, for Unreal Engine: its files are there."""
    small(width=512, height=512, show_result=True)
    for number in range(6):
        grid(f"crate_{number}_low", 4, x=4.0 * number)
        grid(f"crate_{number}_high", 30, x=4.0 * number, height=0.2)
    keep_for("crate")
    yield from all_selected()
    picture("1 selected")
    yield from counted()
    yield from press("imprint.set_add")
    yield from textures("ONE")
    yield from press("imprint.pack_uvs")
    yield from press("imprint_sets[0].own.engine")
    yield from underlined("u")
    picture("2 ready")
    yield from press("imprint.bake_sets")
    at = window.wheel.places["imprint.bake_sets"]
    yield from finished()
    print(f"  presses: {len(window.presses)}, notches of the wheel: {window.wheel.notches}", flush=True)
    yield from until(is_looked_at)
    picture("3 baked")
    yield from press("imprint.bake_sets")
    yield from finished()
    yield from until(is_looked_at)
    one = bpy.context.scene.imprint_sets[0]
    check("six parts", [low.name for low in sets.lows(bpy.context, one)] == [f"crate_{n}_low" for n in range(6)])
    check("one atlas", files() == ["T_crate_N.png", "T_crate_ORM.png"])
    check("the button stays", abs(window.wheel.places["imprint.bake_sets"] - at) < window.STEP)
    found = [results.of(bpy.context, low) for low in sets.lows(bpy.context, one)]
    check("without overlaps", all(report.checks["overlap"]["share"] == 0.0 for report in found))
    check("all true", signs.of_set(bpy.context, one).status == "TRUE")


MATERIALS = ("wood", "iron", "cloth")


def part_prop() -> Steps:
    """A prop of 14 parts and three materials for Unreal Engine, with seven maps as of My Defaults, up to its first files."""
    settings = bpy.context.scene.imprint
    small(width=256, height=256)
    for name in MATERIALS:
        bpy.data.materials.new(name)
    for number in range(14):
        low = grid(f"prop_{number:02}_low", 4, x=4.0 * number)
        low.data.materials.append(bpy.data.materials[MATERIALS[number % 3]])
        grid(f"prop_{number:02}_high", 30, x=4.0 * number, height=0.15).data.materials.append(red())
    settings.maps = {"AO", "CURVATURE", "BASE_COLOR", "ROUGHNESS", "METALLIC", "THICKNESS"}
    keep_for("prop_next_day")
    yield from all_selected()
    yield from counted()
    yield from press("imprint.set_add")
    yield from textures("MATERIAL")
    yield from press("imprint_sets[0].own.engine")
    yield from underlined("u")
    yield from press("imprint.pack_uvs")
    picture("ready")
    yield from press("imprint.bake_sets")
    yield from finished()
    print(f"  presses: {len(window.presses)}, notches of the wheel: {window.wheel.notches}", flush=True)
    yield from until(is_looked_at)
    picture("baked")
    made = files("prop_next_day")
    print(f"  files: {made}", flush=True)
    check("files of each material", all(any(f"_{name}_" in file for file in made) for name in MATERIALS))
    yield from saved_by_key()


def part_prop_next_day() -> Steps:
    """On another day two high objects change: one press of Bake Changed bakes them, and no texel of the others changes."""
    one = bpy.context.scene.imprint_sets[0]
    yield from window.open_tab()
    yield from until(is_looked_at)
    picture("opened")
    check("all true", signs.of_set(bpy.context, one).status == "TRUE")
    before = {name: (FOLDER / PART / name).read_bytes() for name in files()}
    for number in (3, 8):
        mesh = bpy.data.objects[f"prop_{number:02}_high"].data
        for vertex in mesh.vertices:
            vertex.co.z *= 1.5
        mesh.update()
    yield from until(lambda: signs.of_set(bpy.context, one).status == "CHANGED")
    picture("changed")
    check("changed", signs.of_set(bpy.context, one).status == "CHANGED")
    baked = _baked()
    yield from counted()
    yield from press('imprint.bake_sets(name="prop", changed=True')
    yield from finished()
    yield 2.0  # until looks have begun
    yield from until(is_looked_at)
    picture("baked")
    check(f"one press: {len(window.presses)}", len(window.presses) == 1)
    again = sorted(name for name, when in _baked().items() if when and when != baked.get(name))
    check("two were baked", again == ["prop_03_low", "prop_08_low"])
    kept = {name for name in before if (FOLDER / PART / name).read_bytes() == before[name]}
    check("files of the other material stay", kept == {name for name in before if "_iron_" in name})
    check("all true again", signs.of_set(bpy.context, one).status == "TRUE")


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


def part_queue() -> Steps:
    """Forty sets are baked in the queue while strokes are drawn; results are in files and images, and no stroke waits."""
    small(maps={"AO"}, storage="PACK", rays=64)
    for number in range(SETS):
        name = f"part_{number:02}"
        place = 4.0 * (number % 8), 4.0 * (number // 8)
        for end, cuts, height in (("low", 6, 0.0), ("high", 40, 0.1)):
            made = grid(f"{name}_{end}", cuts, height=height)
            made.location.xy = place
        one = bpy.context.scene.imprint_sets.add()
        one.name = name
        one.parts.add().object = bpy.data.objects[f"{name}_low"]
        if number % 2:
            one.own.storage, one.own.output = "FILE", "//maps/{low}.png"
    clay = grid("clay", 300, x=-6.0)
    folder = FOLDER / "queued"
    folder.mkdir(exist_ok=True)
    bpy.ops.wm.save_as_mainfile(filepath=str(folder / "scene.blend"))
    window.select_only(clay)
    with window.at_view():
        bpy.ops.view3d.view_axis(type="TOP")
        bpy.ops.view3d.view_selected()
        bpy.ops.object.mode_set(mode="SCULPT")
    yield 1.5
    with window.at_view():
        bpy.ops.imprint.queue_add("INVOKE_DEFAULT", all=True)
    picture("begun")
    strokes, moved, began = 0, 0, time.monotonic()
    while any(item.is_open for item in bake_queue.queue.items) and time.monotonic() - began < 20 * PATIENCE:
        before = live_strokes.points(clay)
        yield from live_strokes.stroke(8, offset=10 * (strokes % 8))
        strokes += 1
        moved += bool((live_strokes.points(clay) != before).any())
        if strokes == 3:
            picture("baking")
    queue = bake_queue.queue
    print(
        f"  {strokes} strokes in {time.monotonic() - began:.0f} s; the copy took {1e3 * queue.saving:.0f} ms, the longest"
    )
    print(f"  wait of the window after that {1e3 * queue.longest:.1f} ms")
    failed = [(item.name, item.sentence) for item in queue.items if item.state != "DONE"]
    print(*failed, sep="\n", flush=True)
    check("all sets are baked", len(queue.items) == SETS and not failed)
    check("each stroke moved the mesh", moved == strokes)
    check("no wait of more than 50 ms", queue.longest < 0.05)
    check("images", sum(name.endswith("_ao") for name in mine()) == SETS)
    check(
        "files", len(list((folder / "maps").glob("*.png"))) == SETS
    )  # a normal map and another one of each second set
    check("still in Sculpt Mode", clay.mode == "SCULPT")
    check("no other file", sorted(each.name for each in folder.iterdir()) == ["maps", "scene.blend"])
    with window.at_view():
        bpy.ops.object.mode_set(mode="OBJECT")
    bpy.ops.wm.save_mainfile()


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


def part_daily() -> Steps:
    """Daily tasks about maps, with as many presses as scripts/dev/presses.py counts. The window has 1920 x 1080 pixels."""
    small(crate=True)
    yield from task("bake a normal map of a pair", click_row("crate_low"), press("imprint.bake"), finished())
    check("with the high object of that name", results.of(bpy.context).high == ["crate_high"])
    switches = [press(f"imprint.bakes_{name}") for name in ("ao", "curvature", "thickness")]
    more = [press(f"imprint.bakes_{name}") for name in ("base_color", "roughness")]
    header = window.press_beside("imprint.rays", below=27)
    row = click_row("crate_low")
    yield from task("bake six maps", row, *switches, header, *more, press("imprint.bake"), finished())
    check("six maps", len(mine()) == 6)
    yield from task("look at occlusion on the model", press('imprint.view_map(map="AO")'))
    yield 2.0
    picture("occlusion")
    check("it is shown", (bpy.context.scene.imprint_view.mode, viewer.map) == ("MAP", "AO"))
    yield from task("compare high and low", keys("ctrl+alt+h"))
    yield 2.0
    check("the high object is shown", bpy.context.scene.imprint_view.mode == "HIGH")


def part_daily_files() -> Steps:
    """Daily tasks with files, counted as those of part_daily."""
    small(crate=True)
    yield from click_row("crate_low")
    yield from bake()
    yield from task("make levels of detail", window.press_last_header(), press("imprint.make_levels"), finished())
    check("levels", "crate_low_LODs" in bpy.data.collections)
    yield from click_row("crate_low")
    yield from task("export a .glb", press("imprint.export"), browser())
    yield from finished()
    written = Path.home() / "crate_low.glb"  # where the file browser begins in a file that was never saved
    check("a file", written.is_file())
    written.unlink(missing_ok=True)
    settings, menu = bpy.context.scene.imprint, window.press_beside("imprint.size", right=31)
    yield from task("change the size", menu, window.choose(0))
    check("the size", (settings.width, settings.height) == (512, 512))
    yield from task("switch to Unreal Engine", press("imprint.engine"), underlined("u"))
    check("the engine", settings.engine == "Unreal Engine")


def part_daily_inside_out() -> Steps:
    """A daily task with a closed high mesh, counted as those of part_daily."""
    small()
    for name, segments in (("ball_low", 16), ("ball_high", 64)):
        with window.at_view():
            bpy.ops.mesh.primitive_uv_sphere_add(segments=segments, ring_count=segments // 2)
        bpy.context.object.name = name
        bpy.context.object.data.shade_smooth()
    bpy.data.objects["ball_high"].data.flip_normals()
    yield from click_row("ball_low")
    yield from task("bake a high mesh that is inside out", press("imprint.bake"), finished())
    check("without a warning", not results.of(bpy.context).warnings)


def part_daily_batch() -> Steps:
    """The batch of the daily tasks, counted as those of part_daily."""
    small()
    seven()
    yield from task("batch of seven, find the wrong two", by_names(), press("imprint.bake_sets"), finished())
    check("the wrong ones are named", len(results.batch().left_out) == 2)
    yield from find("imprint.bake_sets")
    picture("batch")


def part_engines() -> Steps:
    """Each choice of Engine, by the wheel over it, is one step: a single Ctrl Z has all settings as they were."""
    small(crate=True)
    yield from click_row("crate_low")
    yield from keys("g", "x", "1", "Return")  # a step before
    for name in list(targets.CHOICES)[1:]:  # the first one is chosen already
        before = values()
        yield from turn_engine()
        chosen = values()
        changed = [setting for setting in before if before[setting] != chosen[setting]]
        check(f"{name} sets {len(changed)} settings", chosen["engine"] == name)
        yield from keys("ctrl+z")
        check(f"{name}: undone at once", values() == before)
        yield from turn_engine()
    check("not further", bpy.data.objects["crate_low"].location.x == 1.0)


def turn_engine() -> Steps:
    """Turn the wheel by one over the setting Engine."""
    yield from find("imprint.engine")
    mouse("keydown", "ctrl")
    mouse("click", window.DOWN)
    yield 0.3
    mouse("keyup", "ctrl")
    yield 0.3


def part_store() -> Steps:
    """Store: File by the mouse. The file is asked to be saved first, and the maps go beside it."""
    open_again("bake", "output")
    small(crate=True)
    yield from click_row("crate_low")
    yield from press("imprint.storage")
    yield from window.choose(1)
    settings = bpy.context.scene.imprint
    check("Store: File", settings.storage == "FILE")
    settings.output = "//maps/{name}.png"
    yield from press("wm.save_mainfile")
    yield from browser()
    check("saved by the button of the box", bool(bpy.data.filepath))
    yield from bake()
    picture("file")
    path = Path(bpy.path.abspath("//maps/crate.png"))
    check("a file", path.is_file())
    image = bpy.data.images["crate_low_normal"]
    check("the image is that of the file", Path(bpy.path.abspath(image.filepath)) == path and not image.packed_file)
    path.unlink()
    Path(bpy.data.filepath).unlink()


def part_formats() -> Steps:
    """A DDS file whose blocks are chosen by the mouse: the file has them, and all mip levels."""
    open_again("bake", "output")
    small(crate=True, storage="FILE")
    keep_for("formats_next_day")
    bpy.context.scene.imprint.output = "//maps/{name}_normal.dds"
    yield from click_row("crate_low")
    yield from press("imprint.compression")
    yield from window.choose(4)
    chosen = bpy.context.scene.imprint.compression
    check(f"Compression: {chosen}", chosen == "BC7")
    yield from bake()
    picture("blocks")
    content = containers.read(bpy.path.abspath("//maps/crate_normal.dds"))
    check(f"{content.block_format.name}, {len(content.levels)} levels", content.block_format.name == "bc7")
    check("all mip levels", [max(level.shape[:2]) for level in content.levels] == [64, 32, 16, 8, 4, 2, 1, 1, 1])
    yield from saved_by_key()


def part_formats_next_day() -> Steps:
    """The image shows the file of blocks, and a bake makes the same one."""
    first = _files(Path(bpy.path.abspath("//maps")))
    image = bpy.data.images["crate_low_normal"]
    check("the image shows the blocks", tuple(image.size) == (256, 256) and image.has_data)
    yield from click_row("crate_low")
    yield from bake()
    picture("baked again")
    check("baked again at once", _files(Path(bpy.path.abspath("//maps"))) == first)


def part_checks() -> Steps:
    """Report and Checks: a button that cures what a warning names, faces in Edit Mode, a mask beside the viewport."""
    open_again("results", "report", "checks")
    small(crate=True, method="FLATTEN")
    layer = bpy.data.meshes["crate_low"].uv_layers[0]
    for corner in layer.uv:
        corner.vector.x = abs(corner.vector.x - 0.4)  # folded: two fifths lie on others
    window.select_only(bpy.data.objects["crate_low"], bpy.data.objects["crate_high"])
    with window.at_view():
        bpy.ops.imprint.bake("INVOKE_DEFAULT")
    yield from finished()

    def method() -> str:  # an Undo makes other settings
        return bpy.context.scene.imprint.chosen(bpy.context).rays.method

    yield from press("imprint.fix(kind='AUTO'")
    picture("report")
    check("the report's button", method() == "AUTO")
    yield from keys("ctrl+z")
    check("is undone at once", method() == "FLATTEN")
    faces = "imprint.select_flaws(low=\"crate_low\", kind='OVERLAP'"
    yield from window.press_beside(faces, right=-18)
    yield 1.0
    picture("mask")
    areas = bpy.context.window_manager.windows[0].screen.areas
    shown = [area.spaces.active.image.name for area in areas if area.type == "IMAGE_EDITOR"]
    check("a mask beside the viewport", any("overlap" in name for name in shown))
    yield from press(faces)
    yield 0.5
    picture("faces")
    low = bpy.data.objects["crate_low"]
    check("Edit Mode", low.mode == "EDIT")
    low.update_from_editmode()
    chosen = sum(polygon.select for polygon in low.data.polygons)
    check(f"{chosen} faces are selected", 0 < chosen < len(low.data.polygons))


# What they are made of


def part_asset() -> Steps:
    """A sculpt alone becomes an asset by the button in the box. Ctrl Z takes it all back, and Esc ends it in each stage."""
    small()
    with window.at_view():
        bpy.ops.mesh.primitive_ico_sphere_add(subdivisions=6)
        rock = bpy.context.object
    rock.name = rock.data.name = "rock"
    for vertex in rock.data.vertices:
        x, y, z = vertex.co
        vertex.co *= 1.0 + 0.06 * math.sin(7.0 * x) * math.cos(6.0 * y + 2.0 * z)
    bpy.context.scene.imprint.asset_triangles = "800"
    yield from click_row("rock")
    yield from keys("g", "x", "0", "Return")  # a step before
    before = kept()
    yield from press("imprint.make_asset")
    stages = yield from stages_of_asset()
    picture("made")
    low = bpy.data.objects.get("rock_low")
    check("a low object with a UV map", low is not None and len(low.data.uv_layers) == 1)
    check("of 800 triangles", low is not None and abs(len(low.data.polygons) - 800) <= 16)
    check("which is selected", bpy.context.object == low and bpy.context.selected_objects == [low])
    check("with its map", mine() == ["rock_low_normal"])
    keep_for("asset_next_day")
    yield from keys("ctrl+z")
    check("one step back", kept() == before)
    for number in range(len(stages) - 1):  # to store takes less time than a key
        yield from escape("imprint.make_asset", stages[number:], lambda: mine() == ["rock_low_normal"])
        check(f"Esc in {stages[number]!r} leaves nothing", kept() == before)
    picture("stopped")


def part_asset_next_day() -> Steps:
    """The asset is as it was saved, and is baked again at once."""
    same_as_saved()
    first = contents()
    check("its map is there", list(first) == ["rock_low_normal"])
    yield from click_row("rock_low")
    yield from bake()
    picture("baked again")
    check("baked again at once", contents() == first)


def part_unwrap() -> Steps:
    """A mesh of 20,000 quads gets a UV map by the button in the box. Ctrl Z takes it back, and Esc ends it in each stage."""
    small()
    with window.at_view():
        bpy.ops.mesh.primitive_uv_sphere_add(segments=200, ring_count=100, calc_uvs=False)
        rock = bpy.context.object
    rock.name = rock.data.name = "rock"
    for vertex in rock.data.vertices:
        x, y, z = vertex.co
        vertex.co *= 1.0 + 0.08 * math.sin(9.0 * x) * math.cos(7.0 * y + 5.0 * z)
    yield from click_row("rock")
    yield from keys("g", "x", "0", "Return")  # a step before
    before = kept()
    ticks = timed_ticks()
    yield from press("imprint.unwrap")
    yield from until(lambda: display.current is not None and display.current.done > 0.3)
    picture("unwrapping")
    stages = yield from stages_of_asset()
    check(f"no tick of {len(ticks)} takes longer than 0.3 s: {max(ticks):.2f}", max(ticks) < 0.3)
    picture("unwrapped")
    check("a UV map", len(bpy.data.objects["rock"].data.uv_layers) == 1)
    yield from keys("ctrl+z")
    check("one step back", kept() == before and not bpy.data.objects["rock"].data.uv_layers)
    for number, name in enumerate(stages):
        seconds = yield from escape(
            "imprint.unwrap", stages[number:], lambda: len(bpy.data.objects["rock"].data.uv_layers) > 0
        )
        check(f"Esc in {name!r} acts within 0.3 s and a redraw: {seconds:.2f}", seconds < 0.3)
        check(f"Esc in {name!r} leaves nothing", kept() == before)
    picture("stopped")


def part_atlas() -> Steps:
    """Three pairs whose UV maps lie on each other share an image, after Pack UV Maps. Ctrl Z takes both steps back."""
    small(method="CAST")
    for number, name in enumerate("abc"):
        grid(f"{name}_low", 6, x=4.0 * number)
        grid(f"{name}_high", 40, x=4.0 * number, height=0.2)
    lows = ("a_low", "b_low", "c_low")
    window.select_only()
    yield from by_names()
    yield from textures("ONE")
    before = kept()
    yield from press("imprint.pack_uvs")
    yield from press("imprint.bake_sets")
    yield from finished()
    picture("atlas")
    check("each has the UV map", all("Atlas" in bpy.data.objects[name].data.uv_layers for name in lows))
    check("one image", mine() == ["Set_normal"])
    found = [results.of(bpy.context, bpy.data.objects[name]) for name in lows]
    check("without overlaps", all(report.checks["overlap"]["share"] == 0.0 for report in found))
    yield from keys("ctrl+z", "ctrl+z")
    check("two steps back", kept() == before)
    check("no UV map is left", all("Atlas" not in bpy.data.objects[name].data.uv_layers for name in lows))


def part_other_uv_map() -> Steps:
    """An object with a painted image gets it in another UV map: selected alone, by one press."""
    small(maps={"BASE_COLOR"}, normal=False)
    plate = grid("plate", 6)
    image = bpy.data.images.new("painted", 64, 64)
    image.generated_type = "COLOR_GRID"
    material = red()
    plate.data.materials.append(material)
    nodes, links = material.node_tree.nodes, material.node_tree.links
    texture, uv_map = nodes.new("ShaderNodeTexImage"), nodes.new("ShaderNodeUVMap")
    texture.image, uv_map.uv_map = image, plate.data.uv_layers[0].name
    links.new(uv_map.outputs["UV"], texture.inputs["Vector"])
    links.new(texture.outputs["Color"], nodes["Principled BSDF"].inputs["Base Color"])
    other = plate.data.uv_layers.new(name="other")
    for loop in other.uv:
        loop.vector = 0.5 * loop.vector
    plate.data.uv_layers.active = other
    yield from click_row("plate")
    yield from bake()
    picture("other UV map")
    check("the color alone", mine() == ["painted", "plate_base_color"])
    check("a quarter of the map", abs(results.of(bpy.context).coverage - 0.25) < 0.01)


def part_itself() -> Steps:
    """One mesh alone, then three that stand side by side, each onto itself by one press, which Ctrl Z takes back."""
    small(maps={"AO"}, normal=False)
    names = ["lamp", "table", "vase"]
    for number, name in enumerate(names):
        grid(name, 12, x=4.0 * number, height=0.4).data.materials.append(red())
    yield from click_row("lamp")
    yield from keys("g", "x", "0", "Return")  # a step before
    yield from bake()
    check("one map of one mesh", mine() == ["lamp_ao"])
    alone = contents()["lamp_ao"]
    for name in names[1:]:
        yield from click_row(name, "ctrl")
    check("three are selected", sorted(obj.name for obj in bpy.context.selected_objects) == names)
    yield 1.0
    picture("three")
    yield from bake()
    check("a map of each", mine() == [f"{name}_ao" for name in names])
    check("the first as it was", contents()["lamp_ao"] == alone)
    check("each onto itself", all(object_pairs.of(bpy.data.objects[name]).is_own for name in names))
    yield from keys("ctrl+z")
    check("one step back", mine() == ["lamp_ao"])
    yield from bake()
    yield from press("imprint.share_image")
    yield from press("imprint.pack_uvs")
    yield from bake()
    check("one map of all", mine() == ["atlas_ao", *(f"{name}_ao" for name in names)])
    picture("atlas")
    keep_for("itself_next_day")
    yield from saved_by_key()


def part_itself_next_day() -> Steps:
    """The file is as it was, and one press bakes the three again, then one that lies on another by Each Onto Itself."""
    same_as_saved()
    first = contents()
    yield from click_row("lamp")
    for name in ("table", "vase"):
        yield from click_row(name, "ctrl")
    yield from bake()
    check("baked again at once", contents() == first)
    bpy.data.objects["vase"].location.x = bpy.data.objects["table"].location.x
    bpy.context.scene.imprint.share_image = False
    yield 1.0
    picture("on one another")
    before = _baked()
    yield from press("imprint.bake(each=True")
    yield from finished()
    after = _baked()
    check("Each Onto Itself", all(before[name] != after[name] for name in ("lamp", "table", "vase")))


def by_names() -> Steps:
    """A set of all pairs by name: Sets, and the plus sign with nothing selected."""
    yield from press("imprint.bakes")
    yield from press("imprint.set_add")


def textures(which: str) -> Steps:
    """Choose how the parts of the first set share textures, in a row of three buttons."""
    yield from find("imprint_sets[0].textures")
    whole, area, _ = window.view()
    sidebar = next(region for region in area.regions if region.type == "UI")
    share = {"PART": 0.15, "MATERIAL": 0.45, "ONE": 0.75}[which]
    mouse("mousemove", round(sidebar.x + sidebar.width * share), window._seen["imprint_sets[0].textures"][1])
    yield 0.3
    mouse("click", 1)
    yield 0.7
    check(f"textures: {which}", bpy.context.scene.imprint_sets[0].textures == which)


def all_selected() -> Steps:
    """Select all objects by A, with the tab open."""
    yield from window.open_tab()
    yield from click_row(min(bpy.context.scene.objects.keys()))
    yield from keys("a")
    yield from until(lambda: len(bpy.context.selected_objects) == len(bpy.context.scene.objects))


def counted() -> Steps:
    """Count presses and notches from here."""
    yield 0.5
    window.presses.clear()
    window.wheel.begin()


def is_looked_at() -> bool:
    """Whether it is known of all parts of the first set if something has changed."""
    one = bpy.context.scene.imprint_sets[0]
    sign = signs.of_set(bpy.context, one)
    return not signs.waiting(bpy.context, one) and sign.status != "UNKNOWN"


def files(part: str = "") -> list[str]:
    """The names of the images in the folder of a part."""
    return sorted(path.name for path in (FOLDER / (part or PART)).rglob("*") if path.suffix in {".png", ".tga", ".exr"})


def stage() -> str:
    """What the running task does, without numbers."""
    shown = display.current.what if display.current is not None else ""
    return "".join(letter for letter in shown if not letter.isdigit() and letter not in ".,%")


def stages_of_asset() -> Iterator[float]:
    """Wait for the end of the task. Returns its stages, in order."""
    seen: list[str] = []
    for _ in range(int(PATIENCE / 0.05)):
        if modal.runner.run is None and seen:
            break
        if stage() and stage() not in seen:
            seen.append(stage())
        yield 0.05
    yield 0.5
    return seen


def timed_ticks() -> list[float]:
    """The seconds of this process that each tick of a task takes from now on, in a list that grows."""
    ticks, advance = [], modal.Runner.advance

    def timed(runner: modal.Runner, context: bpy.types.Context) -> None:
        start = time.process_time()
        try:
            advance(runner, context)
        finally:
            ticks.append(time.process_time() - start)

    modal.Runner.advance = timed
    return ticks


ATTEMPTS = 3


def redraw_seconds() -> float:
    """The seconds of this process that one redraw of the window takes: the least of three."""
    seconds = []
    for _ in range(3):
        start = time.process_time()
        with bpy.context.temp_override(window=bpy.context.window_manager.windows[0]):
            bpy.ops.wm.redraw_timer(type="DRAW_WIN_SWAP", iterations=1)
        seconds.append(time.process_time() - start)
    return min(seconds)


def escape(button: str, stages: list[str], is_made) -> Iterator[float]:
    """Select the rock, click a button, and press Esc when its task is in the first of these stages, or in a later one. Checks
    that this came before the end. Returns the seconds of this process until the task ended, less those of one redraw: there is
    one in between, and in software it takes 0.3 to 0.5 s, also if no task runs.

    On a busy machine the task may end before the key arrives. Then it is undone and begun again. is_made: whether what the
    task makes is there.
    """
    redraw = redraw_seconds()
    for attempt in range(ATTEMPTS):
        if attempt:
            yield from keys("ctrl+z")
        yield from click_row("rock")
        yield from press(button)
        yield from until(lambda: modal.runner.run is None or stage() in stages, every=0.01)
        start = time.process_time()
        mouse("key", "Escape")
        yield from until(lambda: modal.runner.run is None, every=0.01)
        seconds = time.process_time() - start - redraw
        yield 0.5
        if not is_made():
            break
    check(f"Esc in {stages[0]!r} comes before the end", not is_made())
    return seconds


def kept() -> dict[str, list[str]]:
    """The names of what a bake makes."""
    kinds = ("objects", "meshes", "images", "materials", "scenes")
    return {kind: sorted(block.name for block in getattr(bpy.data, kind) if block.users) for kind in kinds}


def values() -> dict[str, object]:
    """All settings of the scene that have one value."""
    settings = bpy.context.scene.imprint
    kinds = {"BOOLEAN", "INT", "FLOAT", "STRING", "ENUM"}
    known = [one for one in settings.bl_rna.properties if one.type in kinds and not one.is_readonly]
    found = {one.identifier: (getattr(settings, one.identifier), getattr(one, "is_array", False)) for one in known}
    return {name: tuple(value) if is_array else value for name, (value, is_array) in found.items()}


def open_again(*names: str) -> None:
    """Register the add-on again, with these panels alone open."""
    addon.modules()
    addon.unregister()
    window.open_alone(*(f"IMPRINT_PT_{name}" for name in names))
    addon.register()


def task(name: str, *steps: Steps) -> Steps:
    """Play a daily task, and compare the number of its presses."""
    window.presses.clear()
    for each in steps:
        yield from each
    check(f"{name}: {len(window.presses)}", len(window.presses) == PRESSES[name])


ACCEPT = 63, 19
"""How far the button that accepts is from the lower right corner of a file browser, in pixels at a scale of 1."""


def underlined(letter: str) -> Steps:
    """Press the underlined letter of a choice in the menu that is open."""
    yield 1.0
    mouse("key", letter)
    yield 1.0


def browser() -> Steps:
    """Click the button that accepts, in the file browser, which is a window of its own."""
    yield 1.5
    picture("file browser")
    whole, browser = bpy.context.window_manager.windows
    right, above = (length * bpy.context.preferences.system.ui_scale for length in ACCEPT)
    top = whole.y + whole.height
    mouse("mousemove", round(browser.x + browser.width - right), round(top - browser.y - above))
    yield 0.5
    mouse("click", 1)
    yield 1.5


def seven() -> None:
    """Seven low objects: one is inside out, one has no UVs, one has no high object."""
    for number, name in enumerate("abcdefg"):
        grid(f"{name}_low", 6, x=4.0 * number)
        if name != "e":
            grid(f"{name}_high", 40, x=4.0 * number, height=0.2)
    bpy.data.objects["c_low"].data.flip_normals()
    layers = bpy.data.meshes["f_low"].uv_layers
    layers.remove(layers[0])
    window.select_only()


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
    yield from until(lambda: bpy.context.scene.imprint_view.mode == "SPLIT")
    yield 1.0
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


def until(is_there, every: float = 0.1) -> Steps:
    for _ in range(int(PATIENCE / every)):
        if is_there():
            return
        yield every
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
