# SPDX-License-Identifier: GPL-3.0-or-later
"""Runs tests of the passes and of bakes once more, with samplers in place of images: the way of all GPUs."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests.support import lanes

ROOT = Path(__file__).parents[2]
FILES = {
    "rays": ["passes/test_drawn_rays.py", "passes/test_drawn_rays.py", "engine/test_flat_and_rays.py"],
    "owned hits": ["passes/test_owned_hits.py", "engine/test_unsure_texels.py"],
    "rays from hits": ["passes/test_openness.py", "passes/test_curvature.py", "engine/test_ray_maps.py"],
    "materials": ["passes/test_image_look_up.py", "passes/test_image_look_up.py", "engine/test_material_maps.py"],
    "normals of materials": ["passes/test_turned_normals.py", "engine/test_own_normals.py"],
    "margins": ["passes/test_margin_search.py", "engine/test_margins.py"],
    "samples": ["engine/test_samples.py", "engine/test_samples.py", "passes/test_slope_moments.py"],
}


@pytest.mark.slow
@pytest.mark.parametrize("files", FILES.values(), ids=FILES)
def test_what_images_read_is_what_samplers_read(files):
    paths = [str(ROOT / "tests" / name) for name in files]
    words = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "-p", "no:xdist", "-m", "not slow", *paths]
    done = subprocess.run(
        words, cwd=ROOT, env={**os.environ, lanes.SAMPLERS: "1"}, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stdout[-4000:]
