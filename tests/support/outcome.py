# SPDX-License-Identifier: GPL-3.0-or-later
"""What every bake must end in, whatever goes into it: a map, or one sentence and nothing changed."""

import json
import re
import warnings
from dataclasses import replace
from pathlib import Path

import bpy
import numpy as np

from addon.core import file_names, map_types
from addon.core.errors import BakeError
from addon.jobs import bake_pair
from addon.output import image_writer, output_clashes
from tests.support import maps
from tests.support.snapshot import difference, snapshot

LONGEST = 400
"""Characters of a sentence that a person still reads."""


def of_bake(low, highs, settings, folder, cage=None):
    """The report of a bake, or the sentence with which it was refused; what both leave behind has been looked at.

    folder: where the settings' output lies.
    """
    before, files = snapshot(), set(folder.rglob("*"))
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        try:
            report = bake_pair(bpy.context, low, highs, settings, cage)
        except BakeError as error:
            report, sentence = None, str(error)
    assert not told, [f"{warning.filename}:{warning.lineno} {warning.message}" for warning in told]
    changed, written = difference(before, snapshot()), set(folder.rglob("*")) - files
    if report is None:
        _check_sentence(sentence)
        assert not changed, changed
        assert not written, written
        return sentence
    _check_report(report)
    filled = replace(settings, image=report.image, output=file_names.fill(settings.output, report.low))
    plan = output_clashes.settings_by_map(filled)
    _check_changes(changed, low, [own.image for own in plan.values()])
    expected = set()
    for name, own in plan.items():
        is_color = map_types.BY_NAME[name].range is map_types.Range.UNIT or not own.is_float
        image, path = bpy.data.images[own.image], image_writer.output_for(own)
        if settings.udim:
            assert image.source == "TILED"
            assert [tile.number for tile in image.tiles if tile.size[0]] == sorted(report.tiles)
        else:
            _check_image(image, own, is_color=is_color)
            assert name != "NORMAL" or (maps.pixels(image)[..., 3] == 1.0).any()
        for tile in report.tiles if path else ():
            file = Path(path.replace("<UDIM>", str(tile)))
            expected.add(file)
            _check_file(file, own, is_color=is_color)
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
    """Of the file nothing has changed but the images, the materials, and which of them the low mesh has."""
    sharers = {obj.name_full for obj in bpy.data.objects if obj.data == low.data}
    for key in changed:
        kind, name = key if isinstance(key, tuple) else (key, None)
        allowed = {"images": [name], "materials": [name], "material": [name], "image": names, "object": sharers}
        assert name in allowed.get(kind, ()), (key, changed[key])


def _check_file(path, settings, *, is_color):
    image = bpy.data.images.load(str(path))
    image.colorspace_settings.is_data, image.alpha_mode = True, "CHANNEL_PACKED"
    try:
        _check_image(image, settings, is_color=is_color)
    finally:
        bpy.data.images.remove(image)


def _check_image(image, settings, *, is_color):
    assert tuple(image.size) == (settings.width, settings.height)
    texels = maps.pixels(image)
    assert np.isfinite(texels).all()
    if is_color:
        assert texels.min() >= 0.0
        assert texels.max() <= 1.0
    if not settings.is_float:
        assert set(np.unique(texels[..., 3])) <= {0.0, 1.0}
