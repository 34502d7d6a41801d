# SPDX-License-Identifier: GPL-3.0-or-later
"""Writes a small .blend file as an older version of Imprint does, for tests/ui/test_properties.py.

    git worktree add ../older COMMIT
    .venv/bin/python -m tests.support.older_file ../older tests/support/data/version_0.3.blend

The file has two scenes. All settings of "changed" have other values than their defaults; "baked" was baked by the button. What
they had is in their custom property `expected`, as JSON, with the items of each list of choices in the order of their numbers.
"""

import json
import sys
from pathlib import Path

import bpy
import gpu

SIZE = 16


def main(checkout: str, out: str) -> None:
    sys.path.insert(0, str(Path(checkout).resolve()))
    import addon  # of the older version

    gpu.init()
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    addon.register()
    scenes = [fill("changed"), fill("baked")]
    change(scenes[0].imprint)
    scenes[0].imprint.cage = scenes[0].imprint.highs[0].object
    scenes[1].imprint.width = scenes[1].imprint.height = SIZE
    assert bpy.ops.imprint.bake() == {"FINISHED"}
    for scene in scenes:
        scene["expected"] = json.dumps({"values": values(scene.imprint), "items": items(scene.imprint)})
    bpy.data.libraries.write(str(Path(out).resolve()), {*scenes}, compress=True)
    addon.unregister()


def fill(name: str) -> bpy.types.Scene:
    """A scene with a low and a high object in the slots."""
    scene = bpy.data.scenes.new(name)
    bpy.context.window.scene = scene
    settings = scene.imprint
    for kind, z in (("low", 0.0), ("high", 0.2)):
        mesh = bpy.data.meshes.new(f"{name} {kind}")
        mesh.from_pydata(
            [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0.5, 0.5, z)],
            [],
            [(0, 1, 4), (1, 2, 4), (2, 3, 4), (3, 0, 4)],
        )
        corners = [value for loop in mesh.loops for value in mesh.vertices[loop.vertex_index].co[:2]]
        mesh.uv_layers.new(name="UVMap").uv.foreach_set("vector", corners)
        obj = bpy.data.objects.new(mesh.name, mesh)
        scene.collection.objects.link(obj)
        if kind == "low":
            settings.low = obj
        else:
            settings.highs.add().object = obj
    bpy.context.view_layer.update()
    return scene


def change(settings: bpy.types.PropertyGroup) -> None:
    """Give each setting another value than its default: the last item of choices, and numbers beside the default."""
    for setting in settings.bl_rna.properties:
        name = setting.identifier
        follows = name in {"names", "size", "engine"} or name.startswith("bakes_") or name.endswith("_length")
        if setting.is_readonly or follows or name == "name":
            continue
        if setting.type == "ENUM":
            last = setting.enum_items[-1].identifier
            setattr(settings, name, {last} if setting.is_enum_flag else last)
        elif setting.type == "BOOLEAN":
            setattr(settings, name, not setting.default)
        elif setting.type == "INT":
            setattr(settings, name, min(setting.default + 1, setting.hard_max))
        elif setting.type == "FLOAT" and not setting.is_array:
            setattr(settings, name, min(setting.default + 0.25, setting.hard_max))
        elif setting.type == "STRING":
            setattr(settings, name, "//maps/changed.png" if name == "output" else f"own {name}")


def values(settings: bpy.types.PropertyGroup) -> dict:
    """The value of each setting, with the names of objects."""
    found = {}
    for setting in settings.bl_rna.properties:
        value = getattr(settings, setting.identifier)
        if setting.type == "ENUM":
            found[setting.identifier] = sorted(value) if setting.is_enum_flag else value
        elif setting.type == "COLLECTION":
            found[setting.identifier] = [slot.object.name for slot in value]
        elif setting.type == "POINTER":
            found[setting.identifier] = value.name if isinstance(value, bpy.types.ID) else None
        elif setting.type == "FLOAT" and setting.is_array:
            found[setting.identifier] = list(value)
        else:
            found[setting.identifier] = value
    return found


def items(settings: bpy.types.PropertyGroup) -> dict[str, dict[str, int]]:
    """The numbers that files have for the items of each list of choices."""
    lists = [setting for setting in settings.bl_rna.properties if setting.type == "ENUM"]
    return {found.identifier: {item.identifier: item.value for item in found.enum_items} for found in lists}


if __name__ == "__main__":
    main(*sys.argv[1:])
