# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests that no map depends on NaN, which fast math on Metal takes to be absent: comparisons are turned around."""

import numpy as np
import pytest
from gpu_extras.batch import batch_for_shader

from addon.core import udim
from addon.passes import high_in_uv, low_in_uv, shader, target
from addon.passes.hemisphere import Occluders
from tests.passes.test_drawn_rays import random_rays, soup, trace
from tests.support import drivers, fast_math, hemisphere, maps, zoo

pytestmark = pytest.mark.usefixtures("gpu_context")

SIZE = 16
ON_A_LINE = np.array([(0.2, 0.4, 0.5), (0.4, 0.4, 0.5), (0.8, 0.4, 0.5)])
WITHOUT_AREA = np.concatenate(
    [
        np.repeat(np.random.default_rng(7).random((20, 1, 3)), 3, axis=1),  # points
        np.random.default_rng(8).random((20, 2, 3))[:, [0, 1, 1]],
        np.random.default_rng(9).random((20, 2, 3))[:, [0, 0, 1]],
        [ON_A_LINE, ON_A_LINE[::-1]],
    ]
)
"""Triangles (N, 3, 3) that no ray can hit. Solving for a hit divides by zero."""


@pytest.fixture(params=[False, True], ids=["exact", "fast math"])
def compiler(request, monkeypatch):
    """Run a test twice: the second time, what compares with NaN gives the opposite."""
    shader.load.cache_clear()
    if request.param:
        source = shader.source
        monkeypatch.setattr(shader, "source", lambda *names: fast_math.turned(source(*names)))
    yield
    shader.load.cache_clear()


def test_comparisons_are_turned():
    text = "if (a + 1.0 <= f(b, c > d ? e : g)[0] && x < y) { return u >= v; }  // a < b\n#if A > 1"
    turned = "if (!(a + 1.0 > f(b, !(c <= d) ? e : g)[0]) && !(x >= y)) { return !(u < v); }  // a < b\n#if A > 1"
    assert fast_math.turned(text).splitlines()[3:] == turned.splitlines()


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("x = a * b + c;", "x = rounded_once(a, b, c);"),
        ("x = c - a * b.xy;", "x = rounded_once(-(a), b.xy, c);"),
        ("x = a * b - c * d + e;", "x = rounded_once(-(c), d, a * b) + e;"),
        ("x += a * f(b, c * d - 1.0);", "x = rounded_once(a, f(b, rounded_once(c, d, -(1.0))), x);"),
        ("x = a / b + c;", "x = a / b + c;"),
        ("const float X = 2.0 * 3.0 + 1.0;", "const float X = 2.0 * 3.0 + 1.0;"),
        ("#define f(a) (a * 2.0 + 1.0)", "#define f(a) (rounded_once(a, 2.0, 1.0))"),
        ("#if A * 2 + 1 > 3", "#if A * 2 + 1 > 3"),
    ],
)
def test_sums_of_products_are_rounded_once(text, expected):
    assert fast_math.rounded_otherwise(text).split("#line 1\n")[1] == expected


def test_products_and_roots_have_the_digits_of_a_gpu(monkeypatch):
    """Of 1 + 2^-12 squared, less 1 + 2^-11, a product that is rounded first leaves nothing."""
    text = "void main() { out_value = vec4(values.x * values.x - values.y, sqrt(values.z), 0.0, 1.0); }"
    declared = shader.Program(
        vertex="lib/fullscreen_vert.glsl",
        fragment="one texel",
        inputs=(("VEC2", "position"),),
        constants=(("VEC3", "values"),),
        outputs=(("VEC4", "out_value"),),
    )
    source, into, found = shader.source, target.Target(1, 1, ("RGBA32F",)), []
    values = (1.0 + 2.0**-12, 1.0 + 2.0**-11, 2.0)
    for change in (lambda text: text, fast_math.rounded_otherwise):
        shader.load.cache_clear()
        monkeypatch.setattr(
            shader, "source", lambda name, change=change: change(text) if name == "one texel" else source(name)
        )
        target.fill(into, declared, values=values)
        found.append(into.texels()[0, 0])
    shader.load.cache_clear()
    (plain, root, _, _), (once, rough, _, _) = found
    assert plain in ((0.0, 2.0**-24) if drivers.on_hardware() else (0.0,))
    assert once == 2.0**-24
    assert root == np.float32(np.sqrt(2.0))
    assert 0.0 < abs(rough - root) < 4e-7


@pytest.mark.usefixtures("compiler")
@pytest.mark.parametrize("facing_only", [True, False])
def test_rays_pass_triangles_without_area_seed_1(facing_only):
    rng = np.random.default_rng(1)
    triangles = soup(rng, 300, 0.3)
    rays = random_rays(rng)
    expected, _, alpha = trace(*rays, triangles, facing_only=facing_only)
    found, _, found_alpha = trace(*rays, np.concatenate([triangles, WITHOUT_AREA]), facing_only=facing_only)
    assert 0.1 < (alpha > 0.0).mean() < 0.9
    assert np.array_equal(found_alpha, alpha)
    assert np.array_equal(found, expected)


@pytest.mark.usefixtures("compiler")
def test_rays_from_hits_pass_triangles_without_area_seed_2():
    """Above a floor."""
    rng = np.random.default_rng(2)
    floor = hemisphere.polygon(hemisphere.rectangle((0, 0, 0), (2, 0, 0), (0, 2, 0)))
    triangles = np.concatenate([floor, soup(rng, 100, 0.3) + (0.0, 0.0, 0.3)])
    points = rng.random((hemisphere.COUNT, 3)) * (1.0, 1.0, 0.0)
    expected, found = (
        hemisphere.Probes(hemisphere.tables(corners), points, (0.0, 0.0, 1.0)).openness(Occluders(two_sided=True))[0]
        for corners in (triangles, np.concatenate([triangles, WITHOUT_AREA + (0.0, 0.0, 0.3)]))
    )
    assert 0.1 < expected.mean() < 0.9
    assert np.array_equal(found, expected)


def covering(declared, **corners):
    """A triangle over the whole map, with these values at all corners."""
    values = {name: [value] * 3 for name, value in corners.items()}
    compiled = shader.load(declared)
    return batch_for_shader(compiled, "TRIS", {"uv": [(0.0, 0.0), (2.0, 0.0), (0.0, 2.0)], **values})


def texels(drawn):
    found = np.empty((SIZE, SIZE, 4), np.float32)
    drawn.read(found)
    return found


@pytest.mark.usefixtures("compiler")
@pytest.mark.parametrize(
    "along", [(0.0, 0.0, 1.0), (0.0, 0.0, 0.0), (1e-22, 0.0, 0.0)], ids=["along the normal", "none", "tiny"]
)
def test_a_basis_without_volume_draws_nothing(along):
    shown = target.Target(SIZE, SIZE, ("RGBA32F",))
    normals = target.Target(SIZE, SIZE, ("RGBA32F",))
    with normals.bound() as bound:
        bound.clear(color=(0.6, 0.0, 0.8, 1.0))
    low = covering(low_in_uv.TANGENT, normal=(0.0, 0.0, 1.0), tangent=(*along, 1.0))
    low_in_uv.draw_in_tangent_space(shown, low, normals.texture, udim.uv_to_clip(1001), basis_flags=0)
    assert (texels(shown) == 0.0).all()


@pytest.mark.usefixtures("compiler")
@pytest.mark.parametrize("length", [0.0, 1e-17, 1e17])
def test_what_has_no_direction_is_not_drawn(length):
    """Not what rounding leaves of normals that cancel out, and not what is about to overflow."""
    normal = target.Target(SIZE, SIZE, ("RGBA32F",))
    high = covering(high_in_uv.NORMALS, normal=(0.0, 0.0, length))
    high_in_uv.draw_normals(normal, [(high, np.eye(3))], udim.uv_to_clip(1001))
    place = target.Target(SIZE, SIZE, ("RGBA32F", "RGBA32F"))
    low = covering(low_in_uv.POINTS, position=(0.0, 0.0, 0.0), direction=(0.0, 0.0, length))
    low_in_uv.draw_points(place, low, udim.uv_to_clip(1001))
    assert (texels(normal) == 0.0).all()
    assert (texels(place) == 0.0).all()


@pytest.mark.parametrize("method", ["FLATTEN", "CAST"])
def test_fast_math_makes_the_same_map(method, monkeypatch):
    """With seams, a margin, tangents and several samples; the high mesh has faces without area."""
    low, high = zoo.sphere("low", 8), zoo.sphere("high", 32)
    high.scale.z = 1.2
    for polygon in list(high.data.polygons)[100:110]:
        for vertex in polygon.vertices:
            high.data.vertices[vertex].co = high.data.vertices[polygon.vertices[0]].co
    rays = {"extrusion": 0.3, "max_distance": 0.6} if method == "CAST" else {}
    found, source = [], shader.source
    for change in (lambda text: text, fast_math.turned):
        shader.load.cache_clear()
        monkeypatch.setattr(shader, "source", lambda name, change=change: change(source(name)))
        found.append(maps.bake(low, high, method=method, samples=4, margin=4, margin_type="ADJACENT_FACES", **rays))
    shader.load.cache_clear()
    assert len(np.unique(found[0])) > 1000
    assert np.array_equal(*found)
