# SPDX-License-Identifier: GPL-3.0-or-later
"""Validates the Jobs for Kubernetes against its schemas, and lets its own Job controller decide by exit codes. Any system.

python3 scripts/dev/farms/try_kubernetes.py [--versions 1.33,1.37] [--controller 1.33.1]

kubernetes-validate, which has the schemas, is installed into a temporary folder if it is missing. With --controller, the Job
controller of this version of Kubernetes does the Job in memory, with pods that only end; Go must be there, and its first
compilation takes minutes. What only a cluster knows, such as whether the volume is there, is not checked.
"""

import argparse
import json
import re
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

import small_sets

MANIFESTS = sorted((small_sets.FARM / "kubernetes").glob("*.yaml"))
BAKE = small_sets.FARM / "kubernetes" / "bake_job.yaml"
CONTROLLER = Path(__file__).with_name("job_controller.go")
DECISIONS = {
    "0": "1 Complete CompletionsReached 16",
    "1": "4 Failed FailedIndexes 15 0",
    "2": "1 Failed PodFailurePolicy",
    "3": "4 Failed FailedIndexes 15 0",
    "4": "1 Failed FailedIndexes 15 0",
    "4/4": "1 Failed FailedIndexes 0 0-15",
    "3,3,3,0": "4 Complete CompletionsReached 16",
    "evicted,evicted,evicted,evicted,evicted,0": "6 Complete CompletionsReached 16",
}
"""What must come of a Job whose first part ends with these exit codes: the words that job_controller.go prints, or the first of
them, where the others depend on how many parts have just been done."""


def compiled(version, folder):
    """Compile the controller of a version of Kubernetes. Returns the program's path."""

    def go(*words):
        return subprocess.run(["go", *words], cwd=folder, stdout=subprocess.PIPE, text=True, check=True).stdout

    shutil.copy(CONTROLLER, folder)
    go("mod", "init", "trial")
    own = json.loads(go("mod", "download", "-json", f"k8s.io/kubernetes@v{version}"))["GoMod"]
    parts = re.findall(r"(k8s\.io/\S+) v0\.0\.0$", Path(own).read_text(encoding="utf-8"), re.MULTILINE)
    published = version.replace("1.", "v0.", 1)
    go("mod", "edit", *(f"-replace={part}={part}@{published}" for part in parts))
    go("mod", "edit", f"-require=k8s.io/kubernetes@v{version}")
    go("mod", "tidy")
    go("build", "-o", "job_controller", CONTROLLER.name)
    return folder / "job_controller"


def decided(program):
    """Yield what the controller decides wrongly."""
    done = subprocess.run([program, BAKE, *DECISIONS], stdout=subprocess.PIPE, text=True, check=False)
    for codes, found in zip(DECISIONS, [*done.stdout.splitlines(), *len(DECISIONS) * [""]], strict=False):
        print(f"exit codes {codes}: {found}")
        if not found.startswith(DECISIONS[codes]):
            yield f"exit codes {codes}: {found or 'nothing'}, not {DECISIONS[codes]}"


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n", maxsplit=1)[0])
    parser.add_argument("--versions", default="1.33,1.37", help="versions of the schemas")
    parser.add_argument("--controller", metavar="VERSION", help="version of the Job controller")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="imprint-kubernetes-") as name:
        folder = Path(name)
        program = small_sets.program("kubernetes-validate", "kubernetes-validate", folder / "validate")
        check = [program, "--strict", "--kubernetes-version"]
        versions = options.versions.split(",")
        wrong = [version for version in versions if subprocess.call([*check, version, *map(str, MANIFESTS)])]
        found = [f"not valid for {version}" for version in wrong]
        if options.controller:
            (folder / "go").mkdir()
            found += decided(compiled(options.controller, folder / "go"))
    return small_sets.finish(found)


if __name__ == "__main__":
    sys.exit(main())
