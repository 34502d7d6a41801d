# SPDX-License-Identifier: GPL-3.0-or-later
"""A finished bake: what its report is read from, and the warnings about it, the most important first."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import gpu

from ..audit import deviations, severity
from ..audit.checks import Findings
from ..core import map_types
from ..core.errors import Fix, shorten_list
from ..core.map_types import BY_NAME, Labeled
from ..core.progress import Timings
from ..core.sentences import WRONG, Sentence
from ..core.settings import MapSettings, Settings
from ..engine import ray_maps, rounded_edges
from ..engine.planning import Plan
from ..mesh import cutouts, triangle_mesh
from ..mesh.inputs import Meshes
from ..mesh.local_space import local_space_of
from ..output.outputs import Stored
from ..passes import surface_tables
from . import map_contents, material_inputs
from .job import Request
from .state_pieces import State


@dataclass(frozen=True)
class Baked:
    """A bake whose maps are drawn and checked. core.report says which field of a report is read from where."""

    request: Request
    plan: Plan
    findings: Findings
    timings: Timings
    warnings: Sequence[Sentence] = ()
    """About the objects."""
    stored: Stored | None = None
    """None until the maps are stored."""
    notes: Sequence[str] = ()
    """Warnings about what was stored."""
    state: State | None = None
    """What was read; and the images, when they are stored. None if nobody asks, as for a file."""

    def stored_as(self, stored: Stored, notes: Sequence[str], margin: float | None = None) -> "Baked":
        """This bake after its maps were stored. margin: of the stored map, if it differs from the drawn one."""
        findings = self.findings if margin is None else replace(self.findings, margin=margin)
        state = self.state
        if state:
            noted = map_contents.note(stored.images, self.meshes.low.name, self.request.job.material)
            state = state.with_images(noted)
        return replace(self, findings=findings, state=state, stored=stored, notes=notes)

    @property
    def settings(self) -> Settings:
        return self.request.settings

    @property
    def meshes(self) -> Meshes:
        """All that were read."""
        return self.plan.read

    @property
    def labels(self) -> dict[Labeled, list[str]]:
        """As Outputs.commit takes them."""
        return {
            Labeled.OBJECTS: self.high_names,
            Labeled.MATERIALS: [material.name for material in self.meshes.materials],
            Labeled.PARTS: self.meshes.parts,
        }

    @property
    def high_names(self) -> list[str]:
        return [high.name for high in self.meshes.highs]

    @property
    def slots(self) -> list[int]:
        return list(self.request.job.slots or ())

    @property
    def tiles(self) -> list[int]:
        """Those that were stored."""
        return [tile for tile in self.plan.tiles if tile in self.stored.tiles]

    @property
    def materials(self) -> dict[str, dict[str, str]]:
        return material_inputs.ways(self.meshes, self.settings.map)

    @property
    def cut_outs(self) -> list[str]:
        return cutouts.names(self.meshes)

    @property
    def maps(self) -> dict[str, dict]:
        """Those that were stored, with what their values mean if that does not depend on other values of the bake."""
        maps = self.stored.maps
        if not any(BY_NAME[name].family in ray_maps.WITH_MEANING for name in self.settings.map.drawn_maps):
            return maps
        space = local_space_of(self.plan.meshes.highs)
        meanings = {name.lower(): how for name, how in ray_maps.meanings(self.settings, space).items()}
        maps = {name: how | meanings.get(name, {}) for name, how in maps.items()}
        for how in maps.values():
            for channel in how.get("channels", {}).values():
                channel.update(meanings.get(channel.get("map", ""), {}))
        return maps

    @property
    def backend(self) -> str:
        return gpu.platform.backend_type_get()

    @property
    def renderer(self) -> str:
        return gpu.platform.renderer_get()

    @property
    def notes_of_targets(self) -> list[str]:
        return deviations.other_greens(self.findings.targets, self.settings.map.green)

    @property
    def all_warnings(self) -> list[Sentence]:
        """The sentences that no other explains, the worst first."""
        meshes, map_settings = self.meshes, self.settings.map
        sentences = [
            *material_inputs.notes(meshes, map_settings),
            *attribute_notes(meshes, map_settings),
            *material_inputs.bare_notes(meshes, self.request.job.found_highs, map_settings),
            *slope_notes(self.settings),
            *rounded_edges.notes(self.plan.meshes, self.settings),
            *self.plan.warnings,
        ]
        return severity.remaining(
            (
                *self.warnings,
                *map(Sentence.of, sentences),
                *self.findings.warnings,
                *deviations.engine_warnings(self.findings.targets),
                *map(Sentence.of, self.notes),
            )
        )


def attribute_notes(meshes: Meshes, map_settings: MapSettings) -> list[str]:
    """The high meshes without the attribute that the attribute map shows, and attributes with values that are no numbers."""
    lacking = [
        repr(high.name) for high in meshes.highs if (triangle_mesh.ATTRIBUTE, map_settings.attribute) not in high.layers
    ]
    notes = []
    for high in meshes.highs:
        names: dict[int, str] = {}  # the attribute that is set to render can have been read by its name, too
        for (kind, name), values in high.layers.items():
            if kind == triangle_mesh.ATTRIBUTE:
                wrong = surface_tables.count_others(values)
                names[wrong] = name or names.get(wrong, "")
        notes += [
            f"The {_attribute(name)} of {high.name!r} is not finite at {wrong:,} face corners: NaN counts as 0 there, "
            f"infinity as {surface_tables.LARGEST_FINITE:,.0f}."
            for wrong, name in names.items()
            if wrong
        ]
    if lacking and map_types.ATTRIBUTE.name in map_settings.drawn_maps:
        wanted = _attribute(map_settings.attribute)
        text = f"The attribute map is black where the high mesh has no {wanted}: {shorten_list(lacking)}."
        notes.append(Sentence(text, WRONG))
    return notes


def _attribute(name: str) -> str:
    """An attribute in a sentence. name: empty for the color attribute that is set to render."""
    return f"attribute {name!r}" if name else "color attribute"


def slope_notes(settings: Settings) -> list[str]:
    """That one sample does not show the detail in a texel."""
    if settings.sampling.samples > 1 or map_types.WIDENED_ROUGHNESS.name not in settings.map.drawn_maps:
        return []
    return [Fix.SAMPLES.after("With 1 sample in a texel, widened roughness is the roughness of the material.")]
