# SPDX-License-Identifier: GPL-3.0-or-later
"""The command `mcp`: a server of tools for agents, by the Model Context Protocol over the standard streams."""

import os
import sys
from collections.abc import Sequence
from typing import Any

from ..core import versions
from ..core.errors import BakeError, WrongPlace
from . import agent_tools
from .agent_tools import Place
from .commands import MCP
from .run_report import DONE

CURE = "python -m pip install 'mcp>=2,<3'"


def run(words: Sequence[str], program: str) -> int:
    """Serve until the client ends. Returns the exit code. Raises SystemExit, WrongUsage, BakeError, WrongPlace."""
    options = MCP.parser(program).parse_args(words)
    root = os.path.realpath(options.root)
    if not os.path.isdir(root):
        raise WrongPlace(f"There is no folder {root!r}.")
    place = Place(root, options.untrusted, options.timeout or agent_tools.SECONDS)
    try:
        import anyio
        import mcp.server  # noqa: F401
        import mcp_types  # noqa: F401  - of version 2
    except ImportError as error:
        python = sys.executable or "python"
        raise BakeError(
            f"The server needs the official SDK of the Model Context Protocol: {CURE.replace('python', python, 1)}."
        ) from error
    anyio.run(_serve, place)
    return DONE


async def _serve(place: Place) -> None:
    import anyio
    from mcp.server.stdio import stdio_server

    served = server(place)
    async with stdio_server(stdout=anyio.wrap_file(sys.stdout)) as (received, sent):
        await served.run(received, sent, served.create_initialization_options())


def server(place: Place) -> Any:
    """The server of the SDK."""
    import anyio
    import mcp_types as types
    from mcp.server import Server

    async def list_tools(*_: object) -> Any:
        return types.ListToolsResult(
            tools=[
                types.Tool(name=name, description=tool.about, input_schema=tool.schema)
                for name, tool in agent_tools.TOOLS.items()
            ]
        )

    async def call_tool(_: object, params: Any) -> Any:
        answer = await anyio.to_thread.run_sync(agent_tools.call, place, params.name, params.arguments)
        content: list[Any] = [types.TextContent(type="text", text=answer.text)]
        if answer.png:
            content.append(types.ImageContent(type="image", data=_base64(answer.png), mime_type="image/png"))
        return types.CallToolResult(content=content, is_error=answer.is_error)

    about = (
        "Imprint bakes the detail of high meshes into maps of low ones on the GPU, and makes game assets of high meshes. "
        f"All paths are below {place.outputs if place.untrusted else place.root}. First check, then bake or asset, then look "
        "at the picture and read the warnings."
    )
    return Server(
        "imprint", version=versions.line(), instructions=about, on_list_tools=list_tools, on_call_tool=call_tool
    )


def _base64(data: bytes) -> str:
    import base64

    return base64.b64encode(data).decode("ascii")
