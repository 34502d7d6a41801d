# SPDX-License-Identifier: GPL-3.0-or-later
"""Each way to bake gives each layer its own high layer: bands, samples, UDIM, pairs by name, an atlas and Live.

The low mesh has two layers, one on each half of the map. Each has a high layer above it with normals of its own. The upper one
lies within reach of the lower layer's rays.
"""

import bpy
import numpy as np
import pytest

from addon.core.naming import Suffixes
from addon.core.progress import Pace
from addon.core.settings import Settings
from addon.engine import bands
from addon.jobs import Job, bake_all, bake_pair, live_session
from addon.jobs.job import jobs_by_name
from tests.support import maps, scenes, zoo

pytestmark = pytest.mark.usefixtures("gpu_context")

SIZE = 64
LAYERS = (0.0, 0.02)
"""Heights of the low layers. The high ones are a little above them."""
ABOVE = 0.003
NORMALS = np.array([(0.6, 0.0, 0.8), (0.0, 0.6, 0.8)])
"""Of the lower and the upper high layer."""
ROUNDING = 1e-6
"""In stored floats."""


def layers(name, heights, normals=None, *, tile=0):
    """Two squares over each other. Their UVs are the halves of a tile, with a gap between them."""
    points = np.array([(x, y, z) for z in heights for x, y in ((-1, -1), (1, -1), (1, 1), (-1, 1))])
    square = np.array([(0, 0), (1, 0), (1, 1), (0, 1)])
    uv = np.stack([square * (0.375, 0.75) + (left, 0.125) for left in (0.0625, 0.5625)])
    uv[1:, :, 0] += tile
    normals = None if normals is None else np.repeat(np.asarray(normals)[:, None], 4, axis=1)
    return zoo.build(name, points, [(0, 1, 2, 3), (4, 5, 6, 7)], uv, normals=normals, smooth=False)


def pair(prefix="", normals=NORMALS, **options):
    low = layers(f"{prefix}low", LAYERS, **options)
    high = layers(f"{prefix}high", np.array(LAYERS) + ABOVE, normals)
    bpy.context.view_layer.update()
    return low, high


def settings(**values):
    common = {"space": "OBJECT", "width": SIZE, "height": SIZE, "margin": 0, "depth": 32, "storage": "MEMORY"}
    return Settings(method="CAST", **{**common, "image": "map", "material": False, **values})


def check(texels, normals=NORMALS, *, halves=(0, 1)):
    """Each half of the map has the normals of its own layer, right up to its border."""
    u, v = np.moveaxis(maps.texel_uv(SIZE, SIZE), -1, 0)
    for half in halves:
        left = (0.0625, 0.5625)[half]
        covered = (np.abs(u - left - 0.1875) < 0.1875) & (np.abs(v - 0.5) < 0.375)
        expected = np.append(normals[half] * 0.5 + 0.5, 1.0)
        assert np.abs(texels[covered] - expected).max() < ROUNDING, half
    return texels


def test_the_outermost_rule_gives_both_halves_the_upper_layer():
    """Otherwise the cases below would test nothing."""
    low, high = pair()
    own = bake_pair(bpy.context, low, [high], settings())
    distances = {name: own.distances[name] for name in ("extrusion", "max_distance")}
    bake_pair(bpy.context, low, [high], settings(hit="OUTERMOST", **distances))
    check(maps.pixels(bpy.data.images["map"]), NORMALS[[1, 1]])


@pytest.mark.parametrize("margin", [0, 5])
@pytest.mark.parametrize("samples", [1, 4, 16])
@pytest.mark.parametrize("rows", [SIZE, 9], ids=["whole", "bands"])
def test_bands_and_samples(monkeypatch, rows, samples, margin):
    monkeypatch.setattr(bands, "BAND_TEXELS", SIZE * rows)
    low, high = pair()
    report = bake_pair(bpy.context, low, [high], settings(samples=samples, margin=margin))
    texels = check(maps.pixels(bpy.data.images["map"]))
    assert report.missed == 0.0
    assert ((texels[..., 3] > 0.0).mean() > 0.6) == (margin > 0)


def test_udim(tmp_path):
    low, high = pair(tile=1)
    values = {"udim": True, "storage": "FILE", "output": str(tmp_path / "map.exr")}
    report = bake_pair(bpy.context, low, [high], settings(**values))
    assert sorted(report.tiles) == [1001, 1002]
    for half, file in enumerate(sorted(report.output)):
        image = bpy.data.images.load(file)
        image.colorspace_settings.is_data = True
        check(maps.pixels(image), halves=[half])


def test_pairs_by_name():
    """Both pairs are in the same place: the layers of one are no layers of the other."""
    turned = NORMALS * (-1.0, -1.0, 1.0)
    pair("a_")
    pair("b_", turned)
    jobs, problems = jobs_by_name(bpy.context, Suffixes())
    assert problems == []
    assert [(job.low.name, [high.name for high in job.highs]) for job in jobs] == [
        ("a_low", ["a_high"]),
        ("b_low", ["b_high"]),
    ]
    reports = bake_all(bpy.context, jobs, settings(image="of {low}"))
    for report, normals in zip(reports, (NORMALS, turned), strict=True):
        check(maps.pixels(bpy.data.images[report.image]), normals)


@pytest.mark.parametrize(
    "data",
    [lambda: None, lambda: bpy.data.armatures.new("Hero"), lambda: bpy.data.lights.new("Hero", "SUN")],
    ids=["empty", "rig", "light"],
)
def test_what_shows_nothing_is_no_high_object_by_its_name(data):
    """Beside another pair, which is baked. A mesh of the name is one."""
    pair("a_")
    low = zoo.cube("Hero_low")
    bpy.context.scene.collection.objects.link(bpy.data.objects.new("Hero", data()))
    bpy.context.view_layer.update()
    jobs, problems = jobs_by_name(bpy.context, Suffixes())
    assert [job.low.name for job in jobs] == ["a_low"] and len(problems) == 1 and "Hero_low" in problems[0]
    bpy.data.objects.remove(bpy.data.objects["Hero"])
    high = zoo.cube("Hero")
    bpy.context.view_layer.update()
    jobs, _ = jobs_by_name(bpy.context, Suffixes())
    assert [job.highs for job in jobs if job.low == low] == [[high]]


def a_line(_data):
    pass


def a_tube(data):
    data.bevel_depth = 0.1


def a_ribbon(data):
    data.extrude = 0.1


def a_section(data):
    data.bevel_mode, data.bevel_object = (
        "OBJECT",
        scenes.link(bpy.data.objects.new("Section", bpy.data.curves.new("Section", "CURVE"))),
    )


def a_disc(data):
    data.dimensions, data.fill_mode, data.splines[0].use_cyclic_u = "2D", "BOTH", True


@pytest.mark.parametrize("name", ["Hero", "Hero_high"])
@pytest.mark.parametrize("change", [a_line, a_tube, a_ribbon, a_section, a_disc])
def test_paths_are_no_high_objects_by_their_names(name, change):
    """Curves with faces are."""
    pair("a_")
    zoo.cube("Hero_low")
    data = bpy.data.curves.new(name, "CURVE")
    data.splines.new("POLY").points.add(3)
    change(data)
    scenes.link(bpy.data.objects.new(name, data))
    bpy.context.view_layer.update()
    jobs, problems = jobs_by_name(bpy.context, Suffixes())
    assert ("Hero_low" in [job.low.name for job in jobs]) == (change is not a_line) == (not problems)


def test_an_atlas():
    """The second low object's UVs are on the free quarter above and below the first one's: both are scaled by a half."""
    turned = NORMALS * (-1.0, -1.0, 1.0)
    jobs = []
    for offset, prefix, normals in ((0.0, "a_", NORMALS), (0.5, "b_", turned)):
        low, high = pair(prefix, normals)
        layer = low.data.uv_layers[0].uv
        uv = np.empty((len(layer), 2), np.float32)
        layer.foreach_get("vector", uv.reshape(-1))
        layer.foreach_set("vector", (uv * (1.0, 0.5) + (0.0, offset)).astype(np.float32).ravel())
        jobs.append(Job(low, [high]))
    bake_all(bpy.context, jobs, settings(image="atlas", height=2 * SIZE), share_image=True)
    texels = maps.pixels(bpy.data.images["atlas"])
    check(texels[:SIZE])
    check(texels[SIZE:], turned)


def test_live_follows_a_layer():
    low, high = pair()
    following = live_session.Session(bpy.context, Job(low, [high]), settings(), Pace())
    following.run(bpy.context)
    check(following.texels)
    for vertex in high.data.vertices[4:]:
        vertex.co.z += ABOVE
    high.data.update()
    bpy.context.view_layer.update()
    following.run(bpy.context, {high.session_uid})
    check(following.texels)
    following.free()
