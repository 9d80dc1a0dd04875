# SPDX-License-Identifier: Apache-2.0
"""The viewer's page reaches the browser without links to other hosts and under a policy that allows none."""

from __future__ import annotations

import http.client
import re
from contextlib import closing

import pytest

from mech_twin.view.flow import Flow
from mech_twin.view.page_server import LONGEST_NAME, content_policy, draws_in_software, local_page
from mech_twin.view.viewer_process import ViewerProcess


@pytest.fixture(scope="module")
def viewer():
    with ViewerProcess() as process:
        yield process


def asked(viewer, method, path, body=None):
    with closing(http.client.HTTPConnection("127.0.0.1", viewer.web_port, timeout=10.0)) as connection:
        connection.request(method, path, body=body)
        answer = connection.getresponse()
        return answer, answer.read()


def test_the_page_loads_nothing_from_another_host(viewer):
    answer, page = asked(viewer, "GET", "/?url=x&hide_welcome_screen")
    assert answer.status == 200
    assert b"the_canvas_id" in page
    assert not re.search(rb"<(link|script|img)[^>]*(href|src)=[\"']?(https?:)?//", page)
    assert int(answer.getheader("Content-Length")) == len(page)


@pytest.mark.parametrize("path", ["/", "/re_viewer.js", "/sw.js", "/signed-in", "/no-such-file"])
def test_whatever_is_served_is_under_the_policy(viewer, path):
    answer, _ = asked(viewer, "GET", path)
    assert answer.getheader("Content-Security-Policy") == content_policy("127.0.0.1", viewer.grpc_port)


def test_the_program_arrives_whole(viewer):
    answer, program = asked(viewer, "GET", "/re_viewer_bg.wasm")
    assert answer.getheader("Content-Type") == "application/wasm"
    assert program[:4] == b"\0asm"
    assert len(program) == int(answer.getheader("Content-Length")) > 1e6


@pytest.mark.parametrize(
    ("host", "named"),
    [
        ("127.0.0.1", "http://127.0.0.1:7"),
        ("box.lan", "http://127.0.0.1:7 http://box.lan:7"),
        ("[::1]", "http://127.0.0.1:7 http://[::1]:7"),
        ("a; script-src *", "http://127.0.0.1:7"),
    ],
)
def test_the_policy_names_this_machine_alone(host, named):
    parts = dict(part.strip().split(" ", 1) for part in content_policy(host, 7).split(";"))
    assert parts["connect-src"] == f"'self' {named}"
    assert parts["default-src"] == "'none'"
    assert not any("*" in part or "https:" in part for part in parts.values())


def test_a_page_of_a_graphics_card_asks_for_the_full_layout_and_one_without_takes_it_back(viewer):
    assert not viewer.graphics_file.exists()
    card = b"ANGLE (NVIDIA, NVIDIA GeForce RTX 3060 Direct3D11 vs_5_0 ps_5_0, D3D11)"
    for name, full in (
        (card, True),
        (b"ANGLE (Google, Vulkan 1.3.0 (SwiftShader Device (Subzero)))", False),
        (card, True),
    ):
        assert asked(viewer, "POST", "/renderer", name)[0].status == 204
        assert viewer.graphics_file.exists() == full


@pytest.mark.parametrize(
    ("renderer", "software"),
    [
        ("llvmpipe (LLVM 15.0.7, 256 bits)", True),
        ("Microsoft Basic Render Driver", True),
        ("none", True),
        ("Apple M2", False),
        ("ANGLE (Intel, Mesa Intel(R) UHD Graphics 620 (KBL GT2), OpenGL 4.6)", False),
    ],
)
def test_what_draws_the_page_is_known_by_its_name(renderer, software):
    assert draws_in_software(renderer) == software


def test_what_is_no_renderer_is_refused(viewer):
    assert asked(viewer, "POST", "/renderer", b"x" * (LONGEST_NAME + 1))[0].status == 400
    assert asked(viewer, "POST", "/elsewhere", b"x")[0].status == 400


def test_links_to_other_hosts_go_and_own_ones_stay():
    page = (
        b'<head><link rel="icon" href="a.ico" />\n<link\n href="https://fonts.example/css"\n rel="stylesheet" /></head>'
    )
    kept = local_page(page)
    assert b"a.ico" in kept
    assert b"https" not in kept


def test_what_a_page_shows_is_noted_and_nothing_else(viewer):
    assert asked(viewer, "POST", "/shown", "abc 1500000000")[0].status == 204
    assert Flow(viewer.reports_directory).shown_s() == 1.5
    for body in ("abc", "abc -1", "abc 1.5", "a b 1", "abc " + "9" * 20, "<b> 1"):
        assert asked(viewer, "POST", "/shown", body)[0].status == 400
    assert asked(viewer, "POST", "/elsewhere", "abc 1")[0].status == 400
    assert Flow(viewer.reports_directory).shown_s() == 1.5
