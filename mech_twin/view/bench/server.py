# SPDX-License-Identifier: Apache-2.0
"""The bench's server: forwards messages of a run to the pages, and orders of the commanding page to the machine.

The page itself contains no data of the run and is served to any request on this machine.  Everything else goes over
one connection for each page, which starts with the token of the printed address::

    run --- socket of this user ---> Bench --- pictures ---> page 1 (commands)
                                       |   <-- orders ------
    machine <--- orders ---------------+   --- pictures ---> page 2 (watches)
"""

import asyncio
import hmac
import json
import secrets
from collections.abc import Awaitable, Callable, Mapping, Sized
from contextlib import suppress
from functools import partial
from importlib.resources import files
from pathlib import Path
from typing import Any

from aiohttp import WSCloseCode, WSMsgType, web

from mech_twin.files.report_page import versions
from mech_twin.view.bench.bench_page import SEND_S, BenchPage, OrderError, check_order
from mech_twin.view.bench.guard import (
    HEADERS,
    LONGEST_LINE,
    SILENT_S,
    Guard,
    content_policy,
    plain,
    sent_file,
    silent_logger,
)
from mech_twin.view.bench.link import HEAD, LARGEST_BYTES, PICTURE
from mech_twin.view.bench.picture import Pictures
from mech_twin.view.bench.rerun_door import MOST_VIEWERS, PAGE, SLOW_S, RerunDoor, viewer_policy

FOLDER = Path(str(files("mech_twin.view.bench"))) / "page"
LOOPBACK, EVERYWHERE = "127.0.0.1", "0.0.0.0"
TOKEN_S = 3.0  # time limit for the token on a new connection
HEARTBEAT_S = 10.0
OFFER_S, FETCH_S = 60.0, 3600.0  # time limits to begin a download, and to complete it
LOOK_S = 0.02
MOST_PAGES, MOST_ORDERS = 16, 4  # pages, and unanswered orders per page
LARGEST_ORDER = 16 << 10
PENDING_BYTES = 4 << 20  # pictures queued for a page that is slower than the run
STATES = ("machine", "layout", "status", "parameters", "metrics", "alarms", "advice", "fit", "pause", "end", "health")
KEPT = (*STATES, "comparison", "hall")
KINDS = {".html": "text/html", ".js": "text/javascript", ".css": "text/css", ".svg": "image/svg+xml"}

Obey = Callable[[Mapping[str, Any]], Awaitable[str]]


class Bench:
    """The server.

    Parameters
    ----------
    obey : callable
        Executes an order and returns the machine's answer, or raises `OrderError`.
    others : bool
        Whether to listen to other hosts too.
    history_bytes : int
        Pictures kept for pages opened later.

    Attributes
    ----------
    pages : list of BenchPage
        The open pages.
    on_machine, on_frame : callable
        Take the description of the running machine, and states of its run.
    on_trial : callable or None
        Tries values that a page asks for.
    """

    def __init__(self, obey: Obey, *, others: bool = False, history_bytes: int = 32 << 20) -> None:
        self.token = secrets.token_urlsafe(32)
        self._obey = obey
        self._others = others
        self._guard = Guard(others=others)
        self._history = Pictures(history_bytes)
        self._pending_bytes = max(PENDING_BYTES, history_bytes)
        self._states = {"versions": json.dumps({"kind": "versions", "text": versions()})}
        self.pages: list[BenchPage] = []
        self._commander: BenchPage | None = None
        self._feeds: set[asyncio.StreamWriter] = set()
        self._feed: asyncio.Server | None = None
        self._runner: web.AppRunner | None = None
        self._tasks: set[asyncio.Task[None]] = set()
        self._files = {path.name: path.read_bytes() for path in FOLDER.iterdir() if path.suffix in KINDS}
        self.on_machine: Callable[[Mapping[str, Any]], None] = lambda machine: None
        self.on_frame: Callable[[dict[str, Any]], None] = lambda frame: None
        self.on_trial: Obey | None = None
        self._offers: dict[str, tuple[Path, float]] = {}
        self._rerun: RerunDoor | None = None

    @property
    def port(self) -> int:
        """TCP port of the server."""
        return self._guard.port

    async def start(self, port: int, feed: Path) -> None:
        """Listen on a TCP port (0: a free one), and on the Unix socket for runs.

        Raises
        ------
        OSError
            The port is in use.
        """
        app = web.Application(middlewares=[self._guard.middleware], client_max_size=0)
        self._rerun = door = RerunDoor(feed.parent / "rerun", self._states, self._history)
        app.router.add_get("/feed", partial(self._connect, HEARTBEAT_S, self.pages, MOST_PAGES, self._attend))
        app.router.add_get("/rerun", partial(self._connect, SLOW_S, door.viewers, MOST_VIEWERS, door.serve_run))
        app.router.add_get("/{name:re_viewer(?:[.]js|_bg[.]wasm)}", self._rerun.serve_file)
        app.router.add_get("/offer/{ticket}", self._serve_offer)
        app.router.add_get("/{name:[a-z_.]*}", self._serve_file)
        runner = web.AppRunner(
            app,
            access_log=None,
            logger=silent_logger(),
            keepalive_timeout=SILENT_S,
            max_line_size=LONGEST_LINE,
            max_field_size=LONGEST_LINE,
            lingering_time=0.0,
            shutdown_timeout=0.2,
        )
        await runner.setup()
        site = web.TCPSite(runner, EVERYWHERE if self._others else LOOPBACK, port)
        await site.start()
        self._guard.port = runner.addresses[0][1]
        self._feed = await asyncio.start_unix_server(self._hear, feed)
        self._runner = runner
        if runner.server is not None:
            self._later(self._guard.watch(runner.server))

    async def stop(self) -> None:
        """Disconnect all pages, and stop listening."""
        if self._feed is not None:
            self._feed.close()
        for writer in self._feeds:
            writer.close()
        if self._runner is not None:
            for page in self.pages:
                page.abort()
            await self._runner.cleanup()
        for task in self._tasks:
            task.cancel()
        await asyncio.gather(*self._tasks, return_exceptions=True)

    def tell(self, kind: str, content: Mapping[str, Any]) -> None:
        """Send a message to all pages, and to those opened later if it is a state."""
        text = json.dumps({"kind": kind, **content})
        if kind in KEPT:
            self._states[kind] = text
        for page in self.pages:
            page.tell(text)

    def change(self, name: str, value: Any, settings: list[list[str]]) -> None:
        """Send a new value of a live parameter, and the settings that differ; pages opened later get them as well."""
        machine = json.loads(self._states.get("machine", "{}"))
        for parameter in machine.get("parameters", []):
            if parameter["name"] == name:
                parameter["value"] = value
        self._states["machine"] = json.dumps(machine | {"settings": settings})
        self.tell("changed", {"name": name, "value": value, "settings": settings})

    async def begin_anew(self) -> None:
        """Clear the contents after the last messages of their sender."""
        with suppress(TimeoutError):
            async with asyncio.timeout(SEND_S):
                while self._feeds:
                    await asyncio.sleep(LOOK_S)
        for kind in (*STATES, "comparison"):
            self._states.pop(kind, None)
        self._take("anew", {"all": True})

    def offer(self, file: Path) -> str:
        """Offer a file for one download within a short time; return its secret address."""
        now = asyncio.get_running_loop().time()
        self._offers = {key: kept for key, kept in self._offers.items() if kept[1] > now}
        ticket = secrets.token_urlsafe(32)
        self._offers[ticket] = (file, now + OFFER_S)
        return f"/offer/{ticket}"

    # -- messages of a run --------------------------------------------------------------------------------------------

    async def _hear(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        """Process the messages of a run until the connection ends or a message is malformed."""
        self._feeds.add(writer)
        with suppress(asyncio.IncompleteReadError, ValueError, ConnectionError):
            while True:
                length, kind = HEAD.unpack(await reader.readexactly(HEAD.size))
                if length > LARGEST_BYTES:
                    break
                body = await reader.readexactly(length)
                if kind == PICTURE:
                    self._show(body)
                else:
                    message = json.loads(body)
                    self._take(message.pop("kind"), message)
        self._feeds.discard(writer)
        writer.close()

    def _show(self, picture: bytes) -> None:
        self._history.add(picture)
        for page in self.pages:
            page.pending.add(picture)
            page.wake.set()
        if self._rerun is not None:
            self._rerun.show(picture)

    def _take(self, kind: str, message: dict[str, Any]) -> None:
        if kind == "anew":  # the run was restarted: its time goes back
            self._history.clear()
            for page in self.pages:
                page.pending.clear()
        elif kind == "machine":
            self.on_machine(message)
        elif kind == "frame":
            self.on_frame(message)
            return
        self.tell(kind, message)
        if kind in ("anew", "layout") and self._rerun is not None:
            self._rerun.begin_anew()

    # -- pages --------------------------------------------------------------------------------------------------------

    async def _serve_file(self, request: web.Request) -> web.StreamResponse:
        name = request.match_info["name"] or "index.html"
        body = self._files.get(name)
        if body is None:
            return plain(404, "no such file")
        kind = KINDS.get(Path(name).suffix, "text/plain")
        host = request.headers["Host"]
        policy = {"Content-Security-Policy": content_policy(host)}
        if name == PAGE:
            policy = {"Content-Security-Policy": viewer_policy(host), "X-Frame-Options": "SAMEORIGIN"}
        return web.Response(body=body, content_type=kind, charset="utf-8", headers=HEADERS | policy)

    async def _serve_offer(self, request: web.Request) -> web.StreamResponse:
        file, until = self._offers.pop(request.match_info["ticket"], (None, 0.0))
        if file is None or until < asyncio.get_running_loop().time() or not file.is_file():
            return plain(404, "no such file")
        named = {"Content-Disposition": f'attachment; filename="{file.name}"'}
        return await sent_file(request, file, "application/octet-stream", named, FETCH_S)

    async def _connect(
        self,
        heartbeat_s: float,
        present: Sized,
        most: int,
        attend: Callable[[web.Request, web.WebSocketResponse], Awaitable[None]],
        request: web.Request,
    ) -> web.StreamResponse:
        """Attend to a page of this server over its WebSocket, which begins with the token, or refuse it."""
        if "Origin" not in request.headers:  # a browser always sends it
            return plain(403, "expected a page of this server")
        socket = web.WebSocketResponse(max_msg_size=LARGEST_ORDER, heartbeat=heartbeat_s, compress=False, timeout=1.0)
        if not socket.can_prepare(request):
            return plain(400, "expected a WebSocket")
        await socket.prepare(request)
        if not await self._has_token(socket):
            await socket.close(code=WSCloseCode.POLICY_VIOLATION, message=b"token")
        elif len(present) >= most:
            await socket.close(code=WSCloseCode.TRY_AGAIN_LATER, message=b"pages")
        else:
            await attend(request, socket)
        return socket

    async def _has_token(self, socket: web.WebSocketResponse) -> bool:
        try:
            async with asyncio.timeout(TOKEN_S):
                message = await socket.receive()
        except TimeoutError:
            return False
        given = message.data if message.type is WSMsgType.TEXT else ""
        return hmac.compare_digest(given.encode(), self.token.encode())

    async def _attend(self, request: web.Request, socket: web.WebSocketResponse) -> None:
        """Serve a page until it disconnects."""
        transport = request.transport
        page = BenchPage(socket, self._pending_bytes, lambda: None if transport is None else transport.abort())
        for text in self._states.values():
            page.tell(text)
        for picture in self._history:
            page.pending.add(picture)
        self.pages.append(page)
        if self._commander is None:
            self._commander = page
        self._tell_commander()
        pump = self._later(self._pumped(page))
        try:
            async for message in socket:
                if message.type is WSMsgType.TEXT:
                    self._listen(page, message.data)
        finally:
            pump.cancel()
            self.pages.remove(page)
            if self._commander is page:
                self._commander = None
            self._tell_commander()

    async def _pumped(self, page: BenchPage) -> None:
        try:
            await page.pump()
        except (TimeoutError, ConnectionError):
            page.abort()

    def _tell_commander(self) -> None:
        for page in self.pages:
            is_free = self._commander is None
            page.tell({"kind": "role", "commands": page is self._commander, "free": is_free, "pages": len(self.pages)})

    def _listen(self, page: BenchPage, text: str) -> None:
        try:
            message = json.loads(text)
            kind = message["kind"]
        except (ValueError, TypeError, KeyError, RecursionError):
            return
        if kind == "drawn":
            page.is_ready = True
            page.wake.set()
        elif kind == "take":
            self._commander = page
            self._tell_commander()
        elif kind == "order":
            self._order(page, message)
        elif kind == "try" and self.on_trial is not None and page is self._commander and not page.is_trying:
            page.is_trying = True
            self._later(self._tried(page, message, self.on_trial))

    def _order(self, page: BenchPage, message: Mapping[str, Any]) -> None:
        answer = {"kind": "answer", "id": message.get("id"), "is_done": False}
        if page is not self._commander:
            page.tell(answer | {"text": "another page commands; take over first"})
        elif page.orders >= MOST_ORDERS:
            page.tell(answer | {"text": "too many orders at once; wait for the answers"})
        else:
            page.orders += 1
            self._later(self._obeyed(page, message, answer))

    async def _obeyed(self, page: BenchPage, message: Mapping[str, Any], answer: dict[str, Any]) -> None:
        try:
            check_order(message)
            outcome = {"is_done": True, "text": await self._obey(message)}
        except OrderError as error:
            outcome = {"text": str(error)}
        finally:
            page.orders -= 1
        page.tell(answer | outcome)

    async def _tried(self, page: BenchPage, message: Mapping[str, Any], tried: Obey) -> None:
        """Send the result of a trial of values to the requesting page only; nothing is sent to the machine."""
        values = message.get("values", {})
        try:
            check_order({"name": "try", **message})
            page.tell(await tried(values))
        except OrderError as error:
            page.tell({"kind": "ghost", "refused": str(error), "values": values})
        finally:
            page.is_trying = False

    def _later(self, work: Awaitable[None]) -> asyncio.Task[None]:
        task = asyncio.ensure_future(work)
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)
        return task
