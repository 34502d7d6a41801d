"""Game assets made with a tenth of the work: the meshes of tests are small, and few of them test the search itself."""

from addon.audit import appearance
from addon.jobs import asset, unwrapping
from addon.jobs.simplify import low_meshes
from addon.mesh import uv_packing


def quicken(monkeypatch, detail: appearance.Detail | None = None) -> None:
    """Look from few sides, correct once, unwrap in one way, pack by one order in larger cells, and remesh coarsely.

    Args:
        detail: how closely ways to make a low mesh are looked at; 6 views of 64 x 64 pixels if None.
    """
    monkeypatch.setattr(appearance, "USUAL", detail or appearance.Detail(6, 64))
    monkeypatch.setattr(asset, "CORRECTIONS", 1)
    monkeypatch.setattr(low_meshes, "VOXELS", 15_000)
    monkeypatch.setattr(unwrapping, "FEW", 0)
    monkeypatch.setattr(unwrapping, "PRICES", (1.0, 1.0))  # the first one is for small meshes
    monkeypatch.setattr(uv_packing, "ORDERS", 1)
    monkeypatch.setattr(uv_packing, "QUICK_CELLS", 64)
    monkeypatch.setattr(uv_packing, "CELLS", 128)
