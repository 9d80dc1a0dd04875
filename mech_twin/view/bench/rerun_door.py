# SPDX-License-Identifier: Apache-2.0
"""rerun's viewer for the run on a bench: serves its files, and the run as a recording over a connection for each page.

The viewer's files are extracted from the wheel on first request; its page needs the token like every other.

The program of rerun embeds them, and serves them briefly on the loopback only.
"""

import asyncio
import json
import os
import socket
import subprocess
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from functools import partial
from importlib.util import find_spec
from mmap import ACCESS_READ, mmap
from pathlib import Path
from typing import Any
from urllib.error import URLError
from urllib.request import urlopen

from aiohttp import web

from mech_twin.errors import ViewerError
from mech_twin.view.bench.guard import content_policy, plain, sent_file
from mech_twin.view.bench.picture import Pictures

VIEWER_FILES = ("re_viewer.js", "re_viewer_bg.wasm")
LOOPBACK = "127.0.0.1"
OWN_PLACES = ("HOME", "XDG_CONFIG_HOME", "XDG_DATA_HOME", "XDG_CACHE_HOME")
UP_LIMIT_S, FETCH_LIMIT_S, LOOK_S = 20.0, 60.0, 0.05
PAGE = "rerun.html"
SLOW_S = 60.0  # time limit for a file or a piece: with software rendering the viewer starts slowly
APART_S = 0.1  # time between two pieces of a recording
MOST_VIEWERS = 2  # the pictures are converted for each separately
KINDS = {".js": "text/javascript", ".wasm": "application/wasm"}


def fetch_viewer(folder: Path) -> None:
    """Copy the viewer's files to a folder, after a check that the program contains them.

    The check is needed because another user of this computer could take the port before the program does.  The program
    also keeps its settings in that folder, with usage analytics disabled.

    Raises
    ------
    ViewerError
        rerun is not installed, or its program serves nothing; one line.
    """
    found = find_spec("rerun_cli")
    if found is None or found.origin is None:
        raise ViewerError("view: rerun is not installed: pip install 'mech_twin[view]'")
    program = Path(found.origin).parent / "rerun"
    folder.mkdir(parents=True, exist_ok=True)
    env = os.environ | {name: str(folder) for name in OWN_PLACES}
    try:
        subprocess.run([program, "analytics", "disable"], check=True, env=env, timeout=UP_LIMIT_S, capture_output=True)
    except (OSError, subprocess.SubprocessError) as reason:
        raise ViewerError(f"view: {program} does not run: {reason}") from reason
    ports = _free_ports(2)
    words = ["--serve-web", "--bind", LOOPBACK, "--port", str(ports[0]), "--web-viewer-port", str(ports[1])]
    with subprocess.Popen([program, *words], env=env, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as server:
        try:
            for name in VIEWER_FILES:
                content = _served(server, f"http://{LOOPBACK}:{ports[1]}/{name}")
                keep_own(program, content, folder / name)
        finally:
            server.kill()


def keep_own(program: Path, content: bytes, file: Path) -> None:
    """Write content to a file, atomically, if a program contains it; else raise a ViewerError."""
    with program.open("rb") as stream, mmap(stream.fileno(), 0, access=ACCESS_READ) as inside:
        if not content or inside.find(content) < 0:
            raise ViewerError(f"view: {file.name} was served by another program than {program}")
    unfinished = file.with_suffix(".part")
    unfinished.write_bytes(content)
    unfinished.replace(file)


def _served(server: subprocess.Popen[bytes], address: str) -> bytes:
    """Return the content at an address, as soon as the server answers."""
    end = time.monotonic() + UP_LIMIT_S
    while True:
        try:
            with urlopen(address, timeout=FETCH_LIMIT_S) as answer:
                return bytes(answer.read())
        except (URLError, ConnectionError) as reason:
            if server.poll() is not None or time.monotonic() > end:
                raise ViewerError(f"view: rerun's viewer is not served: {reason}") from reason
            time.sleep(LOOK_S)


def _free_ports(count: int) -> list[int]:
    sockets = [socket.create_server((LOOPBACK, 0)) for _ in range(count)]
    ports = [int(each.getsockname()[1]) for each in sockets]
    for each in sockets:
        each.close()
    return ports


class _Viewer:
    """An open viewer: its queue of pictures."""

    def __init__(self, most_bytes: int) -> None:
        self.pending = Pictures(most_bytes)
        self.wake = asyncio.Event()
        self.is_new = True  # needs a new recording


class RerunDoor:
    """Serves the viewer, whose files go to a folder of this user alone, and the run."""

    def __init__(self, folder: Path, states: Mapping[str, str], history: Pictures) -> None:
        self._folder, self._states, self._history = folder, states, history
        self.viewers: list[_Viewer] = []
        self._fetching = asyncio.Lock()

    def show(self, picture: bytes) -> None:
        """Add a picture of the run."""
        for viewer in self.viewers:
            viewer.pending.add(picture)
            viewer.wake.set()

    def begin_anew(self) -> None:
        """Clear the run so far: another starts, or other curves."""
        for viewer in self.viewers:
            viewer.pending.clear()
            for picture in self._history:
                viewer.pending.add(picture)
            viewer.is_new = True
            viewer.wake.set()

    async def serve_file(self, request: web.Request) -> web.StreamResponse:
        """Serve a file of the viewer."""
        file = self._folder / request.match_info["name"]
        async with self._fetching:
            if not file.is_file():
                try:
                    await asyncio.to_thread(fetch_viewer, self._folder)
                except ViewerError as error:
                    return plain(404, str(error))
        return await sent_file(request, file, KINDS[file.suffix], {}, SLOW_S)

    async def serve_run(self, _: web.Request, socket: web.WebSocketResponse) -> None:
        """Send the run so far and its continuation, until the page disconnects."""
        viewer = _Viewer(self._history.most_bytes)
        self.viewers.append(viewer)
        pump = asyncio.ensure_future(self._pumped(socket, viewer))
        self.begin_anew()
        try:
            async for _message in socket:
                pass
        finally:
            pump.cancel()
            self.viewers.remove(viewer)

    async def _pumped(self, socket: web.WebSocketResponse, viewer: _Viewer) -> None:
        convert: Callable[[Sequence[Mapping[str, Any]]], bytes] | None = None
        with suppress(TimeoutError, ConnectionError):
            while True:
                await viewer.wake.wait()
                viewer.wake.clear()
                while len(viewer.pending) and "layout" in self._states:
                    if convert is None or viewer.is_new:
                        viewer.is_new = False
                        convert = await asyncio.to_thread(partial(_converter, dict(self._states)))
                    pictures = viewer.pending.take()
                    body = await asyncio.to_thread(_converted, convert, pictures)
                    async with asyncio.timeout(SLOW_S):
                        await socket.send_bytes(body)
                await asyncio.sleep(APART_S)


def viewer_policy(host: str) -> str:
    """Return the content policy of the viewer's page: WebAssembly is allowed, and embedding in this server's pages."""
    policy = content_policy(host).replace("script-src 'self'", "script-src 'self' 'wasm-unsafe-eval'")
    return policy.replace("frame-ancestors 'none'", "frame-ancestors 'self'")


def _converter(states: Mapping[str, str]) -> Callable[[Sequence[Mapping[str, Any]]], bytes]:
    from mech_twin.view.rerun_pictures import converter

    machine = json.loads(states.get("machine", "{}"))
    return converter(machine.get("name", "mech_twin"), json.loads(states["layout"])["panels"])


def _converted(convert: Callable[[Sequence[Mapping[str, Any]]], bytes], pictures: Sequence[bytes]) -> bytes:
    """Return the next piece of a recording; of two runs in one view it contains only the first."""
    return convert([each for each in map(json.loads, pictures) if not each.get("side")])
