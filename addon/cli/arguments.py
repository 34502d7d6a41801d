# SPDX-License-Identifier: GPL-3.0-or-later
"""Reads the words of the command line, and makes settings from options."""

import argparse
import functools
import os
from collections.abc import Collection, Iterable, Iterator, Sequence
from dataclasses import fields
from pathlib import Path, PurePath
from typing import Any

from ..core import asset_limits, file_formats, levels, naming, udim
from ..core.declarations.all_settings import DECLARED
from ..core.declarations.choices import Space, Storage
from ..core.errors import BakeError
from ..core.naming import Suffixes
from ..core.settings import PART_OF, Settings
from ..core.stored_normals import StoredNormals
from . import limits
from .commands import ASSET, BAKE, CHECK, CONVERT, LOD, RUN, Command, WrongUsage
from .options import SUBJECTS, RunOptions, option_word


def settings(options: argparse.Namespace) -> Settings:
    """The settings of the bake. The map goes to a file, of the format's usual depth if no depth is given."""
    given = vars(options)
    values = {name: given[name] for name in PART_OF if name in given}
    values["low_suffix"] = low_suffix(options)
    values["width"], values["height"] = options.size
    values["storage"], values["output"] = Storage.FILE, os.path.abspath(options.output)
    values["udim"] = options.udim or bool(options.tiles) or udim.TOKEN in options.output
    if options.depth is None:
        values["depth"] = file_formats.usual_depth(options.output)
    return Settings(**values)


def low_suffix(options: argparse.Namespace) -> str:
    """The ending of the names of low objects."""
    return vars(options).get("suffixes", Suffixes()).low


def only_low(options: argparse.Namespace) -> str:
    """The name of the low object; "" if there are several, or if it is not named."""
    return options.low[0] if len(options.low) == 1 else ""


def are_several(options: argparse.Namespace) -> bool:
    """Whether the bake may have several low objects."""
    return bool(options.pairs) or len(options.low) > 1 or takes_all(options)


def takes_all(options: argparse.Namespace) -> bool:
    """Whether no object of mesh files is named, so that each is baked onto itself."""
    subjects = ("low", "low_file", "pairs", "high", "cage", "convert", "frames", "levels", "asset")
    is_open = any(vars(options)[name] for name in subjects)
    return bool(options.file) and not is_open and not any(".blend" in PurePath(name).suffix for name in options.file)


def asks_for_sets(options: argparse.Namespace) -> bool:
    """Whether --list lists the sets of .blend files, as nothing in them is named."""
    is_open = any(vars(options)[name.replace("-", "_")] for name in (*SUBJECTS, "output", "convert"))
    return (
        options.list
        and bool(options.file)
        and not is_open
        and all(".blend" in PurePath(name).suffix for name in options.file)
    )


def stored_normals(options: argparse.Namespace) -> StoredNormals:
    """What the map to convert means."""
    return StoredNormals(**{field.name: vars(options)[field.name] for field in fields(StoredNormals)})


def settings_problems(options: argparse.Namespace) -> Iterator[str]:
    """What is wrong with the settings, each without a full stop."""
    problems: list[str] = []
    for check in (lambda: problems.extend(settings(options).problems()), stored_normals(options).check):
        try:
            check()
        except BakeError as error:
            problems.append(str(error))
    yield from (text.rstrip(".") for text in problems)


@functools.cache
def parser(program: str, command: Command = BAKE) -> argparse.ArgumentParser:
    """The parser of the options of a bake. It raises WrongUsage. command: whose own options may be meant by unknown ones."""
    result = BAKE.parser(program, known=(*BAKE.options, *command.options))
    result.set_defaults(levels=None, asset=None)  # the commands lod and asset have them
    result.set_defaults(notes=(), of_window=None)  # sets of scenes have them
    return result


def parse(arguments: Sequence[str], program: str = "imprint", command: Command = BAKE) -> argparse.Namespace:
    """The options in `arguments`, each checked by itself. Raises WrongUsage. command: as in `parser`."""
    return completed(parser(program, command).parse_intermixed_args(_joined(arguments)), command)


def given(arguments: Sequence[str]) -> dict[str, Any]:
    """The values of the options in `arguments` that take one value, by their names. Raises WrongUsage."""
    defaults = vars(parse([]))
    single = [name for name, value in defaults.items() if not isinstance(value, list)]
    absent = object()
    parsed = argparse.Namespace(**dict.fromkeys(single, absent))
    parser("imprint").parse_intermixed_args(_joined(arguments), parsed)
    return {name: value for name in single if (value := vars(parsed)[name]) is not absent}


def completed(options: argparse.Namespace, command: Command = BAKE) -> argparse.Namespace:
    """The options, where what is on disk decides whether `--pairs` names a FILE or a folder, and maps go beside the file of
    `--export`."""
    if options.pairs is True and len(options.file) == 1 and os.path.isdir(options.file[0]):
        options.pairs, options.file = options.file[0], []
    elif options.pairs not in (None, True) and not options.file and os.path.isfile(options.pairs):
        options.file, options.pairs = [options.pairs], True  # `--pairs FILE.blend`
    options.low = (
        list(dict.fromkeys([*options.low, *(part.low for part in options.part)])) if options.part else options.low
    )
    if command is BAKE and options.export and not options.output:
        options.output = str(Path(options.export).with_suffix(".png"))
    return options


def split_jobs(arguments: Sequence[str], program: str = "imprint") -> tuple[RunOptions, list[str]]:
    """The options of the run of a job file, and the other arguments, which override all sets. Raises WrongUsage."""
    own = RUN.parser(program, known=BAKE.options, has_help=False)
    known, more = own.parse_known_args(_joined(arguments))
    rest = parse(more)
    if rest.file or any(vars(rest)[name.replace("-", "_")] for name in SUBJECTS):
        raise WrongUsage("--jobs FILE names what to bake: name nothing beside it")
    run = RunOptions.of(known, program)
    _refuse(run.mistakes(has_files=True))
    return run, more


def check(options: argparse.Namespace, program: str = "imprint") -> RunOptions:
    """The options of the run. Raises WrongUsage for options that are missing or contradict each other."""
    if job_file := next((name for name in options.file if PurePath(name).suffix.lower() in JOB_FILES), None):
        raise WrongUsage(f"{job_file!r} is a job file: put --jobs before it")
    run = RunOptions.of(options, program)
    if asks_for_sets(options):
        return run
    others = _given(options, CONVERT.ignored) if options.convert else []
    of_conversion = [CONVERT.refusal.format(", ".join(others))] if others else []
    _refuse([*mistakes(options), *of_conversion, *run.mistakes(has_files=bool(options.file or options.low_file))])
    return run


def _refuse(problems: Iterable[str]) -> None:
    if text := "; ".join(problems):
        raise WrongUsage(text)


def mistakes(options: argparse.Namespace, unread: Collection[str] = ()) -> Iterator[str]:
    """What is missing among the options of a set, or contradicts another one. Each text is without a full stop.

    unread: names of options that are given but cannot be read, which are not missing.
    """
    if options.set:
        yield from _wrong_set(options)
        return
    yield from _wrong_subjects(options, unread)
    if not options.output and "output" not in unread:
        yield "--export or --output is required" if options.asset else "--output is required"
    if is_folder(options):
        yield from _wrong_folder(options)
    if options.save_blend and PurePath(options.save_blend).suffix != ".blend":
        yield f"{options.save_blend!r} does not end in .blend"
    if options.join and not (options.save_blend and options.one_material and are_several(options)):
        yield "--join is for several low objects, with --one-material and --save-blend"
    if options.export:
        yield from _wrong_export(options)
    yield from _unmeasured(options)
    files = [options.low_file, *options.high_file, options.cage_file]
    yield from _wrong_paths(
        [
            *(options.output, options.report, options.save_blend, options.export, options.pairs, options.convert),
            *options.file,
            *files,
        ]
    )
    if options.output and (problems := list(settings_problems(options))):
        # What else is a folder, or no file, is found with the other files of a call.
        yield from [f"{options.output!r} is a folder: name a file"] if os.path.isdir(options.output) else problems


def _wrong_subjects(options: argparse.Namespace, unread: Collection[str]) -> Iterator[str]:
    ways = ("low", "pairs", "low-file")
    named = [name for name in ways if vars(options)[name.replace("-", "_")]]
    by_file = options.low_file or options.high_file or options.cage_file
    if not (named or options.asset or takes_all(options) or set(ways).intersection(unread)):
        yield "one of --low, --low-file and --pairs is required"
    if len(named) > 1:
        yield "--low, --low-file and --pairs exclude each other"
    elif options.pairs and (options.high or options.cage or by_file):
        yield "--pairs finds the high objects and the cages by itself"
    elif by_file and (options.file or options.low or options.high or options.cage):
        yield "--low-file, --high-file and --cage-file go together, without FILE, --low, --high and --cage"
    if options.part:
        yield from _wrong_parts(options)
    elif len(options.low) > 1:
        yield from _wrong_lows(options)
    if options.scene and (by_file or is_folder(options)):
        yield "--scene is for a .blend: leave it out"
    if options.high_up and not (options.high_file or options.pairs):
        yield "--high-up is for --high-file"
    if options.convert:
        yield from _wrong_conversion(options)
    shares = are_several(options) and not is_folder(options) and not naming.has_low(options.output or "")
    if options.pack_uvs and not shares:
        yield "--pack-uvs is for low objects that share one map: leave it out, or {low} in --output"
    if options.pairs and options.frames:
        yield "--frames is for one low object, --pairs for many"


_BESIDE_SETS = (*("low", "high", "cage", "low_file", "high_file", "cage_file", "pairs", "part", "convert", "frames"),)
"""Options that --set leaves no room for."""


def _wrong_conversion(options: argparse.Namespace) -> Iterator[str]:
    if others := _given(options, CONVERT.refused):
        yield CONVERT.refusal.format(", ".join(others))
    if options.export:
        yield "--export follows a bake: leave it out with --convert"
    before = file_formats.known(options.convert)
    if before and not before.is_shown:
        why = f"since Blender does not read {before.label}: name the map's .dds or .png file"
        yield f"{options.convert!r} cannot be converted, {why}"


def _wrong_set(options: argparse.Namespace) -> Iterator[str]:
    """What contradicts --set. What else is wrong is found when the sets are read."""
    others = [name for name in _BESIDE_SETS if vars(options)[name]]
    if others:
        yield f"--set says what to bake: leave out {', '.join('--' + name.replace('_', '-') for name in others)}"
    wrong = [name for name in options.file if not (".blend" in PurePath(name).suffix or os.path.isdir(name))]
    if wrong:
        yield f"--set is for .blend files, and {wrong[0]!r} is none"


def _wrong_parts(options: argparse.Namespace) -> Iterator[str]:
    """What contradicts --part."""
    others = [name for name in ("high", "cage", "pairs", "low_file", "convert", "frames") if vars(options)[name]]
    if others:
        yield f"--part names the high objects: leave out {', '.join('--' + name.replace('_', '-') for name in others)}"
    lows = [part.low for part in options.part]
    if twice := sorted({low for low in lows if lows.count(low) > 1}):
        yield f"--part names {', '.join(map(repr, twice))} twice"


def _wrong_lows(options: argparse.Namespace) -> Iterator[str]:
    """What cannot be asked for several low objects."""
    names = ("high", "cage", "frames", "convert", "levels", "asset")
    others = [f"--{name}" for name in names[:4] if vars(options)[name]]
    others += [{"levels": "lod", "asset": "asset"}[name] for name in names[4:] if vars(options)[name]]
    if others:
        yield f"{', '.join(others)} is for one low object: give --low once"
    twice = sorted({name for name in options.low if options.low.count(name) > 1})
    if twice:
        yield f"--low names {', '.join(map(repr, twice))} twice"


JOB_FILES = (".toml", ".json")


def _given(options: argparse.Namespace, names: Iterable[str]) -> list[str]:
    """Those of these options that are given, by the names of their values."""
    defaults = parser("imprint").get_default
    given = (name for name in names if vars(options)[name] != defaults(name))
    return [f"--{option_word(name) if name in DECLARED else name.replace('_', '-')}" for name in given]


def _wrong_export(options: argparse.Namespace) -> Iterator[str]:
    if PurePath(options.export).suffix.lower() not in file_formats.MESHES:
        yield f"{options.export!r} does not end in {file_formats.listed_meshes()}"
    elif PurePath(options.export).suffix.lower() != file_formats.MESHES[0]:
        only = f"only a {file_formats.MESHES[0]} file can"
        for name, what in (("export_webp", "WebP"), ("export_ktx2", "KTX2")):
            if vars(options)[name]:
                yield f"{options.export!r} cannot have the {what} textures of --{option_word(name)}: {only}"
    if options.frames:
        yield "--export is for one map, --frames for many"
    if options.normal and options.space != Space.TANGENT:
        yield "--export needs a normal map in tangent space, which engines read: leave out --space"
    if is_folder(options) and not naming.has_low(options.export):
        yield f"--export needs {naming.LOW} in its name, as the meshes of a folder are baked one by one"


def _unmeasured(options: argparse.Namespace) -> Iterator[str]:
    """Errors for limits on metrics that will not be reported."""
    for limit in options.strict:
        needs = limit.metric.needs
        if options.levels and needs == limits.DEVIATION:
            yield f"--strict: lod keeps {limit.name} within --degrees"
        elif options.convert and not limit.metric.is_of_conversions:
            yield f"--strict: a conversion does not measure {limit.name}"
        elif options.levels and needs == limits.APPEARANCE:
            yield f"--strict: lod does not measure {limit.name}"
        elif needs in {limits.DEVIATION, limits.APPEARANCE} and not options.normal:
            yield f"--strict: {limit.name} needs a normal map: leave out --no-normal"
        elif needs == limits.EXPORT and not (options.export and options.normal):
            yield f"--strict: {limit.name} needs --export and a normal map"
        elif needs.startswith(limits.TARGETS):
            _, engine, *of_compressor = needs.split(".")
            file_format = file_formats.known(options.output or "")
            if engine not in options.targets:
                yield f"--strict: {limit.name} needs --targets {engine}"
            elif of_compressor and file_format is not None and file_format.is_blocks:
                yield f"--strict: {limit.name} is not measured of {file_format.label} files, which are compressed already"


def _wrong_folder(options: argparse.Namespace) -> Iterator[str]:
    if options.file:
        yield "--pairs DIR takes the files of that folder: name no others"
    if options.output and not naming.has_low(options.output):
        yield "--pairs DIR makes a map for each pair: put {low} into --output"
    if options.save_blend:
        yield "--pairs DIR has a scene for each pair: --save-blend saves one alone"


def _wrong_paths(paths: Sequence[str | bool | None]) -> Iterator[str]:
    """A mistake if one of `paths` is relative and Blender cannot use the current folder."""
    if all(os.path.isabs(name) for name in paths if isinstance(name, str)):
        return
    here = os.getcwd()
    try:
        here.encode()
    except UnicodeEncodeError:
        yield f"the folder {here!r} is not UTF-8, as all paths in Blender are: start in another one"


def is_folder(options: argparse.Namespace) -> bool:
    """Whether the options bake the pairs of a folder of mesh files."""
    return isinstance(options.pairs, str)


_MAY_BE_NEGATIVE = {f"--{start}{channel}" for start in ("", "from-") for channel in ("red", "green", "blue")} | {
    "--origin"
}
"""Options whose values may begin with a minus."""


def _joined(arguments: Sequence[str]) -> list[str]:
    """The arguments with `--green -y` as `--green=-y`: argparse takes -y, and -1,2,3, for an option."""
    result, words = [], iter(arguments)
    for word in words:
        value = next(words, None) if word in _MAY_BE_NEGATIVE else None
        result.append(word if value is None else f"{word}={value}")
    return result


def _of_bake(command: Command, words: Sequence[str], program: str) -> argparse.Namespace:
    """The options of a bake in a call of another command. Raises WrongUsage for those that it has no use for."""
    options = parse(words, program, command)
    if given := _given(options, command.refused):
        raise WrongUsage(command.refusal.format(given[0]))
    return options


def read_lod(words: Sequence[str], program: str) -> tuple[RunOptions, argparse.Namespace]:
    """The options of the run, and of the bake that makes the chain: its `levels` are the texts of the limits.

    Raises WrongUsage.
    """
    own, rest = LOD.parser(program).parse_known_args(words)
    options = _of_bake(LOD, rest, program)
    if own.triangles is not None and (own.degrees, own.distance) != (None, None):
        raise WrongUsage("--triangles sets how many triangles levels have: give it without --degrees and --distance")
    degrees = own.degrees if own.degrees is not None else "" if own.distance else levels.DEGREES
    options.levels = degrees, levels.PERCENT if own.distance is None else own.distance, own.triangles or ""
    run = check(options, program)
    try:
        count = len(levels.limits(*options.levels))
    except BakeError as error:
        raise WrongUsage(str(error).rstrip(".")) from error
    if count > 1:
        _check_levels(options)
    return run, options


def _check_levels(options: argparse.Namespace, *, have_maps: bool = True) -> None:
    """Raise WrongUsage if several levels would be written to one file. have_maps: whether each has one."""
    if have_maps and not naming.has_low(options.output):
        raise WrongUsage(f"each level has a map: put {naming.LOW} into --output")
    is_one_file = bool(options.export) and not naming.has_low(options.export)
    if is_one_file and Path(options.export).suffix.lower() != ".glb":
        raise WrongUsage(f"only .glb has levels in one file: put {naming.LOW} into --export")


def read_asset(words: Sequence[str], program: str) -> tuple[RunOptions, argparse.Namespace]:
    """The options of the run, and of the bake of an asset: its `asset` is what is wanted. Raises WrongUsage."""
    own, rest = ASSET.parser(program).parse_known_args(words)
    texts = own.degrees or "", own.triangles or "", own.size or "", own.distance or "", own.levels
    try:
        mending = asset_limits.Mending.of_texts(own.crumbs, own.holes, own.symmetry)
        ways = {"owns_textures": own.own_textures, "keeps": own.keep, "stacks_mirrored": own.stack_mirrored}
        ways |= {"quads": own.quads, "density_group": own.density_group}
        wanted = asset_limits.Wanted.of_texts(*texts, mending=mending, **ways)
    except BakeError as error:
        raise WrongUsage(str(error).rstrip(".")) from error
    if own.keep:
        of_making = {"--quads": own.quads, "--crumbs, --holes and --symmetry": mending != asset_limits.USUAL_MENDING}
        unused = ["--triangles"] * bool(own.triangles)
        unused += [name for name, is_given in of_making.items() if is_given and not wanted.own_levels]
        if unused:
            raise WrongUsage(f"--keep keeps all triangles: leave out {', '.join(unused)}")
    size = ["--size", own.size] if own.size and not wanted.finds_size else []
    options = _of_bake(ASSET, [*rest, *size], program)
    options.asset = wanted
    if options.export and not options.output:
        path = Path(options.export)
        is_as_export = not wanted.own_levels or naming.has_low(path.name)
        options.output = str(path.with_suffix(".png") if is_as_export else path.with_name(f"{naming.LOW}.png"))
    run = check(options, program)
    if wanted.levels:
        _check_levels(options, have_maps=wanted.own_levels > 0)
    return run, options


def read_check(words: Sequence[str], program: str) -> tuple[RunOptions, argparse.Namespace]:
    """The options of the run, and of the bake to look at, which need no output. Raises WrongUsage."""
    options = _of_bake(CHECK, words, program)
    options.output = options.output or f"{naming.LOW}.png"
    if not (
        options.low or options.low_file or options.pairs or options.cage or options.cage_file or takes_all(options)
    ):
        if options.high_file and not options.file:  # their meshes are all high
            options.file, options.high_file, options.high_up = options.high_file, [], None
        if options.file:
            options.asset = asset_limits.Wanted(is_count_given=False)  # the look is at high meshes alone
    return check(options), options
