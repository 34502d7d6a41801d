# SPDX-License-Identifier: GPL-3.0-or-later
"""Ambient occlusion of meshes onto themselves: in closed form at edges, and beside Cycles' own bake."""

import bpy
import numpy as np
import pytest

from scripts.bench import occlusion_alone
from scripts.bench.occlusion_alone import Difference
from tests.support import zoo
from tests.support.maps import bake_all_maps

pytestmark = pytest.mark.usefixtures("gpu_context")

MOST = 4.0
"""Standard errors of the mean difference. The script has 4,096 samples of Cycles and takes minutes; here, chance is larger."""


def folded(slope):
    """Two squares that meet at x = 0, and rise away from there by a slope, or fall."""
    return zoo.sheet(
        "fold", lambda u, v: np.stack([2 * u - 1, 40 * v, slope * abs(2 * u - 1)], axis=1), 2, 1, smooth=False
    )


@pytest.mark.parametrize("two_sided", [False, True])
@pytest.mark.parametrize("slope", [-3.0, -1.0, -0.3, 0.3, 1.0])
def test_on_an_edge_it_is_that_of_one_of_its_faces(slope, two_sided):
    """The middle column of texels has its centers on the edge. Over a ridge all is visible; in a valley, the other side blocks
    what of the hemisphere, times its cosine, lies below it."""
    obj = folded(slope)
    _, found = bake_all_maps(obj, obj, maps=["AO"], size=33, method="AUTO", rays=1024, two_sided=two_sided)
    middle = found["ao"][16, :, 0]
    angle = 2.0 * np.arctan(max(0.0, slope))
    assert abs(middle[16] - 0.5 * (1.0 + np.cos(angle))) < 0.01
    if slope < 0.0:
        assert (found["ao"][..., 0] == 1.0).all()


@pytest.mark.parametrize("name", ["stairs", "block", "bowl"])
def test_a_single_object_is_as_cycles_bakes_it(name):
    obj = occlusion_alone.unwrapped(occlusion_alone.alone()[name]())
    found = Difference.of(*occlusion_alone.values(obj, 64, 256), 256)
    assert found.texels > 500 and found.mean < 0.98
    assert found.rms < found.noise and abs(found.bias) < MOST * found.error, found


def test_objects_of_a_scene_shade_each_other_as_in_cycles():
    ground, ball = zoo.plane("ground", smooth=False), occlusion_alone.added("ico_sphere", "ball", subdivisions=2)
    ball.location.z = 0.8
    ball.scale = (0.6, 0.6, 0.6)
    bpy.context.view_layer.update()
    alone = occlusion_alone.values(ground, 64, 256)
    assert (alone[0] == 1.0).all()
    found = Difference.of(*occlusion_alone.values(ground, 64, 256, occluders="SCENE"), 256)
    assert found.mean < 0.8
    assert found.rms < found.noise and abs(found.bias) < MOST * found.error, found
