# SPDX-License-Identifier: Apache-2.0
"""A bench gives no file but the one it offers, once, and opens nothing outside its folder."""

from __future__ import annotations

import asyncio
import json
import shutil

import aiohttp
import pytest
from foreign_bags import converted
from recordings import entries_of, simulated_bag, written_bag
from rosbags.rosbag2 import CompressionMode, StoragePlugin
from served_bench import LIMIT_S, in_loop, served

from mech_twin.nodes.run import bench_hall
from mech_twin.nodes.run.bench_hall import DOWNLOAD, OPEN, OVERLAY, RUN, SALVAGE, Hall
from mech_twin.view.bench import server
from mech_twin.view.bench.bench_page import OrderError
from mech_twin.view.bench.link import FEED
from mech_twin.view.bench.server import Bench


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


def test_of_two_orders_at_once_the_second_ends_what_the_first_began(tmp_path, monkeypatch):
    """A double click would otherwise leave a process that nobody ends, and two runs on one bench."""
    program = tmp_path / "program"
    program.write_text("#!/bin/sh\nexec sleep 60\n", encoding="utf-8")
    program.chmod(0o755)
    monkeypatch.setattr(bench_hall.sys, "executable", str(program))
    started = []
    begin = asyncio.create_subprocess_exec

    async def noted(*words, **more):
        started.append(await begin(*words, **more))
        return started[-1]

    monkeypatch.setattr(asyncio, "create_subprocess_exec", noted)

    async def order_twice() -> list[int | None]:
        async def clear() -> None:
            await asyncio.sleep(0.05)

        hall = Hall(tmp_path, ["mb10_breaker"], "bench:nowhere", clear, lambda *_: None, str)
        order = {"name": RUN, "values": {"machine": "mb10_breaker"}}
        await asyncio.gather(hall.obey(order), hall.obey(order))
        codes = [process.returncode for process in started]
        await hall.close()
        return codes

    assert [code is None for code in asyncio.run(order_twice())] == [False, True]


KILLED = "killed"


@pytest.mark.parametrize(
    ("lines", "shown"),
    [
        (["starting", "[INFO] frames", "mech-twin: mine: no pose"], "run: mech-twin: mine: no pose"),
        (["Traceback", "  here", "KeyError: 'x'"], "run: Traceback; here; KeyError: 'x'"),
        (["[INFO] frames", KILLED], "run: ended by signal 9 (Killed); [INFO] frames"),
    ],
)
def test_of_a_run_that_fails_its_reason_is_told_alone(tmp_path, monkeypatch, lines, shown):
    program = tmp_path / "program"
    said = "\n".join(line for line in lines if line != KILLED)
    end = "kill -9 $$" if KILLED in lines else "exit 2"
    program.write_text(f"#!/bin/sh\ncat >&2 <<'END'\n{said}\nEND\n{end}\n", encoding="utf-8")
    program.chmod(0o755)
    monkeypatch.setattr(bench_hall.sys, "executable", str(program))
    told = []

    async def order() -> None:
        async def clear() -> None:
            pass

        hall = Hall(tmp_path, ["mb10_breaker"], "bench:nowhere", clear, lambda *words: told.append(words), str)
        await hall.obey({"name": RUN, "values": {"machine": "mb10_breaker"}})
        async with asyncio.timeout(LIMIT_S):
            while not any(kind == "end" for kind, _ in told):
                await asyncio.sleep(0.01)

    asyncio.run(order())
    assert [content for kind, content in told if kind == "end"] == [{"text": shown, "has_failed": True}]


def test_a_page_put_into_the_folder_later_is_offered_at_the_next_look(tmp_path):
    told = []
    hall = Hall(tmp_path, ["mb10_breaker"], "bench:nowhere", None, lambda _, content: told.append(content), str)
    asyncio.run(hall.look())
    (tmp_path / "mine.yaml").write_text("name: mine\n", encoding="utf-8")
    asyncio.run(hall.look())
    assert [each["machines"] for each in told] == [["mb10_breaker"], ["mb10_breaker", "mine.yaml"]]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("/**:\n  ros__parameters:\n    machine: mb10_breaker\n", ["mb10_breaker", "--config", "mine.yaml"]),
        ("/**:\n  ros__parameters:\n    machine: /etc/passwd\n", ["mine.yaml"]),
        ("machine: mb10_breaker\nchannels: []\n", ["mine.yaml"]),
        ("name: mine\nbodies: [\n", ["mine.yaml"]),
    ],
)
def test_a_configuration_is_run_with_the_machine_that_it_names(tmp_path, monkeypatch, text, words):
    (tmp_path / "mine.yaml").write_text(text, encoding="utf-8")
    hall, begun = Hall(tmp_path, ["mb10_breaker"], "bench:nowhere", None, None, str), []

    async def noted(*words):
        begun.append(list(words))
        return "begun"

    monkeypatch.setattr(hall, "_begin", noted)
    asyncio.run(hall.obey({"name": RUN, "values": {"machine": "mine.yaml"}}))
    assert [each[1:-2] for each in begun] == [words]


@in_loop
async def test_a_page_opened_later_gets_the_present_values_of_the_live_parameters(tmp_path):
    keys = [{"name": "tool.restitution", "value": 0.35}, {"name": "tool.wall_force_n", "value": 500.0}]
    differing = [["tool.restitution", "0.35", "0.3"]]
    async with served(tmp_path) as (bench, _), aiohttp.ClientSession() as session:
        here = f"127.0.0.1:{bench.port}"
        bench.tell("machine", {"name": "mb10_breaker", "parameters": keys, "settings": []})
        bench.change("tool.restitution", 0.3, differing)
        page = await session.ws_connect(f"ws://{here}/feed", headers={"Origin": f"http://{here}"})
        await page.send_str(bench.token)
        async with asyncio.timeout(LIMIT_S):
            while (told := json.loads((await page.receive()).data))["kind"] != "machine":
                pass
        assert [each["value"] for each in told["parameters"]] == [0.3, 500.0]
        assert told["settings"] == differing


def test_recordings_of_every_kind_are_listed_and_of_one_that_does_not_open_why(tmp_path):
    """Compressed files were not listed, and of two machines in one recording it said that it had no samples."""
    folder = tmp_path / "folder"
    folder.mkdir()
    for name in ("winding_drum", "vibration_crank"):
        simulated_bag(name, 0.05, tmp_path / name)
    written_bag(folder / "two", [*entries_of(tmp_path / "winding_drum"), *entries_of(tmp_path / "vibration_crank")])
    converted(tmp_path / "winding_drum", folder / "sqlite")
    packed = converted(
        tmp_path / "winding_drum", tmp_path / "packed", storage=StoragePlugin.MCAP, mode=CompressionMode.FILE
    )
    shutil.copytree(packed, folder / "packed")
    shutil.copy(next(packed.glob("*.zstd")), folder / "alone.mcap.zstd")
    shutil.copy(next((folder / "sqlite").glob("*.db3")), folder / "alone.db3")
    (folder / "notes.txt").write_text("no recording", encoding="utf-8")
    told = {}

    def tell(kind, content):
        told[kind] = content

    asyncio.run(Hall(folder, [], "bench:nowhere", lambda: None, tell, str).look())
    rows = {row.pop("name"): row for row in told["hall"]["recordings"]}
    assert rows.keys() == {"two", "sqlite", "packed", "alone.mcap.zstd", "alone.db3"}
    assert {name for name, row in rows.items() if row["opens"]} == rows.keys() - {"two"}
    assert rows["packed"]["machine"] == rows["alone.db3"]["machine"] == "winding_drum"
    gone, elsewhere = folder / "packed", tmp_path / "elsewhere.mcap"
    hall = Hall(folder, [], "bench:nowhere", lambda: None, tell, str)
    asyncio.run(hall.obey({"name": DOWNLOAD, "values": {"recording": "sqlite"}}))
    assert [file["name"] for file in told["offer"]["files"]] == ["sqlite.db3"]
    next(gone.glob("*.zstd")).rename(elsewhere)
    (gone / "packed.mcap").symlink_to(elsewhere)
    with pytest.raises(OrderError, match=r"download packed: .* leads out of the bag's directory"):
        asyncio.run(hall.obey({"name": DOWNLOAD, "values": {"recording": "packed"}}))
    assert rows["two"]["state"] == "it holds samples of more than one machine: vibration_crank, winding_drum"
    assert not rows["two"]["salvages"]
