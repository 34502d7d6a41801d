# SPDX-License-Identifier: GPL-3.0-or-later
"""From how many samples on they are adaptive."""

from .choices import Method

LEAST = {Method.FLATTEN: 64, Method.CAST: 4}
"""By method. With fewer, adaptive samples are not faster on all meshes."""


def least(method: str) -> int:
    """The same for a value of the setting; for Auto, of the method that needs fewer."""
    return LEAST.get(method, min(LEAST.values()))
