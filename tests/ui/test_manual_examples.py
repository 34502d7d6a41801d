# SPDX-License-Identifier: GPL-3.0-or-later
"""The examples of operators in the manual work."""

import bpy
import pytest

from scripts.imprint import ROOT
from tests.support import zoo
from tests.support.manual import blocks

pytestmark = pytest.mark.usefixtures("gpu_context", "registered")


def test_the_examples_of_operators_bake(tmp_path):
    zoo.plane("rock_low")
    zoo.plane("rock_high", slope=0.2)
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "rock.blend"))
    (example,) = (text for _, text in blocks(ROOT / "docs" / "python.md") if text.startswith("import bpy"))
    exec(example.replace("1024", "32").replace("last=48", "last=2"))
    maps = {"rock.exr", "rock_ao.png", "rock_curvature.png", "rock_001.png", "rock_002.png"}
    assert {path.name for path in tmp_path.iterdir()} == {"rock.blend"} | maps
    assert bpy.data.images["rock_low_normal"].size[:] == (32, 32)
