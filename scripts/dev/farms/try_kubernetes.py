# SPDX-License-Identifier: GPL-3.0-or-later
"""Validates the Jobs for Kubernetes against the schemas of Kubernetes. Any system.

python3 scripts/dev/farms/try_kubernetes.py [--versions 1.33,1.37]

kubernetes-validate, which has the schemas, is installed into a temporary folder if it is missing. What only a cluster knows,
such as whether the volume is there, is not checked.
"""

import argparse
import subprocess
import sys
import tempfile
from pathlib import Path

import small_sets

MANIFESTS = sorted((small_sets.FARM / "kubernetes").glob("*.yaml"))


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n", maxsplit=1)[0])
    parser.add_argument("--versions", default="1.33,1.37", help="versions of Kubernetes")
    versions = parser.parse_args().versions.split(",")
    with tempfile.TemporaryDirectory(prefix="imprint-kubernetes-") as folder:
        program = small_sets.program("kubernetes-validate", "kubernetes-validate", Path(folder))
        check = [program, "--strict", "--kubernetes-version"]
        wrong = [version for version in versions if subprocess.call([*check, version, *map(str, MANIFESTS)])]
    return small_sets.finish([f"not valid for {version}" for version in wrong])


if __name__ == "__main__":
    sys.exit(main())
