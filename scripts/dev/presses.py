# SPDX-License-Identifier: GPL-3.0-or-later
"""Counts the presses and the wheel clicks that ten daily tasks take in the sidebar, in two versions of Imprint.

    .venv/bin/python scripts/dev/presses.py [--before FOLDER] [--sidebar PIXELS]

FOLDER is another checkout, as `git worktree add FOLDER 74cd6c77` makes of version 0.2. The panels are drawn into a layout that
adds up heights as Blender does at a scale of 1, with each panel open or closed as it is by default. A task is a list of buttons
in STEPS: the closed panels around a button are opened by a press each, and the wheel turns until it is in sight. A click is a
press, and so is a key; a choice in a menu is two. The window has 1920 x 1080 pixels, of which the sidebar of the default
workspace has --sidebar.
"""

import argparse
import json
import math
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

HERE = Path(__file__).resolve().parents[2]
SIDEBAR, WHEEL = 898, 40
"""The height of the sidebar, and how far a wheel click moves it, in pixels."""
ROW, GAP, BOX, HEADER, PANEL = 22, 2, 8, 26, 10
"""Heights of a row, between rows, of the frame of a box, of a panel's header, and below a panel, in pixels."""
WIDTH = 240
NORMAL_BAKE = [("imprint.bake", 1)]
OUTLINER = [("", 2)]
"""A click, and one with Ctrl."""
LOW_ALONE = [("", 1)]
"""A click: the high object is found by its name."""
SIX = [(f"bakes_{name}", 1) for name in ("ao", "curvature", "thickness", "base_color", "roughness")]
STEPS: dict[str, tuple[str, list[tuple[str, int]], list[tuple[str, int]]]] = {
    # task: the state it begins in, the steps of version 0.2, and those of this one
    "bake a normal map of a pair": ("pair", OUTLINER + NORMAL_BAKE, LOW_ALONE + NORMAL_BAKE),
    "bake six maps": ("pair", OUTLINER + SIX + NORMAL_BAKE, LOW_ALONE + SIX + NORMAL_BAKE),
    # Version 0.2 has no view of it: Shading workspace, the image's node, its link to the output, Material Preview.
    "look at occlusion on the model": ("baked", [("", 4)], [("imprint.view_map", 1)]),
    "compare high and low": ("baked", [("mode", 2)], [("", 1)]),  # Ctrl Alt H
    "switch to Unreal Engine": (
        "pair",
        # The presets are in the header of the panel Map.
        [("IMPRINT_PT_map", 2), ("pack", 2), ("depth", 1), ("storage", 2), ("image", 1), ("export", 1)],
        [("engine", 2)],
    ),
    # Version 0.2 says what is wrong with one low object: the one that is selected.
    "batch of seven, find the wrong two": (
        "seven",
        [("imprint.bake_pairs", 1), *[("", 1), ("report", 0)] * 7],
        [("bakes", 1), ("imprint.set_add", 1), ("imprint.bake_sets", 1), ("left_out", 0)],
    ),
    "make levels of detail": ("pair", [("imprint.make_levels", 1)], [("imprint.make_levels", 1)]),
    "change the size": ("pair", [("IMPRINT_MT_size", 2)], [("IMPRINT_MT_size", 2)]),
    # A path in Output and a bake in version 0.2 and here; the button needs the name in the file browser and a press there.
    "export a .glb": ("baked", [("imprint.export", 2)], [("imprint.export", 2)]),
    # Edit Mode, A, Alt N, Flip, Edit Mode, and a bake: version 0.2 does not turn faces over.
    "bake a high mesh that is inside out": ("pair", [("", 5), ("imprint.bake", 1)], [("imprint.bake", 1)]),
}


class Layout:
    """A layout that adds up heights. place: (y, name) of what was drawn, with y from the top of the layout."""

    def __init__(self, state, *, is_row=False, columns=1, frame=0, aligned=False):
        self.state, self.is_row, self.columns, self.frame, self.aligned = state, is_row, columns, frame, aligned
        self.parts = []
        self.scale_y = 1.0
        self.enabled = self.active = True
        self.use_property_split = self.use_property_decorate = False
        self.alignment = self.operator_context = ""

    def _sub(self, **how):
        part = Layout(self.state, **how)
        self.parts.append(part)
        return part

    def column(self, align=False, **_):
        return self._sub(aligned=align)

    def row(self, **_):
        return self._sub(is_row=True)

    split = row

    def box(self):
        return self._sub(frame=BOX)

    def grid_flow(self, columns=0, align=False, **_):
        return self._sub(columns=max(1, columns), aligned=align)

    def panel(self, name, default_closed=False, **_):
        header = self._sub(is_row=True)
        header.parts.append((name, HEADER))
        is_open = name in self.state.opened if default_closed else True
        if not is_open:
            self.state.inside[name] = []
            body = Layout(self.state)  # drawn to know what it holds
            self.state.closed_bodies[name] = body
            return header, body
        return header, self._sub()

    def _add(self, name, rows=1.0):
        self.parts.append((name, round(rows * ROW * self.scale_y)))

    def label(self, text="", **_):
        self._add("")

    def prop(self, _data, name, *_, **__):
        self._add(name)

    prop_search = prop

    def template_ID(self, data, name, **_):
        self._add(name)

    def template_list(self, _kind, _id, _data, name, *_, rows=5, **__):
        self._add(name, rows + 1)

    def template_icon(self, icon_value=0, scale=1.0):
        self._add("", scale)

    def progress(self, **_):
        self._add("")

    def separator(self, factor=1.0, **_):
        if not self.is_row:
            self.parts.append(("", round(6 * factor)))

    def menu(self, name, **_):
        self._add(name)

    def popover(self, panel, **_):
        self._add(panel)

    def operator(self, name, **_):
        self._add(name)
        return SimpleNamespace()

    def icon(self, _image):
        return 1

    def measured(self):
        """The height, and (y, name) of all buttons."""
        found, y, gap = [], self.frame // 2, 0 if self.aligned else GAP
        heights, column = [], 0
        for part in self.parts:
            name = ""
            if isinstance(part, Layout):
                height, inner = part.measured()
                height = round(height * self.scale_y)
            else:
                (name, height), inner = part, []
            found += [(y + at, inside) for at, inside in inner]
            if name:
                found.append((y, name))
            heights.append(height)
            column += 1
            if not self.is_row and column == self.columns:
                y += max(heights) + gap
                heights, column = [], 0
        y += max(heights, default=0)
        return y + self.frame // 2, found


class Sidebar:
    """The panels of the tab as they are drawn now. opened: the panels that a press has opened."""

    def __init__(self, panels, *, opened=()):
        self.panels, self.opened, self.scroll = panels, set(opened), 0
        self.inside, self.closed_bodies = {}, {}

    def places(self):
        """(y, name) of all buttons and headers, and for each closed panel the names in it."""
        found, hidden, y = [], {}, 0
        tops = sorted(
            (one for one in self.panels if not getattr(one, "bl_parent_id", "")),
            key=lambda one: getattr(one, "bl_order", 0),
        )

        def draw(panel, inside_closed):
            nonlocal y
            poll = getattr(panel, "poll", None)
            if poll is not None and not panel.poll(context()):
                return
            name = panel.bl_idname
            is_closed = "DEFAULT_CLOSED" in getattr(panel, "bl_options", set()) and name not in self.opened
            self.closed_bodies = {}
            layout = Layout(self)
            drawn = Drawn(panel, layout)
            panel.draw(drawn, context())
            height, own = layout.measured()
            within = {group: [one for _, one in body.measured()[1]] for group, body in self.closed_bodies.items()}
            if inside_closed is None:
                found.append((y, name))
                if name.endswith(("_report", "_results")):
                    found.append((y, "left_out" if name.endswith("_results") else "report"))
                y += HEADER
            else:
                hidden.setdefault(inside_closed, []).append(name)
            if inside_closed is None and not is_closed:
                found.extend((y + at, one) for at, one in own)
                y += height + PANEL
                hidden.update(within)
            else:
                hidden.setdefault(name, []).extend([one for _, one in own])
                for group, names in within.items():
                    hidden.setdefault(name, []).append(group)
                    hidden[group] = names
            children = sorted(
                (one for one in self.panels if getattr(one, "bl_parent_id", "") == name),
                key=lambda one: getattr(one, "bl_order", 0),
            )
            for child in children:
                draw(child, name if inside_closed is not None or is_closed else None)

        for top in tops:
            draw(top, None)
        return found, hidden, y

    def reach(self, name, height):
        """Bring a button into sight: (presses, wheel clicks)."""
        wheel = 0
        for presses in range(6):
            found, hidden, total = self.places()
            at = next((y for y, one in found if one == name), None)
            if at is not None:
                return presses, wheel + self._turn(at, height, total)
            holder = next((panel for panel, names in hidden.items() if name in names), None)
            if holder is None:
                raise LookupError(f"{name} is in no panel: {sorted({one for _, one in found})}")
            name_of_holder = holder
            while not any(one == name_of_holder for _, one in found):
                name_of_holder = next(panel for panel, names in hidden.items() if name_of_holder in names)
            at = next(y for y, one in found if one == name_of_holder)
            wheel += self._turn(at, height, total)
            self.opened.add(name_of_holder)
        raise LookupError(name)

    def _turn(self, at, height, total):
        before = self.scroll
        if at < self.scroll:
            self.scroll = max(0, WHEEL * math.floor(at / WHEEL))
        elif at + ROW > self.scroll + height:
            self.scroll = min(max(0, total - height), WHEEL * math.ceil((at + ROW - height) / WHEEL))
        return math.ceil(abs(self.scroll - before) / WHEEL)


class Drawn:
    """A panel while it is drawn, with its other methods."""

    def __init__(self, panel, layout):
        self.panel, self.layout = panel, layout

    def __getattr__(self, name):
        found = getattr(self.panel, name)
        return found.__get__(self) if callable(found) else found


def context():
    import bpy

    bpy.context.view_layer.update()
    return SimpleNamespace(
        scene=bpy.context.scene,
        window_manager=bpy.context.window_manager,
        view_layer=bpy.context.view_layer,
        evaluated_depsgraph_get=bpy.context.evaluated_depsgraph_get,
        active_object=bpy.context.active_object,
        selected_objects=bpy.context.selected_objects,
        preferences=SimpleNamespace(system=SimpleNamespace(ui_scale=1.0), addons={}),
        region=SimpleNamespace(width=WIDTH),
    )


def prepare(state):
    """The scene that a task begins in."""
    import bpy

    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    settings = bpy.context.scene.imprint

    def grid(name, cuts, x=0.0, has_uv=True):
        bpy.ops.mesh.primitive_grid_add(x_subdivisions=cuts, y_subdivisions=cuts, location=(x, 0, 0), calc_uvs=has_uv)
        bpy.context.object.name = name
        return bpy.context.object

    settings.width = settings.height = 16
    pairs = 7 if state == "seven" else 1
    for number in range(pairs):
        high = grid(f"part{number}_high", 8, 3.0 * number)
        low = grid(f"part{number}_low", 2, 3.0 * number)
    high.select_set(True)
    low.select_set(True)
    bpy.context.view_layer.objects.active = low
    if state == "baked":
        settings.maps = {"AO"}
        settings.rays = 16
        assert bpy.ops.imprint.bake() == {"FINISHED"}
        settings.maps = set()
    if state == "seven":
        for number in range(pairs):  # the results that the batch leaves
            bpy.context.view_layer.objects.active = bpy.data.objects[f"part{number}_low"]


def count(root: str, version: int, height: int) -> dict[str, tuple[int, int]]:
    """Presses and wheel clicks by task. Runs in a process of its own, with the modules of that checkout."""
    sys.path.insert(0, root)
    import bpy
    import gpu

    gpu.init()
    registered = []
    keep = bpy.utils.register_class

    def register_class(one):
        registered.append(one)
        keep(one)

    bpy.utils.register_class = register_class
    import addon

    addon.register()
    panels = [one for one in registered if issubclass(one, bpy.types.Panel) and one.bl_region_type == "UI"]
    panels = [one for one in panels if getattr(one, "bl_category", "") == "Imprint"]
    panels = [one for one in panels if "INSTANCED" not in getattr(one, "bl_options", ())]
    found = {}
    for task, (state, *both) in STEPS.items():
        prepare(state)
        sidebar, presses, wheel = Sidebar(panels), 0, 0
        is_baked = state != "seven"
        for name, number in both[version]:
            presses += number
            if not name or (name == "left_out" and not is_baked):
                if name:
                    bpy.ops.imprint.bake_pairs()
                    is_baked = True
                    more = sidebar.reach(name, height)
                    presses, wheel = presses + more[0], wheel + more[1]
                continue
            if name == "report" and not is_baked:
                bpy.ops.imprint.bake_pairs()
                is_baked = True
            more = sidebar.reach(name, height)
            presses, wheel = presses + more[0], wheel + more[1]
            if name == "bakes":
                bpy.context.scene.imprint.bakes = "SETS"
            elif name == "imprint.set_add":
                bpy.ops.object.select_all(action="DESELECT")
                bpy.ops.imprint.set_add()
        found[task] = presses, wheel
    found["height of the open panels"] = Sidebar(panels).places()[2], 0
    addon.unregister()
    return found


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--before", type=Path, metavar="FOLDER")
    parser.add_argument("--sidebar", type=int, default=SIDEBAR, metavar="PIXELS")
    parser.add_argument("--count", nargs=2, help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.count:
        print("COUNTED", json.dumps(count(given.count[0], int(given.count[1]), given.sidebar)))
        return 0
    columns = {}
    for version, root in enumerate((given.before, HERE)):
        if root is not None:
            command = [
                sys.executable,
                __file__,
                "--sidebar",
                str(given.sidebar),
                "--count",
                str(root.resolve()),
                str(version),
            ]
            done = subprocess.run(command, capture_output=True, text=True, check=False)
            lines = [line for line in done.stdout.splitlines() if line.startswith("COUNTED")]
            if not lines:
                sys.exit(done.stdout + done.stderr)
            columns[version] = json.loads(lines[0].removeprefix("COUNTED"))
    for task in columns[1]:
        cells = [f"{columns[one][task][0]:4} + {columns[one][task][1]:3}" for one in columns]
        print(f"{task:38} " + "   ".join(cells))
    totals = {one: [sum(column) for column in zip(*(c[t] for t in STEPS), strict=True)] for one, c in columns.items()}
    print(f"{'presses + wheel clicks of all':38} " + "   ".join(f"{p:4} + {w:3}" for p, w in totals.values()))
    return 0


if __name__ == "__main__":
    sys.exit(main())
