# SPDX-License-Identifier: Apache-2.0
"""A bench that listens in a test's own event loop, and requests to it."""

from __future__ import annotations

import asyncio
import functools
import gc
import warnings
from contextlib import asynccontextmanager
from pathlib import Path

import aiohttp

from mech_twin.view.bench.bench_page import OrderError
from mech_twin.view.bench.link import FEED
from mech_twin.view.bench.server import Bench

SECRET = "recorded in /home/someone/secret_machine"
LIMIT_S = 10.0


def in_loop(test):
    """Return a test that runs in an event loop of its own."""

    @functools.wraps(test)
    def run(*arguments, **named):
        with warnings.catch_warnings():  # pages that a test leaves open are its own, and not of a later one
            warnings.filterwarnings("ignore", "Unclosed connection", ResourceWarning)
            asyncio.run(test(*arguments, **named))
            gc.collect()

    return run


@asynccontextmanager
async def served(folder: Path, obey=None):
    """Yield a bench that listens, and the list of orders that reached the machine."""
    orders: list[dict] = []

    async def note(message):
        orders.append(dict(message))
        if message["name"] == "refuse":
            raise OrderError("value 7: expected at most 1")
        return "done"

    bench = Bench(obey or note)
    await bench.start(0, folder / FEED)
    try:
        yield bench, orders
    finally:
        await bench.stop()


async def status(bench: Bench, path: str = "/", method: str = "GET", **headers: str) -> int:
    async with (
        aiohttp.ClientSession() as session,
        session.request(method, f"http://127.0.0.1:{bench.port}{path}", headers=headers) as answer,
    ):
        return answer.status
