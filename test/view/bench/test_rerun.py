# SPDX-License-Identifier: Apache-2.0
"""rerun's own viewer on the bench: it shows the run at the bench's time, to who has the token."""

from __future__ import annotations

import json
import re
from pathlib import Path

import aiohttp
import numpy as np
import pytest
from browser import UP_MS, opened, running
from playwright.sync_api import expect
from rerun.chunk import RrdReader
from rrd_tables import rrd_tables
from served_bench import LIMIT_S, in_loop, served, status

from mech_twin.errors import ViewerError
from mech_twin.samples import Shape
from mech_twin.view.bench.link import FEED, PREFIX, BenchLink
from mech_twin.view.bench.picture import Curves, packed_curves, packed_shapes
from mech_twin.view.bench.rerun_door import keep_own
from mech_twin.view.rerun_pictures import unpacked_shapes

PROGRAM = Path("/bin/sh")
PANEL = {"title": "Torque, N m", "curves": [{"path": "motor/torque", "names": ["motor"]}]}


def picture(time_s: float) -> dict:
    """Return a picture as a run sends it."""
    shapes = [
        Shape("link", "line", ((0.0, 0.0), (0.5, 0.25)), (10, 20, 30), 0.01),
        Shape("name", "text", ((0.5, 0.5),), (0, 0, 0), 0.02, "crank"),
    ]
    curves = [Curves("motor/torque", ("motor",), np.array([time_s]), np.array([[2.5]]))]
    rest = {"state": "running", "alarm": "", "cards": [["crank", "62 rad/s"]], "events": [[time_s, "a blow"]]}
    lanes = [["supply", time_s, "on", []]]
    return rest | {
        "time_s": time_s,
        "bounds": [0.0, 1.0, 0.0, 1.0],
        "shapes": packed_shapes(shapes),
        "curves": packed_curves(curves),
        "lanes": lanes,
    }


def read_piece(piece: bytes, folder: Path) -> dict[str, str]:
    """Return what a piece of a recording holds, per entity as text: its bytes are compressed."""
    file = folder / "piece.rrd"
    file.write_bytes(piece)
    moving, static = rrd_tables(file)
    named = {"machine": str(RrdReader(str(file)).recordings())}
    return named | {entity: f"{table.schema}{table.to_pydict()}" for entity, table in (static | moving).items()}


def test_shapes_of_a_picture_come_back_as_they_were():
    line, text = unpacked_shapes(picture(0.0)["shapes"])
    assert (line.kind, line.points_m, line.colour, line.width_m) == (
        "line",
        ((0.0, 0.0), (0.5, 0.25)),
        (10, 20, 30),
        0.01,
    )
    assert (text.kind, text.text, text.points_m) == ("text", "crank", ((0.5, 0.5),))


@in_loop
async def test_the_run_is_told_to_a_viewer_with_the_token_and_to_no_other(tmp_path):
    async with served(tmp_path) as (bench, _), aiohttp.ClientSession() as session:
        here = f"127.0.0.1:{bench.port}"
        bench.tell("machine", {"name": "four_bar"})
        bench.tell("layout", {"panels": [PANEL]})
        with BenchLink(f"{PREFIX}{tmp_path / FEED}", 5.0) as link:
            assert link.show(picture(1.0))
            stranger = await session.ws_connect(f"ws://{here}/rerun", headers={"Origin": f"http://{here}"})
            await stranger.send_str("0" * 43)
            assert (await stranger.receive(LIMIT_S)).extra == "token"
            with pytest.raises(aiohttp.WSServerHandshakeError) as refusal:
                await session.ws_connect(f"ws://{here}/rerun", headers={"Origin": "http://evil.example"})
            assert refusal.value.status == 403
            viewer = await session.ws_connect(f"ws://{here}/rerun", headers={"Origin": f"http://{here}"})
            await viewer.send_str(bench.token)
            message = await viewer.receive(LIMIT_S)
            assert message.type is aiohttp.WSMsgType.BINARY
            told = read_piece(message.data, tmp_path)
            assert {"/motor/torque", "/mechanism/figure", "/regimes/supply"} <= set(told)
            assert "four_bar" in told["machine"]
            for text in ("a blow", "62 rad/s", "sim_time"):
                assert any(text in entity for entity in told.values()), text
            assert link.show(picture(1.1))
            assert "2.5" in read_piece((await viewer.receive(LIMIT_S)).data, tmp_path)["/motor/torque"]


@in_loop
async def test_only_the_viewers_page_compiles_code_and_only_this_server_frames_it(tmp_path):
    async with served(tmp_path) as (bench, _), aiohttp.ClientSession() as session:
        policies = {}
        for name in ("", "rerun.html"):
            async with session.get(f"http://127.0.0.1:{bench.port}/{name}") as answer:
                policies[name] = answer.headers["Content-Security-Policy"]
        assert "wasm" not in policies[""]
        assert "frame-ancestors 'none'" in policies[""]
        assert "script-src 'self' 'wasm-unsafe-eval';" in policies["rerun.html"]
        assert "frame-ancestors 'self'" in policies["rerun.html"]
        assert "'unsafe" not in json.dumps(policies)
        assert await status(bench, "/re_viewer.js", Host="evil.example") == 403


def cursor_ns(state: bytes) -> int:
    """Return where the cursor stands in an encoded state of the viewer: after the last name of the timeline."""
    found = re.search(
        rb"sim_time\x10\x02\x1a.\x08([\x80-\xff]*[\x00-\x7f])", state[state.rindex(b"sim_time") :], re.DOTALL
    )
    assert found is not None
    return sum((byte & 127) << 7 * place for place, byte in enumerate(found[1]))


SEEK = "(it, time) => { it.value = time; it.dispatchEvent(new Event('input')); }"


def await_cursor(page, time_s: float) -> None:
    page.wait_for_function("() => document.getElementById('viewer').contentWindow.received > 1", timeout=UP_MS)
    viewer = page.frame(url=re.compile("rerun.html"))
    for _ in range(200):
        page.wait_for_timeout(200)
        if cursor_ns(bytes(viewer.evaluate("() => [...window.state()]"))) == 1e9 * time_s:
            return
    pytest.fail(f"the viewer did not go to {time_s} s")


@pytest.mark.browser
@pytest.mark.slow
def test_reruns_viewer_shows_the_run_at_the_time_of_the_bench(browser, ros_domain, tmp_path):
    with running("run", "vibration_crank", "--no-record", folder=tmp_path) as (url, _), opened(browser, url) as page:
        page.wait_for_function("() => window.bench.shown > 1.2", timeout=UP_MS)
        page.locator("#rerun").click()
        page.wait_for_function("() => document.getElementById('viewer').contentWindow.received > 1", timeout=UP_MS)
        page.locator("#cursor").evaluate(SEEK, 0.5)
        await_cursor(page, 0.5)
        page.locator("#rerun").click()
        page.wait_for_selector("#drawing")

        # opened anew, beside a time that it has not taken in yet
        page.locator("#cursor").evaluate(SEEK, 0.75)
        page.locator("#rerun").click()
        await_cursor(page, 0.75)

        # a lost connection comes back
        viewer = page.frame(url=re.compile("rerun.html"))
        viewer.evaluate("() => { window.received = 0; window.cut(); }")
        viewer.wait_for_selector("#status:text('no connection')")
        viewer.wait_for_function("() => window.received > 1", timeout=UP_MS)
        expect(viewer.locator("#status")).to_be_hidden()


@pytest.mark.parametrize("content", [b"fetch('/feed')", b""])
def test_what_another_program_serves_in_place_of_the_viewer_is_refused(content, tmp_path):
    with pytest.raises(ViewerError, match=r"re_viewer\.js was served by another program than /bin/sh"):
        keep_own(PROGRAM, content, tmp_path / "re_viewer.js")
    assert list(tmp_path.iterdir()) == []
    keep_own(PROGRAM, PROGRAM.read_bytes()[100:900], tmp_path / "re_viewer.js")
    assert (tmp_path / "re_viewer.js").stat().st_size == 800
