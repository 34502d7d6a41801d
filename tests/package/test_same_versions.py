# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests Imprint in other versions of Blender. Of the newest, these tests make the environment where it is not there; older ones
are skipped unless scripts/dev/same_versions.py has made theirs.

IMPRINT_BLENDERS names their folder, if it is not out/blender.
"""

import functools
import importlib.util
import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from scripts import imprint
from scripts.dev import blender_packages, same_versions

FOLDER = Path(os.environ.get("IMPRINT_BLENDERS", blender_packages.ENVIRONMENTS)).resolve()
HERE = Path(__file__).resolve().parent
SMALL = 64
"""The size of the maps."""
NEWEST = blender_packages.NEWEST
OLDER = [version for version in blender_packages.PYTHONS if version != NEWEST]
ON_BACKENDS = [
    (version, backend) for version in blender_packages.PYTHONS for backend in blender_packages.backends(version)
]
versions = pytest.mark.parametrize("version", blender_packages.PYTHONS)
older_versions = pytest.mark.parametrize("version", OLDER)
versions_on_backends = pytest.mark.parametrize(("version", "backend"), ON_BACKENDS)
TESTS = (
    "tests/scene",
    "tests/output/test_materials.py",
    "tests/passes/test_block_encoding.py",
    "tests/export/test_ktx2.py",
    "tests/ui/test_live.py",
    "tests/ui/test_live_maps.py",
)
"""What the newest version runs, of the fast lane: where Blender itself has changed most, and blocks to the bit, on Vulkan."""


def python_of(version):
    """The Python of a version, or skip the test if it is an older one that is not there."""
    if version != NEWEST and not (FOLDER / version / "complete").exists():
        pytest.skip(f"no Blender {version} in {FOLDER}: scripts/dev/same_versions.py makes it")
    return blender_packages.environment(FOLDER, version)


def run(tmp_path, *command, **variables):
    """Run a program in a profile of its own. Returns its output."""
    profile = {"BLENDER_USER_RESOURCES": str(tmp_path / "profile"), "PYTHONPATH": str(imprint.ROOT)}
    done = subprocess.run(
        command,
        env={**os.environ, **profile, **variables},
        cwd=imprint.ROOT,
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stdout[-3000:] + done.stderr[-3000:]
    return done.stdout


@pytest.fixture(scope="module")
def wanted(tmp_path_factory):
    """The outputs of this Blender."""
    return same_versions.maps_of(sys.executable, tmp_path_factory.mktemp("own"), SMALL)


@versions_on_backends
@pytest.mark.slow
def test_maps_are_the_same(version, backend, tmp_path, wanted):
    variables = blender_packages.backends(version)[backend]
    found = same_versions.maps_of(python_of(version), tmp_path, SMALL, variables)
    assert same_versions.compare(wanted, found, backend) == []
    assert len(found) >= 33
    assert min(np.ptp(texels) for name, texels in found.items() if "normal" in name) > 0.1


@older_versions
@pytest.mark.slow
def test_materials_are_as_in_newer_versions(version, tmp_path):
    output = run(tmp_path, python_of(version), str(HERE / "older_materials.py"), str(tmp_path))
    assert output.endswith("all as promised\n")


@pytest.fixture(scope="module")
def archive(tmp_path_factory):
    site_packages = Path(importlib.util.find_spec("bpy").origin).parent.parent
    return imprint.build_zip(sys.executable, site_packages, imprint.ROOT, tmp_path_factory.mktemp("zip"))


@versions_on_backends
@pytest.mark.slow
def test_the_zip_can_be_installed_in_other_versions(version, backend, tmp_path, archive):
    program = f"import os, runpy, sys; sys.argv[1:] = [{str(archive)!r}]; "
    program += f"runpy.run_path({str(HERE / 'install_zip.py')!r}, run_name='__main__'); sys.stdout.flush(); os._exit(0)"
    variables = blender_packages.backends(version)[backend]
    output = run(tmp_path, python_of(version), "-I", "-c", program, **variables)
    assert f"Blender {version}" in output
    assert f", {backend.upper()}\ninstalled, used and removed\n" in output


@pytest.mark.slow
def test_tests_pass_in_the_newest_version(tmp_path):
    lane = ["-q", "-m", "not slow and not shared", "-p", "no:cacheprovider", f"--basetemp={tmp_path / 'tests'}"]
    assert " passed" in run(tmp_path, python_of(NEWEST), "-m", "pytest", *lane, *TESTS)


def make_spheres(tmp_path, python):
    """Save one.blend and two.blend, with the objects lo and hi."""
    make = "import bpy\n"
    for name in ("one", "two"):
        make += "bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)\n"
        make += "bpy.ops.mesh.primitive_uv_sphere_add()\nbpy.context.object.name = 'lo'\n"
        make += "bpy.ops.mesh.primitive_uv_sphere_add(segments=64, ring_count=32)\nbpy.context.object.name = 'hi'\n"
        make += f"bpy.ops.wm.save_as_mainfile(filepath={str(tmp_path / name)!r} + '.blend')\n"
    run(tmp_path, python, "-c", make + "import os; os._exit(0)")


@versions
@pytest.mark.slow
def test_processes_conversions_and_levels_of_detail_in_other_versions(version, tmp_path):
    python = python_of(version)
    make_spheres(tmp_path, python)
    bake = functools.partial(run, tmp_path, python, "scripts/bake.py")
    sets = [{"file": f"{tmp_path / name}.blend", "output": f"{tmp_path / name}.png"} for name in ("one", "two")]
    defaults = {"low": "lo", "high": ["hi"], "size": 32, "basis": "mikktspace"}
    (tmp_path / "jobs.json").write_text(json.dumps({"defaults": defaults, "bake": sets}))
    jobs = ["--jobs", str(tmp_path / "jobs.json"), "--resume", "--workers", "2"]
    assert len(json.loads(bake(*jobs, "--list", "--json"))["bakes"]) == 2
    assert "2 done, " in bake(*jobs, "--sheet", str(tmp_path / "page.html"))
    assert (tmp_path / "page.html").read_text().count('src="data:image/png;base64,') == 2
    assert "0 done, 2 done before, " in bake(*jobs)
    one = str(tmp_path / "one.blend")
    converted = ["--convert", str(tmp_path / "one.png"), "--from-basis", "mikktspace", "--basis", "cycles"]
    bake(one, "--low", "lo", *converted, "--output", str(tmp_path / "converted.png"))
    levels = ["--distance", "2,4", "--size", "64", "--export", str(tmp_path / "levels.glb")]
    for more in ((), ("--timeout", "600")):  # here, and in a process of its own
        bake("lod", one, "--low", "hi", *levels, "--output", str(tmp_path / "{low}.png"), *more)
    made = ("converted.png", "hi_LOD1.png", "hi_LOD2.png", "levels.glb")
    assert all((tmp_path / name).stat().st_size > 0 for name in made)


@versions
@pytest.mark.slow
def test_the_command_line_bakes_in_other_versions(version, tmp_path):
    """Two pairs, so that a file is opened between two renders of the engine, and a scene is saved."""
    python = python_of(version)
    make_spheres(tmp_path, python)
    sets = [
        f'{{"file": "{tmp_path / name}.blend", "low": "lo", "high": ["hi"], "size": 32, "method": "{method}", '
        f'"output": "{tmp_path / name}.png", "save-blend": "{tmp_path / name}_baked.blend"}}'
        for name, method in (("one", "flatten"), ("two", "cast"))
    ]
    (tmp_path / "jobs.json").write_text(f'{{"bake": [{", ".join(sets)}]}}')
    run(tmp_path, python, "scripts/bake.py", "--jobs", str(tmp_path / "jobs.json"))
    one = [str(tmp_path / "one.blend"), "--low", "lo", "--high", "hi", "--output", str(tmp_path / "down.png")]
    for ending in ("glb", "fbx", "usd"):
        exported = ["--size", "32", "--green=-y", "--export", str(tmp_path / f"down.{ending}")]
        assert f"down.{ending}: 960 triangles" in run(tmp_path, python, "scripts/bake.py", *one, *exported)
    for name in ("one", "two"):
        assert (tmp_path / f"{name}.png").stat().st_size > 0
        assert (tmp_path / f"{name}_baked.blend").stat().st_size > 0
