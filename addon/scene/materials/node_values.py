# SPDX-License-Identifier: GPL-3.0-or-later
"""Evaluates the sockets of shader nodes to feeds, as far as feeds can express them."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import TypeAlias

import numpy as np
from bpy.types import NodeSocket

from ..images.image_pages import ImagePages
from .node_links import Links, Place, title
from .signals import NotAffineError, NotFollowedError, Signal, color, converted, number

MOST_NODES = 60
"""The longest chain of nodes that is followed, because each takes several calls of Python's stack."""

Reading: TypeAlias = Callable[["NodeValues", Place], Signal]
"""A function that evaluates an output socket of one type of node."""


@dataclass
class NodeValues:
    """The values of the sockets of one material's nodes. It remembers them, because nodes can share inputs.

    readings: how to evaluate outputs, by type of node.
    """

    images: ImagePages
    readings: Mapping[str, Reading]
    links: Links = field(default_factory=Links)
    _known: dict[Place, Signal | NotFollowedError] = field(default_factory=dict)
    _depth: int = 0

    def read(self, place: Place) -> Signal:
        """The value of an input socket, in its own type.

        Raises NotFollowedError for what no feed can express, and NotAffineError if the node of `place` is the reason.
        """
        source = self.links.source(place)
        signal = self.output(source) if source.socket.is_output else own_value(source.socket)
        return converted(signal, source.socket.type, place.socket.type)

    def input(self, output: Place, identifier: str) -> Signal:
        """The value of an input of the node that has this output."""
        return self.read(output.input(identifier))

    def constant(self, output: Place, identifier: str) -> np.ndarray:
        """The constant value (3,) of an input. Raises NotFollowedError for an input that varies over the surface."""
        value = self.input(output, identifier).constant
        if value is None:
            raise NotFollowedError(f"a texture feeds {identifier} of {title(output.node)}")
        return value

    def output(self, place: Place) -> Signal:
        """The value of an output socket. Raises NotFollowedError for what no feed can express."""
        if place not in self._known:
            self._known[place] = self._evaluated(place)
        found = self._known[place]
        if isinstance(found, NotFollowedError):
            raise found
        return found

    def _evaluated(self, place: Place) -> Signal | NotFollowedError:
        read = self.readings.get(place.node.bl_idname)
        if read is None:
            return NotFollowedError(f"Imprint cannot follow the node {title(place.node)}")
        if self._depth == MOST_NODES:
            return NotFollowedError(f"more than {MOST_NODES} nodes follow each other")
        self._depth += 1
        try:
            return read(self, place)
        except NotAffineError as error:
            return NotFollowedError(f"the node {title(place.node)} {error}")
        except NotFollowedError as error:
            return error
        finally:
            self._depth -= 1


def own_value(socket: NodeSocket) -> Signal:
    """The value of a socket without a link. Raises NotFollowedError for a socket that has none."""
    if socket.type == "RGBA":
        return color(tuple(socket.default_value))
    if socket.type == "VECTOR":
        return color(tuple(socket.default_value)[:3])
    if socket.type in {"VALUE", "INT", "BOOLEAN"}:
        return number(float(socket.default_value))
    raise NotFollowedError(f"the socket {socket.name} has no value")
