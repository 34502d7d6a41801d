"""Checks that two paths to the same file clash."""

import pytest

from addon.core.errors import WrongPlace
from addon.output.path_clashes import Places


def check_same(path, same):
    """Check that neither path may be written if the other is read or written, in any order."""
    for first, second in ((path, same), (same, path)):
        places = Places()
        places.read(first, "the mesh")
        with pytest.raises(WrongPlace, match=r"^The map would overwrite the mesh, .*: choose another path for it\.$"):
            places.write(second, "the map")
        places = Places("rename one")
        places.write(first, "the report")
        with pytest.raises(WrongPlace, match=r"^The map and the report would both be .*: rename one\.$"):
            places.write(second, "the map")
        with pytest.raises(WrongPlace, match="The report would overwrite a library"):
            places.read(second, "a library")  # found after the writes
