# SPDX-License-Identifier: GPL-3.0-or-later
"""Bakes a map for each basis, shows them in three.js, Babylon.js and the Khronos renderer, and reports how far each is off.

    .venv/bin/python scripts/dev/engines.py [--engines three,babylon,khronos] [--out DIR] [--npm DIR] [--made] [FILE.blend ...]
    .venv/bin/python scripts/dev/engines.py --fill out/engines/engines.json

Needs Chromium and npm, and the network for the engines' packages: apt-get install chromium npm. The packages go into a
temporary folder, or into DIR, which keeps them. Each FILE.blend holds two objects that share UVs, "hi" and "lo"; without files,
spot, king and helmet of ../shared/assets. Small made meshes follow, each exported with a map for the engine's own basis: with
n-gons, a second UV layer, mirrored halves, two materials, texture sets, UDIM tiles. --made: these alone.

Writes engines.json, and index.html with pictures. Ends with 1 if the map for an engine's own basis is off by more than 1 degree
at the 99th percentile, or if the map for another basis is as good; and if an engine shows a made file without the tangents of
the map's UV layer, by 1 degree beside the known normals, or by 0.01 beside the known values of its other maps.
--fill puts the tables of a run into docs/engines.md, and does nothing else.
"""

import argparse
import json
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

from scripts.dev.in_engines import chromium, drawing, engine_report  # noqa: E402

PAGE = ROOT / "docs" / "engines.md"
PAIRS = ROOT / ".." / "shared" / "assets" / "pairs"
FILES = "spot_1696_536", "king_40480_4000", "helmet_23358_6117"


def measure(files: list[Path], engines: list[str], modules: Path, out: Path, *, texels: int, pixels: int) -> dict:
    """Run each file in each engine, write the pictures, and return the figures of the run."""
    import bpy  # noqa: F401  it has gpu
    import gpu

    import addon
    from addon.core.declarations import readers
    from scripts.dev.in_engines import comparing, made_cases, samples, wavy_sheet

    gpu.init()
    rows, decoded, pictures, cases, made = [], {}, {}, [], {}
    for file in files:
        sample = samples.make(file, texels)
        decoded[sample.name] = sample.decoded_degrees()
        setting = comparing.set_up(sample, pixels)
        for engine in engines:
            reader = readers.BY_NAME[engine]
            found = comparing.run(sample, setting, modules, engine, pixels)
            row = {"sample": sample.name, "engine": engine, "label": reader.label, "basis": reader.basis.name}
            rows.append(row | comparing.figures(found, setting))
            names = pictures[sample.name, engine] = []
            for index, view in enumerate(setting.views):
                names.append(f"{sample.name}-{engine}-{index}.png")
                (out / names[-1]).write_bytes(drawing.png_of(engine_report.strip(found, index, view.matrix)))
            print(engine_report.table({"rows": rows[-1:]})[-1], flush=True)
    for engine in engines:
        reader = readers.BY_NAME[engine]
        basis = reader.basis.name
        made[basis] = made.get(basis) or made_cases.make_all(basis)
        found = wavy_sheet.run(made[basis], modules, engine, pixels // 2)
        cases += [{"engine": engine, "label": reader.label} | row for row in found]
    print("\n".join(engine_report.table_of_cases({"cases": cases})), flush=True)
    addon.free()
    about = subprocess.run([chromium.find_chromium(), "--version"], capture_output=True, text=True, check=True)
    chosen = {name: version for name, version in chromium.PACKAGES.items() if name != "@babylonjs/loaders"}
    run = {"chromium": " ".join(about.stdout.split()[:2]), "packages": chosen, "map": texels, "view": pixels}
    run |= {"rows": rows, "decoded": decoded, "cases": cases}
    (out / "engines.json").write_text(json.dumps(run, indent=1), encoding="utf-8")
    (out / "index.html").write_text(engine_report.page(run, pictures), encoding="utf-8")
    return run


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("files", nargs="*", type=Path, metavar="FILE.blend")
    parser.add_argument("--engines", default=",".join(chromium.ENGINES))
    parser.add_argument("--map", type=int, default=2048, metavar="TEXELS")
    parser.add_argument("--view", type=int, default=2048, metavar="PIXELS")
    parser.add_argument("--out", type=Path, default=ROOT / "out" / "engines", metavar="DIR")
    parser.add_argument("--npm", type=Path, metavar="DIR")
    parser.add_argument("--made", action="store_true")
    parser.add_argument("--fill", type=Path, metavar="ENGINES.json")
    given = parser.parse_args()
    if given.fill:
        run = json.loads(given.fill.read_text(encoding="utf-8"))
        PAGE.write_text(engine_report.fill(PAGE.read_text(encoding="utf-8"), run), encoding="utf-8")
        return 0
    engines = given.engines.split(",")
    if unknown := [name for name in engines if name not in chromium.ENGINES]:
        parser.error(f"there is no engine {unknown[0]}: choose from {', '.join(chromium.ENGINES)}")
    files = [] if given.made else given.files or [PAIRS / f"{name}.blend" for name in FILES]
    given.out.mkdir(parents=True, exist_ok=True)
    try:
        chromium.find_chromium()
        with tempfile.TemporaryDirectory() as temporary:
            modules = chromium.install(given.npm or Path(temporary))
            run = measure(files, engines, modules, given.out, texels=given.map, pixels=given.view)
    except chromium.NoEngine as error:
        sys.exit(f"engines.py: {error}")
    found = engine_report.failures(run)
    print("\n".join(found), file=sys.stderr)
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
