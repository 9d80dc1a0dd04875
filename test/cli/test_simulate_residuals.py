# SPDX-License-Identifier: Apache-2.0
"""``simulate`` shows the worst residuals with their limits and fails where one is broken."""

from __future__ import annotations

import json
from dataclasses import replace
from typing import Any

import pytest
from catalogue import NAMES, built

from mech_twin.cli.simulate import simulate_machine
from mech_twin.cli.verbs import SimulateVerb
from mech_twin.roles import Machine

DRUM = "winding_drum"


class Limited:
    """A role with one limit replaced."""

    def __init__(self, role: Any, residual: str, limit: float) -> None:
        self._role = role
        self.residual_limits = {**role.residual_limits, residual: limit}

    def __getattr__(self, name: str) -> Any:
        return getattr(self._role, name)


def simulated(machine: Machine, monkeypatch: pytest.MonkeyPatch, duration_s: float = 0.1, as_json: bool = True) -> None:
    monkeypatch.setattr(SimulateVerb, "built", machine)
    simulate_machine(SimulateVerb(machine=machine.name, duration_s=duration_s, as_json=as_json))


def test_the_worst_residuals_are_written_with_their_limits(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    machine = built(DRUM)
    simulated(machine, monkeypatch)
    residuals = json.loads(capsys.readouterr().out)["residuals"]
    limits = {**machine.linkage.residual_limits, **machine.forces.residual_limits}
    assert {name: found["limit"] for name, found in residuals.items()} == limits
    assert all(0.0 <= found["worst"] <= found["limit"] for found in residuals.values())


@pytest.mark.parametrize("limit", [-1.0, float("nan")])
@pytest.mark.parametrize("name", NAMES)
def test_every_residual_over_its_limit_is_named_and_the_exit_code_is_1(
    name: str, limit: float, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    machine = built(name)
    roles = ("linkage", "forces") if machine.body is None else ("linkage", "forces", "body")
    assert any(getattr(machine, role).residual_limits for role in roles)
    for role in roles:
        for residual in getattr(machine, role).residual_limits:
            spoilt = replace(machine, **{role: Limited(getattr(machine, role), residual, limit)})
            with pytest.raises(SystemExit) as ended:
                simulated(spoilt, monkeypatch, 5.0 * machine.coupling_step_s)
            assert ended.value.code == 1
            assert residual in capsys.readouterr().err


@pytest.mark.parametrize("name", NAMES)
def test_a_machine_within_its_limits_ends_with_0(
    name: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    simulated(built(name), monkeypatch, 5.0 * built(name).coupling_step_s)
    assert json.loads(capsys.readouterr().out)["residuals"]


def test_people_see_them_too(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    simulated(built(DRUM), monkeypatch, as_json=False)
    shown = capsys.readouterr().out
    assert "worst residuals" in shown
    assert all(name in shown for name in built(DRUM).linkage.residual_limits)
