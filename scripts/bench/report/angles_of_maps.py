# SPDX-License-Identifier: GPL-3.0-or-later
"""Angles between two maps of normals."""

import numpy as np

from tests.support import angles


def difference_of(found: np.ndarray, wanted: np.ndarray) -> dict[str, float]:
    """Degrees between two maps (height, width, 4) of stored normals, and the share of texels that only one of them covers.

    Texels with an alpha of 0 are not covered. Degrees are NaN if no texel is covered in both.
    """
    has, had = (texels[..., 3] > 0.0 for texels in (found, wanted))
    degrees = angles.degrees(angles.decode(found)[has & had], angles.decode(wanted)[has & had])
    high, higher, most = np.percentile(degrees, (99.0, 99.9, 100.0)).tolist() if degrees.size else (float("nan"),) * 3
    return {"percentile_99": high, "percentile_99_9": higher, "maximum": most, "unlike": float((has != had).mean())}
