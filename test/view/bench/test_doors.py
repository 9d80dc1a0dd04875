# SPDX-License-Identifier: Apache-2.0
"""What others on this machine, and other pages of the same browser, can do to a bench: nothing."""

from __future__ import annotations

import asyncio
import json
import os
import socket
import stat
import time
from contextlib import suppress
from pathlib import Path

import aiohttp
import pytest
from served_bench import LIMIT_S, SECRET, in_loop, served, status

from mech_twin.view.bench.guard import MOST_CONNECTIONS, SILENT_S, is_own_host
from mech_twin.view.bench.link import FEED, PREFIX, BenchLink
from mech_twin.view.bench.server import HEARTBEAT_S, LARGEST_ORDER, MOST_ORDERS, SEND_S, TOKEN_S, Bench
from mech_twin.view.bench.started import StartedBench


async def opened(session: aiohttp.ClientSession, bench: Bench, token: str | None = None, **headers: str):
    """Return the connection of a page that shows the token."""
    here = f"127.0.0.1:{bench.port}"
    page = await session.ws_connect(f"ws://{here}/feed", headers={"Origin": f"http://{here}"} | headers)
    await page.send_str(bench.token if token is None else token)
    return page


async def heard(page, kind: str) -> dict:
    """Return the next message of a kind."""
    async with asyncio.timeout(LIMIT_S):
        while True:
            message = await page.receive()
            assert message.type is aiohttp.WSMsgType.TEXT, f"closed with {message.data}, {message.extra}"
            found = json.loads(message.data)
            if found["kind"] == kind:
                return found


def deaf_page(bench: Bench) -> socket.socket:
    """Return the connection of a page that shows the token, and then reads nothing."""
    here = f"127.0.0.1:{bench.port}"
    page = socket.create_connection(("127.0.0.1", bench.port))
    fields = (f"Host: {here}", f"Origin: http://{here}", "Upgrade: websocket", "Connection: Upgrade")
    rest = ("Sec-WebSocket-Version: 13", "Sec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==")
    page.sendall("\r\n".join(["GET /feed HTTP/1.1", *fields, *rest, "", ""]).encode())
    page.recv(1024)
    token = bench.token.encode()
    page.sendall(bytes([0x81, 0x80 | len(token), 0, 0, 0, 0]) + token)  # a masked text, its mask zero
    return page


async def raw(port: int, sent: bytes, limit_s: float = LIMIT_S) -> bytes:
    """Return all a server answers to bytes until it closes."""
    reader, writer = await asyncio.open_connection("127.0.0.1", port)
    writer.write(sent)
    try:
        async with asyncio.timeout(limit_s):
            return await reader.read()
    except ConnectionError:
        return b""
    finally:
        writer.close()


@in_loop
async def test_the_page_is_the_same_for_everybody_and_holds_nothing_of_the_run(tmp_path):
    async with served(tmp_path) as (bench, _), aiohttp.ClientSession() as session:
        bench.tell("machine", {"name": SECRET})
        for name in ("", "bench.js", "bench.css", "curves.js", "drawing.js", "uplot.js", "uplot.css"):
            async with session.get(f"http://127.0.0.1:{bench.port}/{name}") as answer:
                text = await answer.text()
                assert answer.status == 200
                assert bench.token not in text
                assert SECRET not in text
                assert "frame-ancestors 'none'" in answer.headers["Content-Security-Policy"]


@pytest.mark.parametrize("token", ["", "0" * 43, "é"])
@in_loop
async def test_without_the_token_nothing_is_told_and_nothing_done(tmp_path, token):
    async with served(tmp_path) as (bench, orders), aiohttp.ClientSession() as session:
        bench.tell("machine", {"name": SECRET})
        page = await opened(session, bench, token)
        await page.send_json({"kind": "order", "id": 1, "name": "stop"})
        message = await page.receive(LIMIT_S)
        assert message.type is aiohttp.WSMsgType.CLOSE
        assert message.extra == "token"
        assert orders == []


@pytest.mark.slow
@in_loop
async def test_a_connection_that_shows_no_token_is_closed(tmp_path):
    async with served(tmp_path) as (bench, _), aiohttp.ClientSession() as session:
        here = f"127.0.0.1:{bench.port}"
        page = await session.ws_connect(f"ws://{here}/feed", headers={"Origin": f"http://{here}"})
        begin = time.monotonic()
        assert (await page.receive(LIMIT_S)).type is aiohttp.WSMsgType.CLOSE
        assert time.monotonic() - begin < TOKEN_S + 1.0


@in_loop
async def test_another_page_of_the_same_browser_can_neither_connect_nor_read_even_with_the_token(tmp_path):
    async with served(tmp_path) as (bench, orders), aiohttp.ClientSession() as session:
        for origin in ("http://evil.example", "null", f"http://127.0.0.1:{bench.port + 1}", "http://localhost"):
            with pytest.raises(aiohttp.WSServerHandshakeError) as refusal:
                await opened(session, bench, Origin=origin)
            assert refusal.value.status == 403
            assert await status(bench, Origin=origin) == 403
        with pytest.raises(aiohttp.WSServerHandshakeError):
            await session.ws_connect(f"ws://127.0.0.1:{bench.port}/feed")  # a program that names no page
        assert orders == []


@in_loop
async def test_a_name_pointed_at_this_machine_is_refused(tmp_path):
    async with served(tmp_path) as (bench, _), aiohttp.ClientSession() as session:
        for host in (
            f"evil.example:{bench.port}",
            "127.0.0.1",
            f"127.0.0.1:{bench.port + 1}",
            f"127.0.0.1.x:{bench.port}",
        ):
            assert await status(bench, Host=host) == 403
            with pytest.raises(aiohttp.WSServerHandshakeError):
                await opened(session, bench, Host=host, Origin=f"http://{host}")
        assert await status(bench, Host=f"localhost:{bench.port}") == 200


def test_where_other_hosts_may_come_an_address_is_right_and_a_foreign_name_is_not():
    for host in ("192.168.1.7", "[fe80::1]", "localhost", socket.gethostname()):
        assert is_own_host(f"{host}:80", 80, others=True)
    assert not is_own_host("evil.example:80", 80, others=True)
    assert not is_own_host("192.168.1.7:80", 80, others=False)


@pytest.mark.parametrize("method", ["POST", "PUT", "DELETE", "OPTIONS", "PATCH"])
@in_loop
async def test_only_get_is_answered(tmp_path, method):
    async with served(tmp_path) as (bench, orders):
        assert await status(bench, "/", method) == 405
        assert await status(bench, "/feed", method) == 405
        assert orders == []


@pytest.mark.parametrize(
    "sent",
    [
        b"\x00\xff\xfe\r\n\r\n",
        b"GET\r\n\r\n",
        b"GET /%00 HTTP/1.1\r\nHost: 127.0.0.1:PORT\r\n\r\n",
        b"GET /../../etc/passwd HTTP/1.1\r\nHost: 127.0.0.1:PORT\r\n\r\n",
        b"GET http://[::1 HTTP/1.1\r\nHost: 127.0.0.1:PORT\r\n\r\n",
        b"GET //[x HTTP/1.1\r\nHost: 127.0.0.1:PORT\r\n\r\n",
        b"GET /" + b"a" * 100_000 + b" HTTP/1.1\r\n\r\n",
        b"GET / HTTP/1.1\r\nHost: 127.0.0.1:PORT\r\nX: " + b"a" * 100_000 + b"\r\n\r\n",
        b"GET / HTTP/1.1\r\n" + b"X: 1\r\n" * 5000 + b"\r\n",
        b"GET / HTTP/1.1\r\nHost: 127.0.0.1:PORT\r\nContent-Length: -1\r\n\r\n",
        b"GET / HTTP/1.1\r\nHost: 127.0.0.1:PORT\r\nTransfer-Encoding: chunked\r\n\r\nZZ\r\n",
        b"GET /feed HTTP/1.1\r\nHost: 127.0.0.1:PORT\r\nOrigin: http://127.0.0.1:PORT\r\nUpgrade: websocket\r\n\r\n",
        b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n",
    ],
)
@in_loop
async def test_odd_requests_are_refused_and_leave_no_trace(tmp_path, capfd, sent):
    async with served(tmp_path) as (bench, _):
        answer = await raw(bench.port, sent.replace(b"PORT", str(bench.port).encode()))
        assert await status(bench) == 200, "it goes on to serve"
    assert not answer.startswith(b"HTTP/1.1 200")
    assert b"Traceback" not in answer
    said = capfd.readouterr()
    assert said.out + said.err == ""


@pytest.mark.slow
@in_loop
async def test_a_client_that_asks_slowly_is_closed_and_many_of_them_keep_nobody_out(tmp_path):
    async with served(tmp_path) as (bench, _):
        slow = [await asyncio.open_connection("127.0.0.1", bench.port) for _ in range(2 * MOST_CONNECTIONS)]
        for _, writer in slow:
            writer.write(b"GET / HTTP/1.1\r\nHost: ")
        await asyncio.sleep(1.5)
        assert await status(bench) == 200
        begin = time.monotonic()
        async with asyncio.timeout(3.0 * SILENT_S):
            for reader, writer in slow:
                with suppress(ConnectionError):
                    assert await reader.read() == b""
                writer.close()
        assert time.monotonic() - begin < SILENT_S + 2.0


@pytest.mark.slow
@in_loop
async def test_a_page_that_reads_nothing_is_closed_while_another_is_served(tmp_path):
    async with served(tmp_path) as (bench, _), aiohttp.ClientSession() as session:
        bench_side = [(b'{"n":%d,"pad":"' % n) + b"x" * 200_000 + b'"}' for n in range(200)]
        deaf = await asyncio.to_thread(deaf_page, bench)
        well = await opened(session, bench)
        link = await asyncio.to_thread(BenchLink, f"{PREFIX}{tmp_path / FEED}", 5.0)
        for picture in bench_side:
            assert await asyncio.to_thread(link.show, json.loads(picture))
        newest = -1
        while newest < len(bench_side) - 1:
            newest = (await heard(well, "pictures"))["list"][-1]["n"]
            await well.send_json({"kind": "drawn"})
        assert len(bench.pages) == 2
        async with asyncio.timeout(1.5 * HEARTBEAT_S + SEND_S):
            while len(bench.pages) > 1:
                await asyncio.sleep(0.1)
        await asyncio.to_thread(link.close)
        deaf.close()


@in_loop
async def test_what_is_kept_for_a_slow_page_is_bounded_and_its_newest_pictures_stay(tmp_path):
    bench = Bench(None, history_bytes=1 << 20)
    await bench.start(0, tmp_path / FEED)
    async with aiohttp.ClientSession() as session:
        page = await opened(session, bench)
        await heard(page, "role")
        link = await asyncio.to_thread(BenchLink, f"{PREFIX}{tmp_path / FEED}", 5.0)
        for n in range(100):
            assert await asyncio.to_thread(link.show, {"n": n, "pad": "x" * 100_000})
        got = []
        while not got or got[-1] < 99:
            got += [picture["n"] for picture in (await heard(page, "pictures"))["list"]]
            await page.send_json({"kind": "drawn"})
        assert got == sorted(got)
        assert len(got) < 60, "they were not dropped, so nothing bounds them"
        await asyncio.to_thread(link.close)
    await bench.stop()


@in_loop
async def test_one_page_commands_and_another_takes_over_on_request(tmp_path):
    async with served(tmp_path) as (bench, orders), aiohttp.ClientSession() as session:
        first = await opened(session, bench)
        assert (await heard(first, "role"))["commands"]
        second = await opened(session, bench)
        assert not (await heard(second, "role"))["commands"]
        await second.send_json({"kind": "order", "id": 1, "name": "stop"})
        answer = await heard(second, "answer")
        assert (answer["is_done"], answer["text"]) == (False, "another page commands; take over first")
        assert orders == []
        await second.send_json({"kind": "take"})
        assert (await heard(second, "role"))["commands"]
        await second.send_json({"kind": "order", "id": 2, "name": "stop"})
        assert (await heard(second, "answer"))["is_done"]
        assert [order["name"] for order in orders] == ["stop"]
        await heard(first, "role")
        assert not (await heard(first, "role"))["commands"]


@in_loop
async def test_a_refusal_is_told_in_the_machines_words(tmp_path):
    async with served(tmp_path) as (bench, _), aiohttp.ClientSession() as session:
        page = await opened(session, bench)
        await page.send_json({"kind": "order", "id": 5, "name": "refuse"})
        answer = await heard(page, "answer")
        assert answer == {"kind": "answer", "id": 5, "is_done": False, "text": "value 7: expected at most 1"}


@pytest.mark.parametrize(
    ("order", "expected"),
    [
        ({"name": 7}, "expected the name of an order"),
        ({"name": "change", "values": [1]}, "change: expected values by key"),
        ({"name": "change", "values": {"x": None}}, "x: expected a number, a word or a switch"),
        ({"name": "change", "values": {"x": float("nan")}}, "x: expected a finite number"),
        ({"name": "shelve", "fault": 3}, "shelve: expected the name of a fault"),
    ],
)
@in_loop
async def test_an_order_of_a_wrong_form_is_refused_before_it_reaches_the_machine(tmp_path, order, expected):
    async with served(tmp_path) as (bench, orders), aiohttp.ClientSession() as session:
        page = await opened(session, bench)
        await page.send_json({"kind": "order", "id": 1} | order)
        assert (await heard(page, "answer"))["text"] == expected
        assert orders == []


@pytest.mark.parametrize("text", ["", "[]", "7", "{}", '{"kind": 7}', "{", "null", '{"kind": ["take"]}', "[" * 4000])
@in_loop
async def test_what_is_no_message_changes_nothing(tmp_path, capfd, text):
    async with served(tmp_path) as (bench, orders), aiohttp.ClientSession() as session:
        page = await opened(session, bench)
        await page.send_str(text)
        await page.send_json({"kind": "order", "id": 1, "name": "stop"})
        assert (await heard(page, "answer"))["is_done"]
        assert len(orders) == 1
    assert capfd.readouterr().err == ""


@in_loop
async def test_orders_without_answers_do_not_pile_up_and_long_ones_end_the_connection(tmp_path):
    never = asyncio.Event()

    async def obey(message):
        await never.wait()
        return ""

    async with served(tmp_path, obey) as (bench, _), aiohttp.ClientSession() as session:
        page = await opened(session, bench)
        for n in range(MOST_ORDERS + 1):
            await page.send_json({"kind": "order", "id": n, "name": "stop"})
        answer = await heard(page, "answer")
        assert (answer["id"], answer["text"]) == (MOST_ORDERS, "too many orders at once; wait for the answers")
        await page.send_str("x" * (LARGEST_ORDER + 1))
        assert (await page.receive(LIMIT_S)).type is aiohttp.WSMsgType.CLOSE


def test_another_user_of_this_machine_finds_neither_token_nor_socket():
    with StartedBench() as bench:
        folder = Path(bench.place.removeprefix(PREFIX)).parent
        assert stat.S_IMODE(folder.stat().st_mode) == 0o700
        token = bench.url.rpartition("#")[2]
        assert len(token) > 40
        open_to_all = (
            Path(f"/proc/{bench.pid}/cmdline").read_bytes() + Path(f"/proc/{os.getpid()}/cmdline").read_bytes()
        )
        assert token.encode() not in open_to_all
        if os.geteuid() == 0:  # as another user: the folder cannot be entered, the page holds nothing
            child = os.fork()
            if child == 0:
                os.setuid(65534)
                try:
                    socket.socket(socket.AF_UNIX).connect(bench.place.removeprefix(PREFIX))
                except PermissionError:
                    os._exit(7)
                os._exit(0)
            assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 7
    assert not folder.exists()


def test_a_bench_listens_on_the_loopback_interface_alone_and_ends_with_the_run():
    with StartedBench() as bench:
        pid = bench.pid
        listening = [line.split() for line in Path("/proc/net/tcp").read_text().splitlines()[1:]]
        bound = {row[1] for row in listening if row[3] == "0A" and int(row[1].partition(":")[2], 16) == bench.port}
        assert bound == {f"0100007F:{bench.port:04X}"}
    assert not Path(f"/proc/{pid}").exists()


@pytest.mark.slow
@in_loop
async def test_a_recording_is_fetched_whole_by_a_client_that_takes_longer_than_a_silent_one_may(tmp_path):
    file, size = tmp_path / "long.mcap", 40 << 20
    file.write_bytes(os.urandom(size))
    async with served(tmp_path) as (bench, _):
        reader, writer = await asyncio.open_connection("127.0.0.1", bench.port, limit=1 << 16)
        writer.write(f"GET {bench.offer(file)} HTTP/1.1\r\nHost: 127.0.0.1:{bench.port}\r\n\r\n".encode())
        head = await reader.readuntil(b"\r\n\r\n")
        begin, held = time.monotonic(), b""
        while len(held) < size and (piece := await reader.read(1 << 20)):
            held += piece
            await asyncio.sleep(max(0.0, (SILENT_S + 2.0) * len(held) / size - (time.monotonic() - begin)))
        writer.close()
    assert b'filename="long.mcap"' in head
    assert time.monotonic() - begin > SILENT_S
    assert held == file.read_bytes()
