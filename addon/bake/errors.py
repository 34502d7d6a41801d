# SPDX-License-Identifier: GPL-3.0-or-later
"""The one exception that a person is meant to read."""


class BakeError(Exception):
    """The bake cannot be done. Its text is one sentence that names the thing to mend."""
