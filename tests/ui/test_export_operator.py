# SPDX-License-Identifier: GPL-3.0-or-later
"""The button Export for Engine: it writes the last bake's maps to the file of the panel, and the report says what it shows."""

import bpy
import pytest

from addon.ui.bake_results import results
from tests.export.test_glb import bent_pair
from tests.support import panel_layout, zoo

pytestmark = pytest.mark.usefixtures("registered", "gpu_context")


@pytest.fixture
def low():
    low, high = zoo.plane("lo"), zoo.plane("hi", slope=0.2)
    settings = bpy.context.scene.imprint
    settings.low, settings.method, settings.width, settings.height = low, "FLATTEN", 64, 64
    settings.highs.add().object = high
    return low


def test_there_is_nothing_to_export_before_a_bake(low):
    assert not bpy.ops.imprint.export.poll()


def test_the_button_writes_the_file_of_the_panel(low, tmp_path):
    bpy.ops.imprint.bake()
    bpy.context.scene.imprint.export = str(tmp_path / "{low}.glb")
    assert bpy.ops.imprint.export() == {"FINISHED"}
    assert (tmp_path / "lo.glb").is_file()
    (report,) = results.all_of(bpy.context, low)
    assert report.export["files"] == [str(tmp_path / "lo.glb")]
    assert "lo.glb: 2 triangles, read back" in "\n".join(report.summary())


def test_an_error_is_told(low, tmp_path):
    bpy.ops.imprint.bake()
    with pytest.raises(RuntimeError, match=r"is no file for an engine: .glb"):
        bpy.ops.imprint.export(filepath=str(tmp_path / "lo.obj"))
    with pytest.raises(RuntimeError, match="No file is set"):
        bpy.ops.imprint.export()


def test_the_panel_keeps_the_warnings_of_the_file(tmp_path):
    """Two triangles of a bent quad have other tangents than the quad."""
    low, high = bent_pair()
    settings = bpy.context.scene.imprint
    settings.low, settings.method, settings.width, settings.height = low, "FLATTEN", 64, 64
    settings.highs.add().object = high
    bpy.ops.imprint.bake()
    bpy.ops.imprint.export(filepath=str(tmp_path / "lo.fbx"))
    assert "Engines make their own tangents of this file" in panel_layout.draw(width=2000).text
    bpy.ops.imprint.export(filepath=str(tmp_path / "lo.glb"))
    assert "Engines make their own tangents of this file" not in panel_layout.draw(width=2000).text


def test_the_file_browser_lists_the_formats_and_warns_of_existing_files():
    kind = bpy.ops.imprint.export.get_rna_type().properties
    assert kind["filter_glob"].default == "*.glb;*.usd;*.usda;*.usdc;*.fbx"
    assert kind["check_existing"].default
