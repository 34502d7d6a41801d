# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests that Metal takes every shader, by clang and a stand-in for Metal's library, as no Mac is here. See tests/support/metal.

OpenGL takes more than Metal does: the slips below compile on it.
"""

import functools
import os
import re

import gpu
import pytest

from addon.passes import shader
from addon.passes.shader import Program
from tests.support import programs
from tests.support.metal import generator

PROGRAMS = programs.find_all()


@pytest.fixture(autouse=True)
def clang():
    """Skip these tests where clang is missing. Fail where CI=true: a suite that skips its subject looks healthy."""
    if generator.CLANG is None:
        reason = "no clang, which checks the shaders for Metal"
        if os.environ.get("CI") == "true":
            pytest.fail(reason, pytrace=False)
        pytest.skip(reason)


@pytest.mark.parametrize("as_images", [True, False], ids=["images", "samplers"])
@pytest.mark.parametrize("version", generator.VERSIONS)
def test_metal_takes_every_stage(version, as_images):
    stages = [stage for name, each in PROGRAMS.items() for stage in generator.stages_of(name, each, as_images)]
    assert len(stages) > len(PROGRAMS)
    assert generator.errors(stages, version) == []


HOST = Program(
    vertex="host_vert",
    fragment="host_frag",
    inputs=(("VEC2", "position"),),
    varyings=(("VEC4", "v_place"),),
    samplers=(("FLOAT_2D", "colors"),),
    constants=(("MAT4", "matrix"), ("FLOAT", "scale"), ("INT", "count")),
    outputs=(("VEC4", "color_out"),),
)
HOST_VERTEX = """
void main()
{
  gl_Position = vec4(position, 0.0, 1.0);
  v_place = gl_Position;
}
"""
HOST_FRAGMENT = """
struct Pair {
  float a, b;
};
%s
void main()
{
  float sum = texelFetch(colors, ivec2(gl_FragCoord.xy), 0).x;
  vec4 place = matrix * v_place * scale * float(count);
  %s
  color_out = vec4(sum) + place;
}
"""

SLIPS = {
    "vectors compared": ("", "if (ivec2(place.xy) == ivec2(1)) { sum += 1.0; }"),
    "a function that Metal lacks": ("", "sum += roundEven(scale);"),
    "a constructor that is not rewritten": ("", "sum += (mat3 (matrix) * place.xyz).x;"),
    "a matrix cut to another shape": ("", "sum += mat3x2(matrix)[0].x;"),
    "a matrix divided": ("", "sum += (matrix / 2.0)[0].x;"),
    "a whole number beside a float": ("", "sum += max(scale, 0);"),
    "the root of a whole number": ("", "sum += inversesqrt(count);"),
    "the sign of a whole number": ("", "sum += float(sign(count));"),
    "the length of a scalar": ("", "sum += length(scale);"),
    "atan of two types": ("", "sum += atan(1, scale);"),
    "mod of whole numbers": ("", "sum += mod(ivec2(count), 2.0).x;"),
    "a vector of another type": ("", "vec3 wide = ivec3(count); sum += wide.x;"),
    "a vector cut by a constructor": ("", "sum += vec2(place.xyz).x;"),
    "a vector of vectors of another type": ("", "sum += vec4(ivec2(count), ivec2(count)).x;"),
    "the constructor of a struct": ("", "Pair pair = Pair(1.0, 2.0); sum += pair.a;"),
    "an array returned": ("float[2] both() { return float[2](1.0, 2.0); }", "sum += both()[count];"),
    "the size of an array by a constant": ("const int SIZE = 2;", "float both[SIZE]; both[0] = 1.0; sum += both[0];"),
    "a swizzle to be written by a function": ("void clear(inout vec2 v) { v = vec2(0.0); }", "clear(place.xy);"),
    "a name that hides its function": ("", "float distance = distance(place.xy, place.zw); sum += distance;"),
    "a reserved word": ("", "int kernel = count; sum += float(kernel);"),
    "a declaration": ("uniform float extra;", "sum += extra;"),
}
"""What GLSL takes and Metal does not: (outside of main, inside of it)."""

TAKEN = {
    "swizzles of one type": ("", "vec2 pair = count > 0 ? place.xy : place.zw; pair.yx = place.xy; sum += pair.x;"),
    "scalars beside vectors": ("", "sum += (max(place, 0.0) * 2.0 + clamp(place, 0.0, 1.0) / scale - 1.0).x;"),
    "whole vectors": ("", "ivec2 at = ivec2(place.xy) * 2 - 1; at[1] = at.x % 3; sum += vec2(at >> 1 & 1).y;"),
    "all components compared": ("", "if (all(equal(ivec2(place.xy), ivec2(1)))) { sum += 1.0; }"),
    "a choice by component": ("", "sum += mix(place, vec4(0.0), lessThan(place, vec4(scale))).x;"),
    "vectors of bool": ("", "bvec2 is_low = lessThan(place.xy, place.zw); sum += is_low.x ? 1.0 : vec2(is_low).y;"),
    "a part of a matrix": ("", "mat3 turn = mat3(matrix); turn[0] = vec3(1.0); sum += (turn * place.xyz)[count];"),
    "an array of numbers": ("", "float both[2] = float[2](1.0, scale); sum += both[count];"),
    "bits": (
        "",
        "uint bits = floatBitsToUint(scale); sum += uintBitsToFloat(bits & (bits - 1u)) + float(findLSB(bits));",
    ),
    "a result": ("void clear(inout vec2 v, out float x) { v = vec2(0.0); x = v.x; }", "vec2 v; clear(v, sum);"),
    "a struct by its fields": ("Pair pair(float a) { Pair both; both.a = a; return both; }", "sum += pair(scale).a;"),
    "angles": ("", "sum += atan(scale, 2.0) + mod(scale, 2.0) + mod(place, 2.0).x + inversesqrt(scale);"),
    "a constant beside functions": ("const vec2 HALF = vec2(0.5);", "sum += dot(HALF, place.xy);"),
}


def host(parts, name="host"):
    """The stages of HOST with these parts of a fragment shader."""
    text = shader.prelude(False) + HOST_FRAGMENT % parts
    return [
        generator.Stage(f"{name}, vertex", "vertex", HOST_VERTEX, HOST, False),
        generator.Stage(f"{name}, fragment", "fragment", text, HOST, False),
    ]


@functools.cache
def all_errors(version):
    """The errors of all slips, and of all that is taken, in one run of clang."""
    parts = SLIPS | TAKEN
    return generator.errors([stage for name, each in parts.items() for stage in host(each, name)], version)


def errors_of(name, version):
    return [each for each in all_errors(version) if each.startswith(f"{name}, ")]


@pytest.mark.parametrize("name", SLIPS)
def test_what_metal_refuses_is_found(name):
    assert all(errors_of(name, version) for version in generator.VERSIONS)


@pytest.mark.parametrize("name", TAKEN)
def test_what_metal_takes_is_not_reported(name):
    assert [errors_of(name, version) for version in generator.VERSIONS] == [[], []]


@pytest.mark.parametrize("version", generator.VERSIONS)
def test_errors_name_their_stage(version):
    assert [
        each for each in all_errors(version) if not each.startswith(tuple(f"{name}, fragment:" for name in SLIPS))
    ] == []


@pytest.mark.usefixtures("gpu_context")
@pytest.mark.parametrize("parts", [*SLIPS.values(), *TAKEN.values()], ids=[*SLIPS, *TAKEN])
def test_opengl_takes_it_all(parts, monkeypatch):
    """Otherwise the tests on OpenGL would find the slips, and these here would show nothing."""
    if gpu.platform.backend_type_get() != "OPENGL":
        pytest.skip("this Blender does not draw by OpenGL")
    texts = {"host_vert": HOST_VERTEX, "host_frag": HOST_FRAGMENT % parts}
    monkeypatch.setattr(shader, "source", texts.__getitem__)
    shader.load.__wrapped__(HOST)


def test_names_of_constants_are_taken_up_to_5_0():
    """Blender 4.5 and 5.0 make them macros, on Vulkan as well. Later versions do not."""
    parts = "float half_of(float scale) { return 0.5 * scale; }", "sum += half_of(2.0);"
    assert generator.errors(host(parts), "5.1") == []
    assert generator.errors(host(parts), "4.5")


def test_what_is_read_cannot_be_written_from_5_1_on():
    """A varying is a constant in the fragment shader."""
    assert generator.errors(host(("", "v_place = vec4(0.0);")), "5.1")


def test_macros_of_one_stage_do_not_reach_the_next():
    stages = host(("#define TWICE(x) ((x) + (x))", "sum = TWICE(sum);")) + host(("", "sum = TWICE(sum);"))
    assert len(generator.errors(stages, "5.1")) == 1


IMAGE_USES = {
    "READ WRITE": ("vec4 value = imageLoad(image, at);", "imageStore(image, at, vec4(0.0));", "imageFence(image);"),
    "READ": ("vec4 value = imageLoad(image, at);",),
    "WRITE": ("imageStore(image, at, vec4(0.0));",),
}


@pytest.mark.parametrize("version", generator.VERSIONS)
def test_an_image_has_the_access_that_its_program_declares(version):
    wrong = "imageStore(image, at, ivec4(0));", "imageStore(image, gl_GlobalInvocationID.xy, vec4(0.0));"
    stages, refused = [], set()
    for access, uses in IMAGE_USES.items():
        declared = Program(compute="c", images=(("RGBA32F", "FLOAT_2D", "image", access),))
        for statement in (*IMAGE_USES["READ WRITE"], *wrong):
            name = f"{access}: {statement}"
            text = f"void main()\n{{\n  ivec2 at = ivec2(gl_GlobalInvocationID.xy);\n  {statement}\n}}\n"
            stages.append(generator.Stage(name, "compute", text, declared, True))
            refused |= {name} - {f"{access}: {use}" for use in uses}
    assert len(refused) == 10
    assert {re.sub(r":\d+:\d+: .*", "", each) for each in generator.errors(stages, version)} == refused


def asks_for_nan(text):
    """Lines that fast math may change: isnan, isinf, and negations of comparisons, which NaN passes."""
    code = re.sub(r"//[^\n]*", "", text)
    return re.findall(r"[^\n]*(?:\bisnan\b|\bisinf\b|!\((?:[^()]|\([^()]*\))*\s[<>]=?\s)[^\n]*", code)


def test_no_shader_depends_on_nan():
    """Metal compiles with fast math."""
    files = sorted(shader.SHADERS.rglob("*.glsl"))
    assert files
    assert {path.name: lines for path in files if (lines := asks_for_nan(path.read_text(encoding="utf-8")))} == {}


@pytest.mark.parametrize(
    "line", ["if (isnan(x)) {", "is_far = isinf(x) || y;", "if (!(x > 0.0)) {", "a = b && !(dot(x, y) <= f(c) * 2.0);"]
)
def test_what_depends_on_nan_is_found(line):
    assert asks_for_nan(f"  {line}  // x\n")


def test_the_text_changes_as_in_blender():
    """As dumps of Blender 5.2 show it (--debug-gpu-shader-source), and the constructors as it changes them on a Mac."""
    before = """\
vec2 a(in vec2 x, inout vec2 y, out ivec3 z);  // out mat3 (1)
mat3 b = mat3(m) * mat3x3(1.0), c = my_mat3(m); mat3x4 d = mat3x4(e); /* mat3(
mat3( */ float f[2] = float[2](1.0, 2.0);
"""
    after = """\
vec2 a(in vec2 _in_sta x _in_end, inout vec2 _inout_sta y _inout_end, out ivec3 _out_sta z _out_end);
mat3 b = __mat3x3(m) * __mat3x3(1.0), c = my_mat3(m); mat3x4 d = mat3x4(e);
float f[2] = ARRAY_T(float) ARRAY_V(1.0, 2.0);
"""
    lines = [re.sub(r"\s+", " ", line).strip() for line in generator.rewritten(before).splitlines()]
    assert lines == after.splitlines()
