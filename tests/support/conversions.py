"""Conversions of maps for tests: float maps in memory, as arrays."""

import bpy
import numpy as np

from addon.core.settings import Settings
from addon.core.stored_normals import StoredNormals
from addon.jobs.convert import Conversion, convert
from tests.support import angles
from tests.support.maps import pixels


def converted(low, source, before=None, *, is_own_base=False, **settings):
    """The texels (H, W, 4) float32 of a conversion, and its report. source: the name of an image; before: what it means."""
    values = {"margin": 0, "depth": 32, "storage": "MEMORY", "material": False, "image": "converted", **settings}
    conversion = Conversion(low, bpy.data.images[source], StoredNormals(**before or {}), is_own_base=is_own_base)
    report = convert(bpy.context, conversion, Settings(**values))
    return pixels(bpy.data.images[report.image]), report


def percentile(found, expected, kept=None):
    """Degrees at the 99th percentile between two maps. kept (H, W): the texels that count, or None for those of both."""
    kept = (expected[..., 3] > 0) & (found[..., 3] > 0) if kept is None else kept
    assert kept.any()
    return np.percentile(angles.degrees(angles.decode(found)[kept], angles.decode(expected)[kept]), 99)


def picture(name, values, *, is_float=True):
    """An image of these values (H, W, 4)."""
    image = bpy.data.images.new(name, values.shape[1], values.shape[0], alpha=True, float_buffer=is_float, is_data=True)
    image.alpha_mode = "CHANNEL_PACKED"
    image.pixels.foreach_set(values.astype(np.float32).ravel())
    return image
