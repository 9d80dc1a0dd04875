# SPDX-License-Identifier: Apache-2.0
"""A page served by the bench: its queue of messages, its drawing rate, and the form of its orders."""

import asyncio
import json
import math
from collections import deque
from collections.abc import Callable, Mapping
from typing import Any

from aiohttp import web

from mech_twin.view.bench.picture import Pictures

SEND_S = 5.0  # a page that does not accept a message within this time counts as closed


class OrderError(Exception):
    """A refused order; the message is one line for its sender."""


class BenchPage:
    """A connected page, authenticated by the token."""

    def __init__(self, socket: web.WebSocketResponse, pending_bytes: int, abort: Callable[[], None]) -> None:
        self.socket, self.abort = socket, abort
        self.pending = Pictures(pending_bytes)
        self.outbox: deque[str] = deque(maxlen=1000)
        self.wake = asyncio.Event()
        self.is_ready = True  # for the next pictures: the last ones are drawn
        self.orders = 0
        self.is_trying = False

    def tell(self, message: Mapping[str, Any] | str) -> None:
        """Queue a message."""
        self.outbox.append(message if isinstance(message, str) else json.dumps(message))
        self.wake.set()

    async def pump(self) -> None:
        """Send the queued messages, pictures only as fast as the page draws them."""
        while True:
            await self.wake.wait()
            self.wake.clear()
            while self.outbox:
                await self._send(self.outbox.popleft())
            if self.is_ready and len(self.pending):
                self.is_ready = False
                body = b",".join(self.pending.take()).decode()
                await self._send(f'{{"kind":"pictures","list":[{body}]}}')

    async def _send(self, text: str) -> None:
        async with asyncio.timeout(SEND_S):
            await self.socket.send_str(text)


def check_order(message: Mapping[str, Any]) -> None:
    """Raise an OrderError unless an order has a name, values by key, and no fault or the name of one."""
    name, values, fault = message.get("name"), message.get("values", {}), message.get("fault")
    if not isinstance(name, str):
        raise OrderError("expected the name of an order")
    if not isinstance(fault, str | None):
        raise OrderError(f"{name}: expected the name of a fault")
    if not isinstance(values, dict):
        raise OrderError(f"{name}: expected values by key")
    for key, value in values.items():
        if not isinstance(value, bool | int | float | str):
            raise OrderError(f"{key}: expected a number, a word or a switch")
        if isinstance(value, float) and not math.isfinite(value):
            raise OrderError(f"{key}: expected a finite number")
