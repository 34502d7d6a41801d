# SPDX-License-Identifier: GPL-3.0-or-later
"""Which objects of the open scene the options of a bake name: its jobs, and what is guessed where they do not say it."""

import argparse
from collections.abc import Iterator, Sequence
from contextlib import suppress
from pathlib import PurePath

import bpy

from ..core import asset_limits, naming
from ..core.asset_limits import USUAL_MENDING
from ..core.errors import BakeError, shorten_list
from ..core.naming import Suffixes
from ..jobs.job import Job, jobs_by_name
from ..scene import object_checks
from ..scene.importing import Space
from ..scene.mesh_reader import count_triangles
from ..scene.object_checks import object_by_name
from .arguments import takes_all
from .plans import Plan
from .scene_files import SceneLoader

MOST_NAMED = 50
"""Meshes that a message names."""


def opened(options: argparse.Namespace, loader: SceneLoader) -> tuple[list[Job], list[str]]:
    """The jobs, ready in the scene, and sentences about what is wrong with names."""
    jobs, notes = _opened(options, loader)
    floaters = [object_by_name(name).session_uid for name in options.floater]
    return [job.but(floaters=floaters) for job in jobs] if floaters else jobs, notes


def _opened(options: argparse.Namespace, loader: SceneLoader) -> tuple[list[Job], list[str]]:
    if options.low_file:
        space = Space(options.origin)
        job = loader.job(options.low_file, options.high_file, options.cage_file, space, options.high_up or "")
        return [job], []
    if options.file:
        loader.open(options.file, Space(options.origin))
    elif not bpy.data.filepath:
        others = "" if options.asset else ", or mesh files with --low-file and --high-file"
        raise BakeError(f"There is no scene to bake: give a FILE{others}.")
    else:
        loader.take()
    loader.choose(options.scene)
    if options.asset:
        job = _of_asset(options)
        return [job], _kept_low(options, job)
    return _of_scene(options)


def made(options: argparse.Namespace, jobs: Sequence[Job]) -> list[Job]:
    """The jobs of an asset whose low object is still to be made: one of the high objects stands for it."""
    is_made = options.asset is not None and not options.asset.keeps
    return [job for job in jobs if is_made and job.low in job.highs]


def check_named(options: argparse.Namespace) -> None:
    """Raise BakeError, with the meshes there are, if a look at a .blend names none of them."""
    if options.asset and not options.high and any(".blend" in PurePath(name).suffix for name in options.file):
        names = sorted(obj.name for obj in bpy.context.view_layer.objects if obj.type == "MESH")
        raise BakeError(
            "Name the low mesh with --low, or high meshes alone with --high. Meshes of the file: "
            f"{shorten_list(map(repr, names), MOST_NAMED) or 'none'}."
        )


def of_rivals(plan: Plan) -> Iterator[Job]:
    """The jobs of the plan's rivals that the open scene has."""
    for options in plan.rivals:
        with suppress(BakeError):  # each says itself what it lacks
            if options.pairs or options.low:
                yield from _of_scene(options)[0]


def _of_scene(options: argparse.Namespace) -> tuple[list[Job], list[str]]:
    """The jobs of the low objects that the options name in the open scene, and sentences about names."""
    if options.pairs:
        return jobs_by_name(bpy.context, options.suffixes)
    if takes_all(options):
        lows = [obj for obj in bpy.context.view_layer.objects if obj.type == "MESH" and obj.data.polygons]
        pairs = naming.match([low.name for low in lows], options.suffixes)[0]
        return [Job(low, [low]) for low in lows], [
            f"{pair.low!r} and {shorten_list(map(repr, pair.highs))} are each baked onto itself: --low {pair.low!r} bakes the "
            "first from the others, as their names say."
            for pair in pairs
        ]
    if options.part:
        return _of_parts(options)
    lows, highs = (list(map(object_by_name, names)) for names in (options.low, options.high))
    cage = object_by_name(options.cage) if options.cage else None
    if highs or cage or options.convert or options.levels:
        return [Job(lows[0], highs or lows, cage)], []
    return _without_highs(lows, options.suffixes)


def _of_parts(options: argparse.Namespace) -> tuple[list[Job], list[str]]:
    """The jobs of parts, then those of low objects that only have a name, and sentences about names."""
    jobs = []
    for part in options.part:
        low, *highs = map(object_by_name, (part.low, *part.highs))
        cage = object_by_name(part.cage) if part.cage else None
        jobs.append(Job(low, highs or [low], cage, size=part.size, distance=part.distance, sizes=part.sizes))
    others = [object_by_name(low) for low in options.low if low not in {part.low for part in options.part}]
    more, notes = _without_highs(others, options.suffixes)
    return [*jobs, *more], notes


def only(options: argparse.Namespace, jobs: Sequence[Job]) -> frozenset[int] | None:
    """The session_uids of the low objects that are baked, where parts are switched off; None for all."""
    off = {part.low for part in options.part if not part.is_on}
    if off.issuperset(job.low.name for job in jobs):
        raise BakeError("All parts are switched off: switch on those to bake.")
    return frozenset(job.low_ref.uid for job in jobs if job.low.name not in off) if off else None


def _without_highs(lows: Sequence[bpy.types.Object], suffixes: Suffixes) -> tuple[list[Job], list[str]]:
    """The jobs of low objects whose high objects nobody names, and sentences about what was taken.

    They are the low object itself, if its modifiers add detail or it has another UV map than its materials; else those that
    are called as it is; else the low object itself.
    """
    objects = object_checks.by_name(bpy.context.view_layer.objects)
    pairs = {pair.low: pair.highs for pair in naming.match(objects, suffixes)[0]}
    jobs, notes = [], []
    for low in lows:
        called = map(objects.get, pairs.get(low.name, ()) if objects.get(low.name) == low else ())
        highs = [obj for obj in called if object_checks.may_show(obj) and not object_checks.is_line(obj)]
        own = object_checks.own_highs(low)
        jobs.append(Job(low, own or highs or [low]))
        names = shorten_list(repr(high.name) for high in highs)
        if highs and own:
            notes.append(f"{low.name!r} is baked from its own modifiers or UV maps: --high takes {names} instead.")
        elif highs:
            notes.append(
                f"{low.name!r} is baked from {names}, as its name says: --high {low.name!r} bakes it onto itself."
            )
    return jobs, notes


def _of_asset(options: argparse.Namespace) -> Job:
    """The high objects that are named, or all visible ones, with the low object that is named or belongs to them by its name.
    If there is none, one of the high objects is in its place."""
    from ..jobs import asset  # here, since a bake does not need it

    visible = [obj for obj in bpy.context.view_layer.objects if obj.type == "MESH" and obj.visible_get()]
    low = object_by_name(options.low[0]) if options.low else None
    names = (naming.made_names(obj.name, options.suffixes, asset_limits.MOST_LEVELS) for obj in visible)
    lows = {name for each in names for name in each}
    highs = [object_by_name(name) for name in options.high]
    highs = highs or [obj for obj in visible if obj != low and obj.name not in lows]
    if not highs:
        raise BakeError(
            "There is no visible mesh to make an asset of: give a FILE that has one, or name it with --high."
        )
    if options.asset.keeps:
        return Job(low or highs[0], highs)
    return Job(low or asset.known_low(bpy.context, highs, options.suffixes) or highs[0], highs)


def _kept_low(options: argparse.Namespace, job: Job) -> list[str]:
    """That a low object is there already, in a sentence, if only its name says so, or if options count for new ones alone."""
    wanted = options.asset
    if job.low in job.highs or wanted.keeps or job.low.type != "MESH":
        return []
    count = count_triangles(job.low.data)
    is_other = count != wanted.triangles if wanted.has_count else count > wanted.triangles > 0
    is_other &= wanted.is_count_given
    of_making = {"--quads": wanted.quads, "--crumbs, --holes and --symmetry": wanted.mending != USUAL_MENDING}
    unused = [] if wanted.own_levels else [name for name, is_given in of_making.items() if is_given]
    is_known = bool(options.low) or (wanted.is_count_given and count == wanted.triangles)
    if is_known and not (is_other or unused):
        return []
    from ..jobs import asset  # likewise

    is_found = asset.known_low(bpy.context, job.highs, options.suffixes) == job.low  # without --low, too
    why = "named as the low mesh" if options.low else "there already"
    cure = "Rename or remove it" if is_found else "Leave out --low"
    text = f"{job.low.name!r} is {why} and has {count:,} triangles{f', not {wanted.triangles:,}' if is_other else ''}: it is "
    text += f"baked as it is. {cure} to have a low mesh made."
    return [f"{text} {' and '.join(unused)} changed nothing." if unused else text]
