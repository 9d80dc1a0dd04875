# SPDX-License-Identifier: Apache-2.0
"""Extracts the files of rerun's web viewer: its program embeds them, and serves them briefly on the loopback only."""

from __future__ import annotations

import os
import socket
import subprocess
import time
from importlib.util import find_spec
from mmap import ACCESS_READ, mmap
from pathlib import Path
from urllib.error import URLError
from urllib.request import urlopen

from mech_twin.view.errors import ViewerError

VIEWER_FILES = ("re_viewer.js", "re_viewer_bg.wasm")
LOOPBACK = "127.0.0.1"
OWN_PLACES = ("HOME", "XDG_CONFIG_HOME", "XDG_DATA_HOME", "XDG_CACHE_HOME")
UP_LIMIT_S, FETCH_LIMIT_S, LOOK_S = 20.0, 60.0, 0.05


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
    """Write content that a program contains to a file, atomically.

    Raises
    ------
    ViewerError
        The program does not contain it.
    """
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
