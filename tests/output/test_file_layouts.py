# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests what files of TIFF, Targa and OpenEXR hold beside their texels, and what writes them."""

import importlib
import re
import sys

import numpy as np
import pytest

from addon.core import file_formats
from addon.core.errors import BakeError
from addon.core.settings import Settings
from addon.output import image_file, outputs
from tests.support import pictures


@pytest.mark.filterwarnings("error")
def test_an_exr_keeps_values_that_are_no_numbers(tmp_path):
    texels = np.zeros((2, 3, 4), np.float32)
    texels[0, 0], texels[1, 1, 2] = np.nan, np.inf
    for depth in (16, 32):
        image_file.write(texels, tmp_path / "map.exr", depth)
        most = 65504 if depth == 16 else None  # a half float holds no more
        np.testing.assert_array_equal(pictures.read(tmp_path / "map.exr"), texels.clip(None, most))


@pytest.mark.parametrize("ending", sorted(file_formats.BY_ENDING))
def test_files_have_no_time_which_would_differ_in_equal_bakes(ending, tmp_path):
    path, depth = tmp_path / f"map{ending}", file_formats.BY_ENDING[ending].depths[0]
    image_file.write(np.ones((2, 3, 4), np.float32), path, depth)
    found = re.findall(rb"\d{4}:\d\d:\d\d \d\d:\d\d:\d\d", path.read_bytes())
    assert set(found) <= {b"0000:00:00 00:00:00"}


def test_a_blender_without_openimageio_names_it_before_the_bake_and_writes_png(tmp_path, monkeypatch):
    def fail(name):
        raise ModuleNotFoundError(f"No module named {name!r}")

    image_file._library.cache_clear()
    monkeypatch.setattr(importlib, "import_module", fail)
    path = list(sys.path)
    for ending, file_format in file_formats.BY_ENDING.items():
        output, depth = str(tmp_path / f"map{ending}"), file_format.depths[0]
        settings = Settings(storage="FILE", output=output, depth=depth)
        if file_format is file_formats.PNG:
            outputs.check_storage("low", settings)
            continue
        with pytest.raises(BakeError, match="lacks the Python module OpenImageIO, .*: choose PNG, or install"):
            outputs.check_storage("low", settings)
    with pytest.raises(BakeError, match="OpenImageIO"):
        outputs.check_storage("low", Settings(storage="PACK", udim=True, depth=32))
    outputs.check_storage("low", Settings(storage="PACK", udim=True, depth=8))
    assert sys.path == path


def test_the_path_of_modules_stays_as_it_was(tmp_path):
    image_file._library.cache_clear()
    path = list(sys.path)
    image_file.check_format(tmp_path / "map.exr")
    assert sys.path == path
