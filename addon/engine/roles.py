# SPDX-License-Identifier: GPL-3.0-or-later
"""Names of the targets that samples are drawn into."""


def role(name: str, slot: int) -> str:
    """The role of a target for samples in this slot, which stay beside those in other slots."""
    return f"{name} {slot}" if slot else name
