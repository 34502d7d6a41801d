# SPDX-License-Identifier: GPL-3.0-or-later
"""The formats of blocks, and what their encoders keep small. To add one, add it to FORMATS."""

from dataclasses import dataclass
from enum import StrEnum
from types import MappingProxyType

SIDE = 4
"""The texels along a side of a block."""


class Purpose(StrEnum):
    """What the texels of a map are, which decides the error that an encoder makes small."""

    NORMAL = "NORMAL"
    """Unit normals, as 0.5 + 0.5 n: the angle."""
    COLOR = "COLOR"
    """Colors as sRGB stores them: the squares of the differences of linear values. In BC6H, which stores colors linear, those
    of their logarithms."""
    DATA = "DATA"
    """Values as they are stored: the squares of their differences."""


@dataclass(frozen=True)
class BlockFormat:
    """A format of blocks.

    Attributes:
        name: On the command line and in job files.
        label: In the interface and the manual.
        size: The bytes of a block.
        channels: That it stores, from red on.
        dxgi: The number of the format in DDS files (DXGI_FORMAT in Microsoft's dxgiformat.h).
        vulkan: The number of the format in KTX2 files (VkFormat of Vulkan 1.0).
        dxgi_srgb, vulkan_srgb: The same for colors as sRGB stores them; None where there is no such format.
        is_float: Whether it stores floats, rather than steps from 0 to 1.
        is_signed: Whether it stores values below 0.
    """

    name: str
    label: str
    size: int
    channels: int
    dxgi: int
    vulkan: int
    dxgi_srgb: int | None = None
    vulkan_srgb: int | None = None
    is_float: bool = False
    is_signed: bool = False


BC4 = BlockFormat("bc4", "BC4", 8, 1, 80, 139)
BC5 = BlockFormat("bc5", "BC5", 16, 2, 83, 141)
BC6H = BlockFormat("bc6h", "BC6H", 16, 3, 95, 143, is_float=True)
BC7 = BlockFormat("bc7", "BC7", 16, 4, 98, 145, 99, 146)
BC6H_SIGNED = BlockFormat("bc6h-signed", "BC6H with signs", 16, 3, 96, 144, is_float=True, is_signed=True)
FORMATS = (BC4, BC5, BC6H, BC7, BC6H_SIGNED)
BY_NAME = MappingProxyType({block_format.name: block_format for block_format in FORMATS})
