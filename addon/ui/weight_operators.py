# SPDX-License-Identifier: GPL-3.0-or-later
"""The operator that proposes weights for the painted vertex groups."""

import bpy

from ..core.declarations.choices import Method
from ..core.errors import BakeError
from ..core.report import Report
from ..jobs.weights import weight_proposal
from .bake_results import results
from .translations import tooltip
from .viewport.progress_display import display


class IMPRINT_OT_propose_weights(bpy.types.Operator):
    """Fill both groups with weights that leave fewer doubtful texels than the last bake had, and with 0.5 elsewhere"""

    bl_idname = "imprint.propose_weights"
    bl_label = "Propose Weights"
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        problem = _problem(results.of(context))
        if problem:
            cls.poll_message_set(tooltip(problem))
        return not problem and display.current is None

    def execute(self, context: bpy.types.Context) -> set[str]:
        report, settings = results.of(context), context.scene.imprint
        groups = {name: getattr(settings, name) for name in weight_proposal.GROUP_NAMES}
        try:
            proposal = weight_proposal.propose(context, report, groups)
        except BakeError as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        for name, group in weight_proposal.apply(report.refs[0].resolve(), proposal, groups).items():
            setattr(settings, name, group)
        share = f"{proposal.before:.2%} of the texels are doubtful"
        if proposal.after < proposal.before:
            self.report({"INFO"}, f"{share}, with the proposed weights {proposal.after:.2%}")
        else:
            self.report({"INFO"}, f"{share}, and other weights are no better: the groups are ready to be painted")
        return {"FINISHED"}


def _problem(report: Report | None) -> str:
    """Why no weights can be proposed, without a full stop; empty if they can. report: of the last bake."""
    if report is None:
        return "Bake this low object first"
    low = report.refs[0].find()
    if report.method != Method.CAST:
        return "The last bake cast no rays"
    if low.mode == "EDIT":
        return "Leave Edit Mode first"
    return "" if low.is_editable and low.data.is_editable else "The low object is linked from another file"


CLASSES = (IMPRINT_OT_propose_weights,)
register, unregister = bpy.utils.register_classes_factory(CLASSES)
