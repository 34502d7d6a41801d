# SPDX-License-Identifier: GPL-3.0-or-later
"""Values of node sockets as feeds, and the arithmetic that feeds can express: limits, scale and offset of one image or
attribute."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np

from ...core.material_feeds import (
    AVERAGE,
    LUMINANCE,
    LUMINANCE_WEIGHTS,
    NO_LIMITS,
    AttributeFeed,
    Constant,
    Feed,
    ImageFeed,
    Limits,
)

Function: TypeAlias = Callable[..., np.ndarray]
"""A function of (3,) float64 arrays, which works on each channel by itself."""
Texture: TypeAlias = ImageFeed | AttributeFeed
NEGLIGIBLE = 1e-3
"""What a limit or a curve changes, at most, so that it can be left out: a quarter of a level of 8 bits."""


class NotFollowedError(Exception):
    """A value that no feed can express. The message is a clause that gives the reason."""


class NotAffineError(Exception):
    """A node's value that no feed can express. The message lacks the subject, which is the node."""


@dataclass(frozen=True)
class Signal:
    """The value of a socket.

    Attributes:
        notes: What `feed` leaves out, as clauses of a sentence.
        range: Within which the numbers of its texture are, as far as that is known.
        step: The value of `feed` at which nodes make it leap from one end to the other; None if they do not.
    """

    feed: Feed
    notes: tuple[str, ...] = ()
    range: tuple[float, float] = (-np.inf, np.inf)
    step: float | None = None

    @property
    def constant(self) -> np.ndarray | None:
        """The color (3,) float64, or None if the value varies over the surface."""
        return np.array(self.feed.color[:3]) if isinstance(self.feed, Constant) else None

    @property
    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """The smallest and the largest value, (3,) each, as far as they are known."""
        if isinstance(self.feed, Constant):
            return self.constant, self.constant
        limits, scale = self.feed.limits, np.array(self.feed.scale)
        ends = np.clip(np.clip(self.range, limits.least, limits.most)[:, None], limits.low, limits.high)
        # A channel without scale is constant, whatever its texture has.
        first, last = np.multiply(ends, scale, out=np.zeros((2, 3)), where=scale != 0.0) + self.feed.offset
        return np.minimum(first, last), np.maximum(first, last)

    def noted(self, *notes: str) -> "Signal":
        return replace(self, notes=_merged(self.notes, notes))


def color(values: Sequence[float]) -> Signal:
    """A constant color, of three or four channels. Raises NotAffineError for NaN and infinite values."""
    if not np.isfinite(values).all():
        raise NotAffineError("has a value that is not finite")
    red, green, blue = (float(value) for value in values[:3])
    return Signal(Constant((red, green, blue, float(values[3]) if len(values) > 3 else 1.0)))


def number(value: float) -> Signal:
    return color((value, value, value))


def combine(function: Function, affine: set[int], signals: Sequence[Signal]) -> Signal:
    """`function` of the signals. affine: the arguments in which it is affine, the others being constant.

    Raises NotAffineError unless all signals are constant, or all but one, in which the function is affine.
    """
    varying = [i for i, signal in enumerate(signals) if signal.constant is None]
    notes = _merged(*(signal.notes for signal in signals))
    values = [signal.constant for signal in signals]
    with np.errstate(all="ignore"):
        if not varying:
            return color(function(*values)).noted(*notes)
        if len(varying) > 1:
            raise NotAffineError("combines two textures")
        (place,) = varying
        if place not in affine:
            raise NotAffineError("is not a multiple of a texture")
        at_0, at_1 = (function(*values[:place], np.full(3, end), *values[place + 1 :]) for end in (0.0, 1.0))
    return scaled(signals[place], at_1 - at_0, at_0).noted(*notes)


def scaled(signal: Signal, scale: np.ndarray, offset: np.ndarray) -> Signal:
    """`signal` * scale + offset. Raises NotAffineError for values that are not finite."""
    if isinstance(signal.feed, Constant):
        return color(signal.constant * scale + offset).noted(*signal.notes)
    if not np.any(scale):
        return color(offset).noted(*signal.notes)
    scales, offsets = np.array(signal.feed.scale) * scale, np.array(signal.feed.offset) * scale + offset
    if signal.step is not None:
        signal = replace(signal, step=signal.step * float(scale[0]) + float(offset[0]))
    return _with_factors(signal, scales, offsets)


def limited(signal: Signal, low: Sequence[float] | float, high: Sequence[float] | float) -> Signal:
    """`signal` at least `low`, and then at most `high`, numbers or (3,). Limits that a texture cannot reach are left out."""
    low, high = np.broadcast_to(low, 3), np.broadcast_to(high, 3)
    if signal.constant is not None:
        return color(np.minimum(np.maximum(signal.constant, low), high)).noted(*signal.notes)
    smallest, largest = signal.bounds
    if (smallest >= low - NEGLIGIBLE).all() and (largest <= high + NEGLIGIBLE).all():
        return signal
    feed, old = signal.feed, signal.feed.limits
    scale, offset = np.array(feed.scale), np.array(feed.offset)
    low = np.minimum(low, high)
    with np.errstate(divide="ignore", invalid="ignore"):
        ends = (low - offset) / scale, (high - offset) / scale
    is_flat = scale == 0.0
    first = np.where(is_flat, -np.inf, np.minimum(*ends))
    last = np.where(is_flat, np.inf, np.maximum(*ends))
    limits = replace(old, low=_numbers(np.clip(old.low, first, last)), high=_numbers(np.clip(old.high, first, last)))
    cut = replace(signal, feed=replace(feed, limits=limits))
    return _with_factors(cut, scale, np.where(is_flat, np.clip(offset, low, high), offset))


def component(signal: Signal, index: int) -> Signal:
    """One channel of a color or a vector, as a number."""
    if signal.constant is not None:
        return number(signal.constant[index]).noted(*signal.notes)
    feed = signal.feed
    limits = _of_channel(feed.limits, index)
    chosen = replace(signal, feed=replace(feed, channel=index if feed.channel is None else feed.channel, limits=limits))
    return _with_factors(chosen, np.full(3, feed.scale[index]), np.full(3, feed.offset[index]))


def to_number(signal: Signal, channel: int) -> Signal:
    """A color or a vector as a number. channel: LUMINANCE for colors and AVERAGE for vectors.

    Raises NotAffineError for an image whose channels have several scales or limits.
    """
    weights = np.array(LUMINANCE_WEIGHTS if channel == LUMINANCE else (1 / 3, 1 / 3, 1 / 3))
    if signal.constant is not None:
        return number(weights @ signal.constant).noted(*signal.notes)
    feed = signal.feed
    scale, offset = np.array(feed.scale), np.full(3, weights @ feed.offset)
    used = np.flatnonzero(scale)
    one = _of_channel(feed.limits, int(used[0]))
    if feed.channel is None and len(used) == 1:
        chosen = replace(signal, feed=replace(feed, channel=int(used[0]), limits=one))
        return _with_factors(chosen, np.full(3, weights[used[0]] * scale[used[0]]), offset)
    if any(_of_channel(feed.limits, int(place)) != one for place in used):
        raise NotAffineError("weighs the channels of a texture")
    if feed.channel is not None:  # three equal channels
        return _with_factors(replace(signal, feed=replace(feed, limits=one)), np.full(3, weights @ scale), offset)
    if np.ptp(scale) > 1e-6 * np.abs(scale).max():
        raise NotAffineError("weighs the channels of a texture")
    before = Limits(least=one.low[0], most=one.high[0])
    return _with_factors(replace(signal, feed=replace(feed, channel=channel, limits=before)), scale, offset)


def joined(parts: Sequence[Signal]) -> Signal:
    """A color of three numbers. Raises NotAffineError unless they are constant, or channels of one texture in its order."""
    notes = _merged(*(part.notes for part in parts))
    textures = [part.feed for part in parts if part.constant is None]
    if not textures:
        return color([part.constant[0] for part in parts]).noted(*notes)
    places = [i for i, part in enumerate(parts) if part.constant is None]
    channels = {feed.channel for feed in textures}
    if len({_without_factors(feed) for feed in textures}) > 1:
        raise NotAffineError("combines two textures")
    if len(channels) > 1 and any(feed.channel != place for feed, place in zip(textures, places, strict=True)):
        raise NotAffineError("exchanges the channels of a texture")
    channel = None if len(channels) > 1 or (len(places) == 1 and channels == set(places)) else channels.pop()
    scale = np.array([0.0 if part.constant is not None else part.feed.scale[0] for part in parts])
    offset = np.array([part.constant[0] if part.constant is not None else part.feed.offset[0] for part in parts])
    each = [NO_LIMITS if part.constant is not None else part.feed.limits for part in parts]
    limits = replace(textures[0].limits, low=tuple(one.low[0] for one in each), high=tuple(one.high[0] for one in each))
    joined = replace(parts[places[0]], feed=replace(textures[0], channel=channel, limits=limits), notes=notes)
    return _with_factors(joined, scale, offset)


def converted(signal: Signal, source: str, target: str) -> Signal:
    """`signal` of a socket of the type `source`, as Blender converts it for a socket of the type `target`.

    Raises NotAffineError for types without a conversion here.
    """
    scalars, vectors = {"VALUE", "INT", "BOOLEAN"}, {"RGBA", "VECTOR"}
    if not {source, target} <= scalars | vectors:
        raise NotAffineError(f"passes a value of the type {source.title()} to one of the type {target.title()}")
    if source in vectors and target in scalars:
        return to_number(signal, LUMINANCE if source == "RGBA" else AVERAGE)
    return signal


def is_image(signal: Signal) -> bool:
    return isinstance(signal.feed, ImageFeed)


def _with_factors(signal: Signal, scale: np.ndarray, offset: np.ndarray) -> Signal:
    if not (np.isfinite(scale).all() and np.isfinite(offset).all()):
        raise NotAffineError("has a value that is not finite")
    return replace(signal, feed=replace(signal.feed, scale=_numbers(scale), offset=_numbers(offset)))


def _of_channel(limits: Limits, index: int) -> Limits:
    """`limits` with those of one channel for all three."""
    return replace(limits, low=(limits.low[index],) * 3, high=(limits.high[index],) * 3)


def _numbers(values: np.ndarray) -> tuple[float, ...]:
    return tuple(map(float, values))


def _without_factors(feed: Texture) -> Texture:
    """The texture itself, for comparison."""
    limits = replace(feed.limits, low=NO_LIMITS.low, high=NO_LIMITS.high)
    return replace(feed, channel=None, scale=(1.0, 1.0, 1.0), offset=(0.0, 0.0, 0.0), limits=limits)


def _merged(*notes: Sequence[str]) -> tuple[str, ...]:
    return tuple(dict.fromkeys(note for several in notes for note in several))
