# SPDX-License-Identifier: GPL-3.0-or-later
"""Bakes one job for each frame of an animation, and puts the image sequence into the low object's materials."""

import re
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import PurePath

import bpy

from ..core.declarations.choices import Storage
from ..core.errors import BakeError
from ..core.progress import Pace, Progress, Task, part, relay
from ..core.report import Report
from ..core.settings import Settings
from ..output import datablocks, map_names, materials, outputs, shared_maps
from ..output.map_names import of_frame, output_of_frame, settings_by_map, with_low_name
from ..scene.object_checks import scene_by_uid
from . import bake_jobs, shared_image
from .job import NOTHING_ELSE, Job, Wants, check_file_clashes, covers_detail, files_kept

FRAME_IMAGE = "Imprint frame"
"""The image that shows each frame while the sequence is baked."""


def work_on_frames(
    context: bpy.types.Context,
    job: Job,
    settings: Settings,
    frames: Sequence[int],
    pace: Pace,
    *,
    wants: Wants = NOTHING_ELSE,
) -> Task[list[Report]]:
    """Bake each of `frames`, and put the image sequence into the low object's materials. A generator, as `bake_jobs.work`.

    If it is closed early, finished frames stay. A step with its report follows each. Raises BakeError.
    """
    _check_frames(settings, frames)
    settings = bake_jobs.beside_materials(settings, job)
    scene, before = context.scene.session_uid, context.scene.frame_current_final
    low = job.low.name
    settings = with_low_name(settings, low).stored(image=map_names.name_for(low, settings.storing))
    frame_base = settings.without_materials().stored(image=FRAME_IMAGE)
    image = datablocks.get(settings.storing.image)
    if reason := covers_detail(job.low, job.highs, [settings.storing.image]):
        raise BakeError(reason)
    if image is not None and image.source not in {"GENERATED", "FILE", "SEQUENCE"}:
        raise BakeError(f"The image {image.name!r} is not a picture or sequence: choose another name for the map.")
    only_normal = settings.without_other_maps().without_file()  # other maps of frames are only files
    shared_image.check_alone(context, job, only_normal, "the sequence")
    if settings.storing.material:
        materials.check(job.low)  # the bakes of frames do not change it
    frame_settings = [of_frame(frame_base, frame) for frame in frames]
    advice = "put the frame number into the name with #"
    check_file_clashes(frame_settings, [low] * len(frames), advice, files_kept([job], settings.storing))
    reports: list[Report] = []

    def noted(frame: float, number: int, step: Progress) -> Progress:
        report = step.report and replace(step.report, image=settings.storing.image)
        reports.extend([report] if report else [])
        return replace(step, what=f"Frame {frame}: {step.what}", finished=number + step.finished, report=report)

    try:
        for number, frame in enumerate(frames):
            _go_to(scene, frame)
            steps = part(
                bake_jobs.work(context, [job], frame_settings[number], pace, wants=wants),
                number / len(frames),
                (number + 1) / len(frames),
            )
            yield from relay(steps, partial(noted, frame, number))
        yield Progress("Storing", 1.0, finished=len(frames))
    finally:
        if scene_by_uid(scene) is not None:
            _go_to(scene, before)
        for map_settings in settings_by_map(frame_base).values():
            image = datablocks.get(map_settings.storing.image)
            if image is not None:
                bpy.data.images.remove(image)
        if reports:
            reports = _show_frames(job, settings, frames, reports)
    return reports


def _go_to(uid: int, frame: float) -> None:
    scene = scene_by_uid(uid)
    if scene is None:
        raise BakeError("The scene of the sequence was deleted: bring it back with Undo, or choose another one.")
    scene.frame_set(int(frame), subframe=frame - int(frame))


def _check_frames(settings: Settings, frames: Sequence[int]) -> None:
    """Raise BakeError for what cannot be a sequence."""
    if settings.storing.storage != Storage.FILE:
        raise BakeError("A sequence needs files: set Store to File.")
    if settings.storing.has_open_ending:
        raise BakeError("A sequence has files of one format: give the file an ending.")
    if not settings.map.normal:
        raise BakeError("A sequence shows the normal map: switch Normal Map on.")
    if settings.sampling.udim:
        raise BakeError("A sequence has only one tile: turn UDIM Tiles off.")
    if settings.map.texture_sets:
        raise BakeError("A sequence has one image for all materials: turn Texture Sets off.")
    if settings.storing.one_material:
        raise BakeError("A sequence stays beside the materials: turn One Material off.")
    if any(frame < 0 for frame in frames):
        raise BakeError("A sequence cannot have frames below 0: Blender would not find their files.")
    if re.search(r"#[^#]*\d", PurePath(settings.storing.output).stem):
        raise BakeError(
            f"{settings.storing.output!r} has a number after the frame number, and Blender would read it as the frame: "
            "put it before."
        )
    if not frames:
        raise BakeError("There is no frame to bake: set the end frame to the start frame or later.")


def _show_frames(job: Job, settings: Settings, frames: Sequence[int], reports: Sequence[Report]) -> list[Report]:
    """Make the image a sequence of the finished frames, also if the low object was deleted.

    Returns the reports of these frames with that image.
    """
    image = datablocks.show(settings.storing.image, output_of_frame(settings.storing.output, frames[0]))
    image.source = "SEQUENCE"
    shared_maps.note(image, [])
    first, *others = reports
    done = [first.with_warnings(outputs.sign(image, [ref.name for ref in job.high_refs])), *others]
    low = job.low_ref.find()
    if low is not None:
        datablocks.note_maps(low, [image])
    if low is None or not settings.storing.material:
        return done
    is_own_base = low in job.highs
    notes = materials.show_normal_map(low, image, done[-1].uv_layer, settings, is_own_base=is_own_base)
    done[-1] = done[-1].with_warnings(notes)
    for material in materials.of(low, is_own_base=is_own_base):
        for node in material.node_tree.nodes:
            if node.bl_idname == "ShaderNodeTexImage" and node.image == image:
                user = node.image_user
                user.frame_start, user.frame_duration = frames[0], len(reports)
                user.frame_offset, user.use_auto_refresh = frames[0] - 1, True
    return done
