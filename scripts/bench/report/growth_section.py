# SPDX-License-Identifier: GPL-3.0-or-later
"""The section of the report about the growth of cost, with its plot."""

from pathlib import Path

from scripts.bench.report.race_sections import SHORT
from scripts.bench.report.statistics_of_rounds import exponents
from scripts.bench.report.verdicts import LARGEST
from scripts.bench.report.writing import GAP, milliseconds, span, table


def growth(parts: dict[str, list[dict]]) -> list[str]:
    lines, fits = [], []
    for kind, points in parts.items():
        for point in points:
            peaks = (point["peak_gigabytes"][name] for name in SHORT)
            lines.append(
                [kind, f"{point['amount']:,}", *(milliseconds({"seconds": point["seconds"][name]}) for name in SHORT)]
                + [f"{peak:.2f}" if peak is not None else GAP for peak in peaks]
            )
        fits.append(
            [kind, *(span(exponents(points, name, last)) for name in SHORT for last in (None, LARGEST))],
        )
    return [
        "## Growth of cost",
        "",
        "Triangles at 512 x 512; texels and samples with 199,712 triangles, samples at 256 x 256. The exponent is the b of "
        "time = a x amount^b, by least squares of the logarithms; below 1, growth is slower than linear. Peak memory is that "
        "of the whole process, with Blender and the meshes and images of all points so far: an upper bound.",
        "",
        *table(["by", "Flatten, all", f"Flatten, largest {LARGEST}", "Cast, all", f"Cast, largest {LARGEST}"], fits),
        *table(["by", "amount", "Flatten, ms", "Cast, ms", "Flatten, peak GB", "Cast, peak GB"], lines),
        "![Growth of cost](growth.png)",
        "",
    ]


def plot(parts: dict[str, list[dict]], path: Path) -> None:
    """Plot seconds and peak memory over triangles, texels and samples, with fits over all points."""
    import matplotlib as mpl

    mpl.use("Agg")
    import matplotlib.pyplot as plt
    import numpy as np

    figure, axes = plt.subplots(2, len(parts), figsize=(4.2 * len(parts), 7), squeeze=False, layout="constrained")
    for column, (kind, points) in enumerate(parts.items()):
        amounts = np.array([point["amount"] for point in points], float)
        time, memory = axes[:, column]
        for name, short in SHORT.items():
            rounds = np.array([point["seconds"][name] for point in points])
            middle = np.median(rounds, axis=1)
            exponent = exponents(points, name)["median"]
            (line,) = time.loglog(amounts, middle, "o", label=f"{short}, exponent {exponent:.2f}")
            time.fill_between(amounts, rounds.min(axis=1), rounds.max(axis=1), color=line.get_color(), alpha=0.2)
            scale = np.exp(np.mean(np.log(middle) - exponent * np.log(amounts)))
            time.loglog(amounts, scale * amounts**exponent, "-", color=line.get_color(), linewidth=1)
            peaks = [point["peak_gigabytes"][name] for point in points]
            if None not in peaks:
                memory.loglog(amounts, peaks, "o-", label=short)
        time.set(xlabel=kind, ylabel="seconds")
        memory.set(xlabel=kind, ylabel="peak memory, GB")
        time.legend()
    figure.savefig(path, dpi=110)
    plt.close(figure)
