#!/usr/bin/env python3
# SPDX-License-Identifier: GPL-3.0-or-later
"""Runs tests, or bakes maps, on drivers that do what real GPUs do and llvmpipe does not. No GPU is needed.

    python3 scripts/dev/lanes.py test --lanes zink,validation --blender blender [FILE.py ...]
    python3 scripts/dev/lanes.py maps --lanes opengl,zink,vulkan --blender blender [--scenes 0:200] [--size 256] PAIR.blend ...
    python3 scripts/dev/lanes.py slices --lanes zink,vulkan --blender blender [--size 2048] PAIR.blend ...

A lane is one of those in LANES below; docs/testing.md says what each finds, and the packages. They run one after another.
--blender is a command that starts a Blender from 5.2 on, in the background; it may have arguments of its own. Without it,
Blender's Python package runs, on OpenGL alone; `newest` and `newest-opengl` run that of the newest version, which is
installed into out/blender. Each PAIR.blend holds two objects, "hi" and "lo". `maps` needs numpy.

test: tests/passes and tests/engine, or these files, each in a process of its own. Ends with 1 if a test fails, a process
crashes, or Vulkan's validation has a message.

maps: compares the maps of all lanes with those of the first. --scenes are the seeds of random scenes of overlapping layers.
Ends with 1 if a lane lacks a map, or if texels differ that may not.

slices: how many rows of rays the GPU gets at once. Ends with 1 if a bake goes on before the GPU is done with them.
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
from scripts.dev import blender_packages  # noqa: E402
from scripts.dev.blender_packages import NEWEST  # noqa: E402

OUT = ROOT / "out" / "lanes"
TOLERANCE = 1e-5
"""The most by which a channel may differ: normals in 32-bit floats, from 0 to 1, and values of other maps."""
MOST = 5e-4
"""Share of the texels that may differ by more: rays along an edge or along the surface, or ties between two layers."""
MISSED = 0.02
"""Seconds that the GPU may still take after a wait: reading back a texel of another texture."""
LONGEST = 7200
"""Seconds that one file of tests, or the maps of one lane, may take."""


@dataclass(frozen=True)
class Lane:
    """A driver, and what tests/support/drivers.py imitates on it.

    variables: of the environment. renderer: a part of its name, if the variables choose one. validates: Khronos' validation
    layer checks each call. other_rasterizer: drawn triangles have other corners and depths, so that maps are not equal.
    in_package: Blender's Python package runs, also where there is a Blender. version: of the package, if not that of .venv.
    """

    backend: str = "opengl"
    driver: str = "samplers"
    variables: dict[str, str] = field(default_factory=dict)
    renderer: str = ""
    validates: bool = False
    other_rasterizer: bool = False
    in_package: bool = False
    version: str = ""


VALIDATION = {"VK_INSTANCE_LAYERS": "VK_LAYER_KHRONOS_validation", "VK_KHRONOS_VALIDATION_VALIDATE_SYNC": "1"}
VALIDATION["VK_KHRONOS_VALIDATION_SYNCVAL_SHADER_ACCESSES_HEURISTIC"] = "1"
GPU_VALIDATION = {**VALIDATION, "VK_KHRONOS_VALIDATION_GPUAV_ENABLE": "1"}
ZINK = {"GALLIUM_DRIVER": "zink", "LIBGL_ALWAYS_SOFTWARE": "1"}
SWIFTSHADER = "/usr/lib/chromium/vk_swiftshader_icd.json"
"""Of Debian's package chromium-common."""
LANES = {
    "opengl": Lane(),
    "package": Lane(in_package=True),
    "newest": Lane("vulkan", in_package=True, version=NEWEST),
    "newest-opengl": Lane(in_package=True, version=NEWEST, variables=blender_packages.OPENGL),
    "images": Lane(driver="images"),
    "nan": Lane(driver="nan"),
    "rounding": Lane(driver="rounding"),
    "zink": Lane(variables=ZINK, renderer="zink"),
    "vulkan": Lane("vulkan"),
    "validation": Lane("vulkan", variables=VALIDATION, validates=True),
    "gpu-validation": Lane("vulkan", variables=GPU_VALIDATION, validates=True),
    "swiftshader": Lane(
        "vulkan", variables={"VK_DRIVER_FILES": SWIFTSHADER}, renderer="SwiftShader", other_rasterizer=True
    ),
}


# Outside Blender


def claim_features(out: Path) -> dict[str, str]:
    """Build the layer with which Blender starts on SwiftShader, by $CC. Returns variables of the environment."""
    library, name = out / "libclaimed_features.so", "VK_LAYER_IMPRINT_claimed_features"
    compiler = shlex.split(os.environ.get("CC", "cc"))
    source = Path(__file__).with_name("claimed_features.c")
    subprocess.run([*compiler, "-O1", "-shared", "-fPIC", "-o", str(library), str(source)], check=True)
    layer = {"name": name, "type": "GLOBAL", "library_path": str(library), "api_version": "1.3.0"}
    layer |= {"implementation_version": "1", "description": "Claims features that SwiftShader lacks"}
    (out / "claimed_features.json").write_text(json.dumps({"file_format_version": "1.2.0", "layer": layer}))
    return {"VK_ADD_LAYER_PATH": str(out), "VK_INSTANCE_LAYERS": name}


def run(lane: Lane, blender: list[str], words: list[str], name: str, out: Path) -> int:
    """Start this file in Blender with some words. Returns the exit code. What it prints goes to a file of this name."""
    if blender and not lane.in_package:
        command = [*blender, "--background", "--factory-startup", "--gpu-backend", lane.backend]
        command += ["--python-exit-code", "1", "--python", __file__]
    else:
        found = blender_packages.environment(blender_packages.ENVIRONMENTS, lane.version) if lane.version else ""
        command = [found or imprint.environment(), __file__]
    with tempfile.TemporaryDirectory(prefix="imprint-lane-") as profile:
        variables = {
            **os.environ,
            **lane.variables,
            "BLENDER_USER_RESOURCES": profile,
            "IMPRINT_TEST_DRIVER": lane.driver,
        }
        with (out / f"{name}.txt").open("w", encoding="utf-8") as log:
            return subprocess.call(
                [*command, "--", lane.renderer, *words],
                cwd=ROOT,
                env=variables,
                stdout=log,
                stderr=log,
                timeout=LONGEST,
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
        raise SystemExit(
            f"Vulkan's validation does not run: is vulkan-validationlayers installed? See {out / 'control.txt'}"
        )
    print(f"validation runs, and finds the control: {dict(found)}", flush=True)


def test(lane: Lane, blender: list[str], files: list[Path], out: Path) -> int:
    """Run files of tests. Returns how many of them fail."""
    wrong = 0
    for path in files:
        name = f"{path.parent.name}-{path.stem}"
        result, start = out / f"{name}.json", time.monotonic()
        result.unlink(missing_ok=True)
        code = run(lane, blender, ["test", str(result), str(path)], name, out)
        found = (
            json.loads(result.read_text())
            if result.is_file()
            else {"passed": 0, "failed": ["it did not come to its end"]}
        )
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


def compare(names: list[str], out: Path) -> bool:
    """Print how the maps of all lanes differ from those of the first, as a table. Returns whether they differ too much."""
    import numpy as np

    def load(name: str) -> dict:
        with np.load(out / name / "maps.npz") as found:
            return dict(found)

    first, wrong, details = load(names[0]), False, []
    print(
        f"| against {names[0]} | maps equal to the bit | texels that differ by more than {TOLERANCE} | coverage differs in",
        end="",
    )
    print(" | not finite | normals, medians |\n| --- | --- | --- | --- | --- | --- |")
    for lane in names[1:]:
        other = load(lane)
        details += [f"{lane}: only one lane has {name}" for name in sorted(first.keys() ^ other.keys())]
        wrong |= first.keys() != other.keys()
        rows = {
            name: _differences(first[name], other[name]) for name in first if name in other and first[name].ndim == 3
        }
        equal, texels, differing, alphas, not_finite, _ = (sum(column) for column in zip(*rows.values(), strict=True))
        turned = [row[-1] for name, row in rows.items() if name.endswith(" NORMAL")]
        wrong |= not_finite > 0 or (not LANES[lane].other_rasterizer and differing > MOST * texels)
        print(
            f"| {lane} | {equal} of {len(rows)} | {differing:,} of {texels:,} ({differing / max(1, texels):.4%})"
            f" | {alphas:,} | {not_finite:,} | {min(turned, default=0):.2g}° to {max(turned, default=0):.2g}° |"
        )
        for name, row in rows.items():
            if row[2]:
                most = np.nanmax(np.abs(first[name] - other[name]))
                details.append(
                    f"{lane}, {name}: {row[2]} of {row[1]:,} texels, by up to {most:.2g}; coverage in {row[3]}"
                )
    (out / "differences.txt").write_text("\n".join(details) + "\n", encoding="utf-8")
    print(f"By map: {out / 'differences.txt'}")
    return wrong


def _differences(one, two) -> tuple:
    """Of two maps: whether they are equal; how many texels they have, and how many differ by more than TOLERANCE, differ in
    alpha, and are not finite in the second one; the median angle in degrees, as between normals."""
    import numpy as np

    is_wrong = ~(np.abs(one - two).max(axis=2) <= TOLERANCE)  # NaN is wrong
    is_both = (one[..., 3] > 0.0) & (two[..., 3] > 0.0)
    a, b = (each[is_both][:, :3].astype(float) * 2.0 - 1.0 for each in (one, two))
    angles = np.degrees(2.0 * np.arctan2(np.linalg.norm(a - b, axis=1), np.linalg.norm(a + b, axis=1)))
    alphas, not_finite = np.count_nonzero(one[..., 3] != two[..., 3]), np.count_nonzero(~np.isfinite(two).all(axis=2))
    median = float(np.median(angles)) if len(angles) else 0.0
    return np.array_equal(one, two), is_wrong.size, np.count_nonzero(is_wrong), alphas, not_finite, median


def compare_slices(names: list[str], out: Path) -> bool:
    """Print the slices of all lanes. Returns whether a wait is too short on one of them."""
    wrong = False
    for name in names:
        for pair, found in json.loads((out / name / "slices.json").read_text()).items():
            missed = max(found["missed"])
            wrong |= missed > MISSED
            print(f"{name}, {pair}: {found['seconds']:.1f} s; rows of the slices: {found['rows']}")
            print(
                f"  longest slice {max(found['slices']):.2f} s; after a wait the GPU worked for at most {missed:.4f} s"
            )
    return wrong


# Inside Blender


def use_control() -> None:
    """Write an image of whole numbers as floats, and read a texture that the same shader writes."""
    from addon.passes import shader, target

    declared = shader.Program(
        compute="control", samplers=(("FLOAT_2D", "source"),), images=(("RGBA32F", "FLOAT_2D", "into", "READ WRITE"),)
    )
    text = (
        "void main() { ivec2 p = ivec2(gl_GlobalInvocationID.xy); imageStore(into, p, texelFetch(source, p + 1, 0)); }"
    )
    shader.source = lambda name: text
    numbers, drawn = (target.Target(64, 64, (texel,)) for texel in ("RGBA32UI", "RGBA32F"))
    target.clear(drawn)
    for source in (numbers, drawn):
        target.dispatch_groups(declared, (8, 8), source=source.texture, into=drawn.texture)
    drawn.texels()


def test_inside(result: str, path: str) -> None:
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
        start = time.monotonic()
        try:
            report = bake_pair(bpy.context, low, highs, settings)
        except BakeError as error:
            found[name] = np.array(str(error))
            return
        print(f"{name}: {time.monotonic() - start:.1f} s", flush=True)
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
    every = {"maps": (*families.split(), "BASE_COLOR", "ROUGHNESS", "ATTRIBUTE"), "detail_maps": True, "rays": 16}
    bakes = {}
    for method in ("CAST", "FLATTEN"):
        bakes |= {
            f"{method} all": {"method": method, "space": "WORLD", "margin_type": "ADJACENT_FACES", **every},
            f"{method} all, 4 samples": {"method": method, "samples": 4, **every},
            f"{method} 64 samples": {"method": method, "samples": 64},
            f"{method} widened": {"method": method, "samples": 4, "maps": ("WIDENED_ROUGHNESS",)},
            f"{method} widened, object space": {
                "method": method,
                "samples": 4,
                "maps": ("WIDENED_ROUGHNESS",),
                "space": "OBJECT",
            },
        }
    bakes |= {f"CAST {hit}": {"method": "CAST", "hit": hit} for hit in ("OWN", "NEAREST", "OUTERMOST")}
    far = {"maps": ("AO",), "ao_distance": 0.3, "ao_fade": "SMOOTH", "two_sided": True, "floor": True}
    return bakes | {"CAST far AO": {"method": "CAST", **far}}


def measure_slices(out: str, size: str, *files: str) -> None:
    """Bake a normal map by Cast twice, and write the rows of each slice of the first bake, by pair, to `out`.

    In the second bake, wait twice for each slice: the first wait has to be long enough, because the next slice depends on it.
    """
    import bpy

    from addon.core.progress import Pace
    from addon.core.settings import Settings
    from addon.jobs import bake_pair
    from addon.passes import target
    from tests.support import drivers

    drivers.imitate(drivers.named())
    found, slices, other = {}, Pace.slices, target.Target(8, 8, ("RGBA32F",))
    settings = Settings(method="CAST", image="map", storage="MEMORY", material=False, width=int(size), height=int(size))

    def measured(rows: list, seconds: list, missed: list | None):
        def in_slices(pace, work, costs, height, draw):
            def timed(part):
                start = time.perf_counter()
                draw(part)
                waited = time.perf_counter()
                if missed is not None:
                    target.clear(other)
                    other.finish()
                    missed.append(time.perf_counter() - waited)
                rows.append(len(part))
                seconds.append(waited - start)

            return slices(pace, work, costs, height, timed)

        return in_slices

    for file in files:
        bpy.ops.wm.open_mainfile(filepath=file)
        low, high = (bpy.data.objects[name] for name in ("lo", "hi"))
        rows, seconds, missed = [], [], []
        bake_pair(bpy.context, low, [high], settings)  # compiles shaders
        Pace.slices, start = measured(rows, seconds, None), time.perf_counter()
        bake_pair(bpy.context, low, [high], settings)
        took = time.perf_counter() - start
        Pace.slices = measured([], [], missed)
        bake_pair(bpy.context, low, [high], settings)
        Pace.slices = slices
        found[Path(file).stem] = {"rows": rows, "slices": seconds, "missed": missed, "seconds": took}
    Path(out).write_text(json.dumps(found))


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
    {"control": use_control, "test": test_inside, "maps": bake, "slices": measure_slices}[what](*words)
    addon.free()  # Blender crashes on exit while GPU objects exist


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", choices=("test", "maps", "slices"))
    parser.add_argument("files", nargs="*", type=Path)
    parser.add_argument("--lanes", required=True, help=", ".join(LANES))
    parser.add_argument("--blender", default="", metavar="COMMAND")
    parser.add_argument("--out", type=Path, default=OUT)
    parser.add_argument("--scenes", default="0:0")
    parser.add_argument("--size", help="256 for maps, 2048 for slices")
    given = parser.parse_intermixed_args()
    blender, names, files = shlex.split(given.blender), given.lanes.split(","), [file.resolve() for file in given.files]
    if unknown := set(names) - set(LANES):
        parser.error(f"no lane {', '.join(unknown)}; there are {', '.join(LANES)}")
    if not blender and any(LANES[name].backend == "vulkan" and not LANES[name].version for name in names):
        parser.error("Vulkan needs --blender: Blender's Python package has OpenGL alone before 5.3")
    wrong = 0
    for name in names:
        lane, out = LANES[name], given.out.resolve() / name
        out.mkdir(parents=True, exist_ok=True)
        if lane.renderer == "SwiftShader":
            lane = replace(lane, variables={**lane.variables, **claim_features(out)})
        if lane.validates:
            check_validation(lane, blender, out)
        if given.what == "test":
            wrong += test(lane, blender, files or _all_tests(), out)
            continue
        words = {"maps": [str(out / "maps.npz"), given.scenes, given.size or "256"]}
        words["slices"] = [str(out / "slices.json"), given.size or "2048"]
        if run(lane, blender, [given.what, *words[given.what], *map(str, files)], given.what, out):
            raise SystemExit(f"{name} failed: see {out / given.what}.txt")
        if said := messages(given.what, out):
            print(f"{name}: {dict(said)}")
            wrong += 1
    if given.what != "test":
        wrong += {"maps": compare, "slices": compare_slices}[given.what](names, given.out.resolve())
    return 1 if wrong else 0


def _all_tests() -> list[Path]:
    return [file for folder in ("passes", "engine") for file in sorted((ROOT / "tests" / folder).glob("test_*.py"))]


if __name__ == "__main__":
    if "--" in sys.argv:  # Blender, or the Python package, runs this file
        inside(*sys.argv[sys.argv.index("--") + 1 :])
    else:
        sys.exit(main())
