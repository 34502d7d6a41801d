# SPDX-License-Identifier: GPL-3.0-or-later
"""Maps of painted low meshes, whose texels are known in closed form."""

import bpy
import numpy as np
import pytest

from addon.jobs import Job, bake_all
from tests.support import maps, scenes, zoo

pytestmark = pytest.mark.usefixtures("gpu_context")

SIZE = 64
SHELLS = {-0.1: (0.6, 0.0, 0.8), 0.1: (0.0, 0.6, 0.8), 0.3: (0.0, 0.0, 1.0)}
"""Heights of planes above the low one, and the normal that each shows."""
HEIGHT = 0.5


def bake(low, *highs, cage=None, **settings):
    """Texels (SIZE, SIZE, 4), and the report."""
    values = {"method": "CAST", "space": "OBJECT", "image": "painted", "size": SIZE} | settings
    report = scenes.bake(low, *highs, cage=cage, **values)
    return maps.pixels(bpy.data.images[report.image]), report


def paint(low, name, weight):
    """Paint each vertex with `weight`, a function of its x and y, or a number."""
    group = low.vertex_groups.new(name=name)
    for vertex in low.data.vertices:
        group.add([vertex.index], weight(*vertex.co.xy) if callable(weight) else weight, "REPLACE")


def tilted(name, normal, n=1):
    """A plane with custom normals."""
    return zoo.plane(name, n, normals=np.tile(np.float32(normal), (n * n, 4, 1)))


def shells():
    result = []
    for number, (height, normal) in enumerate(SHELLS.items()):
        result.append(tilted(f"high {number}", normal))
        result[-1].location.z = height
    return result


def expected(starts):
    """What texels show whose rays start at heights (N,) above the low plane: the first shell below."""
    heights = np.array(list(SHELLS))
    first = np.array([heights[heights <= start].max() for start in starts])
    return np.float32([SHELLS[height] for height in first]) * 0.5 + 0.5


def centers():
    """The x of the texels' centers on the plane, (SIZE,)."""
    return (np.arange(SIZE) + 0.5) / SIZE * 2.0 - 1.0


@pytest.mark.parametrize("hit", ["OWN", "OUTERMOST"])
@pytest.mark.parametrize("with_cage", [False, True])
def test_the_offset_group_scales_where_rays_start(hit, with_cage):
    """The weight falls from 1 at x = -0.5 to 0 at x = 0.5. Rays with 0.5 start at 0.2, between two shells."""
    low = zoo.plane("lo", n=4)
    paint(low, "far", lambda x, _y: np.clip(0.5 - x, 0.0, 1.0))
    cage, distances = None, {"extrusion": 0.2}
    if with_cage:
        cage, distances = zoo.plane("cage", n=4), {}
        cage.location.z = 0.2
    texels, _ = bake(low, *shells(), cage=cage, hit=hit, offset_group="far", max_distance=0.4, **distances)
    starts = 0.4 * np.clip(0.5 - centers(), 0.0, 1.0)
    assert np.allclose(texels[..., :3], expected(starts), atol=1e-6)
    assert (texels[..., 3] == 1.0).all()
    texels, _ = bake(low, *shells(), cage=cage, hit=hit, max_distance=0.4, **distances)
    assert np.allclose(texels[..., :3], expected([0.2]), atol=1e-6)


@pytest.mark.parametrize("with_cage", [False, True])
def test_painting_moves_where_rays_end_only_from_a_cage(with_cage):
    """Rays start at 0.2 and end at -0.2, and where the weight is 1 start at 0.4. The high plane is at -0.1."""
    low, high = zoo.plane("lo", n=4), zoo.plane("hi")
    high.location.z = -0.1
    paint(low, "far", lambda x, _y: 1.0 if x < -0.4 else 0.5)
    cage = zoo.plane("cage", n=4) if with_cage else None
    if cage is not None:
        cage.location.z = 0.2
    distances = {"max_distance": 0.4} | ({} if with_cage else {"extrusion": 0.2})
    texels, _ = bake(low, high, cage=cage, offset_group="far", **distances)
    is_hit = texels[..., 3] == 1.0
    assert is_hit[:, centers() > 0.0].all()
    assert (is_hit[:, centers() < -0.5] != with_cage).all()


def test_high_meshes_that_only_painted_rays_reach_count():
    """Rays start 4 above the plane without paint, and 8 with it. Meshes beyond two radii and the rays are left out."""
    low, near, far = zoo.plane("lo"), tilted("near", SHELLS[0.1]), tilted("far", SHELLS[0.3])
    near.location.z, far.location.z = 1.0, 7.0
    rays = {"hit": "OUTERMOST", "extrusion": 4.0, "max_distance": 4.0}
    texels, report = bake(low, near, far, **rays)
    assert np.allclose(texels[..., :3], np.float32(SHELLS[0.1]) * 0.5 + 0.5, atol=1e-6)
    assert any("out of reach" in warning for warning in report.warnings)
    paint(low, "far", 1.0)
    texels, report = bake(low, near, far, offset_group="far", **rays)
    assert np.allclose(texels[..., :3], np.float32(SHELLS[0.3]) * 0.5 + 0.5, atol=1e-6)
    assert not any("out of reach" in warning for warning in report.warnings)


@pytest.mark.parametrize("weight", [0.0, 0.125, 1.0])
def test_what_is_painted_does_not_change_the_measured_distances(weight):
    low, high = zoo.plane("lo", n=2), zoo.plane("hi", n=16, slope=0.3)
    high.location.z = 0.1
    _, unpainted = bake(low, high)
    paint(low, "far", weight)
    _, painted = bake(low, high, offset_group="far")
    assert painted.distances == unpainted.distances
    assert painted.measured


def step_down(name):
    """A top face, -1..0 along x, with the left half of the map, and a face that goes down from its hard edge at x = 0."""
    points = [(x, y, z) for x, z in ((-1, 0), (0, 0), (0, -1)) for y in (-1, 1)]
    faces = [(0, 2, 3, 1), (2, 4, 5, 3)]
    uv = np.array([[(0, 0), (0.5, 0), (0.5, 1), (0, 1)], [(0.5, 0), (1, 0), (1, 1), (0.5, 1)]])
    return zoo.build(name, points, faces, uv, smooth=False)


@pytest.mark.parametrize(
    ("directions", "weight", "share"),
    [
        ("SMOOTH", 0.0, 0.0),
        ("SMOOTH", 0.5, 0.0),
        ("SMOOTH", 0.75, 0.5),
        ("SMOOTH", 1.0, 1.0),
        ("SPLIT", 0.0, 0.0),
        ("SPLIT", 0.25, 0.5),
        ("SPLIT", 0.5, 1.0),
        ("SPLIT", 1.0, 1.0),
        ("BLENDED", 0.0, 0.0),
        ("BLENDED", 1.0, 1.0),
    ],
)
def test_the_straight_group_turns_rays(directions, weight, share):
    """Halves of a plane above the low mesh show different normals, and turned rays find their border elsewhere."""
    low = step_down("lo")
    paint(low, "turned", weight)
    high = zoo.plane("hi", n=2, normals=np.float32([[(0, 0, 1)] * 4, [(0, 0.6, 0.8)] * 4] * 2))
    high.location.z, high.location.x, high.scale.x = HEIGHT, -0.3, 4.0
    texels, _ = bake(
        low, high, directions=directions, straight_group="turned", extrusion=1.0, max_distance=2.0, hit="OUTERMOST"
    )
    x = (np.arange(SIZE // 2) + 0.5) / (SIZE // 2) - 1.0
    # Interpolated between straight up at x = -1 and (1, 0, 1) / sqrt(2) at the hard edge.
    smooth = np.stack([(x + 1.0) * np.sqrt(0.5), (x + 1.0) * np.sqrt(0.5) - x], axis=1)
    smooth /= np.linalg.norm(smooth, axis=1, keepdims=True)
    along = (1.0 - share) * smooth + share * np.array([0.0, 1.0])
    is_right = x + HEIGHT * along[:, 0] / along[:, 1] > -0.3
    assert np.array_equal(texels[:, : SIZE // 2, 1] > 0.7, np.broadcast_to(is_right, (SIZE, SIZE // 2)))


@pytest.mark.parametrize("neutral", ["outside the group", "0.5"])
def test_neutral_weights_change_nothing(neutral):
    low, high = zoo.cube("lo"), zoo.cube("hi")
    high.scale = (1.05, 1.02, 1.1)
    plain, _ = bake(low, high)
    for name in ("far", "turned"):
        paint(low, name, 0.5)
        if neutral == "outside the group":
            low.vertex_groups[name].remove(range(8))
    painted, _ = bake(low, high, offset_group="far", straight_group="turned")
    assert np.array_equal(painted, plain)


def test_tiles_are_painted_as_the_whole_map():
    low = zoo.plane("lo", n=4)
    paint(low, "far", lambda x, _y: np.clip(0.5 - x, 0.0, 1.0))
    options = {"offset_group": "far", "extrusion": 0.2, "max_distance": 0.4}
    whole, _ = bake(low, *shells(), **options)
    tiles, report = bake(low, *shells(), udim=True, storage="PACK", **options)
    assert report.tiles == [1001]
    assert np.array_equal(tiles, whole)


def test_in_an_atlas_each_low_mesh_has_its_own_weights():
    """Two halves of a map: both low planes have their own shells, and only one of them is painted."""
    jobs = []
    for number, name in enumerate(("painted", "unpainted")):
        low = zoo.plane(f"{name}_low")
        uv = low.data.uv_layers[0].uv
        for corner in uv:
            corner.vector.x = 0.5 * (corner.vector.x + number)
        highs = shells()
        for obj in (low, *highs):
            obj.location.y = 10.0 * number
        jobs.append(Job(low, highs))
    paint(jobs[0].low, "far", 0.0)
    values = {"space": "OBJECT", "image": "all", "extrusion": 0.2, "max_distance": 0.4, "offset_group": "far"}
    bake_all(bpy.context, jobs, scenes.settings("CAST", size=SIZE, **values), share_image=True)
    texels = maps.pixels(bpy.data.images["all"])[..., :3]
    assert np.allclose(texels[:, : SIZE // 2], expected([0.0]), atol=1e-6)
    assert np.allclose(texels[:, SIZE // 2 :], expected([0.2]), atol=1e-6)
