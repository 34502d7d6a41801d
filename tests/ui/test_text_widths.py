# SPDX-License-Identifier: GPL-3.0-or-later
"""No text of the panels is cut off in a sidebar of 300 pixels, in any language: names of settings, their values, buttons."""

from types import SimpleNamespace

import bpy
import pytest

from addon.core import map_types
from addon.ui import texts
from tests.support import text_widths, zoo
from tests.support.panel import use
from tests.support.panel_layout import PANELS, context_of

pytestmark = pytest.mark.usefixtures("registered")

SIDEBAR = 300
LANGUAGES = ["en", *texts.locales()]


@pytest.fixture(params=LANGUAGES)
def known(request, monkeypatch):
    """The translations of a language, in which labels and messages are drawn."""
    found = texts.read_translations(request.param) if request.param != "en" else {}

    def looked_up(text, context):
        return found.get((context, text), text)

    translations = SimpleNamespace(pgettext_iface=looked_up, pgettext_tip=looked_up)
    monkeypatch.setattr(
        texts, "bpy", SimpleNamespace(app=SimpleNamespace(translations=translations), context=bpy.context)
    )
    return found


def states():
    """The settings of each look of the panels that has more rows than the usual one."""
    yield {}
    yield {"pack": "CUSTOM", "maps": set(map_types.NAMES), "ao_limited": True, "texture_sets": False}
    yield {"thickness_limited": True, "curvature_limited": True, "measure": False, "limited": True, "depth": "8"}
    yield {"storage": "FILE", "output": "//a.png", "udim": True, "square": False}


def test_no_text_is_cut_off_in_a_narrow_sidebar(known):
    low, high = zoo.plane("lo"), zoo.plane("hi", 2)
    found = {}
    for values in states():
        use(low, size=16, method="CAST", **values)
        bpy.context.scene.imprint.highs.clear()
        use(None, high)
        for panel in PANELS:
            context = context_of(SIDEBAR)
            if not hasattr(panel, "poll") or panel.poll(context):
                cut = text_widths.cut_texts(panel, context, known, SIDEBAR)
                found.setdefault(panel.bl_label, {}).update(dict.fromkeys(cut))
    found = {name: list(cut) for name, cut in found.items() if cut}
    assert found == {}


def test_paragraphs_are_as_wide_as_there_is_room():
    size = texts.font_size(1.0)
    text = "WWWW " * 20 + "iiii " * 20 + "/a/path/without/a/space" * 6
    lines = texts.wrapped(text, 200.0, size)
    assert "".join(lines).replace(" ", "") == text.replace(" ", "")
    widths = [texts.text_width(line, size) for line in lines]
    assert max(widths) <= 200.0
    assert sum(widths) > 0.75 * 200.0 * len(lines)
    assert texts.wrapped("", 200.0, size) == []
