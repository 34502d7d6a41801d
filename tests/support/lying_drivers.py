# SPDX-License-Identifier: GPL-3.0-or-later
"""Drivers that lie: each lie makes what the passes call do what a broken driver would."""

from contextlib import contextmanager

import gpu
import numpy as np
import pytest

from addon.passes import data_texture, driver_checks, shader, target


@contextmanager
def lying(lie):
    """In this block the driver tells a lie, from the next program that is compiled on."""
    shader.load.cache_clear()
    try:
        with pytest.MonkeyPatch.context() as patch:
            lie(patch)
            yield
    finally:
        shader.load.cache_clear()


class Late:
    """Runs each long dispatch only when something else asks for its result, as an asynchronous driver does.

    waits: whether `finish` asks for it.
    """

    def __init__(self, patch, *, waits):
        self.waiting = []
        self.dispatch, self.finish, self.read = target.dispatch_groups, target.Target.finish, target.read
        patch.setattr(target, "dispatch_groups", self._dispatch)
        patch.setattr(target, "read", self._read)
        if waits:
            patch.setattr(target.Target, "finish", lambda of: (self._run(), self.finish(of)))

    def _dispatch(self, program, groups, **bindings):
        if program is driver_checks.LONG and bindings["turns"] > 2**9:
            self.waiting.append((program, groups, bindings))
        else:
            self.dispatch(program, groups, **bindings)

    def _run(self):
        while self.waiting:
            program, groups, bindings = self.waiting.pop(0)
            self.dispatch(program, groups, **bindings)

    def _read(self, texture, out):
        self._run()
        self.read(texture, out)


def zeros_instead_of_waiting(patch):
    is_running = [False]
    dispatch, read = target.dispatch_groups, target.Target.read

    def dispatched(program, groups, **bindings):
        dispatch(program, groups, **bindings)
        is_running[0] |= program is driver_checks.LONG

    def read_too_early(of, out, slot=0, start=(0, 0)):
        read(of, out, slot, start)
        if is_running[0]:
            out[...] = 0
        is_running[0] = False

    patch.setattr(target, "dispatch_groups", dispatched)
    patch.setattr(target.Target, "read", read_too_early)


def finish_does_not_wait(patch):
    Late(patch, waits=False)


def a_dispatch_is_skipped(patch):
    done, dispatch = [0], target.dispatch_groups

    def dispatched(program, groups, **bindings):
        done[0] += 1
        if done[0] % 20:
            dispatch(program, groups, **bindings)

    patch.setattr(target, "dispatch_groups", dispatched)


def drawing_goes_first(patch):
    """A copy of what is computed is drawn before it is computed."""
    waiting, dispatch, fill = [], target.dispatch_groups, target.fill

    def dispatched(program, groups, **bindings):
        waiting.append(lambda: dispatch(program, groups, **bindings))

    def filled(*arguments, **options):
        fill(*arguments, **options)
        while waiting:
            waiting.pop()()

    patch.setattr(target, "dispatch_groups", dispatched)
    patch.setattr(target, "fill", filled)


def changed_upload(change):
    """A lie about what is uploaded. change: takes and returns the values (height, width, 4)."""

    def lie(patch):
        image = data_texture.image
        patch.setattr(data_texture, "image", lambda values, texel="RGBA32F": image(change(values.copy()), texel))

    return lie


def half_precision(values):
    with np.errstate(over="ignore"):
        return values.astype(np.float16).astype(np.float32)


def without_last_rows(values):
    values[64:][-3:] = 0.0
    return values


def changed_shaders(change):
    """A compiler that takes other texts for those of the shaders."""

    def lie(patch):
        source = shader.source
        patch.setattr(shader, "source", lambda *names: change(source(*names)))

    return lie


def changed_source(before, after):
    """A compiler that takes one text for another."""
    return changed_shaders(lambda text: text.replace(before, after))


def rows_are_flipped(patch):
    read = target.Target.read

    def flipped(of, out, slot=0, start=(0, 0)):
        read(of, out, slot, start)
        out[:] = out[::-1].copy()

    patch.setattr(target.Target, "read", flipped)


def backs_are_not_drawn(patch):
    draw = target.draw_bound

    def culled(*arguments, **options):
        gpu.state.face_culling_set("BACK")
        draw(*arguments, **options)
        gpu.state.face_culling_set("NONE")

    patch.setattr(target, "draw_bound", culled)


def ignored(switch, *values):
    """A state of the GPU that is not set to these values."""

    def lie(patch):
        change = getattr(gpu.state, switch)
        patch.setattr(gpu.state, switch, lambda value: None if value in values else change(value))

    return lie


def nothing_is_cleared(patch):
    patch.setattr(target, "clear", lambda _target: None)
    patch.setattr(target.Target, "__init__", spoiled(target.Target.__init__))


def spoiled(make):
    """New textures with NaN in them."""

    def made(of, width, height, formats):
        make(of, width, height, formats)
        if formats == ("RGBA32F",):
            with of.bound() as framebuffer:
                framebuffer.clear(color=(np.nan,) * 4)

    return made


def constants_are_cut(patch):
    mat4 = shader.mat4
    patch.setattr(shader, "mat4", lambda matrix: [*mat4(matrix)[:-1], 0.0])


def memory_is_shared(patch):
    made, make = {}, target.Target.__init__

    def shared(of, width, height, formats):
        make(of, width, height, formats)
        if width >= 2048:
            of.textures = made.setdefault((width, height), of.textures)

    patch.setattr(target.Target, "__init__", shared)


def anything_is_granted(patch):
    make = gpu.types.GPUTexture
    patch.setattr(gpu.types, "GPUTexture", lambda size, **how: make((min(size[0], 64), size[1]), **how))


LIES = {
    "ends loops early": (changed_source("turn < turns", "turn < min(turns, 30000)"), "Loops end where they should"),
    "reads back zeros instead of waiting": (zeros_instead_of_waiting, "Read-backs wait"),
    "does not wait where it is told to": (finish_does_not_wait, "Waiting waits"),
    "skips a dispatch": (a_dispatch_is_skipped, "No dispatch is left out"),
    "draws before it computes": (drawing_goes_first, "Drawing sees what was computed"),
    "drops the last rows of a table": (changed_upload(without_last_rows), "Large tables arrive whole"),
    "rounds floats to half precision": (changed_upload(half_precision), "Floats keep 32 bits"),
    "cuts whole numbers": (changed_source("hit.z >> 8u", "(hit.z & 16777215u) >> 8u"), "Whole numbers stay whole"),
    "reads beside corners": (changed_source("(size - 1)", "(size - 2)"), "Corners of textures"),
    "gives NaN for a vector of zeros": (
        changed_source("max(length(vector), 1e-20)", "length(vector)"),
        "Vectors without a direction",
    ),
    "takes what rounding leaves for a direction": (
        changed_source("length_squared > 1e-30 &&", "length_squared > 0.0 &&"),
        "Vectors without a direction",
    ),
    "cuts constants": (constants_are_cut, "128 bytes of constants"),
    "flips rows": (rows_are_flipped, "Row 0 is v = 0"),
    "draws one winding alone": (backs_are_not_drawn, "Row 0 is v = 0"),
    "goes on blending": (ignored("blend_set", "NONE"), "Blending"),
    "never blends": (ignored("blend_set", "ADDITIVE"), "Blending"),
    "tests no depth": (ignored("depth_test_set", "LESS"), "Depth and rows"),
    "limits no rows": (ignored("scissor_test_set", True), "Depth and rows"),
    "leaves new textures as they are": (nothing_is_cleared, "New textures are cleared"),
    "gives the same memory twice": (memory_is_shared, "Memory is granted and freed"),
    "grants what it has not": (anything_is_granted, "Too much is refused"),
}


# Lies that the whole test catches


def dispatches_are_lost(patch):
    """One of 20."""
    done, dispatch = [0], gpu.compute.dispatch

    def dispatched(*arguments):
        done[0] += 1
        if done[0] % 20:
            dispatch(*arguments)

    patch.setattr(gpu.compute, "dispatch", dispatched)


def half(texel):
    """The text of a shader's expression in half precision."""
    return f"vec4(unpackHalf2x16(packHalf2x16({texel}.xy)), unpackHalf2x16(packHalf2x16({texel}.zw)))"


SUMS = "imageLoad(sums, texel)"
X, Y = (f"floatBitsToUint(v_weights.{axis})" for axis in "xy")
WHOLE_LIES = {
    "adds up in half precision": (changed_source(SUMS, half(SUMS)), {"Adaptive samples: normal"}),
    "does not write a texture of whole numbers": (
        changed_source("imageStore(offsets, ", "if (gl_GlobalInvocationID.z > 7u) imageStore(offsets, "),
        {"Whole numbers stay whole", "Margin of the nearest: base color"},
    ),
    "loses dispatches": (dispatches_are_lost, {"No dispatch is left out", "Rays from hits: ambient occlusion"}),
    "swaps the weights of corners": (changed_source(f"{X}, {Y}", f"{Y}, {X}"), {"Materials: base color"}),
    "flips rows": (rows_are_flipped, {"Row 0 is v = 0", "Flatten, Cycles: normal"}),
    "gives NaN for a vector of zeros": (LIES["gives NaN for a vector of zeros"][0], {"Vectors without a direction"}),
    "tests no depth": (LIES["tests no depth"][0], {"Depth and rows"}),
}
"""By name: the lie, and tests that are wrong under it."""
