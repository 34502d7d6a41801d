#!/usr/bin/env python3
# SPDX-License-Identifier: GPL-3.0-or-later
"""Runs tests, or compares maps, on drivers that do what real GPUs do and llvmpipe does not. No GPU is needed.

    python3 scripts/dev/lanes.py test zink --blender blender [FILE.py ...]
    python3 scripts/dev/lanes.py maps --blender blender [--lanes opengl,zink,vulkan] [--scenes 0:200] [--size 256] PAIR.blend ...

A lane is one of those in LANES below; docs/testing.md says what each finds. --blender is a command that starts a Blender from
4.5 on, in the background; it may have arguments of its own. Without it, Blender's Python package runs, on OpenGL alone.

test: tests/passes and tests/engine, or these files, each in a process of its own. Ends with 1 if a test fails, a process
crashes, or Vulkan's validation has a message.

maps: each PAIR.blend holds two objects, "hi" and "lo"; --scenes are the seeds of random scenes of overlapping layers. The maps
of each lane stay in --out, and all that are there are compared with those of --against. Ends with 1 if a lane lacks a map, or
if texels differ that may not.
"""

import argparse
import collections
import json
import os
import re
import shlex
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass, field, replace
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

from scripts import imprint  # noqa: E402

OUT = ROOT / "out" / "lanes"
TOLERANCE = 1e-5
"""The most by which a channel may differ: normals in 32-bit floats, from 0 to 1, and values of other maps."""
MOST = 5e-4
"""Share of the texels that may differ by more: rays along an edge or along the surface, or ties between two layers."""
LONGEST = 3600
"""Seconds that one file of tests, or the maps of one lane, may take."""


@dataclass(frozen=True)
class Lane:
    """A driver, and what tests/support/drivers.py imitates on it.

    variables: of the environment. renderer: a part of its name, if the variables choose one. validates: Khronos' validation
    layer checks each call. other_rasterizer: drawn triangles have other corners and depths, so that maps are not equal.
    """

    backend: str = "opengl"
    driver: str = "samplers"
    variables: dict[str, str] = field(default_factory=dict)
    renderer: str = ""
    validates: bool = False
    other_rasterizer: bool = False


VALIDATION = {"VK_INSTANCE_LAYERS": "VK_LAYER_KHRONOS_validation", "VK_KHRONOS_VALIDATION_VALIDATE_SYNC": "1"}
GPU_VALIDATION = {**VALIDATION, "VK_KHRONOS_VALIDATION_GPUAV_ENABLE": "1"}
SWIFTSHADER = "/usr/lib/chromium/vk_swiftshader_icd.json"
"""Of Debian's package chromium-common."""
LANES = {
    "opengl": Lane(),
    "images": Lane(driver="images"),
    "nan": Lane(driver="nan"),
    "rounding": Lane(driver="rounding"),
    "zink": Lane(variables={"GALLIUM_DRIVER": "zink", "LIBGL_ALWAYS_SOFTWARE": "1"}, renderer="zink"),
    "vulkan": Lane("vulkan"),
    "validation": Lane("vulkan", variables=VALIDATION, validates=True),
    "gpu-validation": Lane("vulkan", variables=GPU_VALIDATION, validates=True),
    "swiftshader": Lane("vulkan", variables={"VK_DRIVER_FILES": SWIFTSHADER}, renderer="SwiftShader", other_rasterizer=True),
}


# Outside Blender


def claim_features(out: Path) -> dict[str, str]:
    """Build the layer with which Blender starts on SwiftShader. Returns variables of the environment."""
    out.mkdir(parents=True, exist_ok=True)
    library, name = out / "libclaimed_features.so", "VK_LAYER_IMPRINT_claimed_features"
    subprocess.run(
        ["cc", "-O1", "-shared", "-fPIC", "-o", str(library), str(Path(__file__).with_name("claimed_features.c"))], check=True
    )
    layer = {"name": name, "type": "GLOBAL", "library_path": str(library), "api_version": "1.3.0"}
    layer |= {"implementation_version": "1", "description": "Claims features that SwiftShader lacks"}
    (out / "claimed_features.json").write_text(json.dumps({"file_format_version": "1.2.0", "layer": layer}))
    return {"VK_ADD_LAYER_PATH": str(out), "VK_INSTANCE_LAYERS": name}


def run(lane: Lane, blender: list[str], words: list[str], name: str, out: Path) -> int:
    """Start this file in Blender with some words. Returns the exit code. What it prints goes to a file of this name."""
    log = out / f"{name}.txt"
    command = [str(imprint.environment()), __file__] if not blender else [*blender, "--background", "--factory-startup"]
    if blender:
        command += ["--gpu-backend", lane.backend, "--python-exit-code", "1", "--python", __file__]
    with tempfile.TemporaryDirectory(prefix="imprint-lane-") as profile:
        variables = {**os.environ, **lane.variables, "BLENDER_USER_RESOURCES": profile, "IMPRINT_TEST_DRIVER": lane.driver}
        with log.open("w", encoding="utf-8") as output:
            return subprocess.call(
                [*command, "--", lane.renderer, *words], cwd=ROOT, env=variables, stdout=output, stderr=output, timeout=LONGEST
            )


def messages(name: str, out: Path) -> collections.Counter:
    """How often Vulkan's validation said what, by the name of the rule."""
    text = (out / f"{name}.txt").read_text(encoding="utf-8", errors="replace")
    return collections.Counter(re.findall(r"gpu\.vulkan +\| (?:ERROR|WARNING) \{0x\w+\}([\w-]+)", text))


def check_validation(lane: Lane, blender: list[str], out: Path) -> None:
    """Do what is not allowed: without a message for it, the layer is not there."""
    run(lane, blender, ["control"], "control", out)
    found = messages("control", out)
    if not found:
        raise SystemExit(f"Vulkan's validation does not run: is vulkan-validationlayers installed? See {out / 'control.txt'}")
    print(f"validation runs, and finds the control: {dict(found)}", flush=True)


def test(lane: Lane, blender: list[str], files: list[Path], out: Path) -> int:
    """Run files of tests. Returns how many of them fail."""
    wrong = 0
    for path in files:
        name = f"{path.parent.name}-{path.stem}"
        result, start = out / f"{name}.json", time.monotonic()
        result.unlink(missing_ok=True)
        code = run(lane, blender, ["test", str(result), str(path)], name, out)
        found = json.loads(result.read_text()) if result.is_file() else {"passed": 0, "failed": ["it did not come to its end"]}
        said = messages(name, out)
        wrong += bool(found["failed"] or said or code)
        print(
            f"{path.relative_to(ROOT)}: {found['passed']} passed, {len(found['failed'])} failed, exit code {code},"
            f" {time.monotonic() - start:.0f} s",
            *(f"  {each}" for each in found["failed"]),
            *(f"  {count} x {rule}" for rule, count in said.items()),
            sep="\n",
            flush=True,
        )
    return wrong


def compare(against: str, out: Path) -> bool:
    """Print how the maps of all lanes differ from those of one, as a table. Returns whether they differ too much."""
    import numpy as np

    def load(path: Path) -> dict:
        with np.load(path) as found:
            return dict(found)

    first, wrong = load(out / f"{against}.npz"), False
    print("| lane | maps | equal to the bit | texels that differ by more than 1e-5 | alpha | not finite | normals, median |")
    print("| --- | --- | --- | --- | --- | --- | --- |")
    for path in sorted(out.glob("*.npz")):
        if path.stem == against:
            continue
        other = load(path)
        lacking = sorted(first.keys() ^ other.keys())
        images = [name for name in first if name in other and first[name].ndim == 3]
        equal = texels = differing = alphas = not_finite = 0
        turned = []
        for name in images:
            one, two = first[name], other[name]
            is_wrong = ~(np.abs(one - two).max(axis=2) <= TOLERANCE)  # NaN is wrong
            equal += np.array_equal(one, two)
            texels, differing = texels + is_wrong.size, differing + np.count_nonzero(is_wrong)
            alphas += np.count_nonzero(one[..., 3] != two[..., 3])
            not_finite += np.count_nonzero(~np.isfinite(two).all(axis=2))
            if name.endswith(" NORMAL"):
                is_both = (one[..., 3] > 0.0) & (two[..., 3] > 0.0)
                a, b = (each[is_both][:, :3].astype(float) * 2.0 - 1.0 for each in (one, two))
                lengths = np.linalg.norm(a - b, axis=1), np.linalg.norm(a + b, axis=1)
                turned.append(np.median(np.degrees(2.0 * np.arctan2(*lengths))))
        is_other = path.stem in LANES and LANES[path.stem].other_rasterizer
        wrong |= bool(lacking) or (not is_other and differing > MOST * texels)
        print(
            f"| {path.stem} | {len(images)} | {equal} | {differing:,} of {texels:,} ({differing / max(1, texels):.4%})"
            f" | {alphas:,} | {not_finite:,} | {min(turned):.2g}° to {max(turned):.2g}° |"
        )
        for name in lacking:
            print(f"{path.stem}: only one lane has {name}")
    return wrong


# Inside Blender


def use_control() -> None:
    """Write an image of whole numbers as floats, and read a texture that the same shader writes."""
    import gpu

    from addon.passes import target
    from addon.passes.shader import Program

    declared = Program(
        compute="control", samplers=(("FLOAT_2D", "source"),), images=(("RGBA32F", "FLOAT_2D", "into", "READ WRITE"),)
    )
    text = "void main() { ivec2 p = ivec2(gl_GlobalInvocationID.xy); imageStore(into, p, texelFetch(source, p + 1, 0)); }"
    from addon.passes import shader

    shader.source = lambda name: text
    numbers, drawn = (target.Target(64, 64, (texel,)) for texel in ("RGBA32UI", "RGBA32F"))
    target.clear(drawn)
    for source in (numbers, drawn):
        target.dispatch_groups(declared, (8, 8), source=source.texture, into=drawn.texture)
    drawn.texels()


def test_inside(result: str, path: str) -> int:
    """Run a file of tests, and write how many pass, and which fail."""
    sys.path.append(str(imprint.SITE_PACKAGES))  # for a Blender whose Python has no pytest
    import pytest

    class Listener:
        passed, failed = 0, []

        def pytest_runtest_logreport(self, report):
            self.passed += report.when == "call" and report.passed
            if report.failed:
                where = getattr(report.longrepr, "reprcrash", None)
                said = where.message.splitlines()[0] if where else str(report.longrepr).strip().splitlines()[-1]
                self.failed.append(f"{report.nodeid}: {said}")

    listener = Listener()
    code = pytest.main(["-q", "-p", "no:cacheprovider", "-m", "not slow", "--tb=short", path], plugins=[listener])
    if code > pytest.ExitCode.TESTS_FAILED and code != pytest.ExitCode.NO_TESTS_COLLECTED:
        listener.failed.append(f"pytest ended with {code}")
    Path(result).write_text(json.dumps({"passed": listener.passed, "failed": listener.failed}))
    return 0


def bake(out: str, scenes: str, size: str, *files: str) -> None:
    """Bake everything, and write the texels of each map, or the message, by scene and map to `out`."""
    import bpy
    import numpy as np

    from addon.core.errors import BakeError
    from addon.core.settings import Settings
    from addon.jobs import bake_pair
    from tests.support import drivers, layered_scenes, maps

    drivers.imitate(drivers.named())
    found = {}

    def add(name: str, low: bpy.types.Object, highs: list, settings: Settings) -> None:
        try:
            report = bake_pair(bpy.context, low, highs, settings)
        except BakeError as error:
            found[name] = np.array(str(error))
            return
        for kind, image in {"NORMAL": report.image, **{k: v["image"] for k, v in report.maps.items()}}.items():
            if image in bpy.data.images:
                found[f"{name} {kind}"] = maps.pixels(bpy.data.images[image])

    for seed in range(*map(int, scenes.split(":"))):
        bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
        add(f"random scene {seed}", *layered_scenes.make(seed))
    kept = {"depth": 32, "storage": "MEMORY", "material": False, "width": int(size), "height": int(size), "margin": 8}
    for file in files:
        bpy.ops.wm.open_mainfile(filepath=file)
        low, high = (bpy.data.objects[name] for name in ("lo", "hi"))
        _paint(high)
        for name, settings in _bakes().items():
            add(f"{Path(file).stem} {name}", low, [high], Settings(image=name, **kept, **settings))
    np.savez_compressed(out, **found)


def _bakes() -> dict[str, dict]:
    """Settings that reach every family of maps and every way of the rays."""
    families = "POSITION HEIGHT DISPLACEMENT DISTANCE COVERAGE OBJECT_ID MATERIAL_ID AO BENT_NORMAL THICKNESS CURVATURE"
    every = {"maps": (*families.split(), "BASE_COLOR", "ROUGHNESS", "ATTRIBUTE"), "detail_maps": True}
    bakes = {}
    for method in ("CAST", "FLATTEN"):
        bakes |= {
            f"{method} all": {"method": method, "space": "WORLD", "margin_type": "ADJACENT_FACES", **every},
            f"{method} all, 4 samples": {"method": method, "samples": 4, **every},
            f"{method} 64 samples": {"method": method, "samples": 64},
            f"{method} widened": {"method": method, "samples": 4, "maps": ("WIDENED_ROUGHNESS",)},
        }
    bakes |= {f"CAST {hit}": {"method": "CAST", "hit": hit} for hit in ("OWN", "NEAREST", "OUTERMOST")}
    far = {"maps": ("AO",), "ao_distance": 0.3, "ao_fade": "SMOOTH", "two_sided": True, "floor": True}
    return bakes | {"CAST far AO": {"method": "CAST", **far}}


def _paint(high) -> None:
    """Give the high mesh random colors, and a material of images: a color, a normal map, and bumps on it."""
    import bpy
    import numpy as np

    from tests.support import shader_nodes as nodes

    rng = np.random.default_rng(0)
    colors = high.data.color_attributes.new("Col", "FLOAT_COLOR", "POINT").data
    colors.foreach_set("color", rng.random(len(colors) * 4))
    material = bpy.data.materials.new("of images")
    if bpy.app.version < (5, 0):
        material.use_nodes = True
    color = nodes.texture(material, nodes.image("color", (130, 77)))
    stored = nodes.image("normals", (64, 64), seed=1, space="Non-Color")
    values = np.empty(len(stored.pixels), np.float32)
    stored.pixels.foreach_get(values)
    values = values.reshape(-1, 4) * (0.2, 0.2, 0.1, 1.0) + (0.4, 0.4, 0.9, 0.0)
    stored.pixels.foreach_set(values.astype(np.float32).ravel())
    stored.pack()
    mapped = nodes.add(material, "NormalMap", {"Color": nodes.texture(material, stored).outputs["Color"]})
    height = nodes.texture(material, nodes.image("bumps", (50, 60), seed=2, space="Non-Color"))
    inputs = {"Height": height.outputs["Color"], "Normal": mapped.outputs["Normal"], "Distance": 0.01}
    bump = nodes.add(material, "Bump", inputs)
    principled = nodes.principled(material)
    material.node_tree.links.new(color.outputs["Color"], principled.inputs["Base Color"])
    material.node_tree.links.new(bump.outputs["Normal"], principled.inputs["Normal"])
    high.data.materials.clear()
    high.data.materials.append(material)


def inside(renderer: str, what: str, *words: str) -> None:
    import bpy  # noqa: F401 - Blender's gpu module comes with it
    import gpu

    import addon

    gpu.init()
    print(gpu.platform.backend_type_get(), gpu.platform.renderer_get(), gpu.platform.version_get(), flush=True)
    if renderer not in gpu.platform.renderer_get():
        sys.exit(f"this lane needs {renderer}")
    {"control": use_control, "test": test_inside, "maps": bake}[what](*words)
    addon.free()  # Blender crashes on exit while GPU objects exist


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    commands = parser.add_subparsers(dest="command", required=True)
    tests, maps = commands.add_parser("test"), commands.add_parser("maps")
    for each in (tests, maps):
        each.add_argument("--blender", default="", metavar="COMMAND")
        each.add_argument("--out", type=Path, default=OUT)
    tests.add_argument("lane", choices=LANES)
    tests.add_argument("files", nargs="*", type=Path)
    maps.add_argument("--lanes", default="opengl,vulkan")
    maps.add_argument("--against", default="opengl")
    maps.add_argument("--scenes", default="0:0")
    maps.add_argument("--size", default="256")
    maps.add_argument("files", nargs="*", type=Path)
    given = parser.parse_args()
    blender = shlex.split(given.blender)
    names = [given.lane] if given.command == "test" else [name for name in given.lanes.split(",") if name]
    for name in names:
        lane, out = LANES[name], given.out.resolve() / name
        out.mkdir(parents=True, exist_ok=True)
        if lane.backend == "vulkan" and not blender:
            parser.error(f"{name} needs --blender: Blender's Python package has OpenGL alone")
        if lane.renderer == "SwiftShader":
            lane = replace(lane, variables={**lane.variables, **claim_features(out)})
        if lane.validates:
            check_validation(lane, blender, out)
        if given.command == "test":
            folders = ("passes", "engine")
            files = given.files or [file for each in folders for file in sorted((ROOT / "tests" / each).glob("test_*.py"))]
            return 1 if test(lane, blender, [file.resolve() for file in files], out) else 0
        words = ["maps", str(out.parent / f"{name}.npz"), given.scenes, given.size]
        if run(lane, blender, [*words, *(str(file.resolve()) for file in given.files)], "maps", out):
            raise SystemExit(f"{name} failed: see {out / 'maps.txt'}")
        print(f"{name}: baked", flush=True)
    return 1 if compare(given.against, given.out.resolve()) else 0


if __name__ == "__main__":
    if "--" in sys.argv:  # Blender, or the Python package, runs this file
        inside(*sys.argv[sys.argv.index("--") + 1 :])
    else:
        sys.exit(main())
