# SPDX-License-Identifier: GPL-3.0-or-later
"""UASTC and ETC1S in KTX2, which glTF's extension KHR_texture_basisu shows, by libktx, which Blender brings from 5.3 on.

Blender's Python has no module for it, so that its functions are called as ktx.h of version 4 declares them. It refuses
parameters of another size, by which other versions are told.
"""

import ctypes
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path

import bpy
import numpy as np

from ..core.errors import BakeError
from ..output import value_encoding
from ..scene import textures

MAGIC = b"\xabKTX 20\xbb\r\n\x1a\n"
MULTIPLE = 4
"""What the sides of textures must be multiples of, by KHR_texture_basisu."""
_PLACES = "lib/libktx.so*", "blender.shared/ktx.dll", "lib/libktx*.dylib"
"""Where Blender has the library, beside the folder of its version."""
_UNORM, _SRGB = 37, 43
"""VK_FORMAT_R8G8B8A8_UNORM and _SRGB."""
_ALLOCATED, _LOADED, _RGBA32 = 1, 1, 13
"""KTX_TEXTURE_CREATE_ALLOC_STORAGE, KTX_TEXTURE_CREATE_LOAD_IMAGE_DATA_BIT and KTX_TTF_RGBA32."""
_LEVEL, _ZSTANDARD = 2, 18
"""Of UASTC: how much is tried; of Zstandard: how far it is packed, without losses."""


class _Create(ctypes.Structure):
    """ktxTextureCreateInfo."""

    _fields_ = (
        ("glInternalformat", ctypes.c_uint32),
        ("vkFormat", ctypes.c_uint32),
        ("pDfd", ctypes.c_void_p),
        *((name, ctypes.c_uint32) for name in ("baseWidth", "baseHeight", "baseDepth", "numDimensions")),
        *((name, ctypes.c_uint32) for name in ("numLevels", "numLayers", "numFaces")),
        ("isArray", ctypes.c_bool),
        ("generateMipmaps", ctypes.c_bool),
    )


class _Parameters(ctypes.Structure):
    """ktxBasisParams."""

    _fields_ = (
        ("structSize", ctypes.c_uint32),
        *((name, ctypes.c_bool) for name in ("uastc", "verbose", "noSSE")),
        *((name, ctypes.c_uint32) for name in ("threadCount", "compressionLevel", "qualityLevel", "maxEndpoints")),
        ("endpointRDOThreshold", ctypes.c_float),
        ("maxSelectors", ctypes.c_uint32),
        ("selectorRDOThreshold", ctypes.c_float),
        ("inputSwizzle", ctypes.c_char * 4),
        *((name, ctypes.c_bool) for name in ("normalMap", "separateRGToRGB_A", "preSwizzle")),
        *((name, ctypes.c_bool) for name in ("noEndpointRDO", "noSelectorRDO")),
        ("uastcFlags", ctypes.c_uint32),
        ("uastcRDO", ctypes.c_bool),
        ("uastcRDOQualityScalar", ctypes.c_float),
        ("uastcRDODictSize", ctypes.c_uint32),
        ("uastcRDOMaxSmoothBlockErrorScale", ctypes.c_float),
        ("uastcRDOMaxSmoothBlockStdDev", ctypes.c_float),
        ("uastcRDODontFavorSimplerModes", ctypes.c_bool),
        ("uastcRDONoMultithreading", ctypes.c_bool),
    )


def check() -> None:
    """Raise BakeError if this Blender has no libktx of version 4."""
    if _library() is None:
        raise BakeError(
            "This Blender has no libktx 4, which writes KTX2 textures of .glb files: Blender 5.3 has it. Choose WebP or PNG."
        )


def encoded(texels: np.ndarray, *, is_color: bool, is_normal: bool, quality: int) -> bytes:
    """A KTX2 file with all mip levels. Raises BakeError.

    Args:
        texels: (height, width, 4) uint8, the top row first, with sides that are multiples of MULTIPLE.
        is_color: Whether values are sRGB.
        is_normal: Whether they are normals.
        quality: 100 for UASTC, below it that of ETC1S.
    """
    levels = [texels]
    while max(levels[-1].shape[:2]) > 1:
        levels.append(_halved(levels[-1], is_color=is_color, is_normal=is_normal))
    height, width = texels.shape[:2]
    about = _Create(0, _SRGB if is_color else _UNORM, None, width, height, 1, 2, len(levels), 1, 1, False, False)
    parameters = _Parameters(ctypes.sizeof(_Parameters), uastc=quality == 100, compressionLevel=2, uastcFlags=_LEVEL)
    parameters.qualityLevel, parameters.threadCount = max(1, round(quality * 2.55)), 1
    with _texture() as (library, texture):
        _call(library.ktxTexture2_Create(ctypes.byref(about), _ALLOCATED, ctypes.byref(texture)))
        for number, level in enumerate(map(np.ascontiguousarray, levels)):
            source = level.ctypes.data_as(ctypes.c_void_p)
            _call(library.ktxTexture2_SetImageFromMemory(texture, number, 0, 0, source, ctypes.c_size_t(level.nbytes)))
        _call(library.ktxTexture2_CompressBasisEx(texture, ctypes.byref(parameters)))
        if parameters.uastc:
            _call(library.ktxTexture2_DeflateZstd(texture, _ZSTANDARD))
        with tempfile.TemporaryDirectory(
            prefix="imprint-"
        ) as folder:  # memory of the library would be freed by another one
            file = Path(folder, "map.ktx2")
            _call(library.ktxTexture2_WriteToNamedFile(texture, str(file).encode()))
            return file.read_bytes()


def decoded(data: bytes) -> np.ndarray:
    """The texels (height, width, 4) uint8, the top row first, of level 0 of a file that `encoded` made. Raises BakeError."""
    width, height = (int.from_bytes(data[at : at + 4], "little") for at in (20, 24))
    with _texture() as (library, texture):
        size, start = ctypes.c_size_t(len(data)), ctypes.c_size_t()
        _call(library.ktxTexture2_CreateFromMemory(data, size, _LOADED, ctypes.byref(texture)))
        _call(library.ktxTexture2_TranscodeBasis(texture, _RGBA32, 0))
        _call(library.ktxTexture2_GetImageOffset(texture, 0, 0, 0, ctypes.byref(start)))
        values = ctypes.string_at(library.ktxTexture_GetData(texture) + start.value, width * height * 4)
    return np.frombuffer(values, np.uint8).reshape(height, width, 4)


@cache
def _library() -> ctypes.CDLL | None:
    """The library; None if it is not there, or is another version."""
    folder = Path(bpy.utils.resource_path("LOCAL")).parent
    found = next((path for place in _PLACES for path in sorted(folder.glob(place))), None)
    if found is None:
        return None
    try:
        library = ctypes.CDLL(str(found))
        library.ktxTexture_GetData.restype = ctypes.c_void_p
        library.ktxErrorString.restype = ctypes.c_char_p
        for name in (
            "Create",
            "SetImageFromMemory",
            "CompressBasisEx",
            "DeflateZstd",
            "WriteToNamedFile",
            "CreateFromMemory",
        ):
            getattr(library, f"ktxTexture2_{name}")
    except (OSError, AttributeError):
        return None
    return library


@contextmanager
def _texture() -> Iterator[tuple[ctypes.CDLL, ctypes.c_void_p]]:
    """The library, and room for one of its textures, which is freed at the end. Raises BakeError."""
    check()
    library, texture = _library(), ctypes.c_void_p()
    assert library is not None
    try:
        yield library, texture
    finally:
        if texture:
            library.ktxTexture2_Destroy(texture)


def _call(code: int) -> None:
    """Raise BakeError for a function of the library that has failed."""
    library = _library()
    if code and library is not None:
        raise BakeError(f"libktx could not make a KTX2 texture: {library.ktxErrorString(code).decode()}")


def _halved(texels: np.ndarray, *, is_color: bool, is_normal: bool) -> np.ndarray:
    """The next mip level, (max(1, height // 2), max(1, width // 2), 4) uint8: means of light, of normals, or of numbers."""
    values = texels.astype(np.float32) / np.float32(255.0)
    if is_color:
        values[..., :3] = textures.srgb_to_linear(values[..., :3])
    for axis in range(2):
        before = values.shape[axis]
        starts = np.arange(max(1, before // 2)) * before // max(1, before // 2)
        counts = np.diff([*starts, before]).astype(np.float32)
        sums = np.add.reduceat(values, starts, axis=axis)
        values = sums / (counts[:, None, None] if axis == 0 else counts[None, :, None])
    if is_normal:
        vectors = values[..., :3] * 2.0 - 1.0
        lengths = np.linalg.norm(vectors, axis=2, keepdims=True)
        values[..., :3] = 0.5 + 0.5 * np.divide(vectors, lengths, out=vectors, where=lengths > 0.0)
    if is_color:
        values[..., :3] = value_encoding.to_srgb(values[..., :3])
    return value_encoding.steps(values, 8)
