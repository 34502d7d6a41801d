# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests that GPU state left by scripts, and rows of other passes, do not change what targets get."""

from functools import partial
from types import SimpleNamespace

import bpy
import gpu
import numpy as np
import pytest

from addon.core import udim
from addon.core.errors import NoGpuMemory
from addon.passes import (
    allocation,
    blender_gpu,
    data_texture,
    high_in_uv,
    margin_fill,
    mesh_upload,
    samples,
    surface_tables,
    target,
)
from tests.support import maps, scenes, zoo
from tests.support.seen_surface import SeenSurface, grid, read, texture

pytestmark = pytest.mark.usefixtures("gpu_context")


SIZE = (16, 12)


def square(into):
    """Draw a square with a tilted normal over all of `into`. Returns the texels."""
    mesh = mesh_upload.upload(
        np.array([[0, 1, 2], [0, 2, 3]], np.int32),
        uv=np.array([(0, 0), (1, 0), (1, 1), (0, 1)], np.float32),
        normal=np.tile(np.float32((0.6, 0.0, 0.8)), (4, 1)),
    )
    high_in_uv.draw_normals(
        into, [(mesh, np.eye(3)), (mesh, np.eye(3))], udim.uv_to_clip(1001)
    )  # twice, to detect additive blending
    texels = np.empty((into.height, into.width, 4), np.float32)
    into.read(texels)
    return texels


def is_whole(texels):
    return np.allclose(texels, (0.6, 0.0, 0.8, 1.0), atol=1e-6)


@pytest.mark.parametrize(
    ("switch", "value", "usual"),
    [
        ("blend_set", ("ADDITIVE",), ("NONE",)),
        ("blend_set", ("ALPHA_PREMULT",), ("NONE",)),
        ("color_mask_set", (False, True, False, False), (True, True, True, True)),
        ("depth_test_set", ("EQUAL",), ("NONE",)),
    ],
)
@pytest.mark.parametrize("kind", [target.Target, target.Offscreen])
def test_gpu_state_left_by_a_script_does_not_matter(kind, switch, value, usual):
    getattr(gpu.state, switch)(*value)
    try:
        assert is_whole(square(kind(*SIZE, ("RGBA32F",))))
    finally:
        getattr(gpu.state, switch)(*usual)


def test_the_blend_mode_is_restored():
    gpu.state.blend_set("ADDITIVE")
    try:
        square(target.Target(*SIZE, ("RGBA32F",)))
        assert gpu.state.blend_get() == "ADDITIVE"
    finally:
        gpu.state.blend_set("NONE")


@pytest.mark.parametrize("kind", [target.Target, target.Offscreen])
def test_drawing_some_rows_does_not_limit_later_drawing(kind):
    into = kind(*SIZE, ("RGBA32F",))
    with target.drawing(into, range(2, 5)):
        pass
    assert is_whole(square(into))
    assert is_whole(square(kind(*SIZE, ("RGBA32F",))))


# Offscreen


OFFSCREEN_SIZE = (48, 32)


def triangle(into):
    """Draw one triangle with different normals at its corners into `into`. Returns the texels."""
    mesh = mesh_upload.upload(
        np.array([[0, 1, 2]], np.int32),
        uv=np.array([(0.1, 0.1), (0.9, 0.2), (0.4, 0.95)], np.float32),
        normal=np.array([(0.0, 0.1, 1.0), (0.7, -0.2, 0.4), (-0.3, 0.5, 0.6)], np.float32),
    )
    high_in_uv.draw_normals(into, [(mesh, np.eye(3))], udim.uv_to_clip(1001))
    return texels_of(into)


def texels_of(drawn):
    texels = np.empty((drawn.height, drawn.width, 4), np.float32)
    drawn.read(texels)
    return texels


@pytest.fixture
def made(monkeypatch):
    """All GPUOffScreens that the test creates."""
    found, make = [], gpu.types.GPUOffScreen

    def spy(*arguments, **options):
        found.append(make(*arguments, **options))
        return found[-1]

    monkeypatch.setattr(gpu.types, "GPUOffScreen", spy)
    target.common.free()
    yield found
    target.common.free()


@pytest.mark.parametrize("samples", [1, 4])
def test_flatten_draws_into_a_gpuoffscreen(made, samples):
    low, high = zoo.plane("lo"), zoo.terrain("hi")
    stored = maps.bake(low, high, space="OBJECT", size=OFFSCREEN_SIZE, samples=samples, adaptive=False)
    assert [(one.width, one.height) for one in made] == [OFFSCREEN_SIZE]
    held = np.empty((*OFFSCREEN_SIZE[::-1], 4), np.float32)
    target.read(made[0].texture_color, held)
    assert len(np.unique(held)) > 500
    assert np.allclose(stored[..., :3], held[..., :3] * 0.5 + 0.5, rtol=0, atol=1e-6)


def test_an_offscreen_and_a_framebuffer_get_the_same_bits():
    drawn = [triangle(kind(*OFFSCREEN_SIZE, ("RGBA32F",))) for kind in (target.Target, target.Offscreen)]
    assert 0 < np.count_nonzero(drawn[0][..., 3]) < OFFSCREEN_SIZE[0] * OFFSCREEN_SIZE[1]
    assert np.array_equal(*drawn)


def test_the_depth_buffer_hides_nothing_after_a_script_left_depth_tests_on():
    expected = triangle(target.Offscreen(*OFFSCREEN_SIZE, ("RGBA32F",)))
    gpu.state.depth_test_set("EQUAL")
    gpu.state.depth_mask_set(True)
    try:
        assert np.array_equal(triangle(target.Offscreen(*OFFSCREEN_SIZE, ("RGBA32F",))), expected)
        assert gpu.state.depth_test_get() == "EQUAL"
    finally:
        gpu.state.depth_test_set("NONE")
        gpu.state.depth_mask_set(False)


def test_the_texture_stays_valid_after_the_offscreen_is_freed():
    own = target.Offscreen(*OFFSCREEN_SIZE, ("RGBA32F",))
    expected, texture = triangle(own), own.texture
    del own
    found = np.empty_like(expected)
    target.read(texture, found)
    assert np.array_equal(found, expected)


def test_the_previous_framebuffer_is_bound_again():
    outer, own = target.Target(8, 8, ("RGBA32F",)), target.Offscreen(*OFFSCREEN_SIZE, ("RGBA32F",))
    with target.drawing(outer):
        triangle(own)
        gpu.state.active_framebuffer_get().clear(color=(1.0, 2.0, 3.0, 4.0))
    assert (texels_of(outer) == (1.0, 2.0, 3.0, 4.0)).all()


def test_normals_that_compute_shaders_change_are_not_in_a_gpuoffscreen(made):
    """Its texture cannot be written by compute shaders on Vulkan and Metal."""
    low, high = zoo.plane("lo"), zoo.plane("hi")
    material = bpy.data.materials.new("bumpy")
    node = material.node_tree.nodes.new("ShaderNodeNormalMap")
    image = scenes.image("bumps", np.full((4, 4, 3), (0.6, 0.5, 0.9)), space="Non-Color")
    material.node_tree.links.new(scenes.texture(material, image).outputs["Color"], node.inputs["Color"])
    scenes.set_inputs(material, Normal=node.outputs["Normal"])
    high.data.materials.append(material)
    assert np.ptp(maps.bake(low, high, space="OBJECT", size=OFFSCREEN_SIZE)[..., 0]) < 1e-6
    assert made == []


# Read back


@pytest.fixture
def no_compute(monkeypatch):
    """Make each compute shader an error."""

    def dispatch(program, groups, **bindings):
        pytest.fail(f"{program.compute} ran")

    return lambda: monkeypatch.setattr(target, "dispatch_groups", dispatch)


def test_blocks_are_drawn(no_compute):
    seen = SeenSurface(grid(1, 1), (70, 40))
    no_compute()
    assert surface_tables.find_blocks(seen.hits, seen.labels).masks[..., 0].tolist() == [[2, 2, 2], [2, 2, 2]]


def test_hits_are_removed_by_drawing_seed_1(no_compute):
    seen = SeenSurface(grid(1, 1), (20, 10))
    is_known = np.random.default_rng(1).random((10, 20)) < 0.5
    normals = texture(np.repeat(is_known[..., None], 4, axis=-1))
    no_compute()
    high_in_uv.clip_hits(seen.hits, normals)
    seen.draw_normals(seen.drawn_normals, np.eye(3))
    assert np.array_equal(read(seen.drawn_normals)[..., 3] == 1.0, is_known)


def test_a_texture_is_copied_by_drawing_before_it_is_read_seed_2(monkeypatch):
    values = np.random.default_rng(2).normal(size=(6, 5, 4)).astype(np.float32)
    shown, copied, whole = texture(values), [], target.fill
    monkeypatch.setattr(
        target, "fill", lambda *a, **bindings: (copied.append(bindings["source"]), whole(*a, **bindings))
    )
    found = np.empty((4, 5, 4), np.float32)
    target.read(shown, found)
    assert np.array_equal(found, values[:4])
    assert copied == [shown]


# Waiting


@pytest.mark.parametrize("texel", ["RGBA32UI", "RGBA32F"])
def test_a_target_that_a_dispatch_wrote_is_waited_for(texel):
    """OpenGL refuses to read four channels of integers as Blender asks for them: it gives zeros, and does not wait."""
    kind, values = ("UINT_2D", "uvec4(7u, 8u, 9u, 10u)") if texel == "RGBA32UI" else ("FLOAT_2D", "vec4(7, 8, 9, 10)")
    info = gpu.types.GPUShaderCreateInfo()
    info.image(0, texel, kind, "written", qualifiers={"WRITE"})
    info.local_group_size(8, 8)
    info.compute_source(f"void main() {{ imageStore(written, ivec2(gl_GlobalInvocationID.xy), {values}); }}")
    compiled, into = gpu.shader.create_from_info(info), target.Target(8, 8, (texel,))
    gpu.shader.from_builtin("UNIFORM_COLOR").bind()  # as shader.load has it
    compiled.bind()
    compiled.image("written", into.texture)
    gpu.compute.dispatch(compiled, 1, 1, 1)
    assert into.first().tolist() == ([7] if texel == "RGBA32UI" else [7, 8, 9, 10])
    into.finish()


# Data textures


def test_a_table_that_did_not_arrive_is_an_error(monkeypatch):
    """OpenGL says nothing where it lacks memory: tables are zeros."""
    values = np.full((data_texture.CHECKED // 16, 4), 1.0, np.float32)
    values[-1] = (0.0, np.nan, -0.0, 5.0)
    data_texture.upload(values)
    data_texture.upload_numbers(np.zeros(len(values), np.int32))
    made = allocation.texture
    monkeypatch.setattr(allocation, "texture", lambda size, texel, values: made(size, texel, np.zeros_like(values)))
    for upload in (
        partial(data_texture.upload, values),
        partial(data_texture.upload_numbers, values[:, 0].astype(int)),
    ):
        with pytest.raises(NoGpuMemory, match=r"needs about \d+\.\d GiB of the GPU's memory"):
            upload()
    data_texture.upload(values[4096:])  # small ones are not checked


def test_a_table_has_no_more_rows_than_drivers_grant_in_one_texture(monkeypatch):
    monkeypatch.setattr(blender_gpu, "capabilities", SimpleNamespace(max_texture_size_get=lambda: 32768), raising=False)
    assert data_texture.limit() == 4096 * 16384
    monkeypatch.setattr(blender_gpu, "capabilities", SimpleNamespace(max_texture_size_get=lambda: 8192))
    assert data_texture.limit() == 4096 * 8192


# Texels that are left out


def test_texels_that_are_left_out_are_nearer_than_what_is_drawn():
    """Equal depths would leave the comparison to the driver's rounding."""
    rounds = texture(
        np.repeat(np.float32([[1.0, 4.0]]).repeat(8, axis=1).repeat(8, axis=0)[..., None] / 255, 4, axis=-1)
    )
    some = samples.find_active(rounds, np.repeat(np.repeat(np.uint8([[1, 4]]), 8, axis=1), 8, axis=0), 2)
    into = target.Target(16, 8, ("R32F",))
    corners = np.float32([(0, 0, -0.1, 3), (1, 0, -0.1, 3), (1, 1, -0.1, 3), (0, 1, -0.1, 3)])
    strip = mesh_upload.upload(np.array([[0, 1, 2], [0, 2, 3]], np.int32), corner=corners)
    target.draw(into, margin_fill.SEAM_BORDERS, strip, stopped=some.stopped, uv_to_clip=udim.uv_to_clip(1001))
    found = into.texels()
    assert (found[:, :8] == 0.0).all()
    assert (found[:, 8:] == 3.0).all()
