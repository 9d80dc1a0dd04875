# SPDX-License-Identifier: Apache-2.0
"""A run that cannot keep up with the wall clock says by how much, in the log and in its diagnostics, and catches up."""

from __future__ import annotations

import pytest
from bench_run import BenchRun
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus

from mech_twin.messages.topics import DIAGNOSTICS
from mech_twin.nodes.roles.run_control import BEGINNING_S, StepPacer

pytestmark = pytest.mark.usefixtures("ros_domain")
LAG_S = 0.7


class Clock:
    now_s = 0.0

    def __call__(self) -> float:
        return self.now_s


def test_a_lag_is_told_and_caught_up(capfd: pytest.CaptureFixture[str]) -> None:
    clock, heard = Clock(), list[DiagnosticStatus]()
    with BenchRun("winding_drum", peer_timeout_s=60.0) as run:
        run.client.create_subscription(
            DiagnosticArray, DIAGNOSTICS.name, lambda message: heard.extend(message.status), DIAGNOSTICS.qos
        )
        run.steps(1)
        run.linkage._pacer = StepPacer(run.linkage.machine.coupling_step_s, realtime=True, clock=clock)
        run.steps(1)
        clock.now_s += BEGINNING_S
        run.steps(round(BEGINNING_S / run.linkage.machine.coupling_step_s) - 1)
        clock.now_s += LAG_S
        caught_up = len(run.samples) + round(LAG_S / run.linkage.machine.coupling_step_s)
        run.steps(1)
        run.linkage.report()
        run.until(lambda: any("behind by 0.7 s" in status.message for status in heard))
        told = next(status for status in heard if "behind by" in status.message)
        assert told.level == DiagnosticStatus.WARN
        assert float({pair.key: pair.value for pair in told.values}["lag s"]) == pytest.approx(LAG_S, abs=2e-3)
        run.until(lambda: len(run.samples) >= caught_up - 1)
        run.linkage.report()
    errors = capfd.readouterr().err
    assert errors.count("behind by 0.7 s") == 1
    assert errors.count("caught up with the wall clock") == 1
