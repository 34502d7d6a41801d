# SPDX-License-Identifier: GPL-3.0-or-later
"""Finds texts of panels that are cut off in a narrow sidebar: a layout that lays out what is drawn about as Blender does, and
measures its texts in the letters of the interface. The sizes were read off pictures of Blender's window."""

from dataclasses import dataclass, field
from types import SimpleNamespace

import bpy

from addon.ui import texts

CONTENT = 55.0
"""What tabs and margins take of the sidebar's width, in pixels."""
LABELS = 0.4
"""The share of the width that names of properties get on the left of fields."""
BOX, ICON, CHECK, MARGIN, ARROW, SPACE = 10.0, 20.0, 17.0, 8.0, 18.0, 14.0
"""Widths in pixels: the edges of a box, an icon, a check box, what is empty beside a text, the arrow of a menu, and a separator
of the factor 1."""


@dataclass
class Item:
    """A button or a label. text: drawn in it. name: drawn on the left of it, in a split layout. beside: what else it takes."""

    text: str = ""
    name: str = ""
    beside: float = MARGIN
    is_fixed: bool = False

    @property
    def natural(self) -> float:
        """The width that it would like to have."""
        return self.beside + (width(self.text) if self.text else 0.0)

    def cut(self, space: float) -> list[str]:
        """Its texts that are cut off in a space of this width."""
        if not self.name:
            return [self.text] if self.text and self.natural > space else []
        found = [self.name] if width(self.name) + MARGIN > LABELS * space else []
        return found + ([self.text] if self.text and self.natural > (1.0 - LABELS) * space else [])


@dataclass
class Layout:
    """A part of a panel, as UILayout. known: the translations, by context and English text."""

    known: dict
    kind: str = "column"
    columns: int = 1
    use_property_split: bool = False
    factor: float = 0.5
    parts: list = field(default_factory=list)

    def _part(self, kind: str, columns: int = 1) -> "Layout":
        self.parts.append(Layout(self.known, kind, columns, self.use_property_split))
        return self.parts[-1]

    def column(self, **_):
        return self._part("column")

    def box(self):
        return self._part("box")

    def row(self, heading="", **_):
        row = self._part("row")
        if heading:
            row.parts.append(Item(name=heading))
        return row

    def grid_flow(self, columns=1, **_):
        return self._part("even", columns)

    def split(self, factor=0.5, **_):
        part = self._part("split")
        part.factor = factor
        return part

    def panel(self, _name, **_):
        return self._part("header"), self._part("column")

    def icon(self, _image):
        return 1

    def template_icon(self, icon_value, scale):
        self.parts.append(Item(beside=ICON * scale, is_fixed=True))

    def template_list(self, *_, **__):
        pass

    def separator(self, factor=1.0):
        self.parts.append(Item(beside=SPACE * factor, is_fixed=True))

    def popover(self, **_):
        self.parts.append(Item(beside=ICON, is_fixed=True))

    def menu(self, _name, **_):
        self.popover()

    def progress(self, text="", **_):
        self.parts.append(Item(text))

    def label(self, text="", icon="NONE", **_):
        self.parts.append(Item(text, beside=MARGIN + ICON * (icon != "NONE"), is_fixed=not text))

    def operator(self, name, text=None, icon="NONE", **_):
        group, operator = name.split(".")
        if text is None:
            own = getattr(getattr(bpy.ops, group), operator).get_rna_type().name
            text = self.known.get((texts.OPERATOR, own), own)
        self.parts.append(Item(text, beside=MARGIN + ICON * (icon != "NONE"), is_fixed=not text))
        return SimpleNamespace()

    def prop(self, data, name, text=None, icon="NONE", expand=False, **_):
        prop = data.bl_rna.properties[name]
        title = self.known.get((texts.LABEL, prop.name), prop.name) if text is None else text
        is_named = self.use_property_split and bool(title)
        value, beside = "", MARGIN
        if prop.type == "BOOLEAN":
            self.parts.append(_check(title, self.use_property_split, icon))
            return
        if prop.type == "ENUM" and not prop.is_enum_flag:
            items = [item.name for item in prop.enum_items_static] or [str(getattr(data, name))]
            words = [self.known.get((texts.LABEL, item), item) for item in items]
            if expand:
                row = self._part("row")
                row.parts += [Item(name=title)] if is_named else []
                row.parts += [Item(word) for word in words]
                return
            value, beside = max(words, key=width), ARROW + MARGIN
        elif not is_named and title and prop.type in {"INT", "FLOAT"}:
            value, beside = f"{title}  0.0000", 2.0 * ARROW
        self.parts.append(Item(value, title if is_named else "", beside))

    def prop_search(self, data, name, *_, **__):
        self.prop(data, name)

    def template_ID(self, _data, _name, text="", **_):
        self.parts.append(Item(name=text))

    def cut(self, space: float) -> list[str]:
        """The texts that are cut off if the part is so wide, in pixels."""
        if self.kind == "row":
            return self._cut_in_row(space)
        if self.kind == "box":
            space -= BOX
        elif self.kind == "header":
            space -= 2.0 * ICON
        elif self.kind == "even":
            space /= self.columns
        elif self.kind == "split":
            first, second = self.parts
            return first.cut(self.factor * space) + second.cut((1.0 - self.factor) * space)
        return [text for part in self.parts for text in part.cut(space)]

    def _cut_in_row(self, space: float) -> list[str]:
        names = [part.name for part in self.parts if isinstance(part, Item) and part.name]
        found = [name for name in names[:1] if width(name) + MARGIN > LABELS * space]
        left = space * (1.0 - LABELS if names else 1.0)
        left -= sum(part.natural for part in self.parts if isinstance(part, Item) and part.is_fixed)
        rest = [part for part in self.parts if not (isinstance(part, Item) and (part.is_fixed or not part.natural))]
        whole = sum(part.natural for part in rest)
        for part in rest:
            share = left * part.natural / whole if whole else left
            if isinstance(part, Layout):
                found += part.cut(share)
            elif part.text and part.natural > share:
                found.append(part.text)
        return found

    @property
    def natural(self) -> float:
        """The width that it would like to have."""
        each = [part.natural for part in self.parts] or [0.0]
        return sum(each) if self.kind in {"row", "split"} else self.columns * max(each)


def _check(title: str, is_split: bool, icon: str) -> Item:
    """A check box, which has its name on its right, or a button with an icon alone."""
    if not title:
        return Item(beside=ICON, is_fixed=True)
    if icon != "NONE":
        return Item(title, beside=MARGIN + ICON)
    return Item(title, name="\N{ZERO WIDTH SPACE}" if is_split else "", beside=CHECK + MARGIN)


def width(text: str) -> float:
    """The width of a text of the interface, in pixels at a scale of 1."""
    return texts.text_width(text, texts.font_size(1.0))


def cut_texts(panel: type, context: SimpleNamespace, known: dict, sidebar: float) -> list[str]:
    """The texts of a panel that are cut off in a sidebar of this width."""
    layout = Layout(known)
    panel.draw(_Drawn(panel, layout), context)
    return layout.cut(sidebar - CONTENT)


class _Drawn:
    """A panel while it is drawn, with its other methods."""

    def __init__(self, panel: type, layout: Layout):
        self.panel, self.layout = panel, layout

    def __getattr__(self, name):
        found = getattr(self.panel, name)
        return found.__get__(self) if callable(found) else found
