# SPDX-License-Identifier: Apache-2.0
"""A run computed again comes out the same to the last bit, and the first bit that does not is named."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import pytest
from catalogue import NAMES, built
from hypothesis import given
from hypothesis import strategies as st

from mech_twin.declarations.configuration_tree import ConfigurationError
from mech_twin.engine.coupling import complete_frame, next_frame, restarted
from mech_twin.engine.run import frames
from mech_twin.engine.trajectory import StepSamples
from mech_twin.machines.catalog import CATALOGUE
from mech_twin.parameters.description import description_text
from mech_twin.parameters.load import machine_parameters
from mech_twin.roles import Machine
from mech_twin.samples import Frame
from mech_twin.studies.resimulation import ConfigurationHistory, analysed, first_difference, resimulated

DRUM = "winding_drum"
RUN_S = 0.05


def known(run: list[Frame]) -> list[StepSamples]:
    return [StepSamples(f.linkage.step, f.linkage, f.motor, f.forces, f.body) for f in run]


def always(machine: Machine) -> Callable[[int], Machine]:
    return lambda step: machine


@pytest.mark.parametrize("name", NAMES)
def test_a_run_computed_again_is_identical(name: str) -> None:
    run = list(frames(built(name), RUN_S))
    verdict = resimulated(known(run), always(built(name)))
    assert verdict.identical and not verdict.taken_up and not verdict.missing_steps
    assert verdict.samples == len(run) * (3 if built(name).body is None else 4)


@pytest.mark.parametrize("name", NAMES)
def test_forces_computed_again_from_the_motion_are_identical(name: str) -> None:
    run = list(frames(built(name), RUN_S))
    verdict = analysed(known(run), always(built(name)))
    assert verdict.identical
    assert verdict.samples == len(run)


def test_commands_are_followed_through_their_rate_limit() -> None:
    run = list(frames(built(DRUM), 0.4, lambda step: 0.3 if 50 < step < 200 else 1.0))
    assert min(frame.motor.command for frame in run) < 1.0
    assert resimulated(known(run), always(built(DRUM))).identical


def test_a_reset_is_carried_out_again() -> None:
    machine = built(DRUM)
    run = list(frames(machine, RUN_S))
    start = restarted(machine, run[-1].linkage.step + 1)
    run.append(complete_frame(machine, start, run[-1].body, 1.0))
    for _ in range(20):
        run.append(next_frame(machine, run[-1], 1.0))
    verdict = resimulated(known(run), always(machine))
    assert verdict.identical
    assert verdict.resets == 1


def changed_run() -> tuple[list[Frame], list[str]]:
    """Return a run whose yarn speed is raised at step 21, and what it said about itself."""
    before = machine_parameters(DRUM)
    key = next(path for path in ("drive.yarn_speed_m_per_s", "yarn_speed_m_per_s") if holds(before, path))
    after = machine_parameters(DRUM, overrides={key: 11.0})
    machines = [CATALOGUE[DRUM].build(parameters) for parameters in (before, after)]
    run = [complete_frame(machines[0], machines[0].linkage.start(), None, 1.0)]
    for step in range(1, 60):
        run.append(next_frame(machines[step > 20], run[-1], 1.0))
    return run, [description_text(DRUM, before, 1, 0), description_text(DRUM, after, 2, 21)]


def holds(parameters: Any, path: str) -> bool:
    for name in path.split("."):
        parameters = getattr(parameters, name, None)
    return parameters is not None


def test_a_parameter_changed_during_the_run_takes_effect_at_its_step() -> None:
    run, texts = changed_run()
    history = ConfigurationHistory(texts, "bag")
    assert history.changes == 1
    assert resimulated(known(run), history.machine_at).identical
    assert analysed(known(run), history.machine_at).identical
    unchanged = ConfigurationHistory(texts[:1], "bag")
    first = resimulated(known(run), unchanged.machine_at).first
    assert first is not None
    assert first.step == 21


def test_a_configuration_described_again_counts_from_its_first_step() -> None:
    run, texts = changed_run()
    again = texts[1].replace("from_step: 21", "from_step: 40")
    assert resimulated(known(run), ConfigurationHistory([*texts, again], "bag").machine_at).identical


def test_a_run_without_configuration_is_refused() -> None:
    with pytest.raises(ConfigurationError, match="bag: holds no configuration"):
        ConfigurationHistory([], "bag")


@pytest.mark.parametrize("role", ["linkage", "motor", "forces"])
def test_the_first_bit_that_differs_is_named(role: str) -> None:
    run = known(list(frames(built(DRUM), RUN_S)))
    sample = getattr(run[30], role)
    if role == "forces":
        wrench = sample.wrenches[0]._replace(force_y_n=math.nextafter(sample.wrenches[0].force_y_n, math.inf))
        changed, field = (
            sample._replace(wrenches=(wrench, *sample.wrenches[1:])),
            f"wrenches[{sample.pins[0]}].force_y_n",
        )
    else:
        effort = (math.nextafter(sample.effort[0], math.inf), *sample.effort[1:])
        changed, field = sample._replace(effort=effort), f"effort[{sample.joints[0]}]"
    run[30] = run[30]._replace(**{role: changed})
    verdict = resimulated(run, always(built(DRUM)))
    assert not verdict.identical
    assert verdict.first is not None
    assert (verdict.first.step, verdict.first.role, verdict.first.field) == (30, role, field)
    assert verdict.first.recorded != verdict.first.computed
    assert verdict.first.time_s == sample.time_s


def test_minus_zero_is_not_zero() -> None:
    motor = next(iter(frames(built(DRUM), 0.0))).motor
    positive, negative = (motor._replace(position=(zero,) * len(motor.position)) for zero in (0.0, -0.0))
    assert positive == negative
    difference = first_difference("motor", positive, negative)
    assert difference is not None
    assert difference.field == f"position[{motor.joints[0]}]"


def test_a_missing_entry_is_a_difference() -> None:
    linkage = next(iter(frames(built(DRUM), 0.0))).linkage
    memory = linkage.memory._replace(names=linkage.memory.names[1:], values=linkage.memory.values[1:])
    difference = first_difference("linkage", linkage, linkage._replace(memory=memory))
    assert difference is not None
    assert difference.field == f"memory.{linkage.memory.names[0]}"
    assert difference.computed is None


@given(st.floats(allow_nan=False, allow_infinity=False), st.floats(allow_nan=False, allow_infinity=False))
def test_two_numbers_differ_exactly_when_their_bits_do(one: float, other: float) -> None:
    motor = next(iter(frames(built(DRUM), 0.0))).motor
    difference = first_difference("motor", motor._replace(command=one), motor._replace(command=other))
    assert (difference is None) == (one.hex() == other.hex())


def test_over_a_hole_the_recorded_state_is_taken_up_and_said() -> None:
    run = known(list(frames(built(DRUM), RUN_S)))
    del run[20:25]
    verdict = resimulated(run, always(built(DRUM)))
    assert verdict.identical
    assert verdict.taken_up == [25]
    assert verdict.missing_steps == 5


def test_a_step_without_its_command_is_not_guessed() -> None:
    run = known(list(frames(built(DRUM), RUN_S)))
    run[10] = run[10]._replace(motor=None)
    verdict = resimulated(run, always(built(DRUM)))
    assert verdict.identical
    assert verdict.taken_up == [11]
    assert verdict.missing_steps == 1


def test_nothing_compared_is_not_identical() -> None:
    assert not resimulated([], always(built(DRUM))).identical
    assert not analysed([], always(built(DRUM))).identical
