# SPDX-License-Identifier: GPL-3.0-or-later
"""Exports .glb files with KTX2 textures by libktx, where Blender has it: the newest version runs these tests, too."""

import numpy as np
import pytest

from addon.core.errors import BakeError
from addon.core.settings import Settings
from addon.export import basis_textures, binary_gltf
from tests.export.test_glb import bake, bent_pair, export
from tests.support import angles, glb

pytestmark = pytest.mark.usefixtures("gpu_context")
has_library = pytest.mark.skipif(basis_textures._library() is None, reason="Blender 5.3 and later have libktx")
EXTENSION = binary_gltf.EXTENSIONS[binary_gltf.KTX2]


def bumps(size):
    """Normals (size, size, 4) uint8."""
    v, u = np.mgrid[:size, :size] / size * 2.0 * np.pi
    normals = np.dstack([0.3 * np.sin(2 * u), 0.3 * np.cos(3 * v), np.ones_like(u)])
    normals /= np.linalg.norm(normals, axis=2, keepdims=True)
    return np.dstack([np.round(127.5 + 127.5 * normals), np.full((size, size), 255.0)]).astype(np.uint8)


@pytest.mark.skipif(basis_textures._library() is not None, reason="of versions without libktx")
def test_a_blender_without_the_library_says_so(tmp_path):
    low, high = bent_pair()
    with pytest.raises(BakeError, match="has no libktx 4"):
        export(tmp_path / "out.glb", bake(low, high, export_ktx2=True))
    assert not (tmp_path / "out.glb").exists()


def test_one_format_of_textures_is_chosen():
    settings = Settings(export_webp=True, export_ktx2=True)
    assert any("both WebP and KTX2" in text for text in settings.problems())


@pytest.mark.parametrize("size", [(12, 20), (4, 4), (1, 3)])
def test_levels_are_means(size):
    texels = np.random.default_rng(1).integers(0, 256, (*size, 4), np.uint8)
    found = basis_textures._halved(texels, is_color=False, is_normal=False)
    assert found.shape == (max(1, size[0] // 2), max(1, size[1] // 2), 4)
    if not size[0] % 2:
        means = texels.reshape(size[0] // 2, 2, size[1] // 2, 2, 4).mean(axis=(1, 3))
        assert np.abs(found - means).max() <= 0.501
    white = np.full((*size, 4), 200, np.uint8)
    for kind in ({"is_color": True, "is_normal": False}, {"is_color": False, "is_normal": False}):
        assert np.abs(basis_textures._halved(white, **kind).astype(int) - 200).max() <= 1


def test_black_and_white_have_the_mean_of_light():
    texels = np.zeros((2, 2, 4), np.uint8)
    texels[0] = 255
    assert basis_textures._halved(texels, is_color=True, is_normal=False)[0, 0].tolist() == [188, 188, 188, 128]
    texels[:, 0], texels[:, 1] = (255, 128, 128, 255), (128, 128, 255, 255)
    slope = round(127.5 + 127.5 * np.sqrt(0.5))
    found = basis_textures._halved(texels, is_color=False, is_normal=True)[0, 0]
    assert np.abs(found.astype(int) - (slope, 128, slope, 255)).max() <= 1


@has_library
@pytest.mark.parametrize(("quality", "most"), [(100, 1.5), (80, 10.0)])
def test_normals_keep_their_directions(quality, most):
    texels = bumps(64)
    data = basis_textures.encoded(texels, is_color=False, is_normal=True, quality=quality)
    assert data.startswith(basis_textures.MAGIC)
    assert int.from_bytes(data[40:44], "little") == 7  # levels
    assert int.from_bytes(data[44:48], "little") == (2 if quality == 100 else 1)  # Zstandard, or BasisLZ
    found = basis_textures.decoded(data)
    off = angles.degrees(*(angles.decode(each[..., :3] / 255.0) for each in (found, texels)))
    assert np.percentile(off, 99) < most
    if quality == 100:
        assert off.mean() < 0.5


@has_library
@pytest.mark.parametrize("values", [{}, {"quality": 60, "lossy_normals": True}])
def test_a_glb_shows_ktx2(tmp_path, values):
    low, high = bent_pair()
    (plain,) = export(tmp_path / "png.glb", bake(low, high, maps=("AO",), rays=16))
    (done,) = export(tmp_path / "out.glb", bake(low, high, maps=("AO",), rays=16, export_ktx2=True, **values))
    tree, binary = glb.parse(tmp_path / "out.glb")
    assert {image["mimeType"] for image in tree["images"]} == {"image/ktx2"}
    assert EXTENSION in tree["extensionsRequired"]
    (material,) = tree["materials"]
    number = tree["textures"][material["normalTexture"]["index"]]["extensions"][EXTENSION]["source"]
    view = tree["bufferViews"][tree["images"][number]["bufferView"]]
    assert binary[view.get("byteOffset", 0) :][:12] == basis_textures.MAGIC
    median = done.measured.degrees["MIKKTSPACE"]["median"]
    assert plain.measured.degrees["MIKKTSPACE"]["median"] < median < (12.0 if values else 2.5)
