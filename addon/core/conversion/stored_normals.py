# SPDX-License-Identifier: GPL-3.0-or-later
"""What the colors of an existing normal map mean."""

from dataclasses import dataclass, fields, replace

from ..declarations import bases
from ..declarations.all_settings import DECLARED
from ..declarations.choices import Space
from ..errors import BakeError
from ..settings import MapSettings


@dataclass(frozen=True)
class StoredNormals:
    """The space, the tangent basis and the channels of a normal map that is read. See CONVERT in the declarations."""

    from_space: str = DECLARED["from_space"].default
    from_basis: str = DECLARED["from_basis"].default
    from_red: str = DECLARED["from_red"].default
    from_green: str = DECLARED["from_green"].default
    from_blue: str = DECLARED["from_blue"].default

    def read_by(self, engine: str) -> "StoredNormals":
        """The same, where basis AUTO is replaced by that of a render engine. engine: Blender's identifier."""
        if self.from_basis != bases.AUTO:
            return self
        return replace(self, from_basis=bases.of_engine(engine).name)

    @property
    def channels(self) -> MapSettings:
        """Map settings with these channels."""
        return MapSettings(red=self.from_red, green=self.from_green, blue=self.from_blue)

    def check(self) -> None:
        """Raise BakeError for values that are not valid."""
        for name in (field.name for field in fields(self)):
            DECLARED[name].check(getattr(self, name))
        axes = self.from_red, self.from_green, self.from_blue
        if len({axis[1] for axis in axes}) < 3:
            raise BakeError(
                f"Red, green and blue of the map to convert are {', '.join(axes)}: give each channel another axis."
            )

    @property
    def words(self) -> str:
        """The space, and the basis and the channels where they matter."""
        return in_words(self.from_space, self.from_basis, (self.from_red, self.from_green, self.from_blue))


def in_words(space: str, basis: str, axes: tuple[str, str, str]) -> str:
    """A space of normals in words, with the tangent basis, and with the axes of the channels if they are unusual."""
    details = [bases.of_name(basis).label] if space == Space.TANGENT else []
    details += [", ".join(axes)] if axes != ("+X", "+Y", "+Z") else []
    return f"{space.lower()} space" + (f" ({'; '.join(details)})" if details else "")
