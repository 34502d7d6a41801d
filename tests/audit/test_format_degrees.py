# SPDX-License-Identifier: GPL-3.0-or-later
"""Angles of programs are those of the map as it is stored, and of what compressors leave of it."""

import struct

import bpy
import numpy as np
import pytest

from addon.blocks.formats import BC5, Purpose
from addon.cli import limits
from addon.core.declarations import targets
from addon.core.errors import BakeError
from addon.jobs import bake_pair
from addon.output import image_file, outputs, value_encoding
from addon.passes import block_encoding
from tests.audit.test_other_targets import decode, terrains
from tests.support import angles, block_oracle, scenes, zoo
from tests.support.maps import pixels
from tests.support.seen_frames import frames

pytestmark = pytest.mark.usefixtures("gpu_context")

SIZE = (96, 64)
CLOSE = 0.003
PERCENTS = {"median": 50, "percentile_95": 95, "percentile_99": 99}
COMPRESSING = [target for target in targets.TARGETS if target.compresses]


def settings_of(path=None, **values):
    """Of a bake into a file, or without a path into an image of floats."""
    width, height = values.pop("size", SIZE)
    storage = {"storage": "FILE", "output": str(path), "depth": 8} if path else {"depth": 32}
    given = {"width": width, "height": height, "basis": "CYCLES", "targets": ("three", "unreal")}
    return scenes.settings(**given | storage | values)


def normals(size, seed=5):
    """A map of smooth and rough unit normals that point up, (height, width, 4)."""
    generator = np.random.default_rng(seed)
    width, height = size
    texels = np.ones((height, width, 4), np.float32)
    up = 0.3 * generator.normal(size=(height, width, 3)) * np.linspace(0.0, 1.0, width)[:, None] + (0.1, -0.2, 1.0)
    up[..., 2] = np.abs(up[..., 2]) + 0.1
    texels[..., :3] = 0.5 + 0.5 * up / np.linalg.norm(up, axis=-1, keepdims=True)
    return texels


def by_hand(texels, purpose):
    """Red and green (height, width, 2) of texels once they are blocks, by a decoder of the tests."""
    height, width = texels.shape[:2]
    padded = np.pad(texels[::-1], ((0, -height % 4), (0, -width % 4), (0, 0)), mode="edge")
    blocks = block_encoding.encoded(padded, BC5, purpose)
    rows, columns = blocks.shape[:2]
    both = np.dstack([block_oracle.decoded(blocks.reshape(-1, 16)[:, half]) for half in (slice(8), slice(8, 16))])
    whole = both.reshape(rows, columns, 4, 4, 2).swapaxes(1, 2).reshape(4 * rows, 4 * columns, 2)
    return whole[:height, :width][::-1]


def off(low, meant, kept, chosen, target):
    """The angles (N,) between the normals that `meant` means and those that a program shows of `kept`, in float64."""
    seen = frames(low, SIZE)
    shown = decode(kept[..., :3].astype(np.float64), ("+X", target.green, "+Z"))
    if target.rebuilds_z:
        shown[..., 2] = np.sqrt(np.maximum(0.0, 1.0 - shown[..., 0] ** 2 - shown[..., 1] ** 2))
    own = decode(meant[..., :3].astype(np.float64), chosen.map.channels)
    return angles.degrees(seen.decoded(own, chosen.map.basis), seen.decoded(shown, target.basis.name))


def assert_same(found, expected):
    for key, percent in PERCENTS.items():
        below, above = np.percentile(expected, [percent - 1, min(percent + 1, 100)])
        assert below - CLOSE <= found[key] <= above + CLOSE, key


def assert_loss(loss, meant, kept):
    lost = angles.degrees(angles.decode(meant), angles.decode(kept))
    assert 0.1 < loss["median"] == pytest.approx(np.median(lost), abs=1e-4)
    assert loss["maximum"] == pytest.approx(lost.max(), abs=1e-4)


def meant_by(low, high):
    """The texels of the bake as floats."""
    report = bake_pair(bpy.context, low, [high], settings_of())
    return pixels(bpy.data.images[report.image])


@pytest.mark.parametrize("values", [{}, {"dither": True}, {"output": "m.tga"}], ids=str)
def test_files_of_steps_are_measured_as_they_are_stored(tmp_path, values):
    low, high = terrains()
    values = dict(values)
    chosen = settings_of(tmp_path / values.pop("output", "m.png"), **values)
    meant = meant_by(low, high)
    found = bake_pair(bpy.context, low, [high], chosen)
    kept = image_file.read(found.output[0])
    assert np.array_equal(kept[..., :3], outputs.kept(meant, chosen)[..., :3])
    for name, angles_of in found.targets.items():
        assert_same(angles_of, off(low, meant, kept, chosen, targets.BY_NAME[name]))


@pytest.mark.parametrize("ending", [".dds", ".ktx2"])
def test_files_of_blocks_are_measured_as_they_are_stored(tmp_path, ending):
    low, high = terrains()
    chosen = settings_of(tmp_path / f"m{ending}", margin=0)
    meant = meant_by(low, high)
    found = bake_pair(bpy.context, low, [high], chosen)
    kept = image_file.read(found.output[0])
    assert np.abs(kept[..., :3] - outputs.kept(meant, chosen)[..., :3]).max() < 1e-6
    for name, angles_of in found.targets.items():
        assert_same(angles_of, off(low, meant, kept, chosen, targets.BY_NAME[name]))
        assert "compressed" not in angles_of
    exact = bake_pair(bpy.context, low, [high], settings_of(tmp_path / "m.exr", depth=32, margin=0))
    assert found.targets["three"]["median"] > exact.targets["three"]["median"]
    assert_loss(found.loss, meant, kept)


@pytest.mark.parametrize(("name", "size"), [("m.dds", (8, 12)), ("m.ktx2", (6, 5)), ("m.ktx2", (1, 1))])
def test_blocks_begin_at_the_top_of_the_map(name, size):
    texels = normals(size)
    texels[0, 0, 3] = 1.0 / 3.0
    kept = outputs.kept(texels, settings_of(name, size=size))
    expected = by_hand(texels, Purpose.NORMAL)
    assert np.abs(kept[..., :2] - expected).max() < 1e-6
    x, y = np.moveaxis(2.0 * expected - 1.0, -1, 0)
    assert np.abs(kept[..., 2] - (0.5 + 0.5 * np.sqrt(np.maximum(0.0, 1.0 - x * x - y * y)))).max() < 1e-6
    assert np.array_equal(kept[..., 3], texels[..., 3])


def test_a_flat_map_on_a_step_costs_nothing():
    texels = np.ones((8, 8, 4), np.float32)
    texels[..., 0], texels[..., 1] = 102.0 / 255.0, 153.0 / 255.0
    texels[..., 2] = 0.5 + 0.5 * np.sqrt(1.0 - 2.0 * 0.2**2)
    assert np.abs(outputs.kept(texels, settings_of("m.dds", size=(8, 8))) - texels).max() < 1e-6
    assert np.abs(block_encoding.compressed(texels, "bc5")[..., :2] - texels[..., :2]).max() < 1e-6


def test_two_normals_of_a_block_have_the_angles_that_their_numbers_say(tmp_path, monkeypatch):
    """Of red, one half of each block has the second endpoint, 130, and one is between the two. Green is 128."""
    lower, upper = 3, 1
    indices = sum((lower if texel > 7 else upper) << 3 * texel for texel in range(16))
    block = bytes((191, 130)) + struct.pack("<Q", indices)[:6] + bytes((128, 128)) + bytes(6)

    def encoded(texels, *_):
        return np.tile(np.frombuffer(block, np.uint8), (texels.shape[0] // 4, texels.shape[1] // 4, 1))

    monkeypatch.setattr(block_encoding, "encoded", encoded)
    low, high = zoo.plane("low"), zoo.plane("high")
    given = {"targets": ("unreal", "three"), "green": "-Y", "size": (32, 32), "depth": 8}
    report = bake_pair(bpy.context, low, [high], settings_of(**given))
    in_blocks = bake_pair(bpy.context, low, [high], settings_of(tmp_path / "m.dds", **given))
    x = 2.0 * np.array([130.0, (5.0 * 191.0 + 2.0 * 130.0) / 7.0]) / 255.0 - 1.0
    one, other = np.degrees(np.arcsin(np.hypot(x, 2.0 * 128.0 / 255.0 - 1.0)))
    for found in (report.targets["unreal"]["compressed"], in_blocks.targets["unreal"]):
        assert found["texels"] == 32 * 32
        assert found["median"] == pytest.approx(one, rel=1e-3)
        assert found["percentile_95"] == pytest.approx(other, rel=1e-3)
        assert found["maximum"] == pytest.approx(other, rel=1e-4)
    rounding = np.degrees(np.arcsin(np.hypot(1.0, 1.0) / 255.0))
    assert report.targets["unreal"]["maximum"] == pytest.approx(rounding, rel=1e-3)
    assert "compressed" not in report.targets["three"]


def test_engines_that_compress_are_off_by_what_is_left_of_8_bits(tmp_path):
    low, high = terrains()
    names = tuple(target.name for target in COMPRESSING)
    chosen = settings_of(tmp_path / "m.png", depth=16, targets=(*names, "three", "cycles"), margin=0)
    meant = meant_by(low, high)
    found = bake_pair(bpy.context, low, [high], chosen)
    kept = image_file.read(found.output[0])
    steps = np.floor(kept * 255.0 + 0.5) / 255.0
    compressed = np.dstack([by_hand(steps.astype(np.float32), Purpose.DATA), np.ones(SIZE[::-1])])
    for target in COMPRESSING:
        angles_of = found.targets[target.name]["compressed"]
        assert_same(angles_of, off(low, meant, compressed, chosen, target))
    lines = found.summary()
    assert sum("compresses it to BC5: then at least" in line for line in lines) == len(COMPRESSING)
    assert all("compressed" not in found.targets[name] for name in ("three", "cycles"))


def test_what_compresses_reads_two_channels():
    assert COMPRESSING and all(target.rebuilds_z and target.compresses == "bc5" for target in COMPRESSING)


@pytest.mark.parametrize("name", ["m.jpg", "m.webp"])
def test_files_with_losses_are_measured_as_they_are_stored(tmp_path, name):
    low, high = terrains()
    chosen = settings_of(tmp_path / name, quality=60, lossy_normals=True, margin=0, targets=("three",))
    meant = meant_by(low, high)
    found = bake_pair(bpy.context, low, [high], chosen)
    kept = image_file.read(found.output[0])
    assert np.array_equal(kept[..., :3], outputs.kept(meant, chosen)[..., :3])
    assert_same(found.targets["three"], off(low, meant, kept, chosen, targets.BY_NAME["three"]))
    assert_loss(found.loss, meant, kept)


@pytest.mark.parametrize("alpha", [True, False])
def test_losses_beside_a_background_are_those_of_the_file(tmp_path, alpha):
    """Alpha decides what WebP stores of the background, and blocks mix it with the normals beside it."""
    texels = normals((64, 64))
    texels[:, 20:, 3] = 0.0
    chosen = settings_of(tmp_path / "m.webp", size=(64, 64), quality=60, lossy_normals=True, alpha=alpha)
    image_file.write(texels, tmp_path / "m.webp", 8, has_alpha=alpha, quality=60)
    stored = image_file.read(tmp_path / "m.webp")
    assert np.array_equal(outputs.kept(texels, chosen)[:, :20, :3], stored[:, :20, :3])


def test_limits_on_what_a_compressor_leaves():
    (limit,) = limits.parse("targets.unreal.compressed.p99<1deg")
    report = {"targets": {"unreal": {"percentile_99": 0.3, "compressed": {"percentile_99": 1.5}}}}
    assert limit.over(report) == "targets.unreal.compressed.p99 is 1.5 degrees, and must be less than 1 degrees."
    assert not limits.parse("targets.unreal.p99<1deg")[0].over(report)
    assert "was not measured" in limit.over({"targets": {"unreal": {"percentile_99": 0.3}}})
    with pytest.raises(BakeError, match="not a metric"):
        limits.parse("targets.three.compressed.p99<1deg")


def test_loss_is_that_of_some_rows_of_blocks():
    texels = np.zeros((1030, 512, 4), np.float32)
    texels[..., 0] = np.arange(1030, dtype=np.float32)[:, None]
    some = value_encoding.sample_blocks(texels)
    rows = some[:, 0, 0].reshape(-1, 4).astype(int)
    assert (np.diff(rows, axis=1) == 1).all() and ((rows[:, 0] - 1030 % 4) % 4 == 0).all()
    assert 16 <= len(rows) <= 256 and rows.min() < 8 and rows.max() > 1015
