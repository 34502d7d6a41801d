#!/usr/bin/env python3
# SPDX-License-Identifier: GPL-3.0-or-later
"""Plays the days of an artist: in real Blender windows, by clicks, keys and drags, with files that are saved, closed and opened
in another process. Not collected by pytest.

    python3 scripts/imprint.py build
    xvfb-run -a -s "-screen 0 1600x1000x24" python3 tests/window/artist.py --blender blender dist/imprint-*.zip [PART ...]

Needs X11 (or Xvfb), xdotool and ImageMagick, and the mouse for some minutes. Each part is a Blender of its own, with the zip
installed in a profile that is made for it: see artist_parts.py. Pictures of the window, and the files, stay in --folder. Ends
with 1 if a part fails.
"""

import argparse
import os
import re
import subprocess
import sys
import tempfile
from pathlib import Path

PARTS = Path(__file__).with_name("artist_parts.py")


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("zip", type=Path)
    parser.add_argument("parts", nargs="*")
    parser.add_argument("--blender", default="blender")
    parser.add_argument("--folder", type=Path)
    parser.add_argument("--size", default="1600x1000", help="of the window, in pixels; default: 1600x1000")
    parser.add_argument(
        "--patience", type=float, default=300.0, help="seconds for a part, of which waits have a fifth; default: 300"
    )
    given = parser.parse_args()
    names = re.findall(r"^def part_(\w+)", PARTS.read_text(encoding="utf-8"), re.MULTILINE)
    unknown = {*given.parts} - {*names}
    if unknown:
        parser.error(f"the parts are {', '.join(names)}")
    folder = (given.folder or Path(tempfile.mkdtemp(prefix="imprint-artist-"))).resolve()
    folder.mkdir(parents=True, exist_ok=True)
    environment = {**os.environ, "BLENDER_USER_RESOURCES": str(folder / "profile")}
    install = ["--command", "extension", "install-file", "--repo", "user_default", "--enable", str(given.zip.resolve())]
    subprocess.run([given.blender, *install], check=True, env=environment)
    failed = [name for name in given.parts or names if not play(given, name, folder, environment)]
    print(f"failed: {', '.join(failed)}" if failed else "all as promised", f"(pictures: {folder})", flush=True)
    return int(bool(failed))


def play(given: argparse.Namespace, name: str, folder: Path, environment: dict[str, str]) -> bool:
    """Run a part in a new Blender. It opens the file that an earlier part has left for it. Returns whether all was right."""
    file = folder / name / "scene.blend"
    window = ["--window-geometry", "0", "0", *given.size.split("x")]
    command = [
        given.blender,
        *window,
        *([str(file)] if file.exists() else []),
        "--python",
        str(PARTS),
        "--",
        name,
        str(folder),
        str(given.patience),
    ]
    print(f"{name}:", flush=True)
    (folder / f"{name}.done").unlink(missing_ok=True)
    with (folder / f"{name}.log").open("wb") as log:
        try:
            done = subprocess.run(
                command, env=environment, stdout=log, stderr=subprocess.STDOUT, timeout=given.patience, check=False
            )
            is_well = done.returncode == 0 and (folder / f"{name}.done").exists()
        except subprocess.TimeoutExpired:
            is_well = False
    text = (folder / f"{name}.log").read_text(errors="replace")
    print(*(line for line in text.splitlines() if not is_well or line.startswith("  ")), sep="\n", flush=True)
    return is_well


if __name__ == "__main__":
    sys.exit(main())
