# SPDX-License-Identifier: GPL-3.0-or-later
"""What turning over a part of a high mesh gained."""

from dataclasses import dataclass


@dataclass(frozen=True)
class PartTurned:
    """A connected part of a high mesh of which triangles were turned over.

    Attributes:
        name: Of the object.
        triangles: Of the part.
        of: Of the object.
        before, after: The share of its places on the low mesh that had a hit of their own on it, and that have one now; both 0
            if no place shows it.
    """

    name: str
    triangles: int
    of: int
    before: float
    after: float

    @property
    def sentence(self) -> str:
        """What was gained, for the user."""
        which = (
            repr(self.name) if self.triangles == self.of else f"A part of {self.name!r} ({self.triangles:,} triangles)"
        )
        if not self.after:
            return f"{which} turned over: no texel shows it"
        return f"{which} turned over: {self.before:.1%} of its texels had a hit before, {self.after:.1%} after"
