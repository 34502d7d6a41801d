# SPDX-License-Identifier: GPL-3.0-or-later
"""The queue: sets that a process of their own bakes from a copy of the file, while the window stays free.

Each press saves a copy, which has the file as it is then. The process, see queue_process, bakes its sets one after the other.
What it makes arrives when a part is done: the window moves files to their places, and does what else a bake does to its file,
see output.journal. What is newer there than the copy stays, and the set has a sentence that says so. Results are no steps of
Undo: they are put back after it.

    bake_queue.state_of(scene, "Crate")     # an Item, or None for a set that is not in the queue
    bake_queue.draw(layout, context)        # nothing while the queue is empty
"""

import json
import math
import os
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, field, fields, replace
from enum import StrEnum
from pathlib import Path
from queue import Empty, SimpleQueue
from typing import Any

import bpy
import numpy as np
from bpy.props import BoolProperty, StringProperty

from ..core import foreach
from ..core.errors import BakeError, reason, shorten_list
from ..core.processes import CONNECTION, ENDING, Gone, Process, crash_output, in_blender
from ..core.report import Report
from ..jobs.state_pieces import State
from ..output import atomic_file, datablocks, journal, shared_maps
from ..output.atomic_file import TemporaryPath
from ..scene import object_checks
from ..scene.object_checks import ObjectRef
from . import results
from .callbacks import Timer, events, redraw, registering
from .held_maps import held
from .live import live
from .modal import QuickOperator
from .progress_display import display
from .queue_process import Setup
from .texts import draw_paragraphs, label, labeled, message, tooltip

ROOT = Path(__file__).resolve().parents[2]
PROGRAM = (
    "import sys; sys.path.insert(0, {!r}); import addon; addon.register(); from addon.ui import queue_process; "
    "queue_process.run()"
)
"""What the process does. Imprint is enabled in no other way there."""
LOOK_EVERY = 0.1
"""Seconds between two looks at the process."""
MOST_AT_ONCE = 0.01
"""Seconds after which what has arrived goes into the file at the next look."""
LONGEST_CANCEL = 3.0
"""Seconds for a set that was canceled to end, before its process is killed."""
LONGEST_END = 2.0
"""Seconds for a process to end that has closed its connection."""
MOST_KEPT = 1 << 30
"""The most bytes of packed maps that are kept to put them back after Undo."""
MOST_SHOWN = 3
"""The most sets that wait in the panel."""
STROKES = ("SCULPT_OT", "PAINT_OT", "TRANSFORM_OT", "GREASE_PENCIL_OT", "MESH_OT", "CURVES_OT", "SCULPT_CURVES_OT")
"""Modal operators of Blender, during which nothing changes their object."""


class Stage(StrEnum):
    """Of a set in the queue."""

    WAITING = "WAITING"
    BAKING = "BAKING"
    DONE = "DONE"
    FAILED = "FAILED"
    CANCELED = "CANCELED"


ICONS = {
    Stage.WAITING: "TIME",
    Stage.BAKING: "RENDER_STILL",
    Stage.DONE: "CHECKMARK",
    Stage.FAILED: "ERROR",
    Stage.CANCELED: "X",
}


@dataclass(eq=False)
class Item:
    """A set in the queue.

    Attributes:
        name: Of the set, when it was added.
        scene_uid: The session_uid of its scene.
    """

    name: str
    scene_uid: int
    run: "Run"
    changed: bool = False
    """Whether only parts are baked whose maps are not those of the file."""
    state: Stage = Stage.WAITING
    done: float = 0.0
    """The finished share, from 0 to 1."""
    sentence: str = ""
    """What went wrong, or which parts were left out."""

    @property
    def is_open(self) -> bool:
        """Whether it waits or is baked."""
        return self.state in {Stage.WAITING, Stage.BAKING}

    @property
    def text(self) -> str:
        """The state in words, in the language of the interface."""
        match self.state:
            case Stage.WAITING:
                return label("Paused") if queue.is_paused else label("Waiting")
            case Stage.BAKING:
                text = message("Paused at {} %") if queue.is_paused else message("Baking {} %")
                return text.format(int(100 * self.done))
            case Stage.DONE:
                return self.sentence or label("Done")
            case Stage.CANCELED:
                return label("Canceled")
        return self.sentence


@dataclass(eq=False)
class Run:
    """The sets of one press, and the copy of the file that they are baked from.

    Attributes:
        folder: For large data that the process writes for the window.
        copy: The copy of the file, if it lies beside it; else it is in the folder.
        refs: The objects of the file, by name and library.
        images: What each image was then, or is since this queue has filled it, by name, see `_token`.
        baked: When each low object was baked, in the window by then or by this queue, by its session_uid.
        slots: The material in each slot of low objects, as `_slots` returns it, by their session_uid.
        pressed: Nanoseconds, by time.time_ns.
    """

    setup: Setup
    folder: tempfile.TemporaryDirectory
    copy: TemporaryPath | None
    refs: dict[tuple[str, str], ObjectRef]
    images: dict[str, tuple]
    baked: dict[int, str]
    slots: dict[int, list[int]]
    pressed: int
    filled: set[str] = field(default_factory=set)
    """The images that this queue has filled since the copy was saved."""
    put_for: dict[tuple[int, int], set[int]] = field(default_factory=dict)
    """The materials that this queue has put in place of others, copies of them and new ones for empty slots. The keys: the
    low object for an empty slot, else 0; and what was in the slot. All are session_uids."""

    def same(self, low: bpy.types.Object, material: int) -> set[int]:
        """A material of a slot of a low object, and those that this queue has put in its place."""
        return {material} | self.put_for.get((0 if material else low.session_uid, material), set())

    def close(self) -> None:
        """Remove the copy, and what the process wrote for the window."""
        if self.copy is not None:
            self.copy.remove()
        self.folder.cleanup()

    def find(self, name: str, library: str) -> bpy.types.Object | None:
        """The object that had this name when the copy was made."""
        ref = self.refs.get((name, library))
        obj = ref.find() if ref is not None else None
        return None if obj is None or object_checks.is_deleted(obj) else obj


@dataclass(eq=False)
class Made:
    """What the process has made, and waits to see in the file.

    Attributes:
        calls: Of a journal.
        reports: The reports of the bakes, and the names and libraries of their objects.
    """

    calls: list[list]
    reports: list[dict]
    run: Run
    since: float
    """When it came, by time.monotonic."""
    baked: str = ""
    """When its low objects count as baked, once it is in the file."""
    slots: dict[int, list[int]] = field(default_factory=dict)
    """As in Run, before it is put into the file."""

    @property
    def size(self) -> int:
        """The bytes of its packed maps."""
        paths = [arguments[1] for name, arguments, _ in self.calls if name == journal.PACKED]
        return sum(os.path.getsize(path) for path in paths if os.path.exists(path))


class BakeProcess(Process):
    """The process that bakes."""

    def __init__(self, messages: SimpleQueue, run: Run):
        self.run, self.gone_at = run, 0.0
        self.done: float = 0.0
        """The finished share of its set."""
        self.has_opened = False
        """Whether it has opened its copy."""
        self.lacks = frozenset(run.filled)
        """The images that its copy has as they were before this queue filled them."""
        self.folders: list[str] = []
        """In which it has, or had, temporary files. All of them are here once it is closed."""
        super().__init__(messages)

    def _command(self, number: int) -> tuple[Sequence[str], dict[str, str]]:
        binary = "" if bpy.app.module else bpy.app.binary_path
        return in_blender(binary, PROGRAM.format(str(ROOT))), dict(os.environ, **{CONNECTION: str(number)})

    def _popen(self, words: Sequence[str], **given: Any) -> Any:
        return super()._popen(words, process_group=0, **given)  # Ctrl-C in a terminal is for the window

    def _next(self) -> Any:
        received = self._connection.recv()
        while received[0] in {"share", "folder"}:  # nothing answers these, so that they cost the process no time
            if received[0] == "share":
                self.done = received[1]
            else:
                self.folders.append(received[1])
            received = self._connection.recv()
        return received


class Queue:
    """All sets that were added since the file was opened."""

    def __init__(self):
        self.items: list[Item] = []
        self.is_paused = False
        self.longest = 0.0
        """The longest time in seconds that the window waited for the queue, but for saving the copies."""
        self.saving = 0.0
        """The seconds of saving the last copy."""
        self._process: BakeProcess | None = None
        self._leaving: list[tuple[BakeProcess, float]] = []
        """Processes that are done, and until when they may take to end, by time.monotonic."""
        self._messages: SimpleQueue = SimpleQueue()
        self._made: Made | None = None
        """What waits until the file may be changed."""
        self._runs: list[Run] = []
        self._putting: Iterator[None] | None = None
        """The steps that put it there, once they have begun."""
        self._taken: list[Made] = []
        """What has arrived, to put it back after Undo."""
        self._written: dict[str, tuple] = {}
        """The files that were moved to their places, as they are since then."""
        self._cancel_by = 0.0
        self._drawn: list[tuple] = []
        self.timer = Timer(self.tick)
        events.hear(end=self.end, undo_post=self._after_undo, redo_post=self._after_undo, save_pre=self._before_saving)

    # What the window asks for

    def add(self, context: bpy.types.Context, names: Sequence[str], *, changed: bool = False) -> None:
        """Add sets of the context's scene, as they are now. Those that are in the queue are baked anew. Raises BakeError.

        changed: only parts whose maps are not those of the file.
        """
        start = time.perf_counter()
        run = _save(context)
        self.saving = time.perf_counter() - start
        for name in names:
            self.cancel(context.scene, name)
        self._runs.append(run)
        self.is_paused &= any(each.is_open for each in self.items)
        uid = context.scene.session_uid
        self.items = [each for each in self.items if each.is_open or each.scene_uid != uid or each.name not in names]
        self.items += [Item(name, uid, run, changed) for name in names]
        self.timer.start()

    def pause(self, *, is_paused: bool) -> None:
        """Let the process wait, or go on."""
        self.is_paused = is_paused
        if self._process is not None:
            self._process.tell("pause" if is_paused else "go")
        self.timer.start()

    def cancel(self, scene: bpy.types.Scene, name: str = "") -> None:
        """Cancel a set, or all of them and forget them. Maps that have arrived stay."""
        for item in self.items:
            if item.is_open and item.scene_uid == scene.session_uid and name in {"", item.name}:
                if item.state is Stage.BAKING and self._process is not None:
                    self._process.tell("cancel")
                    self._cancel_by = time.monotonic() + LONGEST_CANCEL
                item.state = Stage.CANCELED
        if not name:
            self.items = [each for each in self.items if each.is_open]
        self.timer.start()

    def end(self) -> None:
        """End the process, and forget all: the file is closed."""
        self.timer.stop()
        self._stop()
        while self._leaving:
            self._leaving.pop()[0].close(0.0)
        while self._runs:
            self._runs.pop().close()
        self.items, self._taken, self.is_paused, self._written = [], [], False, {}

    def state_of(self, scene: bpy.types.Scene, name: str) -> Item | None:
        """The set in the queue; None if it is not there."""
        found = [each for each in self.items if each.name == name and each.scene_uid == scene.session_uid]
        return found[-1] if found else None

    # What the timer does

    def tick(self) -> float | None:
        """Take what the process has sent, without waiting for it. Returns the seconds until the next look."""
        start = time.perf_counter()
        self._look()
        self.longest = max(self.longest, time.perf_counter() - start)
        drawn = [(each.state, int(100 * each.done), each.sentence) for each in self.items]
        if drawn != self._drawn:
            self._drawn = drawn
            redraw("VIEW_3D", region="UI")
        is_busy = self._process is not None or self._leaving or any(each.is_open for each in self.items)
        return LOOK_EVERY if is_busy else None

    def _look(self) -> None:
        if self._putting is not None:
            self._go_on()
        elif self._made is not None:
            self._arrive()
        with suppress(Empty):
            while self._made is None:
                process, received = self._messages.get_nowait()
                if process is self._process:
                    self._handle(received)
        self._check()
        if self._process is None and not self.is_paused:
            self._start()

    def _handle(self, received: Any) -> None:
        process = self._process
        match received:
            case ["ready"]:
                process.answer(asdict(process.run.setup))
            case ["opened"]:
                process.has_opened = True
                self._next_set()
            case ["made", calls, reports]:
                self._made = Made(calls, reports, process.run, time.monotonic())
                self._arrive()
            case ["ended", ended, why, left_out, calls]:
                with suppress(BakeError):  # an object is gone
                    _exhaust(journal.replay(calls, process.run.find))
                self._ended(ended, why, left_out)
            case Gone():
                process.gone_at = time.monotonic()

    def _baking(self) -> list[Item]:
        return [each for each in self.items if each.state is Stage.BAKING]

    def _waiting(self) -> list[Item]:
        return [each for each in self.items if each.state is Stage.WAITING]

    def _next_set(self) -> None:
        """Answer the process with its next set, or let it end."""
        process = self._process
        mine = [each for each in self._waiting() if each.run is process.run]
        if mine:
            mine[0].state, process.done = Stage.BAKING, 0.0
            process.answer(["set", mine[0].name, mine[0].changed])
        else:
            self._dismiss()

    def _ended(self, ended: str, why: str, left_out: Sequence[Sequence[str]]) -> None:
        """A set has ended."""
        self._cancel_by = 0.0
        for item in self._baking():
            item.state = Stage.DONE if ended == "DONE" else Stage.FAILED
            item.done, item.sentence = 1.0, why or _left_out(left_out)
        if ended == "NOT_TAKEN":  # its copy has what the file has not
            self._dismiss()
        else:
            self._next_set()

    def _check(self) -> None:
        """Look whether the process has ended, or should have."""
        process, now = self._process, time.monotonic()
        for item in self._baking() if process is not None else ():
            item.done = process.done
        for each, until in tuple(self._leaving):
            if each.has_ended or now > until:
                self._leaving.remove((each, until))
                each.close(0.0)
        if process is None or self._putting is not None:  # no file has half of what was made
            return
        if self._cancel_by and now > self._cancel_by:
            self._cancel_by = 0.0
            self._stop()
        elif process.has_ended or (process.gone_at and now > process.gone_at + LONGEST_END):
            self._crashed(process)

    def _crashed(self, process: BakeProcess) -> None:
        ending, where = process.end(0.0), crash_output(process.last_printed())
        why = "Memory ran out, and the system ended the bake." if ending.lacked_memory else ""
        if process.has_opened:
            lost = self._baking()
            why = why or f"Blender crashed with {ending.text}{where}."
        else:
            lost = [each for each in self._waiting() if each.run is process.run]
            why = why or f"The process to bake in does not start: {ending.text}{where}."
        for item in lost:
            item.state, item.sentence = Stage.FAILED, why
        self._stop()

    def _start(self) -> None:
        """Start a process for the next set that waits."""
        waiting = self._waiting()
        self._close_runs()
        if not waiting:
            return
        try:
            self._process = BakeProcess(self._messages, waiting[0].run)
        except OSError as error:
            for item in waiting:
                item.state = Stage.FAILED
                item.sentence = f"A process to bake in could not be started: {reason(error)}."

    def _dismiss(self) -> None:
        """Let the process end, which has left nothing."""
        process, self._process = self._process, None
        process.dismiss()
        self._leaving.append((process, time.monotonic() + ENDING))

    def _stop(self) -> None:
        """End the process at once, and remove what it leaves."""
        process, self._process, self._cancel_by = self._process, None, 0.0
        self._made = self._putting = None
        if process is None:
            return
        process.close(0.0)
        for folder in process.folders:
            atomic_file.sweep(Path(folder))

    def _close_runs(self) -> None:
        """Remove the copies that no set needs any more."""
        open_runs = {each.run for each in self.items if each.is_open}
        kept = {each.run for each in self._taken}
        for run in [each for each in self._runs if each not in open_runs]:
            if run.copy is not None:
                run.copy.remove()
            if run not in kept:
                run.close()
                self._runs.remove(run)

    # What arrives

    def _arrive(self) -> None:
        """Put what was made into the file, as soon as it may be changed, unless its set was canceled."""
        made = self._made
        if not self._baking():
            self._arrived("The set was canceled.")
            return
        if _must_wait(made):
            return
        problem = self._newer(made)
        if problem:
            self._arrived(problem)
        else:
            self._putting = _put(made)
            self._go_on()

    def _go_on(self, most: float = MOST_AT_ONCE) -> None:
        """Put more of what was made into the file. most: seconds after which no more is begun."""
        end = time.perf_counter() + most
        try:
            for _ in self._putting:
                if time.perf_counter() > end:
                    return
        except BakeError as error:
            self._arrived(str(error))
        else:
            self._note(self._made)
            self._arrived("")

    def _arrived(self, problem: str) -> None:
        """What was made is in the file, or not, for a reason in a sentence."""
        self._made = self._putting = None
        self._process.answer({"problem": problem})

    def _before_saving(self, *_) -> None:
        """No file has half of what was made."""
        if self._putting is not None:
            self._go_on(math.inf)

    def _newer(self, made: Made) -> str:
        """Why what was made would replace something newer, in a sentence; empty if it would not."""
        run = made.run
        gone = [name for name, library in journal.objects_of(made.calls) if run.find(name, library) is None]
        if gone or None in _lows(made):
            return "A low object was deleted during the bake, so its maps were left out."
        for low in _lows(made):
            if _baked(low) > run.baked.get(low.session_uid, ""):
                return f"{low.name!r} was baked again meanwhile: these newer maps stay."
            if any(not _moved_slots(made, own, options["slots"]) for own, options in _slotted(made) if own == low):
                return f"The materials of {low.name!r} were changed meanwhile, so its maps were left out: add the set again."
        for name in journal.images_of(made.calls):
            image = datablocks.get(name)
            if image is not None and not _is_same(image, run.images.get(name)):
                return f"The image {name!r} was changed meanwhile, and stays: add the set again."
            others = {part.name for part in shared_maps.parts_of_image(name)} - {low.name for low in _lows(made)}
            if others and name in self._process.lacks:
                got = shorten_list(map(repr, sorted(others)))
                return f"The image {name!r} was baked for {got} meanwhile, and stays: add the set again."
        for path in journal.files_of(made.calls):
            stamp = _stamp(path)
            if stamp and stamp != self._written.get(path) and max(stamp[:2]) > run.pressed:
                return f"The file {path!r} was changed meanwhile, and stays: add the set again."
        return ""

    def _know(self, made: Made) -> None:
        """Note what the file has since something was put into it: for no press is that newer than its copy."""
        baked = {low.session_uid: _baked(low) for low in filter(None, _lows(made))}
        images = {name: _token(datablocks.get(name)) for name in journal.images_of(made.calls)}
        put = _put_for(made)
        for run in self._runs:
            for key, materials in put.items():
                run.put_for.setdefault(key, set()).update(materials)
            run.baked.update(baked)
            run.images.update(images)
            run.filled.update(images)

    def _note(self, made: Made) -> None:
        """Note what was put into the file."""
        made.baked = max(map(_baked, filter(None, _lows(made))), default="")
        self._know(made)
        for path in journal.files_of(made.calls):
            self._written[path] = _stamp(path)
        self._taken.append(made)
        while len(self._taken) > 1 and sum(each.size for each in self._taken) > MOST_KEPT:
            del self._taken[0]

    def _has_files(self, made: Made) -> bool:
        """Whether files that were moved to their places are still there. Undo of a later bake moves them, which changes one
        of their times."""
        return all(_stamp(path)[::2] == self._written.get(path, ())[::2] for path in journal.files_of(made.calls))

    def _after_undo(self, *_) -> None:
        """Put back what Undo took: the window did it in no step."""
        if self._putting is not None:
            self._putting = _put(self._made, again=True)
        for made in [
            made for made in self._taken if _is_lost(made) and self._has_files(made)
        ]:  # putting one back makes its low objects newer
            with suppress(BakeError):
                _exhaust(_put(made, again=True))
            self._know(made)


queue = Queue()
state_of = queue.state_of


def _left_out(left_out: Sequence[Sequence[str]]) -> str:
    return " ".join(why for _, why in left_out[:1]) + (f" And {len(left_out) - 1} more." if left_out[1:] else "")


# A copy of the file


def _save(context: bpy.types.Context) -> Run:
    """Save a copy of the file as it is, also of images that are not saved. Raises BakeError."""
    folder = tempfile.TemporaryDirectory(prefix="imprint-queue-")
    file = bpy.data.filepath
    copy: TemporaryPath | None = TemporaryPath(Path(file)) if file else None
    try:
        path = copy.path
    except (OSError, AttributeError):  # none can be written beside it, or it was never saved
        copy, path = None, Path(folder.name, "scene.blend")
    try:
        with held.left_alone():
            bpy.ops.wm.save_as_mainfile(
                filepath=str(path), copy=True, compress=False, relative_remap=copy is None, check_existing=False
            )
        images = dict(_unsaved(Path(folder.name)))
    except (OSError, RuntimeError) as error:
        if copy is not None:
            copy.remove()
        folder.cleanup()
        raise BakeError(f"A copy of the file to bake from could not be written: {reason(error)}.") from error
    setup = Setup(
        str(path),
        copy is not None,
        file,
        folder.name,
        context.scene.name,
        context.view_layer.name,
        images,
        _addons(),
        not bpy.app.autoexec_fail,
    )
    refs = {(obj.name, _library(obj)): ObjectRef.of(obj) for obj in bpy.data.objects}
    tokens = {image.name: _token(image) for image in bpy.data.images if image.library is None}
    meshes = [obj for obj in bpy.data.objects if obj.type == "MESH"]
    baked = {obj.session_uid: _baked(obj) for obj in meshes}
    slots = {obj.session_uid: _slots(obj) for obj in meshes}
    return Run(setup, folder, copy, refs, tokens, baked, slots, time.time_ns())


def _unsaved(folder: Path) -> Iterator[tuple[str, str]]:
    """Write the pixels of images that are not saved. The name of each, and its file."""
    for number, image in enumerate(_in_memory()):
        texels, path = foreach.pixels(image), folder / f"image{number}.npy"
        np.save(path, texels if image.is_float else np.rint(texels * np.float32(255.0)).astype(np.uint8))
        yield image.name, str(path)


def _in_memory() -> list[bpy.types.Image]:
    """The images that are not saved and that a copy of the file lacks."""
    return [
        image
        for image in bpy.data.images
        if image.is_dirty and image.source in {"GENERATED", "FILE"} and image.type in {"IMAGE", "UV_TEST"}
        if image.library is None
    ]


def _addons() -> list[str]:
    """The user's add-ons whose functions drivers or events of the file call."""
    handlers = [bpy.app.handlers.frame_change_pre, bpy.app.handlers.frame_change_post]
    handlers += [bpy.app.handlers.depsgraph_update_pre, bpy.app.handlers.depsgraph_update_post]
    functions = [*bpy.app.driver_namespace.values(), *(each for functions in handlers for each in functions)]
    modules = {getattr(each, "__module__", None) or "" for each in functions}
    own = __package__.rpartition(".addon")[0]
    return [
        name
        for name in bpy.context.preferences.addons.keys()  # noqa: SIM118
        if name != own and any(f"{module}.".startswith(f"{name}.") for module in modules)
    ]


def _library(obj: bpy.types.Object) -> str:
    return bpy.path.abspath(obj.library.filepath) if obj.library else ""


def _baked(low: bpy.types.Object) -> str:
    return low.imprint.baked if low.is_property_set("imprint") else ""


def _slots(low: bpy.types.Object) -> list[int]:
    """The session_uid of the material in each slot; 0 for an empty one."""
    return [slot.material.session_uid if slot.material else 0 for slot in low.material_slots]


def _token(image: bpy.types.Image) -> tuple:
    """What tells whether an image was changed. What is painted on pixels that no file has is told by these."""
    packed = sum(each.packed_file.size for each in image.packed_files)
    texels = _hash(image) if image.is_dirty and image in _in_memory() else 0
    return image.session_uid, image.source, image.filepath, image.is_dirty, packed, texels


def _is_same(image: bpy.types.Image, token: tuple | None) -> bool:
    """Whether an image is as it was, or was saved since."""
    if token is None or token == _token(image):
        return token is not None
    return token[0] == image.session_uid and token[-1] != 0 and token[-1] == _hash(image)


def _hash(image: bpy.types.Image) -> int:
    return hash(foreach.pixels(image).tobytes())


def _stamp(path: str) -> tuple[int, ...]:
    """The times and the size of a file; none if it does not exist."""
    try:
        status = os.stat(path)
    except OSError:
        return ()
    return status.st_mtime_ns, status.st_ctime_ns if os.name != "nt" else 0, status.st_size


# What arrives


def _lows(made: Made) -> list[bpy.types.Object | None]:
    """The low objects of what was made; None for one that is gone."""
    return [made.run.find(*report["refs"][0]) for report in made.reports]


def _is_lost(made: Made) -> bool:
    """Whether Undo took what was made from the file."""
    lows = [low for low in _lows(made) if low is not None]
    return bool(lows) and all(_baked(low) < made.baked for low in lows)


def _slotted(made: Made) -> Iterator[tuple[bpy.types.Object | None, dict]]:
    """The low objects and options of calls that are about some slots of materials alone."""
    for _, arguments, options in made.calls:
        if options.get("slots"):
            yield made.run.find(arguments[0]["name"], arguments[0]["library"]), options


def _moved_slots(made: Made, low: bpy.types.Object | None, numbers: list[int]) -> list[int]:
    """Where the materials are now that slots had when the copy was saved; empty if these are in no slot any more."""
    then = made.run.slots.get(low.session_uid, []) if low is not None else []
    if not then or then == _slots(low) or max(numbers, default=0) >= len(then):  # slots beyond are those of modifiers
        return numbers
    wanted = {each for number in numbers for each in made.run.same(low, then[number])}
    return [number for number, material in enumerate(_slots(low)) if material in wanted]


def _put_for(made: Made) -> dict[tuple[int, int], set[int]]:
    """As in Run, what putting this into the file has put in place of other materials."""
    found: dict[tuple[int, int], set[int]] = {}
    for low in filter(None, _lows(made)):
        before, now = made.slots.get(low.session_uid, []), _slots(low)
        for old, new in zip(before, now, strict=False):
            if old not in now and new not in before:  # else the artist has moved them meanwhile
                found.setdefault((0 if old else low.session_uid, old), set()).add(new)
    return found


def _in_slots(made: Made) -> Made:
    """What was made, for the slots in which its materials are now."""
    moved = replace(made, calls=json.loads(json.dumps(made.calls)), reports=json.loads(json.dumps(made.reports)))
    for low, options in _slotted(moved):
        options["slots"] = _moved_slots(made, low, options["slots"])
    for low, report in zip(_lows(moved), moved.reports, strict=True):
        report["values"]["slots"] = _moved_slots(made, low, report["values"].get("slots", []))
    return moved


def _must_wait(made: Made) -> bool:
    """Whether the file may not be changed now: something else changes it, or a low object cannot take what was made."""
    if display.current is not None:
        return True
    lows = [low for low in _lows(made) if low is not None]
    if live.is_on and live.session.job.low_ref.find() in lows:
        return True
    has_values = any(name == "vertex_attributes.put_values" for name, _, _ in made.calls)
    if has_values and any(low.mode == "EDIT" for low in lows):
        return True
    return any(obj == low or obj.data == low.data for obj in _in_strokes() for low in lows)


def _in_strokes() -> Iterator[bpy.types.Object]:
    """The objects that a stroke or a drag changes now."""
    for window in bpy.context.window_manager.windows:
        active = window.view_layer.objects.active
        if active is not None and any(each.bl_idname.startswith(STROKES) for each in window.modal_operators):
            yield active


def _exhaust(steps: Iterator[None]) -> None:
    """Take all steps."""
    for _ in steps:
        pass


def _put(made: Made, *, again: bool = False) -> Iterator[None]:
    """Put what was made into the file, in steps. again: after Undo, which leaves files as they are. Raises BakeError."""
    made.slots = {low.session_uid: _slots(low) for low in _lows(made) if low is not None}
    made = _in_slots(made)
    calls = [each for each in made.calls if not again or each[0] != journal.PUT]
    yield from journal.replay(_moved(calls, made.run.setup), made.run.find)
    yield
    known = {each.name for each in fields(Report)}
    reports = []
    for plain in made.reports:
        refs = [_ref(made.run, *each) for each in plain["refs"]]
        values = {name: value for name, value in plain["values"].items() if name in known}
        reports.append(Report(**{**values, "refs": refs, "state": State.of_json(plain["state"])}))
    results.remember(reports)
    redraw()


def _ref(run: Run, name: str, library: str) -> ObjectRef:
    return run.refs.get((name, library)) or ObjectRef(object_checks.GONE, name)


def _moved(calls: list[list], setup: Setup) -> list[list]:
    """The calls, with paths that were relative to the file where it lay then, if it was saved elsewhere since."""
    start = os.path.dirname(setup.file)
    if os.path.dirname(bpy.data.filepath) == start:
        return calls
    moved = json.loads(json.dumps(calls))
    for name, arguments, _ in moved:
        if name == journal.SHOW and arguments[1].startswith("//"):
            arguments[1] = bpy.path.abspath(arguments[1], start=start)
    return moved


# The panel


def draw(layout: bpy.types.UILayout, context: bpy.types.Context) -> None:
    """Show how far the queue is with the sets of the context's scene: what is baked, what went wrong, what comes next."""
    items = [each for each in queue.items if each.scene_uid == context.scene.session_uid]
    if not items:
        return
    row = layout.row(align=True)
    counts = message("Queue: {} of {} done").format(sum(not each.is_open for each in items), len(items))
    row.label(text=counts, translate=False, icon="TIME")
    if any(each.is_open for each in items):
        row.operator("imprint.queue_pause", text="", icon="PLAY" if queue.is_paused else "PAUSE")
    row.operator("imprint.queue_cancel", text="", icon="TRASH").name = ""
    column = layout.column(align=True)
    for item in [each for each in items if each.state is not Stage.WAITING and (each.is_open or each.sentence)]:
        _draw_item(column, context, item)
    waiting = [each for each in items if each.state is Stage.WAITING]
    for item in waiting[:MOST_SHOWN]:
        _draw_item(column, context, item)
    if waiting[MOST_SHOWN:]:
        more = message("{} more").format(len(waiting) - MOST_SHOWN)
        column.label(text=more, translate=False, icon="BLANK1")


def _draw_item(layout: bpy.types.UILayout, context: bpy.types.Context, item: Item) -> None:
    line = f"{item.name}: {item.text}"
    if not item.is_open:
        draw_paragraphs(layout, context, [line], ICONS[item.state])
        return
    row = layout.row(align=True)
    row.label(text=line, translate=False, icon=ICONS[item.state])
    row.operator("imprint.queue_cancel", text="", icon="X", emboss=False).name = item.name


class IMPRINT_OT_queue_add(QuickOperator, bpy.types.Operator):
    """Bake sets in a process of their own, from a copy of the file as it is now, while the window stays free"""

    bl_idname = "imprint.queue_add"
    bl_label = "Bake in Queue"

    all: labeled(BoolProperty, "All", "All sets that are switched on, instead of the active one", options={"SKIP_SAVE"})
    name: labeled(StringProperty, "Name", "Name of the set; empty for the active one", options={"SKIP_SAVE"})
    changed: labeled(
        BoolProperty, "Changed", "Bake only parts whose maps are not those of the scene as it is", options={"SKIP_SAVE"}
    )

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        if not len(context.scene.imprint_sets):
            cls.poll_message_set(tooltip("Add a set first"))
            return False
        return display.current is None

    def apply(self, context: bpy.types.Context) -> str:
        sets = context.scene.imprint_sets
        active = sets[min(context.scene.imprint.active_set, len(sets) - 1)]
        names = [each.name for each in sets if each.is_on] if self.all else [self.name or active.name]
        unknown = [name for name in names if name not in sets]
        if unknown or not names:
            raise BakeError(f"There is no set {shorten_list(map(repr, unknown))}." if unknown else "No set is on.")
        queue.add(context, names, changed=self.changed)
        return ""


class IMPRINT_OT_queue_pause(bpy.types.Operator):
    """Let the queue wait, or go on. Memory stays in use meanwhile"""

    bl_idname = "imprint.queue_pause"
    bl_label = "Pause"

    @classmethod
    def poll(cls, _context: bpy.types.Context) -> bool:
        return any(each.is_open for each in queue.items)

    def execute(self, _context: bpy.types.Context) -> set[str]:
        queue.pause(is_paused=not queue.is_paused)
        return {"FINISHED"}


class IMPRINT_OT_queue_cancel(bpy.types.Operator):
    """Cancel this set, or all sets of the queue. Maps that have arrived stay"""

    bl_idname = "imprint.queue_cancel"
    bl_label = "Cancel"

    name: labeled(StringProperty, "Name", "Name of the set; empty for all", options={"SKIP_SAVE"})

    def execute(self, context: bpy.types.Context) -> set[str]:
        queue.cancel(context.scene, self.name)
        return {"FINISHED"}


CLASSES = (IMPRINT_OT_queue_add, IMPRINT_OT_queue_pause, IMPRINT_OT_queue_cancel)
register, unregister = registering(CLASSES)
