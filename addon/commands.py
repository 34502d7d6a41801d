# SPDX-License-Identifier: GPL-3.0-or-later
"""The command line: one parser for `blender --command imprint`, scripts/bake.py and scripts/imprint.py bake."""

import argparse
import json
import sys
from pathlib import Path

import bpy

from .bake import pipeline, subjects
from .bake.errors import BakeError
from .bake.files import check_writable, reason, replacing
from .bake.pairs import Suffixes
from .bake.report import Report
from .bake.settings import SAMPLES, Settings

DONE, FAILED, WRONG_USAGE = 0, 1, 2


def parser(program: str) -> argparse.ArgumentParser:
    """The arguments of a bake. Defaults are those of Settings, but for the map, which goes to a file."""
    result = argparse.ArgumentParser(prog=program, description="Bake the detail of high meshes into a normal map.")
    result.add_argument(
        "file", nargs="?", metavar="FILE.blend", help="the file to open (default: the one that is open)"
    )
    which = result.add_mutually_exclusive_group(required=True)
    which.add_argument("--low", type=_name, metavar="NAME", help="the object that gets the map")
    which.add_argument(
        "--pairs",
        action="store_true",
        help="bake x_low against x_high, x_high_2, … with x_cage, for every x; {low} in --output gives each its own map",
    )
    result.add_argument(
        "--high",
        type=_name,
        action="append",
        default=[],
        metavar="NAME",
        help="an object with detail; may be given again (default: the low object with its modifiers)",
    )
    result.add_argument(
        "--suffixes",
        type=_suffixes,
        default=Suffixes(),
        metavar="LOW,HIGH,CAGE",
        help="what --pairs looks for at the end of names (default: _low,_high,_cage)",
    )
    result.add_argument(
        "--method",
        choices=["auto", "flatten", "cast"],
        default="auto",
        help="flatten draws meshes that share UVs, cast sends rays, auto (default) measures which of them fits",
    )
    result.add_argument(
        "--extrusion", type=float, metavar="D", help="where rays start, outside the low mesh (measured)"
    )
    result.add_argument("--max-distance", type=float, metavar="D", help="how far rays go from there (measured)")
    result.add_argument(
        "--cage", type=_name, metavar="NAME", help="a mesh with the low one's topology: rays start on it"
    )
    result.add_argument(
        "--directions",
        choices=["smooth", "split"],
        default="smooth",
        help="which of the low mesh's normals rays follow",
    )
    result.add_argument("--facing-only", action="store_true", help="rays pass through triangles seen from behind")
    result.add_argument(
        "--missed", type=_colour, default=(0.5, 0.5, 1.0), metavar="R,G,B", help="colour where rays hit nothing"
    )
    result.add_argument("--mask", action="store_true", help="write a mask of misses beside the map as well")
    result.add_argument("--space", choices=["tangent", "object", "world"], default="tangent")
    result.add_argument(
        "--basis",
        choices=["blender", "mikktspace"],
        default="blender",
        help="what reads the tangent-space map: Blender's Normal Map node, or engines",
    )
    result.add_argument(
        "--uv", type=_name, default="", metavar="NAME", help="the low mesh's UV map (default: its active one)"
    )
    result.add_argument("--size", type=_size, default=(2048, 2048), metavar="2048|4096x1024", help="texels")
    result.add_argument(
        "--samples", type=int, choices=SAMPLES, default=1, help="a texel; several are antialiased (default: 1)"
    )
    result.add_argument("--green", choices=["+y", "-y"], default="+y", help="+y: OpenGL, -y: DirectX")
    result.add_argument("--margin", type=int, default=16, metavar="TEXELS", help="around the UV islands (default: 16)")
    result.add_argument("--depth", type=int, choices=[8, 16, 32], default=16, help="bits a channel (default: 16)")
    result.add_argument(
        "--modifiers", choices=["render", "viewport"], default="render", help="whose levels and visibility count"
    )
    result.add_argument(
        "--image", type=_name, default="", metavar="NAME", help="the image datablock (default: LOW_normal)"
    )
    result.add_argument("--output", required=True, metavar="MAP.png|MAP.exr", help="the file to write")
    result.add_argument("--no-material", action="store_true", help="leave the low object's material alone")
    result.add_argument("--single-user", action="store_true", help="copy materials that other objects use as well")
    result.add_argument("--save-blend", type=Path, metavar="OUT.blend", help="save the scene with the map hooked up")
    result.add_argument("--report", type=Path, metavar="REPORT.json", help="write what was done, as JSON")
    return result


def run(arguments: list[str], program: str = "imprint") -> int:
    """Bake as `arguments` say. Returns the exit code; what went wrong is one line on stderr."""
    wanted = parser(program)
    try:
        options = wanted.parse_args(_joined_green(arguments))
        if options.pairs and (options.high or options.cage):
            wanted.error("--pairs finds the high objects and the cages by itself")
        if _has_clash(options):
            wanted.error("the files to read and to write must be different ones")
    except SystemExit as stop:  # argparse has printed the usage, or the help
        return stop.code
    try:
        reports, problems = _bake(options)
    except KeyboardInterrupt:
        print(f"{program}: stopped, nothing was finished.", file=sys.stderr)
        return FAILED
    except BakeError as error:
        print(f"{program}: {error}", file=sys.stderr)
        return FAILED
    for warning in (*problems, *(warning for report in reports for warning in report.warnings)):
        print(f"{program}: warning: {warning}", file=sys.stderr)
    print("\n".join(line for report in reports for line in report.summary()))
    written = [*dict.fromkeys(report.output for report in reports), options.save_blend, options.report]
    print("Wrote", ", ".join(str(path) for path in written if path is not None))
    return DONE


def _bake(options: argparse.Namespace) -> tuple[list[Report], list[str]]:
    """The reports, and what was found to be wrong with names."""
    output = Path(options.output).absolute()
    settings = Settings(
        method=options.method.upper(),
        space=options.space.upper(),
        basis=options.basis.upper(),
        uv_layer=options.uv,
        width=options.size[0],
        height=options.size[1],
        samples=options.samples,
        extrusion=options.extrusion,
        max_distance=options.max_distance,
        directions=options.directions.upper(),
        facing_only=options.facing_only,
        missed=options.missed,
        mask=options.mask,
        green=options.green.upper(),
        margin=options.margin,
        depth=options.depth,
        modifiers=options.modifiers.upper(),
        image=options.image,
        storage="FILE",
        output=str(output),
        material=not options.no_material,
        single_user=options.single_user,
    )
    # Before the file is opened, which may take long: what could go wrong at the end.
    settings.check()
    for path in (output, options.save_blend, options.report):
        if path is not None:
            check_writable(path.absolute())
    if options.save_blend is not None and options.save_blend.suffix != ".blend":
        raise BakeError(f"{str(options.save_blend)!r} does not end in .blend.")
    if options.file is not None:
        _open(options.file)
    elif not bpy.data.filepath:
        raise BakeError("There is no scene to bake: give a FILE.blend.")
    jobs, problems = _jobs(options)
    share_image = options.pairs and "{low}" not in options.output
    reports = pipeline.bake_all(bpy.context, jobs, settings, share_image=share_image)
    if options.save_blend is not None:
        _save(options.save_blend.absolute(), {bpy.data.images[report.image] for report in reports})
    if options.report is not None:
        result = [report.to_dict() for report in reports]
        with replacing(options.report.absolute()) as partial:
            text = json.dumps({"pairs": result, "problems": problems} if options.pairs else result[0], indent=2)
            partial.write_text(text + "\n", encoding="utf-8")
    return reports, problems


def _jobs(options: argparse.Namespace) -> tuple[list[pipeline.Job], list[str]]:
    """What to bake, and what was found to be wrong with names."""
    if options.pairs:
        return pipeline.jobs_by_name(bpy.context, options.suffixes)
    low = subjects.named(options.low)
    highs = [subjects.named(name) for name in options.high] or [low]
    return [pipeline.Job(low, highs, subjects.named(options.cage) if options.cage else None)], []


def _has_clash(options: argparse.Namespace) -> bool:
    """Whether one file is named for two things. The scene alone may be saved over the one that was opened."""
    scenes = {Path(name).resolve() for name in (options.file, options.save_blend) if name is not None}
    others = [Path(name).resolve() for name in (options.output, options.report) if name is not None]
    return len(set(others)) < len(others) or not scenes.isdisjoint(others)


def _open(name: str) -> None:
    path = Path(name).absolute()
    if not path.is_file():
        raise BakeError(f"There is no file {str(path)!r}.")
    try:
        bpy.ops.wm.open_mainfile(filepath=str(path), load_ui=False)
    except RuntimeError as error:
        raise BakeError(f"{str(path)!r} could not be opened: {reason(error)}.") from error


def _save(path: Path, images: set[bpy.types.Image]) -> None:
    for image in images:
        output = Path(bpy.path.abspath(image.filepath))
        if output.is_relative_to(path.parent):
            # So that the files can be moved together. Relative to the file that is open: saving takes all such paths
            # along to the new place.
            image.filepath = bpy.path.relpath(str(output), start=str(Path(bpy.data.filepath or path).parent))
    with replacing(path) as partial:
        # As a copy: relative paths are those of the final place, which is in the same folder.
        bpy.ops.wm.save_as_mainfile(filepath=str(partial), copy=True, compress=False, relative_remap=True)


def _size(text: str) -> tuple[int, int]:
    sides = text.lower().split("x")
    if len(sides) > 2 or not all(side.isdecimal() for side in sides):
        raise argparse.ArgumentTypeError(f"{text!r} is neither a number of texels nor two of them as 4096x1024")
    return int(sides[0]), int(sides[-1])


def _suffixes(text: str) -> Suffixes:
    parts = text.split(",")
    if len(parts) != 3:
        raise argparse.ArgumentTypeError(f"{text!r} is not three endings as _low,_high,_cage")
    return Suffixes(*parts)


def _colour(text: str) -> tuple[float, float, float]:
    try:
        red, green, blue = (float(part) for part in text.split(","))
    except ValueError as error:
        raise argparse.ArgumentTypeError(f"{text!r} is not three numbers as 1,0,1") from error
    return red, green, blue


def _name(text: str) -> str:
    try:
        text.encode()
    except UnicodeEncodeError as error:
        raise argparse.ArgumentTypeError(f"{text!r} is not UTF-8, as all names in Blender are") from error
    return text


def _joined_green(arguments: list[str]) -> list[str]:
    """argparse takes the -y of `--green -y` for an option of its own; `--green=-y` it understands."""
    result = list(arguments)
    for index, word in enumerate(result[:-1]):
        if word == "--green":
            result[index : index + 2] = [f"--green={result[index + 1]}"]
            break
    return result


_handle = None


def register() -> None:
    global _handle  # noqa: PLW0603 - Blender gives a handle to take the command back with
    _handle = bpy.utils.register_cli_command("imprint", run)


def unregister() -> None:
    bpy.utils.unregister_cli_command(_handle)
