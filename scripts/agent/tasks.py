# SPDX-License-Identifier: GPL-3.0-or-later
"""The ten tasks of tasks.json for an agent with SKILL.md: their files, and whether they are done.

`.venv/bin/python scripts/agent/tasks.py FOLDER` makes the files and prints the tasks. With `--play`, it does each by its calls,
through the server, and prints whether it is done.
"""

import argparse
import json
import os
import sys
from collections.abc import AsyncIterator, Sequence
from fnmatch import fnmatch
from pathlib import Path

import anyio
import bpy
import numpy as np
from mcp.client import Client
from mcp.client.stdio import StdioServerParameters, stdio_client

BAKE = Path(__file__).parents[1] / "bake.py"
TASKS = json.loads(Path(__file__).with_suffix(".json").read_text(encoding="utf-8"))
"""Each with its text, the calls that do it, and what must have come of it, as `wrong` reads that."""


def main() -> None:
    """Make the files in the folder that is named, and do the tasks. Raises SystemExit for other arguments."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("folder", type=Path, help="where the files are made")
    parser.add_argument("--play", action="store_true", help="do the tasks by their calls, through the server")
    options = parser.parse_args()
    make_files(options.folder)
    if options.play:
        anyio.run(_print, options.folder)
    else:
        print("\n".join(each["task"] for each in TASKS))


async def _print(folder: Path) -> None:
    async for task, left in played(folder, TASKS):
        print("; ".join(left) or "done", task["task"], sep=": ", flush=True)


def make_files(folder: Path) -> None:
    """Make what the tasks name."""
    folder.mkdir(parents=True, exist_ok=True)
    for make in (rock, scan, statue, pair):
        bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
        make(folder)


async def played(folder: Path, tasks: Sequence[dict]) -> AsyncIterator[tuple[dict, list[str]]]:
    """Do tasks in a folder by their calls, by the SDK's own client. Yields each task, and what it has not reached."""
    words, picture = [str(BAKE), "--", "mcp", "--root", str(folder)], ""
    server = StdioServerParameters(command=sys.executable, args=words, env=dict(os.environ))
    async with Client(stdio_client(server)) as client:
        for task in tasks:
            before, answers = {*folder.rglob("*")}, []
            for name, given in task["calls"]:
                arguments = {key: picture if value == "PICTURE" else value for key, value in given.items()}
                answer = await client.call_tool(name, arguments)
                said, *pictures = answer.content
                answers.append((said.text, len(pictures), answer.is_error))
                if '"picture"' in said.text:
                    picture = json.loads(said.text)["picture"]
            new = {path.relative_to(folder).as_posix() for path in {*folder.rglob("*")} - before}
            yield task, wrong(task["done"], answers, new)


def wrong(done: dict, answers: list, new: set[str]) -> list[str]:
    """What a task has not reached, as sentences.

    Args:
        done: files: patterns of which each has a new file; says: what the answers contain; below: a number that the last one is
            below; pictures: how many; refused: whether nothing may come of it.
        answers: of the tools: (text, how many pictures, whether it is an error).
        new: paths of new files, below the folder of the tasks.
    """
    text, pictures = "\n".join(each for each, *_ in answers), sum(count for _, count, _ in answers)
    found = [f"no file {name}" for name in done.get("files", ()) if not any(fnmatch(each, name) for each in new)]
    found += [f"nobody said {each!r}" for each in done.get("says", ()) if each not in text]
    if "below" in done and not float(answers[-1][0]) < done["below"]:
        found.append(f"{answers[-1][0]} is not below {done['below']}")
    if pictures < done.get("pictures", 0):
        found.append(f"{pictures} pictures")
    if done.get("refused") and (new or not all(is_error for *_, is_error in answers)):
        found.append("it was not refused")
    return found


def rock(folder: Path) -> None:
    """rock_low.obj with UVs, and rock_high.obj."""
    for name, rows in (("rock_low", 12), ("rock_high", 64)):
        ball(name, rows)
        bpy.ops.wm.obj_export(filepath=str(folder / f"{name}.obj"), export_materials=False)
        bpy.data.objects.remove(bpy.data.objects[name])


def scan(folder: Path) -> None:
    """scan.blend: the high mesh has a hole, and its upper half is turned over."""
    ball("rock_low", 12)
    ball("rock_high", 64, is_scan=True)
    _save(folder / "scan.blend")


def statue(folder: Path) -> None:
    """statue.ply, without UVs."""
    obj = ball("statue", 24, has_uv=False)
    obj.scale = (0.6, 0.5, 1.5)
    bpy.ops.wm.ply_export(filepath=str(folder / "statue.ply"), export_uv=False)


def pair(folder: Path) -> None:
    """pair.blend: the low mesh has no UVs."""
    ball("rock_low", 12, has_uv=False)
    ball("rock_high", 64)
    _save(folder / "pair.blend")


def ball(name: str, rows: int, *, has_uv: bool = True, is_scan: bool = False) -> bpy.types.Object:
    """A lumpy ball of 2 * rows by rows quads, whose detail is finer than 12 rows show. is_scan: with faults."""
    u, v = np.meshgrid(np.linspace(0.0, 1.0, 2 * rows + 1), np.linspace(0.0, 1.0, rows + 1))
    around, up = 2.0 * np.pi * u, np.pi * (v - 0.5)
    way = np.stack([np.cos(around) * np.cos(up), np.sin(around) * np.cos(up), np.sin(up)], axis=2)
    radius = 1.0 + 0.08 * np.sin(3.0 * way).prod(axis=2) + 0.02 * np.sin(17.0 * way).prod(axis=2)
    column, row = np.meshgrid(np.arange(2 * rows), np.arange(rows))
    first = (column + row * (2 * rows + 1)).ravel()
    faces = np.stack([first, first + 1, first + 2 * rows + 2, first + 2 * rows + 1], axis=1)
    if is_scan:
        faces[row.ravel() >= rows // 2] = faces[row.ravel() >= rows // 2, ::-1]
        faces = faces[(column + row * 2 * rows).ravel() % (2 * rows * rows) >= rows // 4]
    data = bpy.data.meshes.new(name)
    data.from_pydata((radius[..., None] * way).reshape(-1, 3), [], faces)
    data.polygons.foreach_set("use_smooth", np.ones(len(faces), bool))
    if has_uv:
        uv = 0.02 + 0.96 * np.stack([u, v], axis=2).reshape(-1, 2)[faces]
        data.uv_layers.new(name="UVMap").uv.foreach_set("vector", np.float32(uv).ravel())
    obj = bpy.data.objects.new(name, data)
    bpy.context.scene.collection.objects.link(obj)
    return obj


def _save(path: Path) -> None:
    bpy.ops.wm.save_as_mainfile(filepath=str(path), compress=True)


if __name__ == "__main__":
    main()
