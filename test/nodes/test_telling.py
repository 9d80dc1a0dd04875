# SPDX-License-Identifier: Apache-2.0
"""`mech-twin tell` reaches the nodes of a running machine, and says in their words what they refuse."""

from __future__ import annotations

import signal
import subprocess
import sys
import time

import pytest

from mech_twin.nodes.run.bench_process import Orders

RUN = [sys.executable, "-m", "mech_twin"]
LIMIT_S, LATE_S = 30.0, 2.5


def told(*words: str) -> subprocess.CompletedProcess[str]:
    """Return how `mech-twin tell` ended."""
    return subprocess.run([*RUN, "tell", *words], capture_output=True, text=True, timeout=60, check=False)


@pytest.fixture
def running(ros_domain, tmp_path):
    """Run a vibration crank at real pace until the test is over."""
    command = [*RUN, "run", "vibration_crank", "--view", "none", "--no-record", "--pace", "realtime"]
    with subprocess.Popen(command, cwd=tmp_path, stderr=subprocess.DEVNULL, stdout=subprocess.DEVNULL) as process:
        yield process
        process.send_signal(signal.SIGINT)
        process.wait(30)


@pytest.mark.slow
def test_orders_and_values_are_answered_by_the_nodes_themselves(running):
    begin = time.monotonic()
    first = told("vibration_crank", "stop", "--wait", "60")
    assert first.returncode == 0, (first.stderr, time.monotonic() - begin)
    assert "supply off" in first.stdout
    assert "supply on" in told("vibration_crank", "start").stdout
    assert told("vibration_crank", "drive.speed_rpm=290").stdout == "drive.speed_rpm = 290.0\n"
    assert told("vibration_crank", "reset").returncode == 0
    assert told("vibration_crank", "run.step_count=3").stdout == "run.step_count = 3\n"
    unknown = told("vibration_crank", "drive.sped_rpm=3")
    assert unknown.returncode == 2
    assert "no parameter 'drive.sped_rpm'; did you mean drive.speed_rpm" in unknown.stderr
    offered = told("vibration_crank", "speed=3").stderr
    assert "drive.speed_rpm" in offered and "rod_m" not in offered  # what a run may change, and no other
    assert "motor.command" in offered
    assert told("vibration_crank", "motor.command=0.5").stdout == "speed 50% of rated\n"
    assert told("vibration_crank", "start").stdout == "start: supply on at 0.5 of rated frequency\n"
    for wrong in (["motor.command=2"], ["motor.command=fast"], ["motor.command=0.5", "drive.speed_rpm=290"]):
        answer = told("vibration_crank", *wrong)
        assert answer.returncode == 2
        assert "expected 0 to 1 of the rated speed" in answer.stderr or "expected alone" in answer.stderr
    assert told("vibration_crank", "pause").stdout == "pause: paused\n"
    assert told("vibration_crank", "step").returncode == 0
    assert told("vibration_crank", "resume").stdout == "resume: goes on\n"
    refused = told("vibration_crank", "drive.speed_rpm=0")
    assert refused.returncode == 2
    assert refused.stderr.startswith("mech-twin: tell vibration_crank drive.speed_rpm: refused: ")
    assert refused.stderr.count("\n") == 1
    unwatched = told("vibration_crank", "acknowledge", "--wait", "0.5")
    assert unwatched.returncode == 2
    assert "nobody offers this service" in unwatched.stderr


def test_an_order_that_there_is_not_is_refused_with_those_that_there_are(ros_domain):
    found = told("vibration_crank", "jump")
    assert found.returncode == 2
    assert "expected KEY=VALUE ..., or one of start, stop, reset" in found.stderr


@pytest.mark.slow
def test_a_page_is_told_by_its_path_and_no_other_text_is_a_namespace(ros_domain, tmp_path):
    page = tmp_path / "fall.yaml"
    page.write_text(
        "name: fall\nbodies: {m: {mass_kg: 1}}\njoints: {s: {kind: slider, between: [ground, m]}}\n", encoding="utf-8"
    )
    absent = told(str(page), "start", "--wait", "0.1")
    assert absent.returncode == 2
    assert "/fall/start: nobody offers this service" in absent.stderr
    wrong = told("my hammer", "start")
    assert wrong.returncode == 2
    assert wrong.stderr.startswith("mech-twin: my hammer: expected a machine, a page, or a namespace")


LATE_SERVICE = """
import rclpy
from std_srvs.srv import SetBool

def pause(request, response):
    response.success, response.message = True, "paused"
    return response

rclpy.init()
node = rclpy.create_node("linkage", namespace="vibration_crank")
node.create_service(SetBool, "pause", pause)
rclpy.spin(node)
"""


@pytest.mark.slow
def test_a_pause_that_is_ordered_before_the_machine_is_found_is_carried_out(ros_domain):
    """The page of a machine that begins on a busy computer shows it seconds before its services are found."""
    orders = Orders("vibration_crank", lambda name, value: None, lambda is_paused: None)
    orders.start()
    assert not orders.ask({"name": "no order"}).result(LIMIT_S)[1]  # and what is ordered next is carried out at once
    answer = orders.ask({"name": "pause"})
    time.sleep(LATE_S)
    with subprocess.Popen([sys.executable, "-c", LATE_SERVICE], stderr=subprocess.DEVNULL) as machine:
        try:
            assert answer.result(LIMIT_S) == ("paused", True)
        finally:
            orders.close()
            orders.join(LIMIT_S)
            machine.kill()


def test_orders_to_a_run_that_has_ended_are_refused_and_reach_no_later_run_of_that_name(ros_domain):
    """The bench gives its place to the next run: what the machine before had not answered was told to the next one."""
    orders = Orders("vibration_crank", lambda name, value: None, lambda is_paused: None)
    orders.start()
    asked = [{"name": "change", "values": {"drive.speed_rpm": 290.0}}, {"name": "pause"}, {"name": "stop"}]
    answers = [orders.ask(each) for each in asked]
    orders.close()
    assert [each.result(LIMIT_S) for each in answers] == 3 * [("the run that was told has ended", False)]
    orders.join(LIMIT_S)
    assert not orders.is_alive()
