# SPDX-License-Identifier: GPL-3.0-or-later
"""The add-ons of Blender that some steps need."""

from collections.abc import Callable


def _nothing() -> None:
    pass


load: Callable[[], None] = _nothing
"""Loads them where Blender was loaded without them, as the command line does."""
