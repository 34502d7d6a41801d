# SPDX-License-Identifier: GPL-3.0-or-later
"""Validates the Jobs for Kubernetes against its schemas. Any system.

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
    parser.add_argument("--versions", default="1.33,1.37", help="versions of the schemas")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="imprint-kubernetes-") as name:
        folder = Path(name)
        program = small_sets.program("kubernetes-validate", "kubernetes-validate", folder / "validate")
        check = [program, "--strict", "--kubernetes-version"]
        versions = options.versions.split(",")
        wrong = [version for version in versions if subprocess.call([*check, version, *map(str, MANIFESTS)])]
        found = [f"not valid for {version}" for version in wrong]
    return small_sets.finish(found)


if __name__ == "__main__":
    sys.exit(main())
