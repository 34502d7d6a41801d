# SPDX-License-Identifier: GPL-3.0-or-later
"""Makes the report of a finished bake, and finds the objects and settings of a bake from its report."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import gpu
import numpy as np

from ..audit import causes, other_readers
from ..audit.causes import Warned
from ..audit.checks import Findings
from ..core import fixes, map_types
from ..core.declarations.choices import Method
from ..core.errors import shorten_list
from ..core.map_types import BY_NAME, Labeled
from ..core.progress import Timings
from ..core.report import Report
from ..core.settings import MapSettings, Settings
from ..engine.maps import ray_reach
from ..engine.method_choice import Plan
from ..engine.rays.ray_casting import RayCast
from ..mesh import triangle_mesh
from ..mesh.inputs import Meshes
from ..mesh.local_space import local_space_of
from ..output.outputs import HIDDEN_MISSES, Stored
from ..passes.surface import finite_values
from ..scene.high_materials import MaterialSet
from ..scene.object_refs import ObjectRef
from .job import Job


@dataclass(frozen=True)
class DrawnJob:
    """A bake whose maps are drawn and not yet stored. meshes: all that were read. ray_cast: None for Flatten. warnings: about
    the objects. stopped_early, rays, readers, deviation, picture: as in Report."""

    job: Job
    settings: Settings
    meshes: Meshes
    plan: Plan
    ray_cast: RayCast | None
    findings: Findings
    timings: Timings
    warnings: Sequence[Warned] = ()
    stopped_early: float = 0.0
    rays: float = 0.0
    readers: dict[str, dict[str, float | int]] = field(default_factory=dict)
    deviation: dict[str, float | int] = field(default_factory=dict)
    picture: np.ndarray | None = None

    @property
    def labels(self) -> dict[Labeled, list[str]]:
        """As Outputs.commit takes them."""
        return {
            Labeled.OBJECTS: [high.name for high in self.meshes.highs],
            Labeled.MATERIALS: [material.name for material in self.meshes.materials],
        }


def report_of(drawn: DrawnJob, stored: Stored, notes: Sequence[str] = (), margin: float | None = None) -> Report:
    """The report of a bake. notes: warnings about what was stored, in sentences. margin: of the stored map, if it differs from
    the drawn one."""
    settings, plan, ray_cast, findings = drawn.settings, drawn.plan, drawn.ray_cast, drawn.findings
    return Report(
        method=plan.method,
        space=settings.map.space,
        size=settings.sampling.size,
        low=drawn.meshes.low.name,
        material=drawn.job.material,
        slots=list(drawn.job.slots or ()),
        high=drawn.labels[Labeled.OBJECTS],
        cage=drawn.meshes.cage.name if drawn.meshes.cage else "",
        refs=drawn.job.refs,
        settings=settings.flat(),
        uv_layer=drawn.meshes.uv_layer,
        why=plan.why,
        triangles=findings.triangles,
        distances={"extrusion": ray_cast.extrusion, "max_distance": ray_cast.max_distance} if ray_cast else {},
        measured=ray_cast is not None and ray_cast.is_measured,
        blend_width=ray_cast.blend_width if ray_cast else 0.0,
        rays=drawn.rays,
        missed=findings.missed,
        coverage=findings.coverage,
        stopped_early=drawn.stopped_early,
        margin=findings.margin if margin is None else margin,
        overlap=findings.checks["overlap"]["share"],
        mirrored=findings.checks["mirrored"]["count"],
        checks=findings.checks,
        readers=drawn.readers,
        deviation=drawn.deviation,
        picture=drawn.picture,
        tiles=[tile for tile in plan.tiles if tile in stored.tiles],
        maps=_with_meanings(drawn, stored.maps),
        attributes=stored.attributes,
        loss=stored.loss,
        image=stored.image.name,
        output=stored.paths,
        mip_files=stored.mip_files,
        backend=gpu.platform.backend_type_get(),
        renderer=gpu.platform.renderer_get(),
        seconds=drawn.timings.seconds,
        warnings=causes.remaining(
            (
                *drawn.warnings,
                *map(Warned, material_notes(drawn.meshes, settings.map)),
                *map(Warned, attribute_notes(drawn.meshes, settings.map)),
                *map(Warned, slope_notes(settings)),
                *map(Warned, plan.warnings),
                *findings.warnings,
                *(Warned(text, causes.REBUILT) for text in other_readers.warnings(drawn.readers)),
                *(Warned(text, causes.HIDDEN_MISSES if text == HIDDEN_MISSES else "") for text in notes),
            )
        ),
    )


def material_notes(meshes: Meshes, settings: MapSettings) -> list[str]:
    """What could not be read of the high meshes' materials, of those parts that the bake wanted."""
    wanted = [BY_NAME[name].socket for name in settings.drawn_maps if BY_NAME[name].socket]
    sockets = [*wanted, ""] if wanted else []
    sockets += ["Normal"] if settings.detail_maps else []
    notes = (note for material in meshes.materials for socket in sockets for note in material.notes.get(socket, ()))
    return list(dict.fromkeys(notes))


def attribute_notes(meshes: Meshes, settings: MapSettings) -> list[str]:
    """The high meshes without the attribute that the attribute map shows, and attributes with values that are no numbers."""
    lacking = [
        repr(high.name) for high in meshes.highs if (triangle_mesh.ATTRIBUTE, settings.attribute) not in high.layers
    ]
    notes = []
    for high in meshes.highs:
        names: dict[int, str] = {}  # the attribute that is set to render can have been read by its name, too
        for (kind, name), values in high.layers.items():
            if kind == triangle_mesh.ATTRIBUTE:
                wrong = finite_values.count_others(values)
                names[wrong] = name or names.get(wrong, "")
        notes += [
            f"The {_attribute(name)} of {high.name!r} is not finite at {wrong:,} face corners: NaN counts as 0 there, "
            f"infinity as {finite_values.LARGEST:,.0f}."
            for wrong, name in names.items()
            if wrong
        ]
    if lacking and map_types.ATTRIBUTE.name in settings.drawn_maps:
        wanted = _attribute(settings.attribute)
        notes.append(f"The attribute map is black where the high mesh has no {wanted}: {shorten_list(lacking)}.")
    return notes


def _attribute(name: str) -> str:
    """An attribute in a sentence. name: empty for the color attribute that is set to render."""
    return f"attribute {name!r}" if name else "color attribute"


def slope_notes(settings: Settings) -> list[str]:
    """That one sample does not show the detail in a texel."""
    if settings.sampling.samples > 1 or map_types.WIDENED_ROUGHNESS.name not in settings.map.drawn_maps:
        return []
    return [
        fixes.in_shell("With 1 sample in a texel, widened roughness is the roughness of the material.", fixes.SAMPLES)
    ]


def _with_meanings(drawn: DrawnJob, maps: dict[str, dict]) -> dict[str, dict]:
    """`maps` with what values mean that do not depend on the bake's other values, also in packed channels."""
    settings = drawn.settings
    if not any(BY_NAME[name].family in ray_reach.WITH_MEANING for name in settings.map.drawn_maps):
        return maps
    space = local_space_of(drawn.plan.meshes.highs)
    meanings = {name.lower(): how for name, how in ray_reach.meanings(settings, space).items()}
    found = {name: how | meanings.get(name, {}) for name, how in maps.items()}
    for how in found.values():
        for channel in how.get("channels", {}).values():
            channel.update(meanings.get(channel.get("map", ""), {}))
    return found


@dataclass(frozen=True)
class PastBake:
    """A finished bake: its objects and settings. method: AUTO if Flatten left texels to rays. distances: of its rays, in scene
    units; empty without rays."""

    job: Job
    settings: Settings
    method: str
    distances: dict[str, float]
    tiles: list[int]

    @classmethod
    def of(cls, report: Report) -> "PastBake":
        """The bake of a report, also of one from a file. Raises BakeError if one of its objects was deleted."""
        names = [report.low, *report.high, *([report.cage] if report.cage else [])]
        refs = report.refs or [ObjectRef(0, name) for name in names]
        low, *others = (ref.resolve() for ref in refs)
        highs, cages = others[: len(report.high)], others[len(report.high) :]
        settings = Settings.of_json(report.settings)
        job = Job(low, highs, *cages)
        if report.slots:
            job.texture_set = MaterialSet(report.material, tuple(report.slots))
        method = Method.AUTO if report.rays else report.method
        return cls(job, settings, method, report.distances, report.tiles)
