# SPDX-License-Identifier: GPL-3.0-or-later
"""What is wrong with the files of bakes, as far as it can be seen without opening them in Blender."""

import argparse
import os
from collections.abc import Iterator
from pathlib import Path

from ...core.errors import BakeError
from ...core.file_formats import OPENED
from ...core.file_structure import blend_files, usd_layers, whole_files
from ...core.names import file_names, unknown_name
from ...core.names.name_matching import match
from ...output.files.atomic_file import check_writable
from ..usage.options import STDOUT
from . import plans
from .clashes import InputFiles
from .plans import Plan


class InputProblems:
    """Looks at the files of bakes. Each file and each folder is looked at once."""

    def __init__(self, files: InputFiles, *, reads: bool):
        """reads: whether files, which must be trusted, are read as well, and not only their sizes."""
        self._files, self._reads = files, reads
        self._broken: dict[str, str] = {}
        self._objects: dict[str, set[str] | None] = {}
        self._writable: set[str] = set()

    def of(self, plan: Plan) -> Iterator[str]:
        """Sentences."""
        if plan.problem:
            yield plan.problem
        options, missing = plan.options, False
        for path in dict.fromkeys(path for path, _ in plans.input_paths(options)):
            if problem := self._files.problem(path):
                missing = True
                yield problem
            elif path not in (options.convert, *options.file[:1]) and _ending(path) not in OPENED:
                yield f"{path!r} is no mesh file that can be imported: {', '.join(OPENED)} can."
            elif self._reads and (problem := self._of_content(path, is_image=path == options.convert)):
                missing = True
                yield problem
        if not missing:
            yield from self._of_objects(options)
        for path in (options.output, options.export, options.save_blend, options.report):
            if path and path != STDOUT and (problem := self._of_folder(path)):
                yield problem

    def _of_content(self, path: str, *, is_image: bool) -> str:
        """Why a file, or a layer that a USD file is put together from, is not whole."""
        if path not in self._broken:
            problem = whole_files.problem(path, is_image=is_image)
            self._broken[path] = f"{path!r} {problem}." if problem else self._of_layers(path)
        return self._broken[path]

    def _of_layers(self, path: str) -> str:
        named = usd_layers.named(path)
        if named.has_variants:  # those that are not chosen may be missing
            return ""
        problems = ((layer, whole_files.problem(layer)) for layer in named.layers)
        return next((f"{path!r} refers to {layer!r}, which {problem}." for layer, problem in problems if problem), "")

    def _of_objects(self, options: argparse.Namespace) -> Iterator[str]:
        # Of several files, objects are renamed where names meet. Importers make names of their own.
        if len(options.file) != 1 or _ending(options.file[0]) in set(OPENED) - {".blend"}:
            return
        names = self._names(options.file[0])
        if names is None:
            yield blend_files.NOT_WHOLE.format(options.file[0])
        elif options.pairs:
            try:
                found, problems = match(names, options.suffixes)
            except BakeError as error:
                yield str(error)
                return
            if not found:
                yield " ".join(problems) or f"No object has a name that ends in {options.suffixes.low!r}."
        else:
            for name in dict.fromkeys(filter(None, (options.low, *options.high, options.cage))):
                if name not in names:
                    yield unknown_name.sentence(name, sorted(names))

    def _names(self, path: str) -> set[str] | None:
        if path not in self._objects:
            self._objects[path] = blend_files.object_names(Path(path))
        return self._objects[path]

    def _of_folder(self, path: str) -> str:
        """Why no file can be written to `path`. Where one can be written to a folder, others can."""
        folder = os.path.dirname(path)
        if file_names.LOW not in folder and folder not in self._writable:
            try:
                check_writable(Path(path).absolute())
            except BakeError as error:
                return str(error)
            self._writable.add(folder)
        return ""


def _ending(path: str) -> str:
    return os.path.splitext(path)[1].lower()
