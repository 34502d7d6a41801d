# SPDX-License-Identifier: GPL-3.0-or-later
"""Scenes with maps of each kind of output, and what Blender has of them, as plain data: before a file is saved and after it
was opened again, in this process or in another one.

`python -m tests.support.saved_scenes FUNCTION OUT ARGUMENTS...` runs a function of this module in a new Blender, and writes
what it returns into the file OUT.
"""

import hashlib
import json
import os
import subprocess
import sys
from collections.abc import Callable, Iterable
from pathlib import Path

import bpy
import numpy as np

from addon.output import datablocks
from addon.ui import bake_results, object_pairs
from addon.ui.bake_results import results
from addon.ui.live import live
from scripts import imprint
from tests.support import snapshot, zoo

SIZE = 32
OPTIONS: dict[str, dict] = {
    "packed": {"maps": {"AO", "BASE_COLOR", "CURVATURE"}},
    "packed 8": {"depth": "8", "maps": {"HEIGHT", "BASE_COLOR"}},
    "file": {"storage": "FILE", "maps": {"AO", "BASE_COLOR"}, "output": "//maps/{low}_normal.png"},
    "file exr": {"storage": "FILE", "maps": {"POSITION"}, "output": "//maps/{low}_normal.exr", "depth": "32"},
    "file elsewhere": {"storage": "FILE", "maps": {"AO"}, "output": "ELSEWHERE/1/{low}_normal.tif", "alpha": False},
    "udim": {"udim": True, "maps": {"AO"}},
    "udim file": {"udim": True, "storage": "FILE", "maps": {"HEIGHT"}, "output": "//maps/{low}.<UDIM>.png"},
    "sets": {"texture_sets": True, "maps": {"BASE_COLOR"}},
    "channels": {"pack": "GLTF", "mask": True, "method": "CAST"},
    "no normal map": {"normal": False, "maps": {"THICKNESS", "AO"}},
    "connected": {"maps": {"BASE_COLOR", "AO"}, "connect_maps": True},
    "no material": {"material": False},
    "memory": {"storage": "MEMORY", "maps": {"AO"}},
    "memory 8": {"storage": "MEMORY", "maps": {"BASE_COLOR"}, "depth": "8"},
    "converted": {"maps": {"AO"}},
    "levels": {"maps": {"AO"}, "level_degrees": "", "level_distance": "2"},
    "atlas": {"share_image": True, "maps": {"AO"}},
    "sequence": {"storage": "FILE", "output": "//maps/{low}_###.png"},
    "live": {"maps": {"AO"}, "method": "FLATTEN"},
    "live file": {"maps": {"AO"}, "method": "FLATTEN", "storage": "FILE", "output": "//maps/{low}.png"},
    "live memory": {"maps": {"AO"}, "method": "FLATTEN", "storage": "MEMORY"},
    "live is on": {"maps": {"AO"}, "method": "FLATTEN"},
}
"""The settings of the panel of each kind of output."""
KINDS = list(OPTIONS)


def build(kind: str, elsewhere: str) -> None:
    """A scene of this name with a low and a high object in the slots, and the settings of the kind."""
    scene = bpy.data.scenes.new(kind)
    bpy.context.window.scene = scene
    low, high = zoo.terrain(f"{kind} low", n=4), zoo.terrain(f"{kind} high", n=12, height=0.2)
    if kind.startswith("udim"):  # two tiles
        for obj in (low, high):
            uv = np.empty(len(obj.data.loops) * 2, np.float32)
            obj.data.uv_layers[0].uv.foreach_get("vector", uv)
            uv[::2] *= 2.0
            obj.data.uv_layers[0].uv.foreach_set("vector", uv)
    if kind == "sets":
        for name in ("left", "right"):
            low.data.materials.append(bpy.data.materials.new(f"{kind} {name}"))
        for face in low.data.polygons:
            face.material_index = int(face.center.x > 0.0)
    if kind == "levels":
        bpy.data.objects.remove(high)
    settings = scene.imprint
    settings.low = low
    if kind != "levels":
        settings.highs.add().object = high
    settings.method, settings.width, settings.height = "FLATTEN", SIZE, SIZE
    scene.frame_start, scene.frame_end = 3, 4
    for name, value in OPTIONS[kind].items():
        setattr(settings, name, value.replace("ELSEWHERE", elsewhere) if name == "output" else value)
    bpy.context.view_layer.objects.active = low
    bpy.context.view_layer.update()


def bake(kind: str) -> None:
    """Bake what `build` has made, as its button does. The second time, the high object is another one."""
    if live.is_on:
        press("live")
    scene, low, high = bpy.data.scenes[kind], bpy.data.objects[f"{kind} low"], bpy.data.objects.get(f"{kind} high")
    bpy.context.window.scene = scene
    bpy.context.view_layer.objects.active = low
    if high is not None:
        high.scale.z *= 1.25
    bpy.context.view_layer.update()
    own = OWN_WAYS.get(kind.split(maxsplit=1)[0])
    if own is not None:
        own(kind, low, high)
        return
    if kind == "file elsewhere" and images_of(kind, bpy.data.images.keys()):
        scene.imprint.output = scene.imprint.output.replace("/1/{low}", "/2/{low}")  # the file of the first bake stays
    press("bake")


def press(button: str) -> None:
    assert getattr(bpy.ops.imprint, button)() == {"FINISHED"}


def _levels(_kind: str, _low: bpy.types.Object, _high: None) -> None:
    kept = (bpy.data.objects, bpy.data.meshes, bpy.data.materials, bpy.data.collections)
    bpy.data.batch_remove([each for kind in kept for each in kind if each.name.startswith("levels low_")])
    press("make_levels")


def _atlas(kind: str, low: bpy.types.Object, high: bpy.types.Object) -> None:
    low.name, high.name = "atlas_low", "atlas_high"
    press("bake_pairs")
    low.name, high.name = f"{kind} low", f"{kind} high"


def _sequence(*_) -> None:
    press("bake_sequence")


def _live(kind: str, *_) -> None:
    live.rest = 0.0
    press("live")
    for _ in range(200):
        live.tick()
        if live.is_resting:
            break
    if kind != "live is on":
        press("live")


def _converted(kind: str, *_) -> None:
    press("bake")
    settings = bpy.data.scenes[kind].imprint
    settings.convert_image, settings.space = bpy.data.images[f"{kind} low_normal"], "OBJECT"
    press("convert")
    settings.space = "TANGENT"


OWN_WAYS = {"levels": _levels, "atlas": _atlas, "sequence": _sequence, "live": _live, "converted": _converted}
"""The kinds that another button bakes, by the first word of their name."""


def lows(kind: str) -> list[str]:
    """The names of the objects that have the maps of a kind."""
    return ["levels low_LOD1"] if kind == "levels" else [f"{kind} low"]


def images_of(kind: str, names: Iterable[str]) -> list[str]:
    """Of all names of images, those that the bakes of a kind have made."""
    start = ("atlas_",) if kind == "atlas" else tuple(f"{name}_" for name in lows(kind))
    return sorted(name for name in names if name.startswith(start))


def show_bake() -> None:
    """Show a bake, as after a press of its button: in Material Preview, with the high object hidden."""
    bpy.context.window.scene = bpy.data.scenes["packed"]
    bake_results.show_bake(bpy.context, results.all_of(bpy.context, bpy.data.objects["packed low"]))


def content(image: bpy.types.Image) -> dict[str, str]:
    """A hash of the pixels of each tile, as Blender has them; of a sequence, of each file."""
    if image.source == "SEQUENCE":
        path = _file(image)
        files = sorted(path.parent.glob(f"{path.stem.rstrip('0123456789')}*"))
        return {file.name: _hash(file.read_bytes()) for file in files}
    if image.source == "TILED":
        found = datablocks.tile_contents(image)
        return {str(number): _hash(part.read_bytes() if isinstance(part, Path) else part) for number, part in found}
    pixels = np.empty(len(image.pixels), np.float32)
    image.pixels.foreach_get(pixels)
    return {"": _hash(pixels.tobytes())}


def _file(image: bpy.types.Image) -> Path:
    return Path(bpy.path.abspath(image.filepath, library=image.library)).resolve()


def _hash(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()[:16]


def about(image: bpy.types.Image, users: dict) -> dict:
    """Everything about an image that a file keeps."""
    return {
        "content": content(image),
        "size": list(image.size),
        "source": image.source,
        "is_float": image.is_float,
        "depth": image.depth,
        "colorspace": image.colorspace_settings.name,
        "alpha_mode": image.alpha_mode,
        "half": image.use_half_precision,
        "tiles": [tile.number for tile in image.tiles],
        "packed": sorted(part.tile_number for part in image.packed_files),
        "is_dirty": image.is_dirty,
        "file": str(_file(image)) if image.filepath and not image.packed_files else "",
        "is_relative": image.filepath.startswith("//"),
        "own": {key: image[key] for key in image.keys() if key.startswith("imprint")},  # noqa: SIM118
        "fake_user": image.use_fake_user,
        "users": image.users,
        "used_by": sorted(f"{type(user).__name__} {user.name}" for user in users.get(image, ())),
    }


def state() -> dict:
    """What belongs to the maps of the open file: images, settings, materials, what viewports show, hidden objects."""
    users = bpy.data.user_map(subset=list(bpy.data.images))
    pairs = {obj.name: pair for obj in bpy.data.objects if (pair := object_pairs.of(obj)) is not None}
    return {
        "images": {image.name: about(image, users) for image in bpy.data.images},
        "pairs": {name: _pair(pair) for name, pair in pairs.items()},
        "settings": {scene.name: _settings(scene.imprint) for scene in bpy.data.scenes},
        "materials": {
            material.name: json.loads(json.dumps(snapshot._tree(material.node_tree)))
            for material in bpy.data.materials
            if material.node_tree is not None
        },
        "views": {
            f"{screen.name} {number}": snapshot.settings(space.shading) | {"local": space.local_view is not None}
            for screen in bpy.data.screens
            for number, area in enumerate(screen.areas)
            for space in area.spaces
            if space.type == "VIEW_3D"
        },
        "hidden": sorted(
            obj.name
            for scene in bpy.data.scenes
            for layer in scene.view_layers
            for obj in layer.objects
            if obj.hide_get(view_layer=layer)
        ),
    }


def _pair(pair: object_pairs.ImprintPair) -> dict:
    """What a low object keeps. Its reports are read, and refer to objects of the open file."""
    return snapshot.settings(pair) | {
        "found": [obj.name for obj in pair.found()],
        "missing": pair.missing(),
        "maps": sorted(item.image.name for item in pair.maps if item.image),
        "reports": [[ref.name for ref in report.refs] for report in pair.reports()],
    }


def _settings(settings: bpy.types.PropertyGroup) -> dict:
    found = snapshot.settings(settings)
    return found | {
        "highs": [slot.object and slot.object.name for slot in settings.highs],
        "maps": sorted(settings.maps),
    }


# In processes of their own


def run(function: Callable[..., object], folder: Path, *arguments: object) -> object:
    """What `function(*arguments)` returns in a new Blender, with the add-on. folder: for a file of the result."""
    out = folder / f"{function.__name__}.json"
    command = [sys.executable, "-m", "tests.support.saved_scenes", function.__name__, str(out), *map(str, arguments)]
    done = subprocess.run(command, cwd=imprint.ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    return json.loads(out.read_text())


def save(path: Path) -> dict:
    """Save the open file there. Returns its state, as from a file of JSON."""
    path.parent.mkdir(exist_ok=True)
    bpy.ops.wm.save_as_mainfile(filepath=str(path))
    return json.loads(json.dumps(state()))


def first_day(folder: str, path: str) -> dict[str, dict]:
    """Make a file with maps of all kinds, and save it. Returns its states before and after saving."""
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    save(Path(path))  # files are relative to it
    for kind in KINDS:
        build(kind, folder)
        bake(kind)
    show_bake()
    return {"never": state(), "first": save(Path(path))}


def opened(path: str) -> dict:
    """The state of a file."""
    bpy.ops.wm.open_mainfile(filepath=path)
    return state()


def all_opened(*paths: str) -> list[dict]:
    """The state of each file."""
    return list(map(opened, paths))


def next_day(first: str, twice: str, again: str, appended: str, linked: str) -> dict[str, dict]:
    """What is done with the first file on another day, and the states of the files that are saved."""
    states = {"first": opened(first)}
    states["twice"] = save(Path(twice))
    for kind in KINDS:
        bake(kind)
    states["again"] = save(Path(again))
    for path, link in ((appended, False), (linked, True)):
        bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
        bring = bpy.ops.wm.link if link else bpy.ops.wm.append
        names = [{"name": name} for kind in KINDS for name in lows(kind)]
        assert bring(directory=f"{first}/Object/", files=names) == {"FINISHED"}
        states["linked" if link else "appended"] = save(Path(path))
    return states


def main(name: str, out: str, *arguments: str) -> None:
    import gpu

    import addon

    if hasattr(gpu, "init"):  # see addon/older_blender.py
        gpu.init()
    addon.register()
    result = globals()[name](*arguments)
    Path(out).write_text(json.dumps(result))
    addon.unregister()
    sys.stdout.flush()
    os._exit(0)  # Blender 4.5 hangs where its process ends


if __name__ == "__main__":
    main(*sys.argv[1:])
