# SPDX-License-Identifier: Apache-2.0
"""What the page asks of the network, counted where it would leave the machine: at a proxy for every other host."""

from __future__ import annotations

import re
import socket
import threading
from contextlib import contextmanager

import pytest
from browser import FLAGS, chromium
from playwright.sync_api import sync_playwright

from mech_twin.view.bench.started import StartedBench

pytestmark = [pytest.mark.browser, pytest.mark.slow]

LIMIT_S = 120.0
SETTLE_S = 2.0
# the browser's own, now and then and on whatever page: services of its maker, but for the fonts, which a page asks for
CHROMIUMS = re.compile(r"(?!fonts\.)[\w.-]+\.(google|googleapis)\.com")
HOST = re.compile(r"\w+ (?:http://)?([^/: ]+)")
CONNECTED = "() => document.getElementById('role').textContent === 'this page commands'"
# rerun's viewer asks for its newest release, and tells of its use
RERUN = "() => document.getElementById('rerun').click()"
RERUN_UP = "() => document.getElementById('viewer').contentWindow.state !== undefined"
FOREIGN = "() => { fetch('http://fonts.example.org/x', { mode: 'no-cors' }).catch(() => {}); }"


@contextmanager
def proxy():
    """Yield the address of a proxy that passes nothing on, and the requests it was asked to pass."""
    asked: list[str] = []
    with socket.create_server(("127.0.0.1", 0)) as server:

        def serve():
            while True:
                try:
                    client, _ = server.accept()
                except OSError:
                    return
                with client:
                    client.settimeout(5.0)
                    asked.append(client.recv(4096).split(b"\r\n")[0].decode(errors="replace"))

        threading.Thread(target=serve, daemon=True).start()
        yield f"http://127.0.0.1:{server.getsockname()[1]}", asked
        server.shutdown(socket.SHUT_RDWR)


def hosts_asked_by(
    url: str, *, bypassing: bool = False, script: str = "() => {}", until: str = "() => true"
) -> set[str]:
    """Return the other hosts that were asked for while a page came up and lived for a while."""
    flags = [flag for flag in FLAGS if not flag.startswith(("--no-proxy", "--host-resolver"))]
    with proxy() as (address, asked), sync_playwright() as play:
        options = {"server": address, "bypass": "127.0.0.1"}
        browser = play.chromium.launch(executable_path=chromium(), headless=True, args=flags, proxy=options)
        page = browser.new_page(viewport={"width": 700, "height": 500}, bypass_csp=bypassing)
        page.goto(url, wait_until="commit", timeout=1000 * LIMIT_S)
        page.wait_for_function(CONNECTED, timeout=1000 * LIMIT_S, polling=100)
        page.evaluate(script)
        page.wait_for_function(until, timeout=1000 * LIMIT_S)
        page.wait_for_timeout(1000 * SETTLE_S)
        browser.close()
    hosts = {HOST.match(request).group(1) for request in asked}
    return {host for host in hosts if CHROMIUMS.fullmatch(host) is None}


def test_the_page_asks_nothing_of_other_hosts_and_its_policy_lets_no_script_do_so():
    with StartedBench() as bench:
        assert hosts_asked_by(bench.url, script=FOREIGN) == set()
        beside = hosts_asked_by(bench.url, bypassing=True, script=FOREIGN)
    assert beside == {"fonts.example.org"}, "the count sees nothing, so that it proves nothing"


def test_reruns_viewer_asks_nothing_of_other_hosts():
    with StartedBench() as bench:
        assert hosts_asked_by(bench.url, script=RERUN, until=RERUN_UP) == set()
        beside = hosts_asked_by(bench.url, bypassing=True, script=RERUN, until=RERUN_UP)
    assert "tel.rerun.io" in beside, "the count sees nothing, so that it proves nothing"
