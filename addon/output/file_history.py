# SPDX-License-Identifier: GPL-3.0-or-later
"""Files as they were before and after each step of a session, which Undo and Redo bring back, but not to before a save.

Old content goes into a private folder: as a link where the file system allows it, else as a copy. Of each content there is one.
"""

import os
import shutil
import tempfile
from collections.abc import Collection, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

from ..core.errors import reason, shorten_list
from . import atomic_file

MOST_KEPT = 8 << 30
"""The most bytes of old content that are kept, which the disk would have free otherwise."""
MOST_COPIED = 1 << 30
"""The most bytes of them that may be copies."""
SAVED = "Left alone, since the .blend was saved after the bake: {}."
CHANGED = "Left alone, since changed or deleted after the bake: {}."
NOT_KEPT = "Not brought back, since the old content was not kept: {}."
NOT_WRITTEN = "{} could not be brought back: {}."


class Stamp(NamedTuple):
    """What differs between two contents of a file, in bytes and nanoseconds. Links, copies and renamed files have the same."""

    size: int
    changed: int


def stamp_of(path: Path) -> Stamp | None:
    """The stamp of a file; None without one."""
    try:
        status = path.stat()
    except OSError:
        return None
    return Stamp(status.st_size, status.st_mtime_ns)


@dataclass(eq=False)
class Content:
    """What a file has or had in it."""

    stamp: Stamp | None
    """That of the file while it has this content; None if there is no file."""
    kept: Path | None = None
    """Where it is kept; None if it is not."""
    kept_stamp: Stamp | None = None
    is_copy: bool = False
    """Whether the kept file takes space beside the one that it was made of."""

    @property
    def is_kept(self) -> bool:
        """Whether it is where it was kept, as it was then."""
        return self.kept is not None and stamp_of(self.kept) == self.kept_stamp

    def forget(self) -> None:
        """Keep it no longer."""
        if self.kept is not None:
            with suppress(OSError):
                self.kept.unlink()
        self.kept = None


class Change(NamedTuple):
    """What a step did to a file."""

    before: Content
    after: Content
    folders: Sequence[Path]
    """Those that were made for the file, the innermost first."""


@dataclass(frozen=True)
class Step:
    """What a step did to all files."""

    name: str
    """Stands for the files as they are after it."""
    changes: dict[Path, Change]


class Place(NamedTuple):
    """What a file should have in it now, and what Imprint left in it, which is another content where that was not kept."""

    content: Content
    left: Content


@dataclass
class Moved:
    """What Undo or Redo did.

    Attributes:
        paths: The files that have another content now.
        saved: Those that were left as they were saved.
        changed: Those that were left alone, as another program or bake changed them.
        not_kept: Those whose content is not kept.
        failed: Sentences about those that the system refused.
    """

    paths: set[Path] = field(default_factory=set)
    saved: list[Path] = field(default_factory=list)
    changed: list[Path] = field(default_factory=list)
    not_kept: list[Path] = field(default_factory=list)
    failed: list[str] = field(default_factory=list)

    @property
    def sentences(self) -> list[str]:
        """What was not brought back, and why."""
        said = [(SAVED, self.saved), (CHANGED, self.changed), (NOT_KEPT, self.not_kept)]
        texts = [
            text.format(shorten_list(repr(path.name) for path in dict.fromkeys(paths))) for text, paths in said if paths
        ]
        return [*texts, *self.failed]


class FileHistory:
    """The steps of a session that have changed files, in their order. Those that are undone stay until the next one."""

    def __init__(self):
        self._steps: list[Step] = []
        self._done = 0
        """The number of steps that are not undone."""
        self._saved = 0
        """The number of steps whose files stay, whether they are undone or not."""
        self._begun: dict[Path, tuple[Content, Sequence[Path]]] | None = None
        """Of the step that is going on, the files before it, and the folders that were made for them."""
        self._places: dict[Path, Place] = {}
        self._folder: tempfile.TemporaryDirectory | None = None
        self._number = 0
        self._goal = 0
        """The number of steps that will not be undone: what is kept beside them goes last."""

    @property
    def is_empty(self) -> bool:
        """Whether no step has changed a file."""
        return not self._steps

    @property
    def has_begun(self) -> bool:
        """Whether a step is going on."""
        return self._begun is not None

    def begin(self, folder: str, most: int) -> None:
        """Begin a step. folder: in which the private one is made if there is none. most: the steps that can be undone."""
        forgotten = max(0, self._done + 1 - most)
        del self._steps[:forgotten]
        self._done -= forgotten
        self._saved = max(0, self._saved - forgotten)
        if self._folder is None or not os.path.isdir(self._folder.name):
            with suppress(OSError):
                self._folder = tempfile.TemporaryDirectory(prefix="imprint-", dir=folder, ignore_cleanup_errors=True)
        self._begun, self._goal = {}, self._done
        atomic_file.before_replacing = self._note

    def end(self, name: str) -> bool:
        """End the step. Returns whether it has changed files; then its name stands for the files as they are now."""
        begun, self._begun = self._begun or {}, None
        atomic_file.before_replacing = None
        changes = {}
        for path, (before, folders) in begun.items():
            stamp = stamp_of(path)
            if stamp != before.stamp:
                after = Content(stamp)
                changes[path] = Change(before, after, folders)
                self._places[path] = Place(after, after)
        if changes:
            self._steps[self._done :] = [Step(name, changes)]
            self._saved = min(self._saved, self._done)
            self._done += 1
        self._forget_unused()
        return bool(changes)

    def save(self) -> None:
        """Let the files stay as they are, since the .blend that shows them is saved: Undo goes no further back."""
        self._saved = max(self._saved, self._done)
        self._forget_unused()

    def go_to(self, names: Collection[str]) -> Moved:
        """Bring all files to where they were after the last step of these names, or before the first one; not to before the
        last save."""
        self._goal = max((number for number, step in enumerate(self._steps, 1) if step.name in names), default=0)
        moved = Moved()
        while self._done != self._goal:
            is_undo = self._done > self._goal
            number = self._done - is_undo
            if number >= self._saved:
                self._pass(self._steps[number], moved, is_undo=is_undo)
            elif is_undo:
                changes = self._steps[number].changes.items()
                moved.saved += [path for path, change in changes if stamp_of(path) != change.before.stamp]
            self._done += -1 if is_undo else 1
        return moved

    def forget(self) -> None:
        """Keep nothing."""
        self._steps.clear()
        self._places.clear()
        self._done, self._saved, self._begun, atomic_file.before_replacing = 0, 0, None, None
        if self._folder is not None:
            self._folder.cleanup()
            self._folder = None

    def _note(self, path: Path, folders: Sequence[Path]) -> None:
        """Keep what is at `path`, which is about to be replaced."""
        if path not in self._begun:
            stamp, place = stamp_of(path), self._places.get(path)
            content = place.left if place is not None and place.left.stamp == stamp else Content(stamp)
            self._begun[path] = content, folders
            self._keep(path, content)

    def _pass(self, step: Step, moved: Moved, *, is_undo: bool) -> None:
        """Bring the files of a step to where they were before or after it."""
        changes = list(step.changes.items())
        for path, change in reversed(changes) if is_undo else changes:  # a folder is empty after its first file
            before, after = (change.after, change.before) if is_undo else (change.before, change.after)
            try:
                self._bring(path, before, after, change.folders, moved)
            except OSError as error:
                self._places[path] = Place(after, self._places[path].left)
                moved.failed.append(NOT_WRITTEN.format(repr(path.name), reason(error)))

    def _bring(self, path: Path, before: Content, after: Content, folders: Sequence[Path], moved: Moved) -> None:
        """Bring a file from one content to another one. Raises OSError, and then it has not changed."""
        stamp, place = stamp_of(path), self._places[path]
        if stamp == after.stamp:
            self._places[path] = Place(after, after)
        elif place.content is not before or place.left.stamp != stamp:
            moved.changed.append(path)
        elif after.stamp is not None and not after.is_kept:
            self._places[path] = Place(after, place.left)
            moved.not_kept.append(path)
        else:
            self._keep(path, place.left, after)
            if after.stamp is None:
                path.unlink()
                _remove_empty(folders)
            else:
                atomic_file.make_folder(path.parent)
                _put(after, path)
            self._places[path] = Place(after, after)
            moved.paths.add(path)

    def _keep(self, path: Path, content: Content, spared: Content | None = None) -> None:
        """Keep what is at `path`, if there is room for it beside `spared`. Nothing is kept of what the system refuses."""
        if content.stamp is None or content.is_kept or self._folder is None:
            return
        self._number += 1
        kept = Path(self._folder.name, str(self._number))
        try:
            if not self._make_room(content.stamp.size, MOST_KEPT, spared):
                return
            try:
                os.link(path, kept)
                content.is_copy = False
            except OSError:  # another file system, or one without links
                if not self._make_room(content.stamp.size, MOST_COPIED, spared, are_copies=True):
                    return
                content.is_copy = True
                shutil.copy2(path, kept)
            content.kept, content.kept_stamp = kept, stamp_of(kept)
        except OSError:  # as on a full disk
            with suppress(OSError):
                kept.unlink()

    def _make_room(self, size: int, most: int, spared: Content | None, *, are_copies: bool = False) -> bool:
        """Forget other contents, or other copies, until `size` bytes more are within the limit. Returns whether they are.

        spared: what is brought back now. Raises OSError.
        """
        most = min(most, shutil.disk_usage(self._folder.name).free)
        if size > most:
            return False
        kept = [
            each for each in self._contents() if each.kept and each is not spared and (each.is_copy or not are_copies)
        ]
        taken = sum(content.kept_stamp.size for content in kept)
        for content in kept:
            if taken + size <= most:
                break
            taken -= content.kept_stamp.size
            content.forget()
        return True

    def _contents(self) -> list[Content]:
        """The contents of all steps, the farthest from where Undo is or goes first, then those of the step that goes on."""
        numbers = sorted(range(self._saved, len(self._steps)), key=lambda number: -abs(number + 0.5 - self._goal))
        changes = (change for number in numbers for change in self._steps[number].changes.values())
        begun = [content for content, _ in (self._begun or {}).values()]
        return list(dict.fromkeys([*(content for change in changes for content in change[:2]), *begun]))

    def _forget_unused(self) -> None:
        """Remove what no step needs: that of steps that cannot be redone, were saved, or have ended without a change."""
        if self._folder is None:
            return
        used = {content.kept.name for content in self._contents() if content.kept}
        with suppress(OSError):
            for name in set(os.listdir(self._folder.name)) - used:
                Path(self._folder.name, name).unlink()


def _put(content: Content, path: Path) -> None:
    """Give a file a content that is kept, in one step of the file system. Raises OSError."""
    if content.is_copy:
        copy = atomic_file.TemporaryPath(path)
        try:
            shutil.copy2(content.kept, copy.path)
            os.replace(copy.path, path)
        finally:
            copy.remove()
        content.stamp = stamp_of(path)  # file systems round times
    else:
        os.replace(content.kept, path)
        content.kept = None


def _remove_empty(folders: Sequence[Path]) -> None:
    """Remove folders, the innermost first, as far as they are empty."""
    with suppress(OSError):
        for folder in folders:
            folder.rmdir()
