# SPDX-License-Identifier: GPL-3.0-or-later
"""Finds the pairs among the mesh files of a folder."""

from collections.abc import Sequence
from pathlib import Path

from ...core.errors import BakeError
from ...core.file_formats import OPENED
from ...core.names.name_matching import Pair, Suffixes, match
from ...output.files.atomic_file import reason


def pairs(folder: str, suffixes: Suffixes) -> tuple[list[tuple[Pair, str]], list[str]]:
    """The pairs among the mesh files of a folder, as paths, each with what is wrong with it or "".

    Also sentences about unpaired files. Raises BakeError if there is no pair.
    """
    try:
        files = sorted(path for path in Path(folder).iterdir() if path.suffix.lower() in OPENED)
    except OSError as error:
        raise BakeError(f"The folder {folder!r} cannot be read: {reason(error)}.") from error
    files, strange = _split(files)
    places: dict[str, list[Path]] = {}
    for path in files:
        places.setdefault(path.stem, []).append(path)
    found, problems = match(places, suffixes)
    problems += [f"{str(path)!r} is left out: its name is not UTF-8, as all names in Blender are." for path in strange]
    if not found:
        raise BakeError(" ".join(problems) or f"No mesh file in {folder!r} has a name that ends in {suffixes.low!r}.")
    result = []
    for pair in found:
        names = [pair.low, *pair.highs, *([pair.cage] if pair.cage else [])]
        twice = next((places[name] for name in names if len(places[name]) > 1), None)
        problem = f"{twice[0].name!r} and {twice[1].name!r} share a name: remove one of them." if twice else ""
        low, highs, cage = str(places[pair.low][0]), [str(places[high][0]) for high in pair.highs], pair.cage
        result.append((Pair(pair.name, low, highs, str(places[cage][0]) if cage else ""), problem))
    return result, problems


def _split(files: Sequence[Path]) -> tuple[list[Path], list[Path]]:
    """The files that Blender can open, and those whose names are not UTF-8."""
    strange = [path for path in files if str(path) != str(path).encode(errors="replace").decode()]
    return [path for path in files if path not in strange], strange
