# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests that Vulkan takes every shader, and that it can be said in Metal's and Direct3D's languages, by Khronos' compilers.

They translate what a shader means, where Blender translates its text for Metal: test_metal.py.
"""

import hashlib
import os
import shutil
import subprocess
from concurrent.futures import ThreadPoolExecutor

import pytest

from addon.passes.shader import Program
from tests.support import programs, vulkan
from tests.support.metal import generator

TOOLS = "glslangValidator", "spirv-val", "spirv-cross"
MISSING = [tool for tool in TOOLS if shutil.which(tool) is None]
MSL = "--msl", "--msl-version", "20300"
HLSL = "--hlsl", "--shader-model", "60"


@pytest.fixture(autouse=True)
def tools():
    """Skip these tests where the tools are missing. Fail where CI=true."""
    if MISSING:
        reason = f"no {', '.join(MISSING)}"
        if os.environ.get("CI") == "true":
            pytest.fail(reason, pytrace=False)
        pytest.skip(reason)


def problem(*command):
    """What a tool says of a file that it refuses, or ""."""
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    return f"{command}: {done.stdout}{done.stderr}" if done.returncode else ""


def compiled(kind, whole, folder, languages):
    """What the tools say of a stage of a kind, by its whole text."""
    name = hashlib.sha256(whole.encode()).hexdigest()
    text, binary = folder / f"{name}.{kind}", folder / f"{name}.spv"
    text.write_text(whole, encoding="utf-8")
    environment = "--target-env", "vulkan1.2"
    found = problem("glslangValidator", "--quiet", "-V", *environment, "-o", binary, text)
    found = found or problem("spirv-val", *environment, binary)
    for language in languages:
        found = found or problem("spirv-cross", binary, *language, "--output", folder / f"{name}.txt")
    return found


def problems(stages, version, folder, languages=(), known=()):
    """What the tools say of the stages: whether they become SPIR-V that is valid, and that in these languages. known: kinds
    and texts that were found valid; stages of many programs and versions have the same one."""
    names = {}
    for stage in stages:
        names.setdefault((vulkan.KINDS[stage.kind], vulkan.text_of(stage, version)), stage.name)
    left = [each for each in names if each not in known]
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        found = list(pool.map(lambda each: compiled(*each, folder, languages), left))
    return [f"{names[each]}: {text}" for each, text in zip(left, found, strict=True) if text]


def every_stage(as_images):
    programs_found = programs.find_all().items()
    return [stage for name, declared in programs_found for stage in generator.stages_of(name, declared, as_images)]


@pytest.fixture(scope="module")
def translated(tmp_path_factory):
    """What is wrong with the stages in Vulkan, Metal's and Direct3D's languages, and what is known to be right."""
    stages = every_stage(as_images=False)
    found = problems(stages, "5.1", tmp_path_factory.mktemp("translated"), (MSL, HLSL))
    return found, set() if found else {(vulkan.KINDS[stage.kind], vulkan.text_of(stage, "5.1")) for stage in stages}


@pytest.mark.slow
def test_every_stage_translates_to_metal_and_direct3d(translated):
    assert translated[0] == []


@pytest.mark.slow
@pytest.mark.parametrize(("version", "as_images"), [("4.5", False), ("5.1", True)], ids=["4.5-samplers", "5.1-images"])
def test_vulkan_takes_every_stage(version, as_images, tmp_path, translated):
    assert problems(every_stage(as_images), version, tmp_path, known=translated[1]) == []


def test_what_vulkan_refuses_is_found(tmp_path):
    declared = Program(compute="c", constants=(("FLOAT", "scale"),), images=(("R32F", "FLOAT_2D", "image", "WRITE"),))
    uses = {
        "right": "void main() { imageStore(image, ivec2(0), vec4(scale)); }",
        "no such name": "void main() { imageStore(image, ivec2(0), vec4(size)); }",
        "a constant's name": "void main() { float scale = 2.0; imageStore(image, ivec2(0), vec4(scale)); }",
    }
    stages = [generator.Stage(name, "compute", text, declared, True) for name, text in uses.items()]
    assert [each.split(":")[0] for each in problems(stages, "5.1", tmp_path, (MSL, HLSL))] == ["no such name"]
    assert [each.split(":")[0] for each in problems(stages, "4.5", tmp_path)] == ["no such name", "a constant's name"]
