# SPDX-License-Identifier: GPL-3.0-or-later
"""What rays cost on real meshes, counted by the shader itself: nodes of the trees, hits, and searches for owners."""

from dataclasses import replace

import bpy
import numpy as np
import pytest

from addon.core import progress, udim
from addon.core.declarations.choices import Hit
from addon.core.settings import Run, Settings
from addon.engine.baking import draw
from addon.engine.method_choice import Choice
from addon.engine.planning import Plan
from addon.passes import target
from addon.scene import reading
from tests.support import counting, lanes
from tests.support.real_meshes import open_pair

pytestmark = [pytest.mark.usefixtures("gpu_context"), pytest.mark.shared]

SIZE = 512
MOST = {
    "king_40480_4000": (17.4, 1.1, 0.4, 7.0),
    "helmet_23358_6117": (19.1, 1.1, 0.7, 10.0),
    "kepler_199712_9079": (12.1, 1.01, 0.01, 0.1),
    "sthelens_290088_9079": (12.4, 1.01, 0.01, 0.1),
}
"""The most of each of counting.COUNTS, on average over the texels: about 5 % above what was counted. Where no
other layer is near, hits need no search."""
FAST = ["king_40480_4000"]
AGAINST_OUTERMOST = 1.2
"""Factor on the nodes of the high tree that the rule of the outermost hit visits along the same rays."""
WALKED = 0.6
"""The most nodes that rays visit whose blocks were searched for together, as a share of those that they visit otherwise."""


def counts(folder, name, monkeypatch, *, has_packets=False):
    """The counts of OWN and of OUTERMOST along the same rays, (N, 4) each, on texels with a ray. has_packets: as in of_rays."""
    low, high = open_pair(folder, name)
    settings = Settings(method="CAST", space="WORLD", width=SIZE, height=SIZE)
    plan = Plan(reading.read(bpy.context, low, [high], None, settings), (udim.FIRST,), Choice("CAST"))
    ray_cast = progress.finish(draw(plan, Run(settings))).ray_cast
    drawn = target.Target(SIZE, SIZE, ("RGBA32F", "RGBA32F"))
    ray_cast.draw(drawn, udim.uv_to_clip(udim.FIRST))
    places = np.empty((SIZE, SIZE, 4), np.float32)
    drawn.read(places)
    has_ray = places[..., 3] > 0.0
    rules = ray_cast, replace(ray_cast, hit=Hit.OUTERMOST)
    return [counting.of_rays(rule, drawn, monkeypatch, has_packets=has_packets)[has_ray] for rule in rules]


@pytest.mark.parametrize("name", lanes.slow_but(FAST, MOST))
def test_owned_hits_cost_few_nodes_and_searches(shared_assets, name, monkeypatch):
    own, outermost = counts(shared_assets, name, monkeypatch)
    average, most = own.mean(axis=0), own.max(axis=0)
    for what, *figures in zip(counting.COUNTS, average, MOST[name], most, outermost.mean(axis=0), strict=True):
        print("{}: {:.3f}, allowed {}; most {:.0f}; outermost {:.3f}".format(what, *figures))
    assert average[0] > 5.0  # otherwise nothing was counted
    assert (average <= MOST[name]).all()
    assert average[0] <= AGAINST_OUTERMOST * outermost[:, 0].mean()
    assert not outermost[:, 1:].any()


@pytest.mark.parametrize("name", lanes.slow_but(FAST, MOST))
def test_rays_of_a_block_share_most_of_their_way_through_the_tree(shared_assets, name, monkeypatch):
    alone, together = (
        counts(shared_assets, name, monkeypatch, has_packets=has_packets) for has_packets in (False, True)
    )
    for rule_alone, rule_together in zip(alone, together, strict=True):
        share = rule_together[:, 0].mean() / rule_alone[:, 0].mean()
        print(f"{share:.3f} of the nodes")
        assert share <= WALKED
        # What is asked for owners stays the same, since the hits do.
        assert (rule_together[:, 1:3] == rule_alone[:, 1:3]).all()
