# SPDX-License-Identifier: GPL-3.0-or-later
"""Seconds and bytes to store a map in each file format."""

from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path

from scripts.bench.bakers import Contender, race
from scripts.bench.versions import Child, Version

FORMATS = (
    ("PNG, 16 bits", ".png", 16),
    ("PNG, 8 bits", ".png", 8),
    ("OpenEXR, 16 bits", ".exr", 16),
    ("OpenEXR, 32 bits", ".exr", 32),
    ("TIFF, 16 bits", ".tif", 16),
    ("TIFF, 8 bits", ".tif", 8),
    ("Targa, 8 bits", ".tga", 8),
)
"""Each with the ending of its files and the bits per channel; always red, green, blue and alpha."""


class Storing(Contender):
    """A version that bakes a map into a file. Its time is that of the stage "image": from texels to a file that is there.

    whole: the seconds of the whole bakes. size: the bytes of the file.
    """

    def __init__(self, version: Version, child: Child, path: Path, settings: dict):
        self.child, self.path, self.settings, self.whole, self.size = child, path, settings, [], 0
        super().__init__(version.name, self._bake, lambda: None)

    def _bake(self) -> float:
        self.path.unlink(missing_ok=True)
        done = self.child.ask(do="bake", settings={**self.settings, "output": str(self.path)})
        self.size = self.path.stat().st_size
        self.whole.append(done["seconds"])
        return done["stages"]["image"]


def measure(pair: Path, versions: Sequence[Version], scratch: Path, quick: bool, repeats: int) -> list[dict]:
    """Bake `pair` by Flatten into each format, with all versions in turn."""
    size = 1024 if quick else 2048
    with ExitStack() as stack:
        children = [
            stack.enter_context(version.worker(scratch / f"storing_{n}.log")) for n, version in enumerate(versions)
        ]
        for child in children:
            child.ask(do="open_file", path=str(pair))
        return [
            _row(
                name,
                pair,
                size,
                repeats,
                [
                    Storing(version, child, scratch / f"stored_{n}{ending}", _settings(size, depth))
                    for n, (version, child) in enumerate(zip(versions, children, strict=True))
                ],
            )
            for name, ending, depth in FORMATS
        ]


def _settings(size: int, depth: int) -> dict:
    return {"method": "FLATTEN", "width": size, "height": size, "depth": depth, "storage": "FILE"}


def _row(name: str, pair: Path, size: int, repeats: int, field: list[Storing]) -> dict:
    timed = race(field, repeats)
    return {
        "what": name,
        "pair": pair.stem,
        "size": size,
        "times": {name: vars(times) for name, times in timed.items()},
        "whole": {contender.name: contender.whole[1:] for contender in field},
        "bytes": {contender.name: contender.size for contender in field},
    }
