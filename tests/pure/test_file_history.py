# SPDX-License-Identifier: GPL-3.0-or-later
"""Undo and Redo of files: what steps of a session wrote comes and goes, what others wrote stays, and nothing else remains."""

import errno
import itertools
import os
import random
import shutil
from pathlib import Path

import pytest

from addon.output import atomic_file, file_history
from addon.output.atomic_file import all_or_none, replacing
from addon.output.file_history import FileHistory

_seconds = itertools.count(1_000_000_001, 4)


def write(path, text):
    with replacing(path) as partial:
        partial.write_text(text)
        os.utime(partial, (0, next(_seconds)))  # two writes here may be in one tick of the system's clock


def tree(folder):
    """Every path below `folder`, with the contents of files."""
    return {path.relative_to(folder).as_posix(): path.is_file() and path.read_text() for path in folder.rglob("*")}


class Session:
    """Steps that write files into the folder `maps`, and what that folder held after each; the first entry is before all."""

    def __init__(self, folder):
        self.folder, self.own = folder / "maps", folder / "own"
        self.folder.mkdir()
        self.own.mkdir()
        self.history, self.states, self.at = FileHistory(), [{}], 0

    def step(self, **texts):
        """A bake. Names of files have _ for /."""
        self.history.begin(str(self.own), 32)
        for name, text in texts.items():
            write(self.folder / name.replace("_", "/"), text)
        assert self.history.end(str(self.at + 1))
        self.states[self.at + 1 :] = [tree(self.folder)]
        self.at += 1

    def go_to(self, number):
        self.at = number
        return self.history.go_to({str(number)})

    def is_right(self):
        return tree(self.folder) == self.states[self.at]

    @property
    def number_kept(self):
        return len([path for path in self.own.rglob("*") if path.is_file()])


@pytest.fixture
def session(tmp_path):
    made = Session(tmp_path)
    yield made
    made.history.forget()
    assert list(made.own.iterdir()) == []
    assert atomic_file.before_replacing is None


def no_links(*_):
    raise OSError(errno.EXDEV, os.strerror(errno.EXDEV))


WAYS = {"links": False, "copies": True}
NAMES = ("a.png", "b.png", "new_c.png", "new_deep_d.png")


@pytest.mark.parametrize("copies", WAYS.values(), ids=WAYS)
@pytest.mark.parametrize("seed", range(6))
def test_files_are_those_of_the_step_in_any_order(tmp_path, monkeypatch, seed, copies):
    if copies:
        monkeypatch.setattr(os, "link", no_links)
    chance, session = random.Random(seed), Session(tmp_path)
    (session.folder / "a.png").write_text("before")
    session.states[0] = tree(session.folder)
    for number in range(40):
        if chance.random() < 0.4:
            names = chance.sample(NAMES, chance.randint(1, len(NAMES)))
            session.step(**{name: f"{name} {number}" for name in names})
        else:
            session.go_to(chance.randrange(len(session.states)))
        assert session.is_right(), number
    session.go_to(0)
    assert session.is_right()
    session.history.forget()
    assert list(session.own.iterdir()) == []


@pytest.mark.parametrize("seed", range(10))
def test_undo_goes_no_further_back_than_to_the_last_save(tmp_path, seed):
    chance, session, saved = random.Random(seed), Session(tmp_path), 0
    for number in range(60):
        action = chance.random()
        if action < 0.3:
            names = chance.sample(NAMES, chance.randint(1, len(NAMES)))
            saved = min(saved, session.at)
            session.step(**{name: f"{name} {number}" for name in names})
        elif action < 0.5:
            saved = max(saved, session.at)
            session.history.save()
            session.states[: saved + 1] = [tree(session.folder)] * (saved + 1)
        else:
            moved = session.go_to(chance.randrange(len(session.states)))
            assert not [*moved.changed, *moved.not_kept, *moved.failed], number
        assert session.is_right(), number


def test_what_was_saved_is_told_and_its_old_content_goes(session):
    session.step(a="1", b="1")
    session.step(a="2")
    session.history.save()
    assert session.number_kept == 0
    assert session.go_to(1).sentences == ["Left alone, since the .blend was saved after the bake: 'a'."]
    assert session.go_to(2).sentences == []
    assert session.go_to(1).paths == set()
    assert sorted(session.go_to(0).saved) == [session.folder / "a", session.folder / "b"]
    assert tree(session.folder) == {"a": "2", "b": "1"}


def test_a_file_that_is_as_it_was_before_all_is_not_told(session):
    session.step(a="1", b="1")
    session.history.save()
    (session.folder / "b").unlink()
    assert session.go_to(0).saved == [session.folder / "a"]


def test_a_save_counts_for_its_own_file_alone(session):
    session.step(a="1")
    session.history.save()
    session.history.forget()
    session.at, session.states = 0, [tree(session.folder)]
    session.step(a="2")
    assert session.go_to(0).sentences == []
    assert session.is_right()


def test_what_was_undone_before_a_save_can_be_redone(session):
    session.step(a="1")
    session.step(a="2", b="2")
    session.go_to(1)
    session.history.save()
    for number in (2, 1, 2):
        assert session.go_to(number).sentences == []
        assert session.is_right()


def test_a_save_counts_while_its_step_can_be_undone(session):
    """Steps go at the other end while their number is limited."""
    session.step(a="1")
    session.history.save()
    for text in "23":
        session.history.begin(str(session.own), 2)
        write(session.folder / "a", text)
        assert session.history.end(text)
    assert session.history.go_to({"2"}).sentences == []
    assert tree(session.folder) == {"a": "2"}
    assert session.history.go_to({}).sentences == []
    assert tree(session.folder) == {"a": "1"}


def test_old_content_is_linked_and_not_copied(session, monkeypatch):
    monkeypatch.setattr(shutil, "copy2", no_links)
    session.step(a="1")
    number = (session.folder / "a").stat().st_ino
    session.step(a="2")
    session.go_to(1)
    assert (session.folder / "a").stat().st_ino == number
    session.go_to(2)
    assert session.is_right()


@pytest.mark.parametrize("text", ["painted", None], ids=["changed", "deleted"])
def test_what_another_program_did_stays_and_is_told(session, text):
    session.step(a="1", b="1")
    session.step(a="2", b="2")
    path = session.folder / "a"
    path.unlink()
    if text:
        path.write_text(text)
    now = tree(session.folder).get("a")
    moved = session.go_to(1)
    assert moved.sentences == ["Left alone, since changed or deleted after the bake: 'a'."]
    assert tree(session.folder) == ({"a": now} if now else {}) | {"b": "1"}
    assert moved.paths == {session.folder / "b"}
    assert session.go_to(2).changed == [path]
    assert tree(session.folder).get("a") == now
    session.go_to(0)
    assert tree(session.folder).get("a") == now


def test_a_file_that_was_painted_in_place_stays(session):
    session.step(a="1")
    session.step(a="2")
    with (session.folder / "a").open("a") as file:
        file.write("x")
    session.go_to(1)
    assert tree(session.folder) == {"a": "2x"}


def test_what_another_program_wrote_between_two_bakes_comes_back(session):
    session.step(a="1")
    (session.folder / "a").write_text("painted")
    session.step(a="2")
    assert session.go_to(1).sentences == []
    assert tree(session.folder) == {"a": "painted"}
    assert session.go_to(0).changed == [session.folder / "a"]
    assert tree(session.folder) == {"a": "painted"}


def test_the_same_content_by_hand_is_no_change(session):
    session.step(a="1")
    session.step(a="2")
    old = next(path for path in session.own.rglob("*") if path.is_file())
    os.replace(old, session.folder / "a")
    assert session.go_to(1).sentences == []
    assert session.is_right()


def test_a_deleted_folder_stays_deleted(session):
    session.step(new_a="1", b="1")
    session.step(new_a="2", b="2")
    shutil.rmtree(session.folder / "new")
    assert session.go_to(1).changed == [session.folder / "new" / "a"]
    assert tree(session.folder) == {"b": "1"}
    assert session.go_to(0).sentences == []
    assert tree(session.folder) == {}


def test_a_folder_with_files_of_others_stays(session):
    session.step(new_a="1")
    (session.folder / "new" / "notes").write_text("mine")
    session.go_to(0)
    assert tree(session.folder) == {"new": False, "new/notes": "mine"}


def test_a_bake_that_fails_is_no_step(session):
    session.step(a="1")
    session.history.begin(str(session.own), 32)
    with pytest.raises(ZeroDivisionError), all_or_none():
        write(session.folder / "a", "2")
        write(session.folder / "b", "2")
        raise ZeroDivisionError
    assert not session.history.end("failed")
    assert session.is_right()
    session.go_to(0)
    assert session.is_right()


def test_files_outside_a_step_are_not_kept(session):
    session.step(a="1")
    write(session.folder / "a", "2")
    assert session.number_kept == 0
    assert session.go_to(0).changed == [session.folder / "a"]


def test_steps_that_cannot_be_redone_are_not_kept(session):
    for number in range(4):
        session.step(a=f"{number}")
    assert session.number_kept == 3
    session.go_to(1)
    assert session.number_kept == 3
    session.step(a="again")
    assert session.number_kept == 1


def test_no_more_steps_are_kept_than_can_be_undone(session):
    for number in range(40):
        session.step(a=f"{number}")
    assert session.number_kept == 32
    assert session.go_to(5).sentences == []
    assert tree(session.folder) == session.states[8]


def test_the_oldest_content_goes_first_and_that_is_told(session, monkeypatch):
    monkeypatch.setattr(file_history, "MOST_KEPT", 25)
    for number in range(4):
        session.step(a=f"{number}" * 10)
    assert session.number_kept == 2
    assert session.go_to(2).sentences == []
    assert session.is_right()
    moved = session.go_to(1)
    assert moved.sentences == ["Not brought back, since the old content was not kept: 'a'."]
    assert tree(session.folder) == {"a": "1" * 10}


def test_a_step_whose_content_was_not_kept_is_passed(session, monkeypatch):
    session.step(a="1")
    session.step(a="22" * 10)
    monkeypatch.setattr(file_history, "MOST_KEPT", 5)
    session.step(a="3")
    assert session.go_to(2).not_kept == [session.folder / "a"]
    assert tree(session.folder) == {"a": "3"}
    assert session.go_to(1).sentences == []
    assert session.is_right()
    assert session.go_to(2).not_kept == [session.folder / "a"]
    assert session.go_to(3).sentences == []
    assert session.is_right()


def test_copies_have_a_limit_of_their_own(session, monkeypatch):
    monkeypatch.setattr(os, "link", no_links)
    monkeypatch.setattr(file_history, "MOST_COPIED", 5)
    session.step(a="1" * 10)
    session.step(a="2")
    assert session.go_to(1).not_kept == [session.folder / "a"]


def test_a_copy_on_a_file_system_that_rounds_times_is_known(session, monkeypatch):
    monkeypatch.setattr(os, "link", no_links)
    copy = shutil.copy2

    def rounded(path, other):
        copy(path, other)
        os.utime(other, (0, os.stat(path).st_mtime // 2 * 2))

    monkeypatch.setattr(shutil, "copy2", rounded)
    for number in range(3):
        session.step(a=f"{number}")
    for number in (2, 1, 2, 3, 1):
        assert session.go_to(number).sentences == []
        assert session.is_right()


def full(*_):
    raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


def half(path, kept):
    Path(kept).write_text("half")
    full()


def test_a_full_disk_keeps_nothing_and_the_bake_goes_on(session, monkeypatch):
    session.step(a="1")
    monkeypatch.setattr(os, "link", no_links)
    monkeypatch.setattr(shutil, "copy2", half)
    session.step(a="2")
    assert session.number_kept == 0
    monkeypatch.undo()
    assert session.go_to(1).not_kept == [session.folder / "a"]
    assert tree(session.folder) == {"a": "2"}


def test_nothing_is_kept_on_a_disk_with_little_room(session, monkeypatch):
    session.step(a="1" * 10)
    usage = shutil.disk_usage(session.folder)
    monkeypatch.setattr(shutil, "disk_usage", lambda _: usage._replace(free=5))
    session.step(a="2")
    assert session.number_kept == 0


def test_a_refused_file_has_not_changed_and_is_told(session, monkeypatch):
    session.step(a="1", b="1")
    session.step(a="2", b="2")
    replace = os.replace

    def refuse(path, other):
        if Path(other).name == "a":
            full()
        replace(path, other)

    monkeypatch.setattr(os, "replace", refuse)
    assert session.go_to(1).sentences == ["'a' could not be brought back: No space left on device."]
    assert tree(session.folder) == {"a": "2", "b": "1"}
    monkeypatch.undo()
    assert session.go_to(2).sentences == []
    assert session.is_right()
    session.go_to(1)
    assert session.is_right()


def test_a_private_folder_that_was_emptied_is_told(session):
    session.step(a="1")
    session.step(a="2")
    shutil.rmtree(session.own)
    session.own.mkdir()
    assert session.go_to(1).not_kept == [session.folder / "a"]
    session.go_to(2)
    session.step(a="3")
    session.go_to(2)
    assert session.is_right()


def test_a_link_stays_a_link(session):
    session.step(a="1")
    (session.folder / "link").symlink_to(session.folder / "a")
    session.step(link="2")
    session.go_to(1)
    assert (session.folder / "link").is_symlink()
    assert (session.folder / "a").read_text() == "1"


def test_many_files_are_told_in_short(session):
    session.step(**{f"f{number}": "1" for number in range(6)})
    session.step(**{f"f{number}": "2" for number in range(6)})
    for path in session.folder.iterdir():
        path.write_text("painted")
    (text,) = session.go_to(1).sentences
    assert text.endswith("and 3 more.")
