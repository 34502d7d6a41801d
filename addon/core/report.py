# SPDX-License-Identifier: GPL-3.0-or-later
"""The report of a bake: numbers and sentences."""

import math
from collections.abc import Iterable, Iterator
from dataclasses import asdict, dataclass, field, fields, replace
from inspect import ismethod
from pathlib import Path
from typing import Any

from . import udim
from .declarations import bases, targets
from .declarations.choices import Space
from .errors import Length, plain_length, shorten_list
from .map_types import BY_NAME, Kind
from .parts_turned import PartTurned
from .progress import STAGES, Timings
from .sentences import Sentence, by_harm

VERSION = 1
"""The version of the report's keys in JSON. It increases when a key is removed or changes its meaning, not for new keys."""
EXACT = 5e-4
"""Degrees below which stored normals are exact, for the summary: nobody sees a thousandth of a degree."""
BY_IMPRINT, BY_CYCLES, LEFT_OUT = "IMPRINT", "CYCLES", "NONE"
"""How an input of a material is read."""
MINUTES = 120.0
"""Seconds from which minutes are said, too."""
VISIBLE = 1.0
"""Degrees at the 99th percentile from which a file for an engine is worth a word. 8 bits alone cost 0.3."""
_NORMALS = {name.lower() for name, map_type in BY_NAME.items() if map_type.kind is Kind.NORMAL}
"""The names of maps that are read with the basis, as in Report.maps."""


def smooth_sentences(files: dict[str, int]) -> list[str]:
    """That high meshes are shaded smooth whose files do not say it. files: as Report.smooth_files."""
    return [
        f"The file of {shorten_list(repr(name) for name, each in files.items() if each == degrees)} has no normals: edges "
        f"below {degrees} degrees are smooth"
        for degrees in dict.fromkeys(files.values())
    ]


def _of(path: str, **default: Any) -> Any:
    """A field that a bake gives. path: its place in jobs.baked.Baked; the field has its default if a part of it is None."""
    return field(metadata={"of": path}, **default)


@dataclass(frozen=True)
class Report:
    """The results of a bake. Shares are of all texels, unless noted.

    Attributes:
        seconds: Of each stage, and in total.
    """

    method: str = _of("plan.method")
    """FLATTEN or CAST."""
    space: str = _of("settings.map.space")
    """TANGENT, OBJECT or WORLD."""
    size: tuple[int, int] = _of("settings.sampling.size")
    """Width and height in texels."""
    low: str = _of("meshes.low.name")
    """The name of the low object."""
    high: list[str] = _of("high_names")
    """The names of the high objects."""
    cage: str = _of("meshes.cage.name", default="")
    """The name of the cage, or empty."""
    material: str = _of("request.job.material", default="")
    """The material of the low object whose texture set this is; empty for all faces."""
    slots: list[int] = _of("slots", default_factory=list)
    """The numbers of the low object's material slots in the texture set; empty for all faces."""
    refs: list = _of("request.job.refs", default_factory=list)
    """A scene.object_checks.ObjectRef for the low object, each high object and the cage. Empty in a report from a file."""
    state: Any = _of("state", default=None, compare=False)
    """A jobs.state_pieces.State: what the bake has read. None in a report from a file."""
    settings: dict = _of("settings.flat", default_factory=dict)
    """The settings of the bake, by the names in settings.Settings."""
    uv_layer: str = _of("meshes.uv_layer", default="")
    """The low mesh's UV map that was used."""
    why: str = _of("plan.choice.why", default="")
    """Why the bake chose this method; empty if the settings name it."""
    repeats: dict[str, list[float]] = _of("meshes.repeat.to_dict", default_factory=dict)
    """With Wrap, the steps from a tile to the next along "u" and "v", in world space, in scene units."""
    triangles: dict[str, int] = _of("findings.triangles", default_factory=dict)
    """How many triangles: high, low."""
    mended: dict[str, float] = _of("plan.told.to_dict", default_factory=dict)
    """What was changed of the high meshes for the bake; empty if nothing was. turned: triangles that were turned over, of so
    many (of). parts: connected parts that have such triangles, of so many (of_parts). undecided: parts whose outer side is
    not known. hidden, twice: triangles that were left out since they lie behind the surface, or in the place of others.
    smoothed_median, smoothed_percentile_95: the degrees by which smoothed normals changed."""
    turned_parts: list[dict[str, Any]] = _of("plan.told.largest_to_dicts", default_factory=list)
    """The largest parts of high meshes that were turned over for the bake: the object's name, triangles of the part, of so many
    in the object (of), and the share of its places on the low mesh that had a hit of their own on it (before) and that have one
    now (after)."""
    smooth_files: dict[str, int] = field(default_factory=dict)
    """The high meshes of files that do not say how they are shaded, by name, with the degrees from which edges are hard."""
    materials: dict[str, dict[str, str]] = _of("materials", default_factory=dict)
    """How the maps read the inputs of the high meshes' materials, by the names of both: "IMPRINT" follows the nodes, "CYCLES"
    evaluated them, and "NONE" left the input out."""
    cut_outs: list[str] = _of("cut_outs", default_factory=list)
    """The materials of the high meshes through which rays pass where their alpha is clear."""
    distances: dict[str, float] = _of("plan.rays.distances", default_factory=dict)
    """For rays: extrusion and max_distance in scene units, as set or measured."""
    measured: bool = _of("plan.rays.is_measured", default=False)
    """Whether at least one of `distances` was measured."""
    low_offset: float = _of("plan.rays.low_offset", default=0.0)
    """How far the high meshes lie outside the low one everywhere, negative inside it, in scene units, if rays started from
    where it would touch them; else 0."""
    blend_width: float = _of("plan.rays.blend_width", default=0.0)
    """The distance from hard edges, in scene units, within which the directions of rays blend; 0 if they do not."""
    rays: float = _of("findings.rays", default=0.0)
    """Share of the low mesh's texels that Flatten left to rays; 0 if Auto did not do both in one map."""
    missed: float = _of("findings.missed", default=0.0)
    """Share of the low mesh's texels whose rays missed."""
    coverage: float = _of("findings.coverage", default=0.0)
    """Share of the texels that a mesh covers, without the margin."""
    stopped_early: float = _of("findings.stopped_early", default=0.0)
    """Share of the texels that a mesh covers that took fewer samples than the settings say, since the first ones agreed."""
    margin: float = _of("findings.margin", default=0.0)
    """Share of the texels that were filled as margin."""
    overlap: float = _of("findings.overlap", default=0.0)
    """Share of the low mesh's texels that two or more of its triangles share."""
    mirrored: int = _of("findings.mirrored", default=0)
    """The number of triangles of the low mesh that are mirrored in UV space."""
    checks: dict[str, dict[str, float | str | bool]] = _of("findings.checks", default_factory=dict)
    """The results of the checks of the low mesh and its map, by kind: count, mostly of how many were checked, share (count /
    of) for texels, severity ("GOOD", "LOOK" or "WRONG"), and what docs/command-line.md lists under Checks."""
    targets: dict[str, dict[str, float | int | dict[str, float | int]]] = _of("findings.targets", default_factory=dict)
    """What programs show of the map as it is stored, by their names: median, percentile_95, percentile_99 and maximum of the
    degrees to the normals that the map means before it is rounded or encoded, on so many texels; rebuilt: of these, those that
    come out wrong because the program makes z of x and y; compressed: the same angles once the program has compressed the map
    itself, by an encoder that looks for the least error: fast ones lose more. Programs that compress nothing, and files of
    blocks, have none."""
    deviation: dict[str, float | int] = _of("findings.deviation", default_factory=dict)
    """What the low mesh shows with its map, by the map's own basis: median, percentile_95, percentile_99 and maximum of the
    degrees to the normals of the high meshes, on so many texels; wrong: the share of these that are more than 20 degrees off.
    Empty unless it was asked for."""
    between: dict[str, float | int] = _of("findings.between", default_factory=dict)
    """The same between the centers of texels, where programs interpolate: large where texels are too few for the detail. left:
    the mean of these degrees beyond 0.35, as a share of the mean without the map, or of half a degree if that is less."""
    appearance: dict[str, Any] = _of("findings.appearance.to_dict", default_factory=dict)
    """What a viewer sees of the low mesh with its map, and of the high meshes, from 40 sides: mean, median, percentile_95,
    percentile_99 and maximum of the degrees between both normals, on so many pixels; silhouette: the share of the pixels that
    one of both covers alone; backs: of those at which the low mesh shows a back face, and the high mesh a front, with no back
    a pixel beside it; distance: between both along the view, at the 99th percentile, as a share of the diagonal; wrong: the
    share of the texels, by squares of the map, whose mean is more than 20 degrees; worst_view: the direction towards the
    viewer who sees the largest mean.
    Empty unless it was asked for."""
    tiles: list[int] = _of("tiles", default_factory=lambda: [udim.FIRST])
    """The UDIM tiles that were baked."""
    maps: dict[str, dict] = _of("maps", default_factory=dict)
    """The maps besides the normal map, by name: the image, and how to decode it: value = (stored - midlevel) * scale + offset
    in scene units, or the colors of its labels (colours). With a color_space, `stored` is linear after decoding the space. A
    displacement with the space TANGENT holds tangent, normal and bitangent, in the low object's units. With empty, no texel
    has a value. The packed image has channels: red, green, blue and alpha, each with its map, whether it is inverted
    (1 - stored) and how to decode it, or a constant."""
    attributes: dict[str, str] = _of("stored.attributes", default_factory=dict)
    """The attributes of the low mesh in which maps were stored, by the map's name. Values are decoded, colors linear."""
    loss: dict[str, float] = _of("stored.loss", default_factory=dict)
    """Median and maximum of the degrees between the normals and those that are stored; empty if stored as floats without
    blocks."""
    formats: dict[str, dict[str, float | int | str]] = _of("stored.formats", default_factory=dict)
    """With Format Auto, how each file stores its map, by path: the map, the format, bytes, and by how much what is read of it
    is off the bake, as mean and percentile_99, with the limit of the latter, in a unit, "degrees" or "steps" of 255. Of texels
    that the low mesh covers."""
    compressed: dict[str, dict[str, float | str]] = _of("stored.compressed", default_factory=dict)
    """What compressors of target engines leave of maps that are no normal maps, by name: the format, which is that of their
    settings for high quality, and the mean and percentile_99 of the steps of 255 that texels are off the bake. On a sample of
    texels that the low mesh covers; at least, as fast encoders lose more."""
    image: str = _of("stored.image.name", default="")
    """The name of the image in the .blend."""
    output: list[str] = _of("stored.paths", default_factory=list)
    """The absolute paths of the files that were written: the normal map's of each tile, then those of each other map."""
    mip_files: dict[str, list[str]] = _of("stored.mip_files", default_factory=dict)
    """The absolute paths of the files of mip levels that were written, from level 1 on, by the map's name."""
    export: dict[str, Any] = field(default_factory=dict)
    """The file for an engine, as it was read back: files, triangles, basis, and has_applied_scale: whether the scale of the
    object, which is mirrored or uneven, is in the mesh. With a normal map also has_tangents, points (how many texels were
    compared) and degrees: by basis, the median, percentile_95, percentile_99 and maximum of the angles between the normals that
    an engine with this basis shows of the file and those that were baked; targets: the same of the target engines that the
    settings name. Empty without such a file."""
    asset: dict[str, Any] = field(default_factory=dict)
    """How the low mesh of a game asset was made. Empty for other bakes."""
    memory: dict[str, int] = field(default_factory=dict)
    """Bytes that were estimated before the bake: needed of the machine, on_gpu, and free. Empty in a bake from the window, and
    where modifiers decide how large the meshes are."""
    backend: str = _of("backend", default="")
    """OPENGL, VULKAN or METAL."""
    renderer: str = _of("renderer", default="")
    """The name that the graphics driver gives itself."""
    seconds: dict[str, float] = _of("timings.seconds", default_factory=lambda: Timings().seconds)
    """Of each stage, and total: extract (reading Blender's meshes), orient (turning over faces of the high meshes), method
    (choosing it), tree (building that for rays), upload, distances (measuring them), draw, textures (reading images of the high
    meshes), read (from the GPU), audit (the checks) and image (storing)."""
    startup: dict[str, float] = field(default_factory=dict)
    """Seconds before the bake drew: launcher (from the start of the process), bpy (loading Blender's Python package), imprint
    (loading Imprint), gpu (starting it), opening (the files) and shaders (compiling them, which is part of draw as well). Empty
    in a bake from the window, and in all but the first report of pairs and frames."""
    warnings: list[str] = _of("all_warnings", default_factory=list)
    """Sentences, the worst first."""
    notes: list[str] = _of("notes_of_targets", default_factory=list)
    """A sentence for each program of `targets` that reads another green than the map stores, and so shows something else. Its
    degrees are those of the map with the green that it reads."""
    ratings: dict[str, list[str]] = field(default_factory=dict)
    """Of each warning, how much harm it tells of ("WRONG": the bake is wrong; "LOOK": it may be; "NOTE": it is not), and the
    check or the kind that it is about, or an empty string."""
    picture: Any = _of("findings.picture", default=None, compare=False)
    """An array of the map, the low mesh with it, and its deviations, (rows, columns, 3) uint8, row 0 on top. None unless it was
    asked for, and in a report from a file."""
    version: int = VERSION
    """Of these keys, now 1. It goes up if a key goes or changes its meaning. New keys do not change it."""

    def __post_init__(self):
        ratings: dict[str, Any] = self.ratings
        warnings = [
            each if isinstance(each, Sentence) else Sentence(each, *ratings.get(each, ())) for each in self.warnings
        ]
        object.__setattr__(self, "warnings", warnings)
        object.__setattr__(self, "ratings", {str(each): [str(each.harm), each.kind] for each in warnings})

    @classmethod
    def of(cls, baked: Any) -> "Report":
        """The report of a bake. baked: a jobs.baked.Baked whose maps are stored."""
        read = {each.name: _read(baked, each.metadata["of"]) for each in fields(cls) if each.metadata}
        return cls(**{name: value for name, value in read.items() if value is not None})

    @property
    def images(self) -> list[str]:
        """The names of the images that the maps were stored in, without the mask."""
        return list(dict.fromkeys([self.image, *(how["image"] for how in self.maps.values())]))

    def to_dict(self) -> dict:
        """Plain data for json.dump, without references to objects of this session, the picture, and what was read."""
        values = asdict(replace(self, state=None))
        del values["refs"], values["picture"], values["state"]
        return {"version": values.pop("version"), **values}

    def with_warnings(self, warnings: Iterable[str]) -> "Report":
        """The same report with more warnings."""
        return replace(self, warnings=by_harm([*self.warnings, *warnings]))

    def with_export(self, export: dict[str, Any]) -> "Report":
        """The same report with a file for an engine."""
        return replace(self, export=export)

    def with_startup(self, seconds: dict[str, float]) -> "Report":
        """The same report with the seconds by stage that went before the bake."""
        return replace(self, startup=seconds)

    def _off(self, length: Length) -> list[str]:
        if not self.low_offset:
            return []
        side = "inside" if self.low_offset > 0.0 else "outside"
        return [
            f"{self.low!r} lies {length(abs(self.low_offset))} {side} the high surface everywhere: rays started from where it "
            "would touch that"
        ]

    def _without_own_hit(self) -> str:
        """How many rays have no own hit, for the summary; empty if all have one."""
        unsure: dict[str, Any] = self.checks.get("unsure", {})
        counts = (unsure.get("not_owned", 0), "had no own hit"), (unsure.get("backs", 0), "hit only backs")
        return "".join(f", {count / unsure['of']:.2%} {what}" for count, what in counts if count)

    @property
    def exported(self) -> str:
        """The file for an engine, for the summary; empty without one."""
        how = self.export
        if not how:
            return ""
        start = f"{Path(how['files'][0]).name}: {how['triangles']:,} triangles, read back"
        if how.get("has_applied_scale"):
            start += f", with the scale of {self.low} applied"
        if "degrees" not in how:
            return start
        own, metrics = how["basis"], how["degrees"]
        others = ", ".join(
            f"{bases.BY_NAME[name].label} {angles['percentile_99']:.1f}"
            for name, angles in metrics.items()
            if name != own and angles["percentile_99"] >= VISIBLE
        )
        return (
            f"{start}; normals, read as {bases.BY_NAME[own].label}, differ by {metrics[own]['median']:.2g} degrees (median), "
            f"{metrics[own]['percentile_99']:.2g} (99th percentile), at most {metrics[own]['maximum']:.2g}"
            + (f"; read with another basis, by (99th percentile): {others}" if others else "")
            + "".join(
                f"; {targets.BY_NAME[name].label} is off by {angles['median']:.2g} (median), {angles['percentile_99']:.2g} "
                f"(99th percentile), at most {angles['maximum']:.2g}"
                for name, angles in how["targets"].items()
            )
        )

    def _off_in_targets(self) -> Iterator[str]:
        """What programs show of the map, for the summary."""
        for name, angles in self.targets.items():
            label = targets.BY_NAME[name].label
            yield (
                f"{label} is off by {angles['median']:.3f} degrees (median), {angles['percentile_99']:.3f} (99th percentile), "
                f"at most {angles['maximum']:.2f}{self._other_green(name)}"
            )
            compressed: Any = angles.get("compressed")
            if compressed:
                yield (
                    f"{label} compresses it to {targets.BY_NAME[name].compresses.upper()}: then at least "
                    f"{compressed['median']:.3f} degrees (median), {compressed['percentile_99']:.3f} (99th percentile)"
                )

    def _other_green(self, name: str) -> str:
        """The end of a sentence about a program that reads another green than the map stores; empty if it is the same."""
        green = targets.BY_NAME[name].green
        return "" if self.settings.get("green") == green else f"; it reads green as {green}"

    def _mended(self) -> list[str]:
        """What was changed of the high meshes, for the summary."""
        mended, lines = self.mended, []
        if mended.get("turned"):
            share = mended["turned"] / max(1, mended["of"])
            lines.append(
                f"{mended['parts']:,} of {mended['of_parts']:,} parts, {share:.1%} of the faces, were turned over"
            )
            lines += [PartTurned(**part).sentence for part in self.turned_parts]
        left_out = (("hidden", "behind the surface"), ("twice", "in the place of others"))
        counts = [f"{mended[key]:,} {where}" for key, where in left_out if mended.get(key)]
        if counts:
            lines.append(f"Left out: triangles {' and '.join(counts)}")
        if "smoothed_median" in mended:
            lines.append(
                f"High normals were smoothed by {mended['smoothed_median']:.2g} degrees (median), "
                f"{mended['smoothed_percentile_95']:.2g} (95th percentile)"
            )
        return lines

    def _seen_through(self) -> list[str]:
        """The materials that rays pass, for the summary."""
        names = shorten_list(map(repr, self.cut_outs))
        return [f"Rays pass {names} where alpha is clear"] if names else []

    def _shared(self) -> list[str]:
        """That parts of the low mesh show the detail of others, for the summary."""
        overlap = self.checks.get("overlap", {})
        if not overlap.get("hidden"):
            return []
        differing = overlap["differing"]
        how = f", which differs from theirs on {differing:.1%} of their texels" if differing else ""
        return [f"Shared UVs: {overlap['hidden']:,} triangles show the detail of other parts{how}"]

    def _made(self) -> list[str]:
        """How the low mesh of an asset was made, for the summary."""
        how, lines = self.asset, []
        if how.get("shares"):
            lines.append(
                f"{self.low}: {self.triangles['low']:,} triangles, with the UVs and the textures of {how['shares']}"
            )
        elif how.get("is_made"):
            way = "remeshed by voxels and decimated" if how["is_remeshed"] else "decimated"
            way += ", the last steps by quadrics" if how["is_collapsed"] else ""
            way += ", with its planes and straight edges" if how["keeps_planes"] else ""
            way += f", symmetric along {how['symmetry']}" if how.get("symmetry") else ""
            tries = f"; {how['measured']} meshes were compared" if how["measured"] else ""
            inside = f", {how['inside']:.0%} of the area lies inside" if how["inside"] > 0.005 else ""
            lines.append(f"{self.low}: {self.triangles['low']:,} of {how['of']:,} triangles{inside}, {way}{tries}")
        for name, done in (("crumbs", "small parts were left out"), ("holes", "small holes were filled")):
            lines += [f"{self.low}: {how.get(name, 0):,} {done}"] * bool(how.get(name))
        stages = {stage: seconds for stage, seconds in how.get("seconds", {}).items() if stage != "total"}
        if any(stages.values()):
            lines.append(f"Low mesh: {_in_stages(stages, how['seconds']['total'])}")
        if "distance" in how:
            lines.append(f"Distance from the high mesh: {how['distance']:.2%} of the size (99th percentile)")
        return [*lines, *filter(None, [how.get("unwrapped")])]

    def _seen(self) -> list[str]:
        """The shading error, for the summary."""
        if not self.appearance:
            return []
        mean, most, silhouette = (self.appearance[name] for name in ("mean", "percentile_99", "silhouette"))
        how = f"{mean:.2f} degrees (mean), {most:.1f} (99th percentile)"
        backs = self.appearance.get("backs", 0.0)
        seen = f", back faces show on {backs:.2%}" if backs > 0.0 else ""
        return [f"Shading error: {how}; outlines differ on {silhouette:.2%} of the pixels{seen}"]

    def _ranges(self, length: Length) -> list[str]:
        """What black and white stand for in maps of lengths, for the summary: maps fit together if it is the same."""
        ranges = [
            (name, how["midlevel"], how["scale"])
            for name, how in self.maps.items()
            if name in _LENGTHS and "scale" in how
        ]
        return [
            f"{BY_NAME[name.upper()].label}: black is {_signed(-middle * scale, length)}, "
            f"white is {_signed((1.0 - middle) * scale, length)}"
            for name, middle, scale in ranges
            if scale != 1.0  # floats are stored as they are
        ]

    def _tile(self, length: Length) -> list[str]:
        """How the low mesh repeats, for the summary."""
        steps = [f"along {axis.upper()} by {length(math.hypot(*step))}" for axis, step in self.repeats.items()]
        return [f"Repeats {' and '.join(steps)}"] if steps else []

    def summary(self, length: Length = plain_length) -> list[str]:
        """Lines for the user: what was baked, and how long it took. length: a length in scene units as text."""
        width, height = self.size
        before = self.asset.get("seconds", {}).get("total", 0.0)
        parts = {"low mesh": before} if before else {}
        parts |= {stage: self.seconds[stage] for stage in STAGES}
        details = self._made()
        has_normals = self.settings.get("normal", True) or not self.maps.keys().isdisjoint(_NORMALS)
        basis = self.settings.get("basis") if self.space == Space.TANGENT and has_normals else ""
        if isinstance(basis, str) and basis in bases.BY_NAME:
            details.append(f"Basis: {bases.BY_NAME[basis].label}, for {targets.names(bases.BY_NAME[basis])}")
        details += self._off_in_targets()
        if self.why:
            details.append(f"{self.method.capitalize()} was chosen: {self.why}")
        details += [*smooth_sentences(self.smooth_files), *self._mended(), *evaluated(self.materials)]
        details += self._seen_through()
        if self.rays:
            details.append(f"Flatten on {1.0 - self.rays:.1%} of the texels, rays on {self.rays:.1%}")
        if self.distances:
            distances = " and ".join(
                f"{name.replace('_', ' ')} {length(value)}" for name, value in self.distances.items()
            )
            details.append(f"Rays: {distances}; {self.missed:.2%} missed{self._without_own_hit()}")
        details += [*self._off(length), *self._tile(length), *self._shared(), *self._seen()]
        if self.stopped_early:
            details.append(f"Samples: {self.stopped_early:.1%} of the covered texels needed fewer than all")
        if self.blend_width:
            details.append(f"Directions blend within {length(self.blend_width)} of hard edges")
        far: dict[str, Any] | None = self.checks.get("far")
        if far and far["offset"] > far["limit"]:
            details.append(
                f"High and low are {length(far['offset'])} apart as a whole; this offset was not counted as a distance"
            )
        if self.loss:
            off = f"off by {self.loss['median']:.2g} degrees (median), at most {self.loss['maximum']:.2g}"
            details.append(f"Stored: normals {'exact' if self.loss['maximum'] < EXACT else off}")
        details += [_stored_as(path, how) for path, how in self.formats.items()]
        details += [
            f"Target engines that compress {name.replace('_', ' ')} to {how['format']}: at least {how['mean']:.2g} steps of 255"
            f" off (mean), {how['percentile_99']:.2g} (99th percentile)"
            for name, how in self.compressed.items()
        ]
        details += self._ranges(length)
        details += [f"Packed in {how['image']}: {_channels(how)}" for how in self.maps.values() if "channels" in how]
        if count := sum(map(len, self.mip_files.values())):
            details.append(f"Mip levels: {count} files beside those of the maps, as name_mip1 and so on")
        if self.attributes:
            details.append(f"Attributes of {self.low}: {', '.join(self.attributes.values())}")
        if self.export:
            details.append(self.exported)
        return [
            f"{self.method.capitalize()}, {self.space.lower()} space, {width} x {height}: {self.image}",
            f"{self.triangles['high']:,} triangles onto {self.triangles['low']:,}, {self.coverage:.1%} of the map covered",
            *details,
            _in_stages(parts, self.seconds["total"]),
        ]


def _read(value: Any, path: str) -> Any:
    """What `value` has at a path of attributes and methods; None if a part of it is None."""
    for name in path.split("."):
        if value is None:
            break
        value = getattr(value, name)
        value = value() if ismethod(value) else value
    return value


def _stored_as(path: str, how: dict[str, Any]) -> str:
    """An entry of Report.formats, for the summary."""
    return (
        f"{Path(path).name}: {how['format']}, {how['bytes']:,} bytes, off by {how['mean']:.2g} {how['unit']} (mean), "
        f"{how['percentile_99']:.2g} (99th percentile)"
    )


def _in_stages(stages: dict[str, float], total: float) -> str:
    """Seconds, and those of each stage that has some; minutes and the longest stage, if it takes that long."""
    parts = {stage: seconds for stage, seconds in stages.items() if seconds}
    parts["other"] = max(0.0, total - sum(parts.values()))
    each = ", ".join(f"{stage} {seconds:.2f}" for stage, seconds in parts.items())
    if total < MINUTES:
        return f"{total:.2f} s ({each})"
    return f"{total:.0f} s, which is {total / 60.0:.1f} minutes ({each}; longest: {max(parts, key=parts.__getitem__)})"


def evaluated(materials: dict[str, dict[str, str]]) -> list[str]:
    """A line with the inputs that Cycles evaluates, or none. materials: as Report has them."""
    names = (
        (material, ", ".join(socket for socket, way in ways.items() if way == BY_CYCLES))
        for material, ways in materials.items()
    )
    listed = [f"{sockets} of {material!r}" for material, sockets in names if sockets]
    return [f"Baked by Cycles: {shorten_list(listed)}"] if listed else []


_LENGTHS = ("height", "distance")
"""The maps in scene units whose range is in the summary."""


def _signed(value: float, length: Length) -> str:
    """A length that may be below 0, in words."""
    return f"{'-' if value < 0.0 else ''}{length(abs(value))}" if value else "0"


def _channels(packed: dict) -> str:
    """The maps in the channels of a packed image, for the summary."""
    parts = {name: how for name, how in packed["channels"].items() if "map" in how}
    return ", ".join(f"{name} {'1 - ' if how.get('inverted') else ''}{how['map']}" for name, how in parts.items())
