# SPDX-License-Identifier: GPL-3.0-or-later
"""Remembers the last results of what takes long, by the content that they follow from."""

from collections import OrderedDict
from collections.abc import Hashable
from typing import Generic, TypeVar

Value = TypeVar("Value")


class Recent(Generic[Value]):
    """The last `most` results that were asked for or set. A key must tell all that a result follows from."""

    def __init__(self, most: int):
        self.most = most
        self._values: OrderedDict[Hashable, Value] = OrderedDict()

    def __len__(self) -> int:
        return len(self._values)

    def get(self, key: Hashable) -> Value | None:
        """The result of this key; None if it is not known, or was too long ago."""
        if key in self._values:
            self._values.move_to_end(key)
        return self._values.get(key)

    def __setitem__(self, key: Hashable, value: Value) -> None:
        self._values[key] = value
        self._values.move_to_end(key)
        while len(self) > self.most:
            self._values.popitem(last=False)

    def clear(self) -> None:
        self._values.clear()
