# SPDX-License-Identifier: Apache-2.0
"""A bench gives no file but the one it offers, once, and opens nothing outside its folder."""

from __future__ import annotations

import asyncio

import aiohttp
import pytest

from mech_twin.nodes.run.bench_hall import DOWNLOAD, OPEN, OVERLAY, RUN, SALVAGE, Hall
from mech_twin.view.bench import server
from mech_twin.view.bench.link import FEED
from mech_twin.view.bench.server import Bench, OrderError


async def asked(bench: Bench, path: str) -> tuple[int, bytes]:
    async with aiohttp.ClientSession() as session, session.get(f"http://127.0.0.1:{bench.port}{path}") as answer:
        return answer.status, await answer.read()


def test_a_file_is_given_once_to_who_knows_its_address_and_to_nobody_later(tmp_path, monkeypatch):
    file = tmp_path / "run_0.mcap"
    file.write_bytes(b"recorded")

    async def fetch() -> None:
        bench = Bench(None)
        await bench.start(0, tmp_path / FEED)
        try:
            address = bench.offer(file)
            assert await asked(bench, f"/offer/{'0' * 43}") == (404, b"no such file\n")
            assert await asked(bench, "/offer/run_0.mcap") == (404, b"no such file\n")
            assert await asked(bench, address) == (200, b"recorded")
            assert await asked(bench, address) == (404, b"no such file\n")
            monkeypatch.setattr(server, "OFFER_S", -1.0)
            assert await asked(bench, bench.offer(file)) == (404, b"no such file\n")
        finally:
            await bench.stop()

    asyncio.run(fetch())


@pytest.mark.parametrize("order", [OPEN, OVERLAY, RUN, SALVAGE, DOWNLOAD])
@pytest.mark.parametrize("name", ["../secret", "/etc/passwd", "", None, 7, "--help", "secret.txt"])
def test_what_is_not_in_the_list_is_neither_opened_nor_run(tmp_path, order, name):
    folder = tmp_path / "recordings"
    folder.mkdir()
    for path in (tmp_path / "secret", folder / "secret.txt"):
        path.write_text("secret", encoding="utf-8")

    def never(*words):
        raise AssertionError(words)

    hall = Hall(folder, ["mb10_breaker"], "bench:nowhere", never, never, never)
    with pytest.raises(OrderError, match="expected one of the list"):
        asyncio.run(hall.obey({"name": order, "values": {"recording": name, "machine": name, "other": name}}))
