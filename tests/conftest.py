# SPDX-License-Identifier: GPL-3.0-or-later
"""Fixtures for all tests: a temporary profile, an empty scene, a GPU, and the real meshes.

The fixtures import bpy, not this module: tests/pure does not use them, and runs without bpy.
"""

import atexit
import os
import shutil
import signal
import sys
import tempfile
from pathlib import Path

import pytest

from scripts import imprint

# This comes before the import of bpy, which reads it once. No test may use the user's Blender settings.
_profile = tempfile.mkdtemp(prefix="imprint-profile-")
atexit.register(shutil.rmtree, _profile, ignore_errors=True)
os.environ["BLENDER_USER_RESOURCES"] = _profile

# Shells ignore these for what they start in the background, and with nohup.
for _name, _handler in (("SIGINT", signal.default_int_handler), ("SIGHUP", signal.SIG_DFL)):
    if signal.getsignal(getattr(signal, _name, signal.SIGTERM)) is signal.SIG_IGN:
        signal.signal(getattr(signal, _name), _handler)

ASSETS = imprint.ROOT.parent / "shared" / "assets"


LONGEST = (
    *("test_other_drivers", "test_asset", "test_same_versions", "test_asset_zoo", "test_random", "test_bake_queue"),
    *("test_blender_engines", "test_cycles_maps", "test_right_layer", "test_part_state", "test_spirv", "test_uses"),
    *("test_agent_tools", "test_one_more_map", "test_appearance", "test_saved_files", "test_own_materials"),
    *("test_right_highs", "test_slices", "test_samples", "test_every_texel", "test_operators", "test_site"),
)
"""The files that take longest, with the slow tests. They come first, so that no process is left with one at the end."""


def pytest_collection_modifyitems(items):
    """Keep the order of the tests of a file, which runs in one process."""
    places = {name: place for place, name in enumerate(LONGEST)}
    items.sort(key=lambda item: places.get(item.path.stem, len(places)))


@pytest.fixture(scope="session")
def empty_file(tmp_path_factory):
    """An empty file with factory settings and one workspace: it loads in half the time that all workspaces take."""
    import bpy

    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    bpy.data.batch_remove([each for each in bpy.data.workspaces if each != bpy.context.window.workspace])
    path = str(tmp_path_factory.mktemp("empty") / "empty.blend")
    bpy.ops.wm.save_as_mainfile(filepath=path, copy=True)
    return path


@pytest.fixture(scope="session")
def driver():
    """Programs do what those on real GPUs do, or what IMPRINT_TEST_DRIVER names."""
    from tests.support import drivers

    drivers.imitate(drivers.named())


@pytest.fixture(autouse=True)
def empty_scene(empty_file, driver):
    """An empty file with factory settings for each test, of whose meshes nothing is remembered."""
    import bpy

    from addon.engine import coverage, draw_order, orienting

    for each in (coverage, draw_order, orienting):
        each.known.clear()
    bpy.ops.wm.read_homefile(filepath=empty_file, use_empty=True)


@pytest.fixture(scope="session")
def gpu_context():
    """A GPU to draw on. Without one, tests fail: skipped tests would look like success."""
    import bpy
    import gpu

    import addon

    if bpy.app.module:  # and not a program that has a GPU already
        code, output = imprint.probe(sys.executable)  # in a separate process, because a missing EGL kills it
        if code:
            pytest.fail(f"gpu.init() ended with {code}: {output}", pytrace=False)
    gpu.init()
    yield
    addon.free()


@pytest.fixture(scope="session")
def shared_assets() -> Path:
    """The folder of the real meshes, ../shared/assets, for tests marked `shared`."""
    if not ASSETS.is_dir():
        reason = f"the real meshes are not at {ASSETS}"
        if os.environ.get("CI") == "true":
            pytest.fail(reason, pytrace=False)
        pytest.skip(reason)
    return ASSETS


@pytest.fixture(scope="module")
def registered():
    """The add-on, registered as Blender does when the extension is enabled."""
    import addon

    addon.register()
    yield
    addon.unregister()
