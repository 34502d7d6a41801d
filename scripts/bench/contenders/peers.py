# SPDX-License-Identifier: GPL-3.0-or-later
"""Runs other bakers in a separate environment and process. All of them are optional."""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np

from scripts.bench.contenders import names
from scripts.bench.contenders.child import Child
from scripts.bench.contenders.racing import PATIENCE, Contender
from scripts.bench.scenes import Pair, arrays_of

ROOT = Path(__file__).resolve().parents[3]
HOME = ROOT / "out" / "bench" / "peers"
PYTHON = HOME / ("Scripts/python.exe" if os.name == "nt" else "bin/python")
PACKAGES = (
    "open3d==0.20.0",
    "libusb-package==1.0.26.3",  # Open3D's wheel needs libusb, which some systems lack
    "pymeshlab==2025.7.post1",
    "embreex==4.4.0.post1",
    "pillow==13.0.0",
)


def install() -> None:
    """Create the environment. A package without a wheel for this machine is reported, and leaves a gap in the tables."""
    if not PYTHON.is_file():
        print(f"bench: setting up {HOME}: about 600 MB to download, once", file=sys.stderr)
        subprocess.run([sys._base_executable, "-m", "venv", str(HOME)], check=True, stdout=sys.stderr)
    pip = [str(PYTHON), "-m", "pip", "install", "--quiet", "--disable-pip-version-check", "--no-input"]
    for package in PACKAGES:
        done = subprocess.run([*pip, "--only-binary=:all:", package], check=False, stdout=sys.stderr)
        if done.returncode:
            print(f"bench: {package} cannot be installed here", file=sys.stderr)


class Peers:
    """The process with the other bakers. Use it in a `with` block. `versions` is empty without the environment."""

    def __init__(self, scratch: Path):
        self.scratch, self.versions = scratch, {}
        self._child = None

    def __enter__(self):
        if PYTHON.is_file():
            worker = Path(__file__).with_name("worker.py")
            self._child = Child([str(PYTHON), str(worker)], self.scratch / "peers.log")
            self.versions = self._child.ask(do="versions")
        return self

    def __exit__(self, *exception):
        if self._child:
            self._child.__exit__(*exception)

    @property
    def bakers(self) -> list[str]:
        """The bakers among the installed modules."""
        return [name for name in names.PEERS if name in self.versions]

    def load(self, pair: Pair) -> None:
        """Send a pair to the process, which keeps it in memory, as Blender does."""
        path = self.scratch / "pair.npz"
        np.savez(path, **arrays_of(pair))
        self._child.ask(do="load", path=str(path))
        path.unlink()

    def seconds(self, peer: str, size: int) -> float:
        """The seconds of one bake, measured in the process, without the time to send the request."""
        return self._child.ask(do="bake", peer=peer, size=size, save=None)["seconds"]

    def normals(self, peer: str, size: int) -> np.ndarray:
        """World-space normals (size, size, 3), row 0 at v = 0; 0 where nothing was hit."""
        path = self.scratch / "map.npy"
        self._child.ask(do="bake", peer=peer, size=size, save=str(path))
        texels = np.load(path)
        path.unlink()
        return texels


def contenders(peers: Peers, size: int) -> list[Contender]:
    """The bakers outside Blender, for the pair that they have loaded."""
    return [
        Contender(
            names.PEERS[peer],
            lambda peer=peer: peers.seconds(peer, size),
            lambda peer=peer: peers.normals(peer, size),
            PATIENCE,
        )
        for peer in peers.bakers
    ]
