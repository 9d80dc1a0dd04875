# SPDX-License-Identifier: Apache-2.0
"""The rerun server as a child process, bound to the loopback interface.

The Python function that serves the viewer always binds all interfaces, and the wrapper script leaves an orphaned
server when it is killed.  Therefore the binary itself is started here; its page reaches the browser by `PageServer`.
"""

from __future__ import annotations

import http.client
import json
import os
import shutil
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from importlib.util import find_spec
from pathlib import Path
from types import TracebackType
from urllib.parse import quote

from mech_twin.dependencies import extra_needed
from mech_twin.view.flow import PageReports
from mech_twin.view.page_server import PageServer, draws_in_software

LOOPBACK = "127.0.0.1"
EVERYWHERE = "0.0.0.0"  # bound only on explicit request
STOP_LIMIT_S = 0.8


class ViewerError(RuntimeError):
    """The viewer cannot be started; the message is one line."""


def _to_stderr(line: str) -> None:
    sys.stderr.write(line + "\n")


def viewer_binary() -> Path:
    """Return the path of the viewer binary.

    Raises
    ------
    ViewerError
        The viewer package or its binary is not installed.
    """
    found = find_spec("rerun_cli")
    if found is None or found.origin is None:
        raise ViewerError(f"viewer: {extra_needed('view')}")
    binary = Path(found.origin).parent / "rerun"
    if not binary.is_file():
        raise ViewerError(f"viewer: no binary at {binary}")
    return binary


def graphics_file(directory: Path) -> Path:
    """Return the file, in a viewer's folder, that exists while the page opened last is drawn by a graphics card."""
    return directory / "graphics_card"


def free_port() -> int:
    """Return a free TCP port."""
    with socket.socket() as probe:
        probe.bind((LOOPBACK, 0))
        port: int = probe.getsockname()[1]
        return port


def _available_port(port: int | None, address: str, purpose: str) -> int:
    """Return the port to use; raise ViewerError if it is busy."""
    if port is None or port == 0:
        return free_port()
    if not 1 <= port <= 65535:
        raise ViewerError(f"viewer: {purpose} port {port}: expected 1 to 65535")
    with socket.socket() as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind((address, port))
        except OSError as reason:
            why = "is busy" if reason.errno == 98 else f"cannot be used ({reason.strerror})"
            raise ViewerError(f"viewer: {purpose} port {port} on {address} {why}; choose another one") from reason
    return port


class ViewerProcess:
    """The running server; a context manager.

    Start it from a thread that lives as long as the viewer should: with `setpriv` available, the kernel terminates the
    server when that thread ends, even if this process is killed.

    Parameters
    ----------
    port : int or None
        Port of the web page; None or 0 selects a free one.
    grpc_port : int or None
        Port that receives the samples; None or 0 selects a free one.
    open_to_other_hosts : bool
        Bind all interfaces instead of the loopback interface; a warning is announced.
    memory_limit : str
        History kept by the server for pages opened later; the oldest data is dropped first.
    newest_first : bool
        Send a page opened later the newest of that history first.
    ready_limit_s : float
        Time limit for the server to answer.
    announce : callable
        Receives the warning (default: standard error).

    Raises
    ------
    ViewerError
        Port busy, binary missing, server exited or not ready in time; one line.
    """

    def __init__(
        self,
        port: int | None = None,
        *,
        grpc_port: int | None = None,
        open_to_other_hosts: bool = False,
        memory_limit: str = "512MiB",
        newest_first: bool = False,
        ready_limit_s: float = 15.0,
        announce: Callable[[str], None] = _to_stderr,
    ) -> None:
        address = EVERYWHERE if open_to_other_hosts else LOOPBACK
        binary = viewer_binary()
        self.web_port = _available_port(port, address, "web")
        self.grpc_port = _available_port(grpc_port, address, "data")
        if self.web_port == self.grpc_port:
            raise ViewerError(f"viewer: web and data port are both {self.web_port}; choose two different ones")
        self._directory = Path(tempfile.mkdtemp(prefix="mech_twin_view_"))
        self._reports = PageReports(self._directory)
        self.files_port = free_port()
        try:
            self._process = self._started(binary, address, memory_limit, newest_first=newest_first)
            self._wait_until_ready(ready_limit_s)
            ports = (self.web_port, self.files_port, self.grpc_port)
            self._page = PageServer(address, *ports, self._note_renderer, self._reports.shown)
        except BaseException:
            self.close()
            raise
        if open_to_other_hosts:
            announce(
                f"viewer: OPEN TO OTHER HOSTS, without authentication: web page on port {self.web_port}, "
                f"its files on port {self.files_port}, data on port {self.grpc_port}, all interfaces of "
                f"{socket.gethostname()}"
            )

    _process: subprocess.Popen[bytes] | None = None
    _page: PageServer | None = None

    @property
    def grpc_url(self) -> str:
        """Address for `RerunScene`."""
        return f"rerun+http://{LOOPBACK}:{self.grpc_port}/proxy"

    @property
    def web_url(self) -> str:
        """Address to open in a browser."""
        return f"http://{LOOPBACK}:{self.web_port}/?url={quote(self.grpc_url, safe='')}&hide_welcome_screen"

    @property
    def graphics_file(self) -> Path:
        """File that exists while the page opened last is drawn by a graphics card."""
        return graphics_file(self._directory)

    @property
    def reports_directory(self) -> Path:
        """Folder of what the pages say: of `graphics_file`, and of what `Flow` reads."""
        return self._directory

    @property
    def pid(self) -> int | None:
        """Process id of the server, None if it is not running."""
        return self._process.pid if self._process is not None and self._process.poll() is None else None

    def close(self) -> None:
        """Stop the server within a second and remove its files; idempotent."""
        if self._page is not None:
            self._page.close()
            self._page = None
        if self._process is not None and self._process.poll() is None:
            self._process.terminate()
            try:
                self._process.wait(STOP_LIMIT_S)
            except subprocess.TimeoutExpired:
                self._process.kill()
                self._process.wait()
        shutil.rmtree(self._directory, ignore_errors=True)

    def __enter__(self) -> ViewerProcess:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _note_renderer(self, name: str) -> None:
        self._reports.opened()
        if draws_in_software(name):
            self.graphics_file.unlink(missing_ok=True)
        else:
            self.graphics_file.touch()

    def _started(self, binary: Path, address: str, memory_limit: str, *, newest_first: bool) -> subprocess.Popen[bytes]:
        command = [str(binary), "--serve-web", "--bind", address, "--port", str(self.grpc_port)]
        command += ["--web-viewer-port", str(self.files_port), "--server-memory-limit", memory_limit]
        command += ["--newest-first"] if newest_first else []
        setpriv = shutil.which("setpriv")
        if setpriv is not None:  # the process id stays the same: setpriv executes the binary in place
            command = [setpriv, "--pdeathsig", "TERM", "--", *command]
        with (self._directory / "log").open("wb") as log:
            # a session of its own: Ctrl-C in the terminal reaches the run alone, which then stops the server
            return subprocess.Popen(
                command,
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=log,
                env=self._environment(),
                start_new_session=True,
            )

    def _environment(self) -> dict[str, str]:
        """Return the environment of the server: a private configuration with analytics off, plain log text."""
        settings = self._directory / "rerun"
        settings.mkdir()
        content = {
            "analytics_enabled": False,
            "analytics_id": "",
            "metadata": {},
            "config_file_path": str(settings / "analytics.json"),
            "data_dir_path": str(settings / "analytics"),
        }
        (settings / "analytics.json").write_text(json.dumps(content))
        directory = str(self._directory)
        return os.environ | {
            "XDG_CONFIG_HOME": directory,
            "XDG_DATA_HOME": directory,
            "NO_COLOR": "1",
            "TELEMETRY_ENABLED": "false",
        }

    def _wait_until_ready(self, limit_s: float) -> None:
        process = self._process
        end = time.monotonic() + limit_s
        while process is not None and time.monotonic() < end:
            if process.poll() is not None:
                raise ViewerError(f"viewer: exited at once with code {process.returncode}: {self._last_log_line()}")
            if self._answers():
                return
            time.sleep(0.02)
        raise ViewerError(f"viewer: not ready after {limit_s:g} s on ports {self.files_port} and {self.grpc_port}")

    def _answers(self) -> bool:
        page = http.client.HTTPConnection(LOOPBACK, self.files_port, timeout=1.0)
        try:
            page.request("GET", "/")
            ready = page.getresponse().status == http.HTTPStatus.OK
            with socket.create_connection((LOOPBACK, self.grpc_port), timeout=1.0):
                return ready
        except (OSError, http.client.HTTPException):
            return False
        finally:
            page.close()

    def _last_log_line(self) -> str:
        lines = (self._directory / "log").read_text(errors="replace").split("\n")
        said = [line.strip() for line in lines if line.strip()]
        return said[-1] if said else "no output"
