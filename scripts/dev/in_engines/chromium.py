# SPDX-License-Identifier: GPL-3.0-or-later
"""Engines in a headless Chromium: their npm packages in a temporary folder, and a local page that posts floats."""

import json
import os
import shutil
import subprocess
import tempfile
import threading
from collections.abc import Callable
from dataclasses import dataclass
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from urllib.parse import unquote

import numpy as np

PAGES = Path(__file__).resolve().parent / "pages"
PACKAGES = {
    "three": "0.187.0",
    "@babylonjs/core": "9.34.0",
    "@babylonjs/loaders": "9.28.0",
    "@khronosgroup/gltf-viewer": "1.1.0",
}
"""The npm packages and their versions."""
ENGINES = "three", "babylon", "khronos"
"""The engines, by the names of the declared target engines. A page of the same name drives each."""
WITHOUT_OBJECT_SPACE = {"khronos"}
"""Engines without object-space normal maps. They show such a map as a surface's colors."""
NORMAL, COLOR, SURFACE = OUTPUTS = "normal", "color", "surface"
"""What a picture of an engine's shader holds: world-space normals as normal * 0.5 + 0.5; the base color, linear; occlusion,
roughness and metallic in red, green and blue."""
KINDS = {".js": "text/javascript", ".html": "text/html", ".wasm": "application/wasm", ".json": "application/json"}
CHROMIUMS = "chromium", "chromium-browser", "google-chrome", "chrome"
OPTIONS = (
    *("--headless", "--no-first-run", "--disable-dev-shm-usage", "--disable-background-networking"),
    *("--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"),
)
MOST_SECONDS = 600.0


class NoEngine(Exception):
    """Something that the engines need is not there. Its text says what, and how to get it."""


@dataclass(frozen=True)
class Model:
    """A .glb for an engine.

    kind: "object" for an object-space map, otherwise "tangent". outputs: of OUTPUTS, what to draw. map: the ending and the
    content of a file that three.js shows in place of the normal map, by texel; "f32" for square floats, the top row first.
    """

    name: str
    content: bytes
    kind: str = "tangent"
    outputs: tuple[str, ...] = (NORMAL,)
    map: tuple[str, bytes] | None = None


def find_chromium() -> str:
    """The path of a Chromium. Raises NoEngine if there is none."""
    found = next(filter(None, map(shutil.which, CHROMIUMS)), None)
    if found is None:
        raise NoEngine("no Chromium is installed: apt-get install chromium")
    return found


def install(folder: Path) -> Path:
    """Install the packages into a folder, unless they are there, and return the folder with the modules. Raises NoEngine."""
    modules = folder / "node_modules"
    if all(installed_version(modules, name) == version for name, version in PACKAGES.items()):
        return modules
    if shutil.which("npm") is None:
        raise NoEngine("npm is not installed: apt-get install npm")
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "package.json").write_text("{}", encoding="utf-8")
    # The loaders of Babylon.js have fewer releases than its core, and name a later version of the core as their peer.
    options = ["--no-audit", "--no-fund", "--ignore-scripts", "--legacy-peer-deps", "--prefix", str(folder)]
    wanted = [f"{name}@{version}" for name, version in PACKAGES.items()]
    command = [shutil.which("npm"), "install", *options, *wanted]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode:
        raise NoEngine(f"npm could not install the engines: {done.stderr.strip()}")
    return modules


def installed_version(modules: Path, name: str) -> str | None:
    about = modules / name / "package.json"
    return json.loads(about.read_text(encoding="utf-8"))["version"] if about.is_file() else None


class Server(ThreadingHTTPServer):
    """Serves the page, the packages and the models, and keeps what the page posts."""

    daemon_threads = True

    def __init__(
        self, modules: Path, job: dict, models: list[Model], keep: Callable[[str, int, str, np.ndarray], None]
    ):
        super().__init__(("127.0.0.1", 0), _Handler)
        self.modules, self.job, self.keep = modules.resolve(), job, keep
        self.models = {f"{model.name}.glb": model.content for model in models}
        self.maps = {f"{model.name}.{model.map[0]}": model.map[1] for model in models if model.map}
        self.tangents: dict[str, list[list[float] | None]] = {}
        self.ended, self.failure = threading.Event(), ""

    def found(self, path: str) -> tuple[bytes, str] | None:
        """The content and the kind of what a path names."""
        first, _, rest = unquote(path).lstrip("/").partition("/")
        if first == "job":
            return json.dumps(self.job).encode(), KINDS[".json"]
        if first == "glb" and rest in self.models:
            return self.models[rest], "model/gltf-binary"
        if first == "map" and rest in self.maps:
            return self.maps[rest], "application/octet-stream"
        top = {"pages": PAGES, "npm": self.modules}.get(first)
        file = (top / rest).resolve() if top else PAGES / "index.html"
        if (top and not file.is_relative_to(top)) or (first and not top) or not file.is_file():
            return None
        return file.read_bytes(), KINDS.get(file.suffix, "application/octet-stream")

    def take(self, path: str, body: bytes) -> None:
        """Keep what the page has posted."""
        first, *rest = unquote(path).strip("/").split("/")
        if first == "result":
            size = self.job["size"]
            self.keep(rest[0], int(rest[1]), rest[2], np.frombuffer(body, np.float32).reshape(size, size, 4))
        elif first == "tangents":
            self.tangents[rest[0]] = json.loads(body)
        elif first in {"failed", "done"}:
            self.failure = body.decode(errors="replace")
            self.ended.set()


class _Handler(BaseHTTPRequestHandler):
    protocol_version = "HTTP/1.1"
    server: Server

    def do_GET(self) -> None:
        found = self.server.found(self.path.partition("?")[0])
        content, kind = found or (b"", "text/plain")
        self._answer(200 if found else 404, content, kind)

    def do_POST(self) -> None:
        body = self.rfile.read(int(self.headers["Content-Length"]))
        self._answer(200, b"", "text/plain")
        self.server.take(self.path, body)

    def _answer(self, code: int, content: bytes, kind: str) -> None:
        self.send_response(code)
        self.send_header("Content-Type", kind)
        self.send_header("Content-Length", str(len(content)))
        self.end_headers()
        self.wfile.write(content)

    def log_message(self, *_) -> None:
        pass


def render(
    modules: Path,
    engine: str,
    models: list[Model],
    *,
    views: int,
    size: int,
    keep: Callable[[str, int, str, np.ndarray], None],
) -> dict[str, list[list[float] | None]]:
    """Let an engine draw the models with each of their cameras.

    keep(name, view, output, pixels) gets the pixels (size, size, 4) float32 of one of OUTPUTS, bottom row first, and alpha 0
    where there is nothing. Returns the tangents that the engine has loaded, four numbers each, by the names of the models and
    their parts; None for a part without. Raises NoEngine if the page fails.
    """
    names = [
        {"name": model.name, "kind": model.kind, "outputs": model.outputs, "map": model.map and model.map[0]}
        for model in models
    ]
    job = {"engine": engine, "size": size, "views": views, "models": names, "right_handed": True}
    with (
        Server(modules, job, models, keep) as server,
        tempfile.TemporaryDirectory() as profile,
        tempfile.TemporaryFile("w+") as said,
    ):
        threading.Thread(target=server.serve_forever, daemon=True).start()
        url = f"http://127.0.0.1:{server.server_port}/"
        command = [find_chromium(), *OPTIONS, f"--user-data-dir={profile}", "--enable-logging=stderr"]
        # Chromium's sandbox refuses to start as root, as in containers. The page is our own.
        command += ["--no-sandbox", url] if hasattr(os, "geteuid") and os.geteuid() == 0 else [url]
        browser = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=said)
        try:
            ended = server.ended.wait(MOST_SECONDS)
        finally:
            browser.terminate()
            browser.wait()
            server.shutdown()
        if not ended or server.failure:
            said.seek(0)
            last = [line for line in said.read().splitlines() if "CONSOLE" in line][-5:]
            raise NoEngine("\n".join([f"{engine}: {server.failure or 'no end after the longest time'}", *last]))
        return server.tangents
