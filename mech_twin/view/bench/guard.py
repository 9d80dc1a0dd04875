# SPDX-License-Identifier: Apache-2.0
"""Access rules of a server on this machine: hosts, origins, sizes and times.

::

    request --> Host one of ours? --> Origin none or ours? --> GET? --> page, the same for everybody
                     | no                  | no                 | no
                    403                   403                  405
"""

import asyncio
import ipaddress
import logging
import socket
import time
from collections.abc import Mapping
from pathlib import Path

from aiohttp import hdrs, web
from aiohttp.typedefs import Handler, Middleware

SILENT_S = 5.0  # a connection without a request, or that does not read its response, is closed
LOOK_S = 0.5
PIECE_BYTES = 1 << 20
MOST_CONNECTIONS = 64
LONGEST_LINE = 4096
HEADERS = {
    "Cache-Control": "no-store",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Referrer-Policy": "no-referrer",
    "X-Content-Type-Options": "nosniff",
    "X-Frame-Options": "DENY",
}


def silent_logger() -> logging.Logger:
    """Return a logger without output: foreign requests are not shown at the terminal of a run."""
    logger = logging.Logger("mech_twin.bench.strangers", logging.CRITICAL + 1)
    logger.addHandler(logging.NullHandler())
    return logger


def is_own_host(host: str, port: int, *, others: bool) -> bool:
    """Return whether a Host header names this server.

    A DNS name that could be rebound to this host is refused; an address cannot be rebound.  With ``others`` any
    address and the name of this machine are valid.
    """
    name, _, named_port = host.rpartition(":")
    if named_port != str(port):
        return False
    if not others:
        return name in ("127.0.0.1", "localhost")
    try:
        ipaddress.ip_address(name.strip("[]"))
    except ValueError:
        return name in ("localhost", socket.gethostname(), socket.getfqdn())
    return True


def content_policy(host: str) -> str:
    """Return the Content-Security-Policy of a page: scripts, styles and connections of this server only."""
    return (
        "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data: blob:; "
        f"connect-src 'self' ws://{host}; frame-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
    )


async def sent_file(
    request: web.Request, file: Path, kind: str, headers: Mapping[str, str], limit_s: float
) -> web.StreamResponse:
    """Send a file while its connection counts as busy: the watch would cut one that aiohttp sends after the handler."""
    answer = web.StreamResponse(headers={**HEADERS, **headers})
    answer.content_type, answer.content_length = kind, file.stat().st_size
    await answer.prepare(request)
    async with asyncio.timeout(limit_s):
        with file.open("rb") as content:
            while piece := await asyncio.to_thread(content.read, PIECE_BYTES):
                await answer.write(piece)
    return answer


class Guard:
    """The access rules of one server as aiohttp middleware, and the supervision of its connections."""

    def __init__(self, *, others: bool) -> None:
        self._others = others
        self.port = 0
        self._busy: set[web.RequestHandler] = set()
        self._seen_s: dict[web.RequestHandler, float] = {}

    @property
    def middleware(self) -> Middleware:
        """Check every request."""

        @web.middleware
        async def guarded(request: web.Request, handler: Handler) -> web.StreamResponse:
            refusal = self._refusal(request)
            if refusal is not None:
                return refusal
            self._busy.add(request.protocol)
            try:
                return await handler(request)
            except web.HTTPException as error:
                return plain(error.status, error.reason)
            finally:
                self._busy.discard(request.protocol)
                self._seen_s[request.protocol] = time.monotonic()

        return guarded

    async def watch(self, server: web.Server) -> None:
        """Close connections that are silent too long, and the oldest silent ones if too many; never returns."""
        while True:
            now = time.monotonic()
            idle = [each for each in server.connections if each not in self._busy]
            self._seen_s = {each: self._seen_s.get(each, now) for each in idle}
            idle.sort(key=lambda each: self._seen_s[each])
            surplus = max(0, len(server.connections) - MOST_CONNECTIONS)
            for place, each in enumerate(idle):
                if place < surplus or now - self._seen_s[each] > SILENT_S:
                    each.force_close()
                    if each.transport is not None:
                        each.transport.abort()
            await asyncio.sleep(LOOK_S)

    def _refusal(self, request: web.Request) -> web.Response | None:
        host = request.headers.get(hdrs.HOST, "")
        if not is_own_host(host, self.port, others=self._others):
            return plain(403, "expected the address of this server as host")
        origin = request.headers.get(hdrs.ORIGIN)
        if origin is not None and origin != f"http://{host}":
            return plain(403, "requests of other pages are refused")
        if request.method != hdrs.METH_GET:
            return plain(405, "expected GET")
        return None


def plain(status: int, text: str) -> web.Response:
    """Return a plain text response of one line."""
    return web.Response(status=status, text=f"{text}\n", headers=HEADERS | {"Connection": "close"})
