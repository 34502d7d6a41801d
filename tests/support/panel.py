# SPDX-License-Identifier: GPL-3.0-or-later
"""Sets up what the panel bakes: slots, settings, selection and collections."""

from types import SimpleNamespace

import bpy
import pytest

from tests.support.snapshot import difference, snapshot


def use(
    low: bpy.types.Object | None = None, *highs: bpy.types.Object, size: int = 0, **values
) -> bpy.types.PropertyGroup:
    """Fill slots of the panel, and set settings. size: of both sides of the map. Returns the settings of the scene."""
    settings = bpy.context.scene.imprint
    if low is not None:
        settings.low = low
    for high in highs:
        settings.highs.add().object = high
    if size:
        settings.width = settings.height = size
    for name, value in values.items():
        setattr(settings, name, value)
    return settings


def select(active: bpy.types.Object, *others: bpy.types.Object) -> None:
    """Make an object active, and select it and the others alone."""
    for obj in bpy.context.selected_objects:
        obj.select_set(False)
    for obj in (active, *others):
        obj.select_set(True)
    bpy.context.view_layer.objects.active = active


def shelve(obj: bpy.types.Object, *, is_linked: bool = True) -> bpy.types.Collection:
    """Move an object from the scene's collection into a new one. is_linked: whether the scene shows that one."""
    shelf = bpy.data.collections.new("Shelf")
    bpy.context.scene.collection.objects.unlink(obj)
    shelf.objects.link(obj)
    if is_linked:
        bpy.context.scene.collection.children.link(shelf)
    return shelf


def add(name: str, data: bpy.types.ID | None = None) -> bpy.types.Object:
    """A new object in the scene: an empty without data."""
    obj = bpy.data.objects.new(name, data)
    bpy.context.scene.collection.objects.link(obj)
    return obj


def instance_of(shelf: bpy.types.Collection, name: str) -> bpy.types.Object:
    """An empty that shows a collection."""
    empty = add(name)
    empty.instance_type, empty.instance_collection = "COLLECTION", shelf
    return empty


def refusal(operator, **arguments) -> str:
    """The message of a button that must fail and change nothing."""
    before = snapshot()
    with pytest.raises(RuntimeError) as refused:
        operator(**arguments)
    assert difference(before, snapshot()) == {}
    message = str(refused.value)
    assert message.startswith("Error: ")
    message = message.removeprefix("Error: ").strip()
    assert "Traceback" not in message
    assert "\n" not in message
    return message


def area(kind: str, size: int = 100, **space) -> SimpleNamespace:
    """An editor of the window, as far as results are shown in it."""
    return SimpleNamespace(type=kind, width=size, height=size, spaces=SimpleNamespace(active=SimpleNamespace(**space)))


def image_editor(image: bpy.types.Image | None, *, use_image_pin: bool = False) -> SimpleNamespace:
    return area("IMAGE_EDITOR", image=image, use_image_pin=use_image_pin)


def window(*areas: SimpleNamespace) -> SimpleNamespace:
    return SimpleNamespace(screen=SimpleNamespace(areas=areas))
