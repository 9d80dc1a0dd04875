# SPDX-License-Identifier: Apache-2.0
"""Live parameters changed at a time: checked before the run, in force from the first step at or after it."""

from __future__ import annotations

import re

import pytest
from catalogue import built

from mech_twin.declarations.configuration_tree import ConfigurationError
from mech_twin.engine.run import frames
from mech_twin.parameters.live_change import ChangingMachine, live_changes

CURVE = "motor.torque_curve"
KEY = "body.spring_rate_n_per_m"


@pytest.mark.parametrize(
    "text",
    [KEY, f"{KEY}=1", f"{KEY}@3", f"{KEY}=@3", "=3@4", f"{KEY}=5@soon", f"{KEY}=5@-1", f"{KEY}=x%@1", f"{KEY}=nan%@1"],
)
def test_a_change_of_another_form_is_refused(text: str) -> None:
    with pytest.raises(ConfigurationError, match="KEY=VALUE@SECONDS"):
        live_changes([text])


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("body.spring_rate_n_per_m=-150%@1", ("spring_rate_n_per_m", "greater than or equal to 1")),
        ("linkage.crank_m=1@1", ("is fixed during a run; expected a live key of mb10_breaker", KEY)),
        ("crank_m=1@1", ("unknown key 'crank_m'; expected one of", KEY)),
        ("spring_sag=-1%@1", ("unknown key 'spring_sag'", "spring_soft")),
        ("no_such_fault=-1%@1", ("unknown key", "motor.command", "spring_soft", "supply_frequency", "tool_worn")),
        ("body.sprung=1@1", ("unknown key 'body.sprung'; expected one of", KEY)),
    ],
)
def test_a_change_the_machine_refuses_is_named(text: str, words: tuple[str, ...]) -> None:
    with pytest.raises(ConfigurationError) as refused:
        ChangingMachine(built("mb10_breaker"), live_changes([text]))
    assert all(word in str(refused.value) for word in words)


def test_shares_multiply_what_is_in_force() -> None:
    machine = built("mb10_breaker")
    changing = ChangingMachine(machine, live_changes([f"{KEY}=+50%@2", f"{KEY}=-20%@1", f"{KEY}=40000@3"]))
    before = machine.parameters.body.spring_rate_n_per_m  # type: ignore[attr-defined]
    rates = [changing.at(step).parameters.body.spring_rate_n_per_m for step in (0, 999, 1000, 1999, 2000, 3000)]  # type: ignore[attr-defined]
    assert rates == pytest.approx([before, before, 0.8 * before, 0.8 * before, 1.2 * before, 40000.0], rel=1e-15)


def test_a_run_is_the_same_until_the_change_and_another_after() -> None:
    machine = built("vibration_crank")
    changing = ChangingMachine(machine, live_changes(["working_force_n=500@0.05"]))
    plain = [frame.forces.quantities["drive_torque_nm"] for frame in frames(machine, 0.1)]
    changed = [frame.forces.quantities["drive_torque_nm"] for frame in frames(machine, 0.1, machine_at=changing.at)]
    assert changed[:50] == plain[:50]
    assert all(one != other for one, other in zip(changed[50:], plain[50:], strict=True))


def test_a_command_sags_and_comes_back_and_a_ramp_is_straight() -> None:
    machine = built("mb10_breaker")
    told = ["motor.command=0.8@1", "motor.command=1@1.5", "motor.command=-50%@2..4"]
    changing = ChangingMachine(machine, live_changes(told))
    per_s = round(1.0 / machine.coupling_step_s)
    asked = [changing.command(round(at_s * per_s)) for at_s in (0.0, 0.999, 1.0, 1.499, 1.5, 2.0, 3.0, 4.0, 9.0)]
    assert asked == pytest.approx([1.0, 1.0, 0.8, 0.8, 1.0, 1.0, 0.75, 0.5, 0.5])
    assert changing.at(5 * per_s) is machine


def test_the_supply_goes_up_along_a_ramp_and_back_to_what_it_was() -> None:
    machine = built("mb10_breaker")
    told = ["supply_frequency=+4%@1..2", "tool_load=-5%@3", "supply_frequency=0%@4"]
    changing = ChangingMachine(machine, live_changes(told))
    per_s = round(1.0 / machine.coupling_step_s)
    motors = [changing.at(round(at_s * per_s)).parameters.motor for at_s in (0.5, 1.5, 3.0, 5.0)]
    assert [motor.synchronous_speed_rpm for motor in motors] == pytest.approx([1500.0, 1530.0, 1560.0, 1500.0])
    slips = [motor.synchronous_speed_rpm - motor.rated_speed_rpm for motor in motors]
    assert slips == pytest.approx([80.0] * 4)
    last = changing.at(5 * per_s).parameters
    assert (last.tool.mass_kg, last.motor) == (pytest.approx(9.5), machine.parameters.motor)


def test_a_line_of_the_supply_opens_and_closes() -> None:
    machine = built("mb10_breaker")
    changing = ChangingMachine(machine, live_changes([f"{CURVE}=single_phase@1", f"{CURVE}=kloss@1.5"]))
    per_s = round(1.0 / machine.coupling_step_s)
    motors = [changing.at(round(at_s * per_s)).parameters.motor for at_s in (0.5, 1.2, 2.0)]
    assert [motor.torque_curve for motor in motors] == ["kloss", "single_phase", "kloss"]
    assert motors[2] == machine.parameters.motor


@pytest.mark.parametrize(
    ("texts", "told"),
    [
        ([f"{CURVE}=two_phases@1"], "two_phases"),
        ([f"{CURVE}=single_phase@1..2"], "is no number, expected it at once"),
        (["motor.command=1.2@1"], "expected a fraction of rated frequency, 0 to 1"),
        (["supply_frequency=0.98@1"], "expected a share, such as supply_frequency=-2%@12"),
        (["motor.command=0.5@1..5", "motor.command=1@3"], "expected a time after the end of the previous ramp"),
        (["motor.command=0.5@5..1"], "or @BEGIN..END"),
        (["supply_frequency=1%@0..1e6"], "expected a ramp of at most 100 s"),
    ],
)
def test_a_change_that_cannot_be_is_told_in_one_line(texts: list[str], told: str) -> None:
    with pytest.raises(ConfigurationError, match=re.escape(told)):
        ChangingMachine(built("mb10_breaker"), live_changes(texts))
