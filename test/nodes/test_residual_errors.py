# SPDX-License-Identifier: Apache-2.0
"""A residual over its limit is an ERROR in the diagnostics a node publishes, through real topics."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import pytest
from bench_run import BenchRun
from catalogue import NAMES
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus

from mech_twin.messages.topics import DIAGNOSTICS

pytestmark = pytest.mark.usefixtures("ros_domain")
FIELDS = {"linkage": "linkage", "force_analysis": "forces", "body": "body"}  # of a machine, by the node of its role


class Spoilt:
    """A role whose samples have residuals replaced; all else is the real role's."""

    def __init__(self, role: Any, residuals: Mapping[str, float]) -> None:
        self._role, self._residuals = role, residuals

    def __getattr__(self, name: str) -> Any:
        attribute = getattr(self._role, name)
        if name not in ("advance", "analyse", "start", "follow"):
            return attribute
        return lambda *arguments: self._spoilt(attribute(*arguments))

    def _spoilt(self, sample: Any) -> Any:
        now = {**sample.residuals.as_dict(), **self._residuals}
        return sample._replace(
            residuals=sample.residuals._replace(values=tuple(now[k] for k in sample.residuals.names))
        )


def broken_in(message: str) -> set[str]:
    """Return what a message says of residuals, without the remedy that follows some."""
    return {part.partition(": ")[0] for part in message.split("; ")}


@pytest.mark.parametrize("name", NAMES)
def test_every_residual_over_its_limit_is_an_error_in_the_diagnostics_and_told_with_its_limit(name: str) -> None:
    """All of a machine's roles at once; `test_diagnostics` breaks each residual alone."""
    with BenchRun(name) as run:
        heard: list[DiagnosticStatus] = []
        run.client.create_subscription(DiagnosticArray, DIAGNOSTICS.name, lambda m: heard.extend(m.status), 100)
        wanted: dict[str, set[str]] = {}
        targets = [run.node(node) for node in FIELDS if any(n.get_name() == node for n in run.nodes)]
        for target in targets:
            field = FIELDS[target.get_name()]
            role = getattr(target.machine, field)
            over = {residual: 1.01 * limit for residual, limit in role.residual_limits.items()}
            object.__setattr__(target.machine, field, Spoilt(role, over))
            wanted[target.get_name()] = {f"{k} {v:.3g} exceeds {role.residual_limits[k]:.3g}" for k, v in over.items()}
        assert any(wanted.values())

        def told(node: str) -> list[DiagnosticStatus]:
            return [s for s in heard if s.name.endswith(f"/{node}") and wanted[node] <= broken_in(s.message)]

        try:
            run.until(lambda: all(told(node) for node in wanted if wanted[node]))
        finally:
            for target in targets:
                field = FIELDS[target.get_name()]
                object.__setattr__(target.machine, field, getattr(target.machine, field)._role)
        for target in targets:
            node = target.get_name()
            if wanted[node]:
                assert {s.level for s in told(node)} == {DiagnosticStatus.ERROR}
                assert target.diagnostics.breaches >= len(wanted[node])
