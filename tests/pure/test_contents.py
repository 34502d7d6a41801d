# SPDX-License-Identifier: GPL-3.0-or-later
"""The short text of plain data is the same for the same data, also where scripts pass numbers of numpy."""

import numpy as np
import pytest

from addon.core import contents


@pytest.mark.parametrize(
    "value", [np.float32(0.5), np.float64(0.5), np.float16(0.5), np.int64(3), np.uint8(3), np.bool_(True)]
)
def test_numbers_of_numpy_are_those_of_python(value):
    assert contents.canonical({"b": [value], "a": 1}) == contents.canonical({"a": 1, "b": [value.item()]})
    assert contents.short(value) == contents.short(value.item())
    assert contents.short(value) != contents.short(value.item() + 1)


def test_what_is_no_plain_data_is_refused():
    with pytest.raises(TypeError, match="plain data"):
        contents.canonical({"a": {1, 2}})
