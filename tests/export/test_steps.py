# SPDX-License-Identifier: GPL-3.0-or-later
"""An export in steps: the file that is open is the same at each of them, and nothing is written before the last."""

from dataclasses import replace

import bpy
import pytest

from addon.core import progress
from addon.export import engine_files
from tests.export.test_glb import bake, bent_pair, export
from tests.support import scenes, snapshot

pytestmark = pytest.mark.usefixtures("gpu_context")


@pytest.mark.parametrize("ending", [".glb", ".usda", ".fbx"])
def test_the_open_file_is_the_same_at_each_step(tmp_path, ending):
    low, high = bent_pair()
    report = bake(low, high)
    before, shares = snapshot.snapshot(), []
    work = engine_files.work(bpy.context, [[report]], tmp_path / f"out{ending}")
    for step in work:
        shares.append(step.done)
        assert snapshot.difference(before, snapshot.snapshot()) == {}
        assert list(tmp_path.iterdir()) == []
    assert shares == sorted({*shares})
    assert len(shares) > 1
    assert (tmp_path / f"out{ending}").is_file()


def test_an_export_that_is_stopped_leaves_the_file_that_was_there(tmp_path):
    low, high = bent_pair()
    report, path = bake(low, high), tmp_path / "out.glb"
    path.write_bytes(b"before")
    work = engine_files.work(bpy.context, [[report]], path)
    for _ in range(2):
        next(work)
    work.close()
    assert path.read_bytes() == b"before"
    assert list(tmp_path.iterdir()) == [path]
    assert progress.finish(engine_files.work(bpy.context, [[report]], path))
    assert path.read_bytes() != b"before"


def test_what_materials_of_one_object_lack_is_told_of_that_object(tmp_path):
    low, high = bent_pair()
    other = low.copy()
    other.data = low.data.copy()
    other.name = "other"
    bpy.context.scene.collection.objects.link(other)
    for obj in (low, other):
        for number in range(2):
            scenes.material(f"{obj.name} {number}", obj)
        obj.data.polygons[0].material_index = 1
    first, second = (bake(obj, high, image=f"{obj.name} normal") for obj in (low, other))
    done = export(tmp_path / "out.glb", replace(first, slots=[0]), second)
    assert [one.warnings for one in done] == [
        ["The material slot 2 of 'bent' has no maps: bake its texture set as well."],
        [],
    ]
