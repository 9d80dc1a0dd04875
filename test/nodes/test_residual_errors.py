"""A residual over its limit is an ERROR in the diagnostics a node publishes, through real topics."""

from __future__ import annotations

from typing import Any

import pytest
from bench_run import BenchRun
from catalogue import built
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus

from mech_twin.messages.topics import DIAGNOSTICS

pytestmark = pytest.mark.usefixtures("ros_domain")
NAN = float("nan")


class Spoilt:
    """A role whose samples have one residual replaced; all else is the real role's."""

    def __init__(self, role: Any, residual: str, value: float) -> None:
        self._role, self._residual, self._value = role, residual, value

    def __getattr__(self, name: str) -> Any:
        attribute = getattr(self._role, name)
        if name not in ("advance", "analyse", "start", "follow"):
            return attribute
        return lambda *arguments: self._spoilt(attribute(*arguments))

    def _spoilt(self, sample: Any) -> Any:
        names, values = sample.residuals
        index = names.index(self._residual)
        spoilt = (*values[:index], self._value, *values[index + 1 :])
        return sample._replace(residuals=sample.residuals._replace(values=spoilt))


def cases() -> list[tuple[str, str, str, float]]:
    found = []
    for name in ("mb10_breaker", "winding_drum"):
        machine = built(name)
        for node, role in (("linkage", machine.linkage), ("force_analysis", machine.forces), ("body", machine.body)):
            for residual, limit in {} if role is None else role.residual_limits.items():
                found.append((name, node, residual, 1.01 * limit))
    return found


@pytest.mark.parametrize(("name", "node", "residual", "value"), cases())
def test_a_residual_over_its_limit_is_an_error_in_the_diagnostics(
    name: str, node: str, residual: str, value: float
) -> None:
    field = {"linkage": "linkage", "force_analysis": "forces", "body": "body"}[node]
    with BenchRun(name) as run:
        heard: list[DiagnosticStatus] = []
        run.client.create_subscription(DiagnosticArray, DIAGNOSTICS.name, lambda m: heard.extend(m.status), 100)
        target = run.node(node)
        spoilt = Spoilt(getattr(target.machine, field), residual, value)
        object.__setattr__(target.machine, field, spoilt)
        try:
            run.until(lambda: any(s.name.endswith(f"/{node}") and residual in s.message for s in heard))
        finally:
            object.__setattr__(target.machine, field, spoilt._role)
        told = [s for s in heard if s.name.endswith(f"/{node}") and residual in s.message]
        assert {s.level for s in told} == {DiagnosticStatus.ERROR}
        assert all("exceeds" in s.message for s in told)
        assert target.diagnostics.breaches >= 1
