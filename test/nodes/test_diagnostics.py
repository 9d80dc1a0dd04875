# SPDX-License-Identifier: Apache-2.0
"""What a node says of a window: OK, WARN for what was lost, ERROR for what must not be."""

from __future__ import annotations

import pytest
from catalogue import NAMES, built
from diagnostic_msgs.msg import DiagnosticStatus

from mech_twin.nodes.exchange.counting import KINDS, NodeDiagnostics, TopicStatistics
from mech_twin.samples import Named


@pytest.mark.parametrize("kind", KINDS)
def test_what_is_counted_is_a_warning_but_for_the_runs_own_repeats(kind: str) -> None:
    statistics = TopicStatistics()
    diagnostics = NodeDiagnostics("/drum/motor", statistics)
    statistics.count("joint_states", kind, "why")
    status, lines = diagnostics.close_window({})
    assert status.level == (DiagnosticStatus.OK if kind == "repeated" else DiagnosticStatus.WARN)
    assert len(lines) == (0 if kind == "repeated" else 1)
    assert f"joint_states: {kind}" in [pair.key for pair in status.values]


def test_the_hardware_is_the_machine_in_its_namespace() -> None:
    for name, hardware in (("/drum/motor", "drum"), ("/hall/left/motor", "hall/left")):
        assert NodeDiagnostics(name, TopicStatistics()).close_window({})[0].hardware_id == hardware


@pytest.mark.parametrize("value", [1.1, -1.1, float("nan"), float("inf")])
def test_a_broken_residual_is_an_error_of_its_window_alone(value: float) -> None:
    diagnostics = NodeDiagnostics("/drum/linkage", TopicStatistics())
    diagnostics.limits({"closure_m": 1.0}, 1e-3)
    diagnostics.observe(Named(("closure_m",), (value,)))
    assert diagnostics.close_window({})[0].level == DiagnosticStatus.ERROR
    assert diagnostics.breaches == 1
    diagnostics.observe(Named(("closure_m",), (1.0,)))
    assert diagnostics.close_window({})[0].level == DiagnosticStatus.OK


@pytest.mark.parametrize("name", NAMES)
def test_each_residual_of_each_machine_just_over_its_limit_is_an_error_that_names_it(name: str) -> None:
    machine = built(name)
    roles = [role for role in (machine.linkage, machine.forces, machine.body) if role is not None]
    for limits in (role.residual_limits for role in roles):
        diagnostics = NodeDiagnostics(f"/{name}/node", TopicStatistics())
        diagnostics.limits(limits, 1e-3)
        for residual in limits:
            for over, level in ((1.0, DiagnosticStatus.OK), (1.001, DiagnosticStatus.ERROR)):
                values = tuple(over * limits[other] if other == residual else 0.0 for other in limits)
                diagnostics.observe(Named(tuple(limits), values))
                status, _ = diagnostics.close_window({})
                assert status.level == level
                assert (f"{residual} {values[list(limits).index(residual)]:.3g}" in status.message) == (over > 1.0)
