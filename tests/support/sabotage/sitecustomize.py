# SPDX-License-Identifier: GPL-3.0-or-later
"""Makes bakes fail as no input does on demand. Python imports this module at its start where PYTHONPATH has its folder.

What happens is in the name of the low mesh's file.
"""

import ctypes
import os
import sys
import time
from importlib.machinery import PathFinder
from pathlib import Path

TARGET = "addon.cli.batch"


def crash():
    ctypes.string_at(0)


def fill_memory():
    blocks = []
    while True:
        blocks.append(bytearray(b"x") * (1 << 24))
        time.sleep(0.005)


def hang():
    print("hangs", flush=True)
    time.sleep(1000)


def leave():
    os._exit(7)


def be_killed():
    os.kill(os.getpid(), 9)


DEEDS = {"crash": crash, "fill": fill_memory, "hang": hang, "leave": leave, "killed": be_killed}


class Finder:
    """Finds the module whose function is replaced."""

    def find_spec(self, name, path=None, target=None):
        if name != TARGET:
            return None
        spec = PathFinder.find_spec(name, path, target)
        load = spec.loader.exec_module

        def exec_module(module):
            load(module)
            open_files = module.open_files

            def sabotaged(plan, *more):
                for word, deed in DEEDS.items():
                    if word in Path(plan.options.low_file or "").stem:
                        deed()
                return open_files(plan, *more)

            module.open_files = sabotaged

        spec.loader.exec_module = exec_module
        return spec


sys.meta_path.insert(0, Finder())
