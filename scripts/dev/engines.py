# SPDX-License-Identifier: GPL-3.0-or-later
"""Bakes a map for each basis, shows them in three.js, Babylon.js and the Khronos renderer, and reports how far each is off.

    .venv/bin/python scripts/dev/engines.py [--engines three,babylon,khronos] [--out DIR] [--npm DIR] [FILE.blend ...]

Needs Chromium and npm, and the network for the engines' packages: apt-get install chromium npm. The packages go into a
temporary folder, or into DIR, which keeps them. Each FILE.blend holds two objects that share UVs, "hi" and "lo"; without files,
spot, king and helmet of ../shared/assets.

Writes engines.json. Ends with 1 if the map for an engine's own basis is off by more than 1 degree at the 99th percentile, or
if the map for another basis is as good.
"""

import argparse
import json
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

from addon.core.declarations import bases, targets  # noqa: E402
from scripts.dev.in_engines import chromium  # noqa: E402

PAIRS = ROOT / ".." / "shared" / "assets" / "pairs"
FILES = "spot_1696_536", "king_40480_4000", "helmet_23358_6117"
LIMIT = 1.0
"""Degrees at the 99th percentile that an engine may be off with the map for its own basis, away from seams."""
LABELS = {
    **{basis.name: basis.label for basis in bases.BASES},
    "no-tangents": "MikkTSpace, mesh without tangents",
    "bare": "no map",
}
"""What an engine shows, in the table's order."""


def measure(files: list[Path], engines: list[str], modules: Path, *, texels: int, pixels: int) -> dict:
    """Run each file in each engine. Returns the degrees as plain data."""
    import bpy  # noqa: F401  it has gpu
    import gpu

    import addon
    from scripts.dev.in_engines import comparing, samples

    gpu.init()
    rows = []
    for file in files:
        sample = samples.make(file, texels)
        setting = comparing.set_up(sample, pixels)
        for engine in engines:
            target = targets.BY_NAME[engine]
            row = {"sample": sample.name, "label": target.label, "basis": target.basis.name}
            rows.append(row | comparing.degrees(comparing.run(sample, setting, modules, engine, pixels), setting))
            print(table(rows[-1:])[-1], flush=True)
    addon.free()
    about = subprocess.run([chromium.find_chromium(), "--version"], capture_output=True, text=True, check=True)
    return {"chromium": " ".join(about.stdout.split()[:2]), "map": texels, "view": pixels, "rows": rows}


def failures(rows: list[dict]) -> list[str]:
    """What a run shows that it must not."""
    found = []
    for row in rows:
        own, where = row["degrees"][row["basis"]], f"{row['sample']} in {row['label']}"
        if own > LIMIT:
            found.append(f"{where}: its own map is off by {own:.2f} degrees, and not by {LIMIT} at most")
        for basis in bases.BY_NAME:
            if basis != row["basis"] and row["degrees"][basis] <= own:
                found.append(f"{where}: the map for {LABELS[basis]} is as good, {row['degrees'][basis]:.2f} degrees")
    return found


def table(rows: list[dict]) -> list[str]:
    """The 99th percentiles as lines of Markdown. The engine's own basis is bold."""
    lines = ["| Mesh | Engine | " + " | ".join(LABELS.values()) + " |", "| --- " * (2 + len(LABELS)) + "|"]
    for row in rows:
        texts = {name: f"{row['degrees'][name]:.2f}" for name in LABELS}
        texts[row["basis"]] = f"**{texts[row['basis']]}**"
        lines.append(f"| {row['sample'].split('_')[0]} | {row['label']} | {' | '.join(texts.values())} |")
    return lines


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("files", nargs="*", type=Path, metavar="FILE.blend")
    parser.add_argument("--engines", default=",".join(chromium.ENGINES))
    parser.add_argument("--map", type=int, default=2048, metavar="TEXELS")
    parser.add_argument("--view", type=int, default=2048, metavar="PIXELS")
    parser.add_argument("--out", type=Path, default=ROOT / "out" / "engines", metavar="DIR")
    parser.add_argument("--npm", type=Path, metavar="DIR")
    given = parser.parse_args()
    files = given.files or [PAIRS / f"{name}.blend" for name in FILES]
    given.out.mkdir(parents=True, exist_ok=True)
    try:
        with tempfile.TemporaryDirectory() as temporary:
            modules = chromium.install(given.npm or Path(temporary))
            run = measure(files, given.engines.split(","), modules, texels=given.map, pixels=given.view)
    except chromium.NoEngine as error:
        sys.exit(f"engines.py: {error}")
    (given.out / "engines.json").write_text(json.dumps(run, indent=1), encoding="utf-8")
    found = failures(run["rows"])
    print("\n".join(found), file=sys.stderr)
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
