# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests files without alpha: the colors are the same, what alpha would show is refused or reported, other storage keeps it."""

import bpy
import numpy as np
import pytest
from PIL import Image

from addon.core import file_formats
from addon.core.errors import BakeError
from addon.core.map_types import MISSED, NORMAL, WRITTEN, Labeled
from addon.core.settings import Settings
from addon.output.outputs import MapWriter, Outputs
from tests.support.maps import pixels

WIDTH, HEIGHT = 33, 20
KINDS = [
    (one.endings[0], depth)
    for one in file_formats.FORMATS
    for depth in one.depths
    if not (one.is_blocks or one.has_quality)
]
LABELS = {Labeled.OBJECTS: ["hi"], Labeled.MATERIALS: []}


def texels_with_background(seed=1):
    texels = np.random.default_rng(seed).random((HEIGHT, WIDTH, 4), dtype=np.float32)
    texels[..., 3] = 1.0
    texels[:5] = (0.5, 0.5, 1.0, 0.0)
    return texels


def store(texels, **settings):
    settings = Settings(width=WIDTH, height=HEIGHT, image="map", **settings)
    settings.check()
    with MapWriter("low", settings) as writer:
        writer.add(1001, texels)
        return writer.commit()


@pytest.mark.parametrize(("ending", "depth"), KINDS)
def test_a_file_without_alpha_has_the_same_colors(ending, depth, tmp_path):
    """In Blender, which gives it an alpha of 1, also as the image that shows the map."""
    texels = texels_with_background()
    paths = {has_alpha: str(tmp_path / f"{has_alpha}{ending}") for has_alpha in (True, False)}
    found = {}
    for has_alpha, path in paths.items():
        image = store(texels, storage="FILE", output=path, depth=depth, alpha=has_alpha)
        assert (image.filepath, image.is_dirty, image.channels) == (path, False, 4)
        found[has_alpha] = pixels(image)
    np.testing.assert_array_equal(found[False][..., :3], found[True][..., :3])
    assert (found[False][..., 3] == 1.0).all()
    np.testing.assert_array_equal(found[True][..., 3], texels[..., 3])
    assert image.depth == 3 * (8 if depth == 8 else 32)  # in memory


@pytest.mark.parametrize(("ending", "depth"), KINDS)
def test_a_file_without_alpha_is_smaller_seed_1(ending, depth, tmp_path):
    """Also where few texels are background, so that alpha is mostly 1 and packs well."""
    texels = texels_with_background(seed=1)
    sizes = []
    for has_alpha in (True, False):
        path = tmp_path / f"{has_alpha}{ending}"
        store(texels, storage="FILE", output=str(path), depth=depth, alpha=has_alpha)
        sizes.append(path.stat().st_size)
    assert sizes[1] < sizes[0]


@pytest.mark.parametrize("ending", [".png", ".tif", ".tga"])
def test_another_program_sees_three_channels(ending, tmp_path):
    texels = texels_with_background()
    store(texels, storage="FILE", output=str(tmp_path / f"map{ending}"), depth=8, alpha=False)
    with Image.open(tmp_path / f"map{ending}") as picture:
        assert picture.mode == "RGB"
        found = np.asarray(picture)[::-1]
    np.testing.assert_array_equal(found, np.floor(texels[..., :3] * np.float32(255) + np.float32(0.5)))


@pytest.mark.parametrize("udim", [False, True])
@pytest.mark.parametrize("depth", [8, 32])
def test_packed_images_keep_alpha(udim, depth):
    texels = texels_with_background()
    image = store(texels, storage="PACK", depth=depth, udim=udim, alpha=False)
    np.testing.assert_array_equal(pixels(image)[..., 3], texels[..., 3])


@pytest.mark.parametrize(
    ("packing", "what"),
    [
        ({"pack": "URP"}, "the map Roughness"),
        ({"pack": "HDRP"}, "the map Roughness"),
        ({"pack": "CUSTOM", "pack_alpha": "HEIGHT"}, "the map Height"),
        ({"pack": "CUSTOM", "pack_alpha": "ZERO"}, "a number"),
    ],
)
def test_an_alpha_that_holds_a_map_is_refused(packing, what):
    settings = {"storage": "FILE", "output": "map.png", **packing}
    with pytest.raises(BakeError) as refused:
        Settings(alpha=False, **settings).check()
    assert str(refused.value) == (
        f"The packed image has {what} in its alpha, but the files are to have no alpha: choose one of the two."
    )
    Settings(**settings).check()
    Settings(**{**settings, "pack": "UNREAL"}, alpha=False).check()
    Settings(**{**settings, "storage": "PACK"}, alpha=False).check()


@pytest.mark.parametrize(
    ("settings", "is_missed", "is_reported"),
    [
        ({"alpha": False}, True, True),
        ({"alpha": False}, False, False),
        ({"alpha": False, "mask": True}, True, False),
        ({"alpha": False, "storage": "PACK"}, True, False),
        ({}, True, False),
    ],
)
def test_hidden_misses_are_reported(settings, is_missed, is_reported, tmp_path):
    values = {"storage": "FILE", "output": str(tmp_path / "map.png"), "width": WIDTH, "height": HEIGHT, "image": "map"}
    state = np.full((HEIGHT, WIDTH), WRITTEN, np.uint8)
    state[3, 4] = MISSED if is_missed else WRITTEN
    with Outputs(Settings(**values | settings)) as outputs:
        outputs.add(1001, {NORMAL.name: (texels_with_background(), state)})
        stored = outputs.commit(LABELS, [])
    assert (
        any("hit nothing, and files without alpha do not show which" in text for text in stored.warnings) == is_reported
    )


def test_one_image_can_lose_its_alpha_and_get_it_back(tmp_path):
    texels = texels_with_background()
    for turn, (storage, has_alpha) in enumerate([("FILE", False), ("PACK", True), ("FILE", True), ("FILE", False)] * 2):
        path = str(tmp_path / "map.png") if storage == "FILE" else ""
        image = store(texels, storage=storage, output=path, depth=8, alpha=has_alpha)
        alpha = texels[..., 3] if has_alpha else np.ones((HEIGHT, WIDTH), np.float32)
        np.testing.assert_array_equal(pixels(image)[..., 3], alpha, err_msg=str(turn))
    assert len(bpy.data.images) == 1
