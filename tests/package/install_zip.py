# SPDX-License-Identifier: GPL-3.0-or-later
"""Installs an extension's zip as a user does, enables it, uses it, disables it, and uninstalls it.

test_build.py starts this in a separate process outside the checkout, so that the add-on can come only from the zip. In a real
Blender, scripts/dev/in_blender.py does, with the zip after "--". A backend before the zip is one that has to draw.
"""

import math
import pathlib
import sys

import bpy

MODULE = "bl_ext.user_default.imprint"


def install(archive):
    """Install the zip into the user's repository and enable it."""
    bpy.ops.extensions.package_install_files(filepath=archive, repo="user_default", enable_on_install=True)
    assert MODULE in bpy.context.preferences.addons, f"{MODULE} is not enabled"


def use():
    """Bake a tilted plane onto a flat one, with the installed add-on. Returns the name of the backend."""
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    bpy.ops.mesh.primitive_plane_add(rotation=(0.5, 0.0, 0.0))
    high = bpy.context.object
    bpy.ops.mesh.primitive_plane_add()
    low = bpy.context.object
    high.select_set(True)
    assert bpy.ops.imprint.bake(method="FLATTEN", width=16, height=16) == {"FINISHED"}
    image = bpy.data.images[f"{low.name}_normal"]
    assert abs(image.pixels[1] - (0.5 - 0.5 * math.sin(0.5))) < 1e-3, tuple(image.pixels[:4])
    assert any(node.type == "NORMAL_MAP" for node in low.data.materials[0].node_tree.nodes)
    return sys.modules[f"{MODULE}.addon.ui.bake_results"].results.of(bpy.context, low).backend


def remove():
    """Disable the add-on, and then uninstall it, which leaves nothing of it."""
    bpy.ops.preferences.addon_disable(module=MODULE)
    assert MODULE not in bpy.context.preferences.addons, f"{MODULE} is still enabled"
    repositories = bpy.context.preferences.extensions.repos
    index, repository = next((index, one) for index, one in enumerate(repositories) if one.module == "user_default")
    bpy.ops.extensions.package_uninstall(repo_index=index, pkg_id="imprint")
    left = [path for path in pathlib.Path(repository.directory).rglob("*") if "imprint" in path.name]
    assert not left, left
    assert not hasattr(bpy.types.Scene, "imprint")


if __name__ == "__main__":
    install(sys.argv[-1])
    backend = use()
    remove()
    print(f"Blender {bpy.app.version_string}, {backend}")
    print("installed, used and removed")
