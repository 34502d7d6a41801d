# SPDX-License-Identifier: GPL-3.0-or-later
"""What other programs do with meshes: `imprint.weld(points, triangles)` and its kind. They need numpy alone, no Blender.

Each takes points (V, 3) and triangles (T, 3), and an object with its options.
"""

from .collapse import CollapseOptions, PartialCollapse, collapse, partial_collapse
from .fitting import FitOptions, Samples, fit, surface_samples
from .folds import UnfoldOptions, unfold
from .uv_charts import ChartOptions, chart
from .uv_packing import PackOptions, pack
from .welding import ClusterOptions, WeldOptions, cluster, weld

__all__ = [
    "ChartOptions",
    "ClusterOptions",
    "CollapseOptions",
    "FitOptions",
    "PackOptions",
    "PartialCollapse",
    "Samples",
    "UnfoldOptions",
    "WeldOptions",
    "chart",
    "cluster",
    "collapse",
    "fit",
    "pack",
    "partial_collapse",
    "surface_samples",
    "unfold",
    "weld",
]
