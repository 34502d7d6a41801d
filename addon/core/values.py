# SPDX-License-Identifier: GPL-3.0-or-later
"""Values that are compared by what they hold."""

from dataclasses import fields
from typing import Any

import numpy as np


class ComparedByValue:
    """A base of dataclasses with `eq=False` whose fields may be arrays, or tuples of such dataclasses."""

    def __eq__(self, other: object) -> bool:
        if type(other) is not type(self):
            return NotImplemented
        compared = [each.name for each in fields(self) if each.compare]  # type: ignore[arg-type]
        return all(_is_same(getattr(self, name), getattr(other, name)) for name in compared)

    __hash__ = None  # type: ignore[assignment]


def _is_same(one: Any, other: Any) -> bool:
    if isinstance(one, np.ndarray) or isinstance(other, np.ndarray):
        return one is other or np.array_equal(one, other)
    return one == other
