# SPDX-License-Identifier: GPL-3.0-or-later
"""Bakes through the Python door of the package `imprint`, or of the extension in a zip, which is installed first.

test_python.py starts this outside the checkout. In a real Blender, with a zip that `imprint.py build` made:

    blender --background --factory-startup --python-exit-code 1 --python tests/package/use_python.py -- ZIP
"""

import importlib
import math
import sys
import tempfile
from pathlib import Path

import bpy
import numpy as np

ANGLE = 0.3
FLAT = np.float32([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]])
TRIANGLES = np.array([[0, 1, 2], [0, 2, 3]])
NORMAL = np.array([0.5, 0.5 - 0.5 * math.sin(ANGLE), 0.5 + 0.5 * math.cos(ANGLE)])
"""The color of a plane that is tilted by ANGLE around X."""
ROUNDING = 2e-3
"""Of 8 bits, in a file."""


def door(archive):
    """The package, from a zip of the extension if one is given."""
    if archive is None:
        return importlib.import_module("imprint")
    bpy.ops.extensions.package_install_files(filepath=archive, repo="user_default", enable_on_install=True)
    return importlib.import_module("bl_ext.user_default.imprint")


def tilted():
    points = FLAT.copy()
    points[:, 2] = points[:, 1] * math.tan(ANGLE)
    return points


def blocks():
    """How many datablocks of each kind the open file has."""
    return {name: len(getattr(bpy.data, name)) for name in ("objects", "meshes", "materials", "images")}


def use(imprint, folder):
    low = imprint.Surface(FLAT, TRIANGLES, (FLAT[:, :2] + 1) / 2)
    high = imprint.Surface(tilted(), TRIANGLES)
    before = blocks()
    result = imprint.bake(low, high, maps=["normal", "height"], size=32)
    assert set(result.maps) == {"normal", "height"}, result.maps.keys()
    assert result.maps["normal"].shape == (32, 32, 4)
    assert np.abs(result.maps["normal"][..., :3] - NORMAL).max() < 1e-3
    rows = (np.arange(32) + 0.5) / 16 - 1
    assert np.abs(result.maps["height"][..., 0] - rows[:, None] * math.tan(ANGLE)).max() < 1e-3
    assert result.files == []
    assert blocks() == before

    path = Path(folder, "maps", "plane.png")
    result = imprint.bake(low, high, size=(32, 16), output=path, samples=4, space="object")
    assert [Path(name) for name in result.files] == [path.absolute()]
    assert path.is_file()
    assert np.abs(result.maps["normal"][..., :3] - NORMAL).max() < ROUNDING
    assert blocks() == before

    bpy.ops.mesh.primitive_plane_add(size=2.0)
    obj = bpy.context.object
    before = blocks()
    assert np.abs(imprint.bake(obj, [high], size=16).maps["normal"][..., :3] - NORMAL).max() < 1e-3
    assert blocks() == before
    assert not obj.data.materials

    for wrong, words in (
        ({"low": imprint.Surface(FLAT, TRIANGLES)}, "no UVs"),
        ({"maps": ["norml"]}, "did you mean 'normal'"),
        ({"sample": 4}, "did you mean 'samples'"),
    ):
        try:
            imprint.bake(**{"low": low, "high": high, "size": 16} | wrong)
        except imprint.BakeError as error:
            assert words in str(error), error
        else:
            raise AssertionError(f"no error for {wrong}")
    assert blocks() == before


if __name__ == "__main__":
    arguments = sys.argv[sys.argv.index("--") + 1 :] if "--" in sys.argv else sys.argv[1:]
    with tempfile.TemporaryDirectory() as scratch:
        use(door(*arguments or [None]), scratch)
    print("baked through the door")
