"""What is said of two paths that lead to one file."""

import pytest

from addon.core.errors import WrongPlace
from addon.output.files.path_clashes import Places


def check_same(one, other):
    """Neither may be written where the other is read or written, in any order."""
    for first, second in ((one, other), (other, one)):
        places = Places()
        places.read(first, "the mesh")
        with pytest.raises(WrongPlace, match=r"^The map would overwrite the mesh, .*: choose another path for it\.$"):
            places.write(second, "the map")
        places = Places("do what is right")
        places.write(first, "the report")
        with pytest.raises(WrongPlace, match=r"^The map and the report would both be .*: do what is right\.$"):
            places.write(second, "the map")
        with pytest.raises(WrongPlace, match="The report would overwrite a library"):
            places.read(second, "a library")  # which showed itself late
