# SPDX-License-Identifier: GPL-3.0-or-later
"""Tests that links are kept and resolved, and that pipes, sockets and devices are refused."""

import os
import socket

import pytest

from addon.core.errors import BakeError, WrongPlace
from addon.output.atomic_file import Partial, check_writable, replacing
from addon.output.path_clashes import Places
from tests.support import clashes

pytestmark = pytest.mark.skipif(os.name == "nt", reason="links and pipes of POSIX")


def tree(folder):
    """Every path below `folder`, with the text of a file or the target of a link."""
    return {
        str(path.relative_to(folder)): os.readlink(path) if path.is_symlink() else path.is_file() and path.read_text()
        for path in folder.rglob("*")
    }


def write(path, text="new"):
    with replacing(path) as partial:
        partial.write_text(text)


def test_a_link_is_kept_and_its_target_is_replaced(tmp_path):
    (tmp_path / "store").mkdir()
    (tmp_path / "store" / "1234").write_text("old")
    (tmp_path / "map.png").symlink_to("store/1234")
    partial = Partial(tmp_path / "map.png")
    assert (
        partial.temporary.parent == tmp_path.resolve() / "store"
    )  # in the same file system, so that moving is one step
    assert partial.temporary.suffix == ".png"  # the ending selects the format
    partial.discard()
    write(tmp_path / "map.png")
    assert tree(tmp_path) == {"store": False, "store/1234": "new", "map.png": "store/1234"}


def test_the_missing_target_of_a_link_is_created(tmp_path):
    (tmp_path / "map.png").symlink_to("later/it.png")
    check_writable(tmp_path / "map.png")
    write(tmp_path / "map.png")
    assert tree(tmp_path) == {"later": False, "later/it.png": "new", "map.png": "later/it.png"}


def special(kind, path):
    if kind == "pipe":
        os.mkfifo(path)
    elif kind == "socket":
        with socket.socket(socket.AF_UNIX) as made:
            made.bind(str(path))
    elif kind == "device":
        path.symlink_to("/dev/null")
    elif kind == "folder":
        path.mkdir()
    else:
        path.symlink_to(path.name)


@pytest.mark.parametrize(
    ("kind", "message"),
    [
        ("pipe", "is a pipe"),
        ("socket", "is a socket"),
        ("device", "is a device"),
        ("folder", "is a folder"),
        ("loop", "links"),
    ],
)
def test_special_files_are_refused_and_kept(tmp_path, monkeypatch, kind, message):
    monkeypatch.chdir(tmp_path)  # the paths of sockets must be short
    path = tmp_path / "x"
    special(kind, path.relative_to(tmp_path))
    before = os.lstat(path)
    for refuse in (check_writable, Partial, write):
        with pytest.raises(BakeError, match=message):
            refuse(path)
    assert os.lstat(path).st_mode == before.st_mode
    assert os.listdir(tmp_path) == ["x"]


@pytest.fixture
def linked(tmp_path, monkeypatch):
    """The working folder: in/ with meshes, links to it and into it, a hard link, and an empty out/."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "in" / "deep").mkdir(parents=True)
    (tmp_path / "out").mkdir()
    for name in ("a.obj", "skin.1001.png", "skin_0002.png", "é.obj"):
        (tmp_path / "in" / name).write_text(name)
    (tmp_path / "soft").symlink_to("in")
    (tmp_path / "down").symlink_to("in/deep")
    (tmp_path / "soft.obj").symlink_to("in/a.obj")
    (tmp_path / "chain.obj").symlink_to("soft.obj")
    (tmp_path / "later.json").symlink_to("out/r.json")
    os.link(tmp_path / "in" / "a.obj", tmp_path / "hard.obj")
    return tmp_path


SAME = {
    "two slashes at the start": ("in/a.obj", "/{here}/in/a.obj"),
    "a linked folder": ("in/a.obj", "soft/a.obj"),
    "out of a linked folder": ("in/a.obj", "down/../a.obj"),
    "a link": ("in/a.obj", "soft.obj"),
    "a link that is read": ("soft.obj", "in/a.obj"),
    "a link to a link": ("in/a.obj", "chain.obj"),
    "a hard link": ("in/a.obj", "hard.obj"),
    "a link and a hard link": ("soft.obj", "hard.obj"),
    "a link to a missing file": ("out/r.json", "later.json"),
    "a tile in a linked folder": ("in/skin.1001.png", "soft/Skin.<UDIM>.png"),
}


@pytest.mark.parametrize("case", SAME)
def test_links_to_one_file_clash(linked, case):
    first, second = (path.replace("{here}", str(linked)) for path in SAME[case])
    clashes.check_same(first, second)


def test_a_file_may_be_read_more_than_once_through_links(linked):
    places = Places()
    for path in ("in/a.obj", "soft.obj", "hard.obj"):
        places.read(path, "the mesh")


def test_only_the_reader_itself_may_replace_a_file_through_a_link(linked):
    places = Places()
    places.read("in/a.obj", "the scene", "set 1")
    places.write("soft/a.obj", "the scene", may_replace="set 1")
    with pytest.raises(WrongPlace):
        places.write("hard.obj", "the scene", may_replace="set 2")


def test_a_message_has_a_path_once_if_both_spellings_are_equal(linked):
    places = Places()
    places.write("out/m.png", "the map")
    with pytest.raises(WrongPlace) as refused:
        places.write("soft/../out/m.png", "the report")
    assert str(refused.value).lower().count("m.png'") == 1


def test_a_report_cannot_be_written_to_a_device():
    with pytest.raises(WrongPlace, match="is a device"):
        Places().write(os.devnull, "the report")
