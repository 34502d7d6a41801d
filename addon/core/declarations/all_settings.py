# SPDX-License-Identifier: GPL-3.0-or-later
"""All settings, by the panels that show them."""

from dataclasses import dataclass

from .kinds import Setting
from .map_settings import CHANNELS, CONVERT, MAP, MAPS
from .object_settings import BAKE, LEVELS, PAIRS
from .output_settings import OUTPUT
from .ray_settings import RAYS


@dataclass(frozen=True)
class PanelSettings:
    """A panel's title, and its settings by their names."""

    title: str
    settings: dict[str, Setting]


PANELS = {
    "bake": PanelSettings("Imprint", BAKE),
    "map": PanelSettings("Map", MAP),
    "channels": PanelSettings("Channels", CHANNELS),
    "maps": PanelSettings("Maps", MAPS),
    "output": PanelSettings("Output", OUTPUT),
    "rays": PanelSettings("Rays", RAYS),
    "pairs": PanelSettings("Pairs by Name", PAIRS),
    "levels": PanelSettings("Levels of Detail", LEVELS),
    "convert": PanelSettings("Convert Map", CONVERT),
}
"""In the order of the sidebar."""
DECLARED: dict[str, Setting] = {name: value for panel in PANELS.values() for name, value in panel.settings.items()}
"""All settings by name."""
