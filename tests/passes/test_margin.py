# SPDX-License-Identifier: GPL-3.0-or-later
"""The margin against a brute-force search for the nearest written texel."""

import gpu
import numpy as np
import pytest

from addon.passes import margin, resolve, target

pytestmark = pytest.mark.usefixtures("gpu_context")


def resolved(written, margin_texels):
    """Run the two passes on texels that hold their own place.

    Returns for each texel the place (H, W, 2) whose value it got, as column and row; its alpha; its state.
    """
    height, width = written.shape
    rows, columns = np.indices(written.shape)
    texels = np.stack([columns, rows, np.zeros_like(rows), written], axis=-1).astype(np.float32)
    normals = target.Target(width, height, ("RGBA32F",))
    normals.textures[0] = gpu.types.GPUTexture(
        (width, height), format="RGBA32F", data=gpu.types.Buffer("FLOAT", texels.shape, texels)
    )
    stored = target.Target(width, height, ("RGBA32F", "R8"))
    offsets = target.Target(width, height, ("R16I",))
    margin.draw(offsets, normals.texture, margin_texels)
    resolve.draw(
        stored,
        normals.texture,
        offsets,
        halo=0,
        margin=margin_texels,
        channels=np.eye(3),
        missed=(0.5, 0.5, 1.0),
    )
    out, state = np.empty((height, width, 4), np.float32), np.empty((height, width), np.uint8)
    stored.read(out)
    stored.read(state, slot=1)
    return (out[..., :2] - 0.5) * 2.0, out[..., 3], state


@pytest.mark.parametrize("margin_texels", [0, 1, 3, 16])
def test_the_margin_repeats_the_nearest_written_texel_seed_3(margin_texels):
    written = np.random.default_rng(3).random((48, 64)) < 0.01
    place, alpha, state = resolved(written, margin_texels)
    rows, columns = np.indices(written.shape)
    y, x = np.nonzero(written)
    truth = np.sqrt(((rows[..., None] - y) ** 2 + (columns[..., None] - x) ** 2).min(axis=-1))
    filled = state == resolve.MARGIN

    assert np.array_equal(state == resolve.WRITTEN, written)
    assert np.array_equal(alpha, (written | filled).astype(np.float32))
    assert np.array_equal(place[written], np.stack([columns, rows], axis=-1)[written])
    assert np.array_equal(filled, (truth <= margin_texels) & ~written)
    distance = np.hypot(place[..., 0] - columns, place[..., 1] - rows)
    assert np.array_equal(distance[filled], truth[filled])
    assert written[place[filled][:, 1].astype(int), place[filled][:, 0].astype(int)].all()


def test_background_is_the_flat_normal_with_alpha_0():
    written = np.zeros((20, 20), bool)
    written[0, 0] = True
    place, alpha, state = resolved(written, 4)
    assert alpha[19, 19] == 0.0
    assert state[19, 19] == 0
    assert (place[19, 19] == 0.0).all()  # 0.5 as stored
