# SPDX-License-Identifier: GPL-3.0-or-later
"""Checks the outcome of any bake: either a map, or one message and no change."""

import json
import re
import warnings
from pathlib import Path

import bpy
import numpy as np

from addon.core import map_types
from addon.core.errors import BakeError
from addon.jobs import bake_jobs, bake_pair
from addon.output import image_file, map_names
from tests.support import maps
from tests.support.snapshot import difference, snapshot

LONGEST = 400
"""The longest message, in characters."""
ANY_FLOAT = {map_types.Family.MATERIAL, map_types.Family.CURVATURE}
"""Maps that floats store beyond 0 and 1: values of materials, and edges sharper than 90 degrees."""


def of_bake(low, highs, settings, folder, cage=None):
    """Bake and check the outcome. Returns the report, or the message of the error. folder: the folder of the output."""
    before, files = snapshot(), set(folder.rglob("*"))
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        try:
            report = bake_pair(bpy.context, low, highs, settings, cage)
        except BakeError as error:
            report, sentence = None, str(error)
    assert not caught, [f"{warning.filename}:{warning.lineno} {warning.message}" for warning in caught]
    changed, written = difference(before, snapshot()), set(folder.rglob("*")) - files
    if report is None:
        _check_sentence(sentence)
        assert not changed, str(changed)[:LONGEST]
        assert not written, written
        return sentence
    _check_report(report)
    filled = bake_jobs.for_low(settings, report.low)
    plan = map_names.settings_by_map(filled)
    _check_changes(changed, low, [map_settings.storing.image for map_settings in plan.values()])
    expected = set()
    for name, map_settings in plan.items():
        map_type = map_types.BY_NAME[name]
        is_unit = map_type.range is map_types.Range.UNIT and map_type.family not in ANY_FLOAT
        is_color = is_unit or not map_settings.storing.is_float
        image, path = bpy.data.images[map_settings.storing.image], map_names.output_for(map_settings)
        if settings.sampling.udim:
            assert image.source == "TILED"
            assert [tile.number for tile in image.tiles if tile.size[0]] == sorted(report.tiles)
        else:
            _check_image(image, map_settings, is_color=is_color)
            assert name != "NORMAL" or (maps.pixels(image)[..., 3] == 1.0).any()
        for tile in report.tiles if path else ():
            file = Path(path.replace("<UDIM>", str(tile)))
            expected.add(file)
            _check_file(file, map_settings, is_color=is_color)
    assert written == expected, written
    assert {Path(path) for path in report.output} == expected
    return report


def _check_sentence(text):
    assert re.match(r"[A-Z'\"]", text), text
    assert text.endswith("."), text
    assert len(text) < LONGEST, text
    assert "\n" not in text, text
    assert not re.search(r"Traceback|<class|<bpy|object at 0x|array\(|Error:", text), text


def _check_report(report):
    data = json.loads(json.dumps(report.to_dict(), allow_nan=False))
    assert 0.0 < data["coverage"] <= 1.0
    assert all(0.0 <= data[name] <= 1.0 for name in ("missed", "margin", "overlap"))
    assert all(line and "\n" not in line for line in (*data["warnings"], *report.summary()))


def _check_changes(changed, low, names):
    """Only the images, the materials with their groups and the material slots of the low mesh may have changed."""
    sharers = {obj.name_full for obj in bpy.data.objects if obj.data == low.data}
    for key in changed:
        kind, name = key if isinstance(key, tuple) else (key, None)
        allowed = {
            "images": [name],
            "node_groups": [name],
            "materials": [name],
            "material": [name],
            "image": names,
            "object": sharers,
        }
        assert name in allowed.get(kind, ()), (key, str(changed[key])[:LONGEST])


def _check_file(path, settings, *, is_color):
    if settings.storing.is_blocks:  # Blender reads some of them
        _check_texels(image_file.read(path), settings, is_color=is_color)
        return
    image = bpy.data.images.load(str(path))
    image.colorspace_settings.is_data, image.alpha_mode = True, "CHANNEL_PACKED"
    try:
        _check_image(image, settings, is_color=is_color)
    finally:
        bpy.data.images.remove(image)


def _check_image(image, settings, *, is_color):
    assert tuple(image.size) == settings.sampling.size
    texels = maps.pixels(image)
    # Blender rounds where it shows 16 bits of sRGB as scene-linear colors.
    most = 1.0 if image.colorspace_settings.is_data else 1.0 + 1e-4
    _check_texels(texels, settings, is_color=is_color, most=most)


def _check_texels(texels, settings, *, is_color, most=1.0):
    assert texels.shape[1::-1] == settings.sampling.size
    assert np.isfinite(texels).all()
    if is_color:
        assert texels.min() >= 0.0
        assert texels.max() <= most
    alpha = texels[..., 3]
    if settings.storing.is_blocks:
        assert (np.abs(alpha - 0.5) > 0.1).all()  # a cut-out keeps its outline
    elif not settings.storing.is_float:
        assert set(np.unique(alpha)) <= {0.0, 1.0}
