# SPDX-License-Identifier: Apache-2.0
"""`start` says whether the machine turns: if not, it is refused with the reason, and the supply stays off."""

from __future__ import annotations

import re
import subprocess
import sys
import time
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import pytest
from bench_run import BenchRun
from catalogue import NAMES, built
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from process_run import ProcessRun
from rclpy.parameter import Parameter
from std_srvs.srv import Trigger

from mech_twin.engine.coupling import LOOK_AHEAD_S, STANDING_REACH, start_forecast
from mech_twin.engine.run import frames
from mech_twin.messages.topics import DIAGNOSTICS
from mech_twin.nodes.roles.answering_nodes import FORECAST_BURST_S, FORECAST_SHARE, MotorNode
from mech_twin.parameters.load import machine

pytestmark = pytest.mark.usefixtures("ros_domain")
FORMER = "roller_former"
STUCK = {"friction.coulomb_nm": 1e6}
STORM_CALLS = 10000
MOST_CALLS_A_STEP = 20  # a pass of a node answers each of the three services once; a step takes a few passes
FORECASTS_IN_A_HALT = 3.0  # the node beside others computes one; the test measures one by itself
STORM = """
import sys
import rclpy
from std_srvs.srv import Trigger
rclpy.init()
node = rclpy.create_node("storm", namespace="/" + sys.argv[1])
clients = [node.create_client(Trigger, name) for name in ("stop", "start", "reset")]
assert all(client.wait_for_service(20.0) for client in clients)
waiting, answered = [], 0
while answered < int(sys.argv[2]):
    waiting += [client.call_async(Trigger.Request()) for client in clients if len(waiting) < 300]
    rclpy.spin_once(node, timeout_sec=0.0)
    answered += sum(each.done() for each in waiting)
    waiting = [each for each in waiting if not each.done()]
print(answered)
"""


def called(run: BenchRun, service: str) -> Any:
    return run.call(Trigger, service, Trigger.Request())


@pytest.mark.slow
def test_a_drive_that_friction_holds_is_not_started_until_it_is_let_go() -> None:
    with BenchRun(FORMER) as run:
        heard: list[DiagnosticStatus] = []
        run.client.create_subscription(DiagnosticArray, DIAGNOSTICS.name, lambda m: heard.extend(m.status), 100)
        run.steps(20)
        assert run.set_parameters("linkage", friction__coulomb_nm=1e6)[0].successful
        assert called(run, "stop").success
        run.until(lambda: run.samples[-1].command == 0.0 and abs(run.samples[-1].velocity[0]) < 1e-6)
        refused = called(run, "start")
        assert not refused.success
        assert "would stand still" in refused.message
        run.steps(20)
        assert run.samples[-1].command == 0.0
        motor = f"/{FORMER}/motor"
        warned = DiagnosticStatus.WARN
        run.until(lambda: any(s.name == motor and s.level == warned and "stand still" in s.message for s in heard))
        held = run.linkage.revision
        assert run.set_parameters("linkage", friction__coulomb_nm=0.0)[0].successful
        run.until(lambda: run.node("motor").revision > held)  # taken up with the next step, not with the answer
        started = called(run, "start")
        if not started.success:  # the forecast before took long: it says when to ask again
            run.spin_for(float(re.fullmatch("asked too often: ask again in (.*) s", started.message)[1]))
            started = called(run, "start")
        assert started.success, started.message
        run.until(lambda: abs(run.samples[-1].velocity[0]) > 0.1)


def test_calls_without_end_leave_the_run_nine_tenths_of_its_time() -> None:
    """Each start computes three seconds of the machine; asked for again and again it did nothing else."""
    with BenchRun("mb10_breaker") as run:
        run.steps(20)
        motor = run.node("motor")
        assert isinstance(motor, MotorNode)
        begun, refused = time.monotonic(), 0
        for _ in range(200):
            motor.stop()
            is_done, message = motor.start()
            refused += not is_done
            assert is_done or "ask again in" in message
        taken_s = time.monotonic() - begun
        assert refused >= 150, taken_s
        run.steps(20)


@pytest.mark.slow
def test_changes_and_starts_in_turn_without_end_leave_the_run_its_time() -> None:
    """Each change makes a new machine, and a start of a new machine was computed however often one was asked for."""
    key = "body.spring_rate_n_per_m"
    with BenchRun("mb10_breaker") as run:
        run.steps(20)
        motor, linkage = run.node("motor"), run.node("linkage")
        assert isinstance(motor, MotorNode)
        begun, starts_s = time.monotonic(), [0.0]
        for number in range(60):
            linkage.set_parameters([Parameter(key, value=40000.0 + number)])
            run.steps(1)
            asked_s = time.monotonic()
            motor.start()
            starts_s.append(time.monotonic() - asked_s)
        taken_s = time.monotonic() - begun
        assert sum(starts_s) < FORECAST_BURST_S + FORECAST_SHARE * taken_s + 2.0 * max(starts_s)


@pytest.mark.slow
def test_changes_without_end_are_refused_but_for_some_each_second() -> None:
    key = "friction.viscous_nms_per_rad"
    with BenchRun("winding_drum") as run:
        run.steps(20)
        linkage = run.node("linkage")
        begun = time.monotonic()
        answers = [linkage.set_parameters([Parameter(key, value=0.1 + 1e-4 * number)])[0] for number in range(300)]
        taken_s = time.monotonic() - begun
        refused = [answer.reason for answer in answers if not answer.successful]
        assert 20 <= 300 - len(refused) <= 51 + 25.0 * taken_s
        assert all("asked too often: ask again in" in reason for reason in refused)
        run.spin_for(1.0)
        assert linkage.set_parameters([Parameter(key, value=0.5)])[0].successful
        run.steps(20)


@pytest.mark.slow
@pytest.mark.parametrize("machine", [FORMER, "mb10_breaker"])
def test_calls_without_end_from_another_process_do_not_stop_the_steps(machine: str, tmp_path: Path) -> None:
    with ProcessRun(machine, tmp_path) as run, ExitStack() as at_end:
        run.start_all(limit_s=120.0)
        run.steps(200)
        command = [sys.executable, "-c", STORM, machine, str(STORM_CALLS)]
        storm = at_end.enter_context(subprocess.Popen(command, stdout=subprocess.PIPE))
        at_end.callback(storm.kill)
        run.until(lambda: run.witness.count_clients(f"/{machine}/reset") > 0, what="a storm")
        first, last_s, halts_s = run.step, time.monotonic(), [0.0]
        while storm.poll() is None:
            before = run.step
            run.spin_for(0.02)
            halts_s.append(time.monotonic() - last_s)
            last_s = last_s if run.step == before else time.monotonic()
        calls = int(storm.communicate()[0])
        assert calls <= MOST_CALLS_A_STEP * (run.step - first)
        begun = time.monotonic()
        start_forecast(run.machine, run.machine.linkage.start(), 1.0)
        assert max(halts_s) < 1.0 + FORECASTS_IN_A_HALT * (time.monotonic() - begun)
        run.steps(200)


@pytest.mark.slow
def test_the_breaker_starts_again_wherever_it_was_stopped() -> None:
    breaker = built("mb10_breaker")
    step_s = breaker.coupling_step_s
    for off_at in (400, 417, 431):
        run = list(frames(breaker, 2.5, lambda step, off=off_at: 0.0 if off <= step < 1000 else 1.0))
        assert start_forecast(breaker, run[1000].linkage, 1.0).turns
        blows = [event.time_s for frame in run for event in frame.linkage.events if event.kind == "blow"]
        assert max(blows) > 2.0 > 1000 * step_s


@pytest.mark.parametrize("name", NAMES)
def test_every_machine_starts_from_rest_as_installed(name: str) -> None:
    fresh = built(name)
    assert start_forecast(fresh, fresh.linkage.start(), 1.0).turns


@pytest.mark.parametrize("overrides", [{}, STUCK])
def test_what_is_foretold_is_what_the_machine_then_does(overrides: dict[str, float]) -> None:
    former = machine(FORMER, None, overrides)
    start = former.linkage.start()
    steps = round(LOOK_AHEAD_S / former.coupling_step_s)
    drive = [frame.motor.position[0] for frame in frames(former, LOOK_AHEAD_S)]
    last = drive[steps - round(1.0 / former.coupling_step_s) :]
    assert start_forecast(former, start, 1.0).turns == (max(last) - min(last) > STANDING_REACH)


def test_the_mass_may_rest_on_its_stop_without_being_stalled() -> None:
    mass = machine("impact_mass", None, {"period_s": 20.0})
    assert start_forecast(mass, mass.linkage.start(), 1.0).turns
