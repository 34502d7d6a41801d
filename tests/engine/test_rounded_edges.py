# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests rounded edges: by closed form, by sums over many points, and against Cycles' Bevel node."""

import bpy
import numpy as np
import pytest
from mathutils import Euler, Matrix

from addon.core.errors import BakeError
from tests.support import angles, cycles, hard_shapes, lanes, maps, scenes, zoo

pytestmark = pytest.mark.usefixtures("gpu_context")

SIDE = 64
METHODS = ("FLATTEN", "CAST")
RADIUS = 0.4
DEGREES = 0.02
"""What single precision leaves."""


def rounded(low, *highs, radius=RADIUS, **settings):
    """The texels (H, W, 4) of a bake in world space, without distances to measure."""
    values = {"size": (SIDE, SIDE), "space": "WORLD", "extrusion": 0.01, "max_distance": 0.02, **settings}
    return maps.bake(low, *highs, edge_radius=radius, **values)


def off(texels, normals):
    """The most degrees between texels and normals (H, W, 3), where there are texels."""
    is_known = texels[..., 3] > 0
    assert is_known.mean() > 0.3
    return angles.degrees(angles.decode(texels), normals)[is_known].max()


def bent(name, side=1.0, n=1, *, end=1.0):
    """The square from 0 to 1 in x with a wall at x = 0, which goes down from it, or up for side -1. U is the way from the end
    of the wall to that of the square, from which `end` is left, and v is y."""

    def surface(u, v):
        along = 2.0 * u - 1.0
        return np.stack([np.maximum(along, 0.0) * end, 2.0 * v - 1.0, np.minimum(along, 0.0) * side], axis=1)

    obj = zoo.sheet(name, surface, 2 * n, n, smooth=True)
    edges = obj.data.attributes.new("sharp_edge", "BOOLEAN", "EDGE")
    points = np.array([vertex.co for vertex in obj.data.vertices])
    is_bend = [all(abs(points[v, 0]) + abs(points[v, 2]) < 1e-6 for v in edge.vertices) for edge in obj.data.edges]
    edges.data.foreach_set("value", is_bend)
    return obj


def around_edge(distance):
    """The angles (...) in radians by which a right-angled edge turns normals at distances (...) from it, in radii.

    The other side has the integral of (1 - r)^3 over half a disc without its middle, pi * integral of r (1 - r)^3 from the
    distance on; the own side has that over a whole disc, pi / 10, less the cap beyond the edge.
    """
    x = np.minimum(distance, 1.0)[..., None]
    nodes, weights = np.polynomial.legendre.leggauss(200)
    # r = sqrt(x^2 + (1 - x^2) q^2) takes the root out of the angle of the cap.
    q = 0.5 * (nodes + 1.0)
    r = np.sqrt(x**2 + (1.0 - x**2) * q**2)
    cap = (0.5 * weights * (1.0 - r) ** 3 * 2.0 * np.arccos(np.clip(x / r, 0.0, 1.0)) * (1.0 - x**2) * q).sum(axis=-1)
    x = x[..., 0]
    other = np.pi * (0.05 - x**2 / 2.0 + x**3 - 0.75 * x**4 + x**5 / 5.0)
    return np.arctan2(other, np.pi / 10.0 - cap)


def expected_of_bend(side):
    """The normals (SIDE, SIDE, 3) of `bent`."""
    along = 2.0 * maps.texel_uv(SIDE, SIDE)[..., 0] - 1.0
    turn = around_edge(np.abs(along) / RADIUS)
    turn = np.where(along > 0.0, turn, np.pi / 2.0 - turn)
    return np.stack([-side * np.sin(turn), 0.0 * turn, np.cos(turn)], axis=-1)


def middle(texels):
    """`texels` without the rows near the ends of the edge."""
    kept = np.zeros_like(texels)
    inner = slice(SIDE // 4, -SIDE // 4)
    kept[inner] = texels[inner]
    return kept


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("side", [1.0, -1.0], ids=["convex", "concave"])
def test_a_right_angle_is_round_by_closed_form(side, method):
    low, high = bent("lo", side), bent("hi", side)
    for image, pair in (("pair", (low, high)), ("itself", (low, low))):
        assert off(middle(rounded(*pair, method=method, image=image)), expected_of_bend(side)) < DEGREES


@pytest.mark.parametrize("method", METHODS)
def test_beyond_the_radius_no_bit_changes(method):
    obj = bent("obj")
    obj.matrix_world = Matrix.LocRotScale(None, Euler((0.3, 0.5, 0.7)), None)
    plain, found = (rounded(obj, obj, radius=radius, method=method, space="OBJECT") for radius in (0.0, RADIUS))
    distance = np.abs(2.0 * maps.texel_uv(SIDE, SIDE)[..., 0] - 1.0)
    is_far, is_near = distance >= RADIUS, distance < 0.9 * RADIUS
    assert np.array_equal(found[is_far], plain[is_far])
    assert (found[is_near] != plain[is_near]).any(axis=-1).all()


@pytest.mark.parametrize("method", METHODS)
def test_what_is_shaded_smooth_stays(method):
    """Also where faces bend by much: what a smooth surface shows is round."""
    low, ball = zoo.sphere("lo", 6), zoo.sphere("hi", 6, smooth=True)
    ball.data.attributes.remove(ball.data.attributes["custom_normal"])
    reach = {"method": method, "extrusion": 0.2, "max_distance": 0.4}
    assert np.array_equal(rounded(low, ball, **reach), rounded(low, ball, radius=0.0, **reach))


def test_a_high_mesh_without_hard_edges_is_told():
    low, smooth, hard = bent("lo"), zoo.plane("smooth", smooth=True), bent("hard")
    for highs, is_told in (([smooth], True), ([smooth, hard], False)):
        report = scenes.bake(low, *highs, edge_radius=RADIUS)
        assert any("no edge of 'smooth' is hard" in text for text in report.warnings) == is_told
    assert not any("Edge Radius" in text for text in scenes.bake(low, smooth).warnings)


def test_many_small_triangles_are_as_few_large_ones():
    """So many that no dispatch takes all of those within the radius."""
    few, many = bent("few"), bent("many", n=60)
    expected = angles.decode(rounded(few, many))
    assert off(rounded(few, few, image="few"), expected) < 2.0 * DEGREES


@pytest.mark.parametrize("is_joined", [True, False], ids=["same object", "another object"])
def test_a_surface_that_only_lies_close_does_not_count(is_joined):
    low, high = bent("lo"), bent("hi")
    alone = rounded(low, high)
    behind = zoo.cube("behind")  # with hard edges of its own
    behind.matrix_world = Matrix.LocRotScale((1.2, 0.0, -0.1), None, (1.1, 1.0, 0.05))
    others = [behind]
    if is_joined:
        scenes.select(high, behind)
        bpy.ops.object.join()
        others = []
    found = rounded(low, high, *others, method="CAST", hit="OUTERMOST", keep_faces=True)
    assert off(found, angles.decode(alone)) < DEGREES


def polyhedron(name, seed):
    """A squeezed icosahedron whose edges are hard, but some; and its matrix."""
    rng = np.random.default_rng(seed)
    bpy.ops.mesh.primitive_ico_sphere_add(subdivisions=1)
    obj = bpy.context.object
    obj.name = name
    smooth = rng.random(len(obj.data.polygons)) < 0.4
    obj.data.polygons.foreach_set("use_smooth", smooth)
    obj.matrix_world = Matrix.LocRotScale((3.0, -2.0, 1.0), Euler(rng.random(3) * 6.0), (1.0, 1.4, 0.7))
    return hard_shapes.unwrapped(obj)


def summed(obj, points, radius, n=120):
    """The mean normals (N, 3) around points (N, 3), from n * n / 2 points in each triangle of the evaluated object."""
    mesh = cycles.read(obj)
    grid = (np.arange(n) + 1.0 / 3.0) / n
    u, v = (each.reshape(-1) for each in np.meshgrid(grid, grid))
    u, v = u[u + v < 1.0], v[u + v < 1.0]
    weights = np.stack([1.0 - u - v, u, v], axis=1)
    matrix = np.array(obj.matrix_world)
    corners = mesh.positions[mesh.vertices[mesh.triangles]] @ matrix[:3, :3].T + matrix[:3, 3]
    normals = mesh.normals[mesh.triangles] @ np.linalg.inv(matrix[:3, :3])
    sums = np.zeros((len(points), 3))
    for corner, normal in zip(corners, normals, strict=True):
        area = np.linalg.norm(np.cross(corner[1] - corner[0], corner[2] - corner[0]))
        at, facing = weights @ corner, weights @ normal
        facing /= np.linalg.norm(facing, axis=1, keepdims=True)
        far = np.linalg.norm(points[:, None] - at, axis=2)
        sums += area * (np.clip(1.0 - far / radius, 0.0, None) ** 3 @ facing)
    return sums / np.linalg.norm(sums, axis=1, keepdims=True)


@pytest.mark.parametrize("seed", range(2))
def test_corners_of_any_shape_are_the_mean_over_many_points(seed):
    obj = polyhedron("poly", seed)
    _, found = maps.bake_all_maps(obj, obj, maps=["POSITION"], size=48, space="WORLD", edge_radius=0.5)
    texels = rounded(obj, obj, radius=0.5, size=(48, 48))
    plain = rounded(obj, obj, radius=0.0, size=(48, 48))
    is_round = (texels != plain).any(axis=-1)
    chosen = np.flatnonzero(is_round)[:: max(1, np.count_nonzero(is_round) // 60)]
    expected = summed(obj, found["position"].reshape(-1, 4)[chosen, :3].astype(np.float64), 0.5)
    error = angles.degrees(angles.decode(texels).reshape(-1, 3)[chosen], expected)
    # The sums are of points, and normals of a smooth triangle are those at its center of gravity in the ball.
    assert np.percentile(error, 90) < 0.5 and error.max() < 3.0


def test_a_normal_map_is_turned_as_by_the_bevel_node():
    """n = normalize(the map's normal + the rounded one - the surface's)."""
    low, high = bent("lo"), bent("hi")
    material = scenes.material("waves", high)
    node = material.node_tree.nodes.new("ShaderNodeNormalMap")
    node.inputs["Color"].default_value = (0.7, 0.4, 0.9, 1.0)
    stored = np.full((4, 4, 3), (0.7, 0.4, 0.9))
    shown = scenes.texture(material, scenes.image("waves", stored, space="Non-Color", is_float=True))
    material.node_tree.links.new(shown.outputs["Color"], node.inputs["Color"])
    scenes.set_inputs(material, Normal=node.outputs["Normal"])
    plain, mapped = (rounded(low, high, radius=0.0, detail_maps=is_on) for is_on in (False, True))
    only_round, both = (rounded(low, high, detail_maps=is_on) for is_on in (False, True))
    expected = angles.decode(mapped) + angles.decode(only_round) - angles.decode(plain)
    expected /= np.linalg.norm(expected, axis=-1, keepdims=True)
    assert angles.degrees(angles.decode(mapped), angles.decode(plain)).min() > 5.0
    assert off(both, expected) < DEGREES


def roof(name, shift):
    """A tile in x with a ridge and a valley, one of which is on its border."""

    def surface(u, v):
        return np.stack([2.0 * u - 1.0, 2.0 * v - 1.0, np.abs(np.mod(u + shift, 1.0) - 0.5)], axis=1)

    return zoo.sheet(name, surface, 16, 1, smooth=False)


def test_edges_on_the_border_of_a_tile_are_round():
    low, rays = zoo.plane("low"), {"method": "CAST", "extrusion": 1.0, "max_distance": 2.0, "hit": "OUTERMOST"}
    found = [rounded(low, roof("roof", shift), radius=1.5, wrap="U", **rays) for shift in (0.0, 0.5)]
    inner = slice(SIDE // 4, -SIDE // 4)  # the ends of the edges are at the borders in V
    moved = np.roll(found[1], SIDE // 2, axis=1)
    assert angles.degrees(angles.decode(found[0]), angles.decode(moved))[inner].max() < 0.1


def test_samples_are_averaged():
    low, high = bent("lo"), bent("hi")
    assert off(middle(rounded(low, high, samples=4)), expected_of_bend(1.0)) < 0.5


@pytest.mark.parametrize(
    ("radius", "said"),
    [
        (-0.1, "0 or more"),
        (float("nan"), "not a distance"),
        (float("inf"), "not a distance"),
        (9.0, "set a shorter one"),
    ],
)
def test_a_radius_that_cannot_be_is_told(radius, said):
    obj = bent("obj")
    with pytest.raises(BakeError, match=said):
        rounded(obj, obj, radius=radius)
    assert "map" not in bpy.data.images


def test_triangles_without_an_area_change_nothing():
    low, high = bent("lo"), bent("hi")
    alone = rounded(low, high)
    points = [vertex.co for vertex in high.data.vertices]
    line = zoo.build("line", [points[1], points[4], points[1]], [(0, 1, 2)], np.zeros((1, 3, 2)))
    scenes.select(high, line)
    bpy.ops.object.join()
    assert off(rounded(low, high), angles.decode(alone)) < DEGREES


# Against Cycles

OF_SHAPE = {"cube": 0.2, "gear": 0.04, "crate": 0.1}
"""The radius of each shape."""
BEVEL_SAMPLES = 128
"""The most that a Bevel node takes."""
BAKES = 8
"""With 256 samples, 99 % of the texels are within 2.0 degrees on the cube, 1.7 on the gear and 2.2 on the crate, with 1,024
within 0.9, 0.9 and 1.2, and with 2,048 within 0.7, 0.7 and 0.8: what is left is the noise of Cycles."""
WITHIN = 1.3


def beveled(obj, radius, size):
    """The world normals (H, W, 3) of a Bevel node with BEVEL_SAMPLES for each of BAKES, and the mask (H, W)."""
    material = bpy.data.materials.new("beveled")
    obj.data.materials.clear()
    obj.data.materials.append(material)
    nodes, links = material.node_tree.nodes, material.node_tree.links
    bevel, shift, emission = (nodes.new(f"ShaderNode{kind}") for kind in ("Bevel", "VectorMath", "Emission"))
    bevel.samples = BEVEL_SAMPLES
    bevel.inputs["Radius"].default_value = radius
    shift.operation = "MULTIPLY_ADD"
    shift.inputs[1].default_value, shift.inputs[2].default_value = (0.5,) * 3, (0.5,) * 3
    links.new(bevel.outputs["Normal"], shift.inputs[0])
    links.new(shift.outputs["Vector"], emission.inputs["Color"])
    links.new(emission.outputs[0], material.node_tree.get_output_node("CYCLES").inputs["Surface"])
    bakes = [cycles.bake(obj, size, "EMIT", seed=seed) for seed in range(BAKES)]
    sums = sum(angles.decode(texels) for texels, _ in bakes)
    return sums / np.maximum(np.linalg.norm(sums, axis=-1, keepdims=True), 1e-12), bakes[0][1]


@pytest.mark.parametrize("name", lanes.slow_but(["cube"], OF_SHAPE))
def test_they_are_those_of_cycles_bevel_node(name):
    obj, size = getattr(hard_shapes, name)(), (128, 128)
    found, plain = (rounded(obj, obj, radius=radius, size=size) for radius in (OF_SHAPE[name], 0.0))
    expected, written = beveled(obj, OF_SHAPE[name], size)
    inner = written & (found[..., 3] > 0)
    error = angles.degrees(angles.decode(found), expected)[inner]
    share = (found != plain).any(axis=-1)[inner].mean()
    print(f"{name}: {share:.0%} rounded; degrees to Cycles: {np.percentile(error, [50, 90, 99, 100]).round(2)}")
    assert share > 0.3
    assert np.percentile(error, 99) < WITHIN
