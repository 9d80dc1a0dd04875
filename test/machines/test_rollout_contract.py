# SPDX-License-Identifier: Apache-2.0
"""A roll-out is what the roles compute step by step, to the bit: every machine, any command, change, start and step."""

from __future__ import annotations

import itertools
import random
import re
from pathlib import Path

import numpy as np
import pytest
from rollout_cases import CASES, IDS

import mech_twin
from mech_twin.engine.coupling import complete_frame, next_frame
from mech_twin.engine.rollout import column_names, layout_of, roll_out
from mech_twin.engine.run import frames
from mech_twin.engine.trajectory import frame_events
from mech_twin.errors import StudyError
from mech_twin.parameters.live_change import live_numbers
from mech_twin.parameters.load import catalogue_entry, machine, machine_parameters
from mech_twin.studies.named_rollouts import changed


def engine_frames(built, targets, machines=None):
    """Return the frames of a run by the roles, one call after the other."""
    frame = complete_frame(built, built.linkage.start(), None, targets[0])
    out = [frame]
    for step, target in enumerate(targets[1:], 1):
        frame = next_frame(built if machines is None else machines[step], frame, target)
        out.append(frame)
    return out


def random_command(seed, count):
    """Return a command that starts, stops and changes speed at random steps, one number a step."""
    draw = random.Random(seed)
    bounds = sorted(draw.sample(range(1, count), 5))
    values = [1.0, 0.0, draw.uniform(0.2, 1.0), 1.0, 0.0, draw.uniform(0.2, 1.0)]
    targets = np.empty(count + 1)
    for begin, end, value in zip([0, *bounds], [*bounds, count + 1], values, strict=True):
        targets[begin:end] = value
    return targets


def assert_same(found, run, first=0):
    """Fail unless a roll-out holds every number, event and the last frame of a run, bit for bit."""
    layout = layout_of(run[0])
    assert list(found.columns) == list(layout.columns)
    rows = np.array([layout.row(frame) for frame in run])
    for place, (name, column) in enumerate(found.columns.items()):
        differing = np.flatnonzero(rows[:, place].view(np.int64) != column.view(np.int64))
        assert differing.size == 0, (name, run[differing[0]].linkage.step)
    told = [(frame.linkage.step, event) for frame in run[1:] for event in frame_events(frame)]
    assert list(found.stepped_events) == told
    numbers = found.event_numbers
    arrays = zip(numbers.step.tolist(), numbers.time_s.tolist(), numbers.kind.tolist(), strict=True)
    assert list(arrays) == [(step, event.time_s, event.kind) for step, event in told]
    assert found.final == run[-1]
    assert first == run[0].linkage.step


@pytest.mark.parametrize(("name", "overrides"), CASES, ids=IDS)
def test_roll_out_is_the_engine_to_the_bit_under_any_command(name, overrides):
    built = machine(name, None, overrides)
    targets = random_command(name, 700)
    run = engine_frames(built, targets.tolist())
    found = mech_twin.rollout(built, duration_s=700 * built.coupling_step_s, command=targets)
    assert_same(found, run)
    assert list(frames(built, 700 * built.coupling_step_s, lambda step: targets[step])) == run


@pytest.mark.parametrize(("name", "overrides"), CASES, ids=IDS)
@pytest.mark.parametrize("share", [0.37, 1.7])
def test_roll_out_is_the_engine_to_the_bit_at_other_steps(name, overrides, share):
    step_s = machine(name, None, overrides).coupling_step_s * share
    built = machine(name, None, overrides | {"coupling.step_s": step_s})
    found = mech_twin.rollout(built, duration_s=300 * step_s)
    assert_same(found, engine_frames(built, [1.0] * 301))


@pytest.mark.parametrize(("name", "overrides"), CASES, ids=IDS)
def test_roll_out_goes_on_from_any_frame(name, overrides):
    built = machine(name, None, overrides)
    targets = random_command(name + "start", 500)
    run = engine_frames(built, targets.tolist())
    found = mech_twin.rollout(
        built, duration_s=259 * built.coupling_step_s, start=run[241], command=lambda step: targets[step]
    )
    assert_same(found, run[241:], first=241)


def drawn_change(name, parameters, draw):
    """Return another value of a random live key that the configuration allows."""
    numbers = live_numbers(parameters)
    for _ in range(200):
        key = draw.choice(list(numbers))
        value = numbers[key]
        if not isinstance(value, float):
            continue
        change = {key: value * draw.uniform(0.9, 1.1) if value else draw.uniform(0.1, 1.0)}
        try:
            changed(name, parameters, change, "drawn")
        except ValueError:
            continue
        return change
    raise AssertionError(f"{name}: no live key can be changed")


@pytest.mark.parametrize(("name", "overrides"), CASES, ids=IDS)
def test_roll_out_is_the_engine_to_the_bit_when_parameters_change(name, overrides):
    parameters = machine_parameters(name, None, overrides)
    build, draw = catalogue_entry(name).build, random.Random(name)
    built, step_s = build(parameters), parameters.coupling.step_s
    changes, machines, known = [], [built] * 100, parameters
    for begin in (100, 233):
        change = drawn_change(name, known, draw)
        changes.append((begin * step_s, change))
        known = changed(name, known, change, "test")
        machines += [build(known)] * (133 if begin == 100 else 168)
    found = mech_twin.rollout(name, 400 * step_s, parameters, changes=changes)
    assert_same(found, engine_frames(built, [1.0] * 401, machines))


def test_a_batch_is_its_members_whatever_the_cores():
    parameters = [machine_parameters("winding_drum", None, {"yarn_speed_m_per_s": speed}) for speed in (3.0, 4.0, 5.0)]
    one = mech_twin.rollouts("winding_drum", 0.2, parameters, columns=["linkage.drum.velocity"], cores=1)
    many = mech_twin.rollouts("winding_drum", 0.2, parameters[::-1] + parameters, cores=3)
    alone = [mech_twin.rollout("winding_drum", 0.2, p) for p in parameters]
    for i, member in enumerate(alone):
        assert one["linkage.drum.velocity"][i].tobytes() == member["linkage.drum.velocity"].tobytes()
        assert many.members[3 + i].columns.keys() == member.columns.keys()
        for name, column in member.columns.items():
            assert many.members[3 + i][name].tobytes() == column.tobytes()
            assert many.members[2 - i][name].tobytes() == column.tobytes()


def test_one_machine_rolls_out_many_times_at_once():
    built = machine(str(Path(__file__).parents[2] / "config" / "pages" / "rock_hammer.yaml"))
    alone = mech_twin.rollout(built, 1.0)
    for found in mech_twin.rollouts(built, 1.0, [None] * 8, cores=4):
        assert found.error is None
        for name, column in alone.columns.items():
            assert np.array_equal(column, found[name], equal_nan=True), name


def test_commands_may_be_numbers_pairs_functions_or_arrays():
    built = machine("winding_drum")
    pairs = roll_out(built, 0.1, command=[(0.0, 0.5), (0.05, 1.0)])
    by_step = roll_out(built, 0.1, command=lambda step: 0.5 if step < 50 else 1.0)
    by_array = roll_out(built, 0.1, command=np.array([0.5] * 50 + [1.0] * 51))
    for name, column in pairs.columns.items():
        assert column.tobytes() == by_step[name].tobytes() == by_array[name].tobytes()


def test_residuals_are_those_of_the_whole_run():
    built = machine("mb10_breaker")
    found, run = roll_out(built, 0.6), engine_frames(built, [1.0] * 601)
    names = run[0].linkage.residuals.names
    for name in names:
        assert found.residuals[name].worst == max(abs(frame.linkage.residuals[name]) for frame in run)
        assert found.residuals[name].limit == built.linkage.residual_limits[name]


@pytest.mark.parametrize(
    ("asked", "said"),
    [
        ({"columns": ["linkage.drum.speed"]}, "no column 'linkage.drum.speed'"),
        ({"duration_s": -1.0}, "duration_s -1.0"),
        ({"duration_s": float("nan")}, "duration_s nan"),
        ({"command": np.ones(3)}, "one number a step"),
        ({"command": float("inf")}, "command inf: expected 0 to 1"),
        ({"command": 2.0}, "command 2.0: expected 0 to 1"),
        ({"command": [(0.1, -0.5)]}, "command -0.5: expected 0 to 1"),
        ({"command": [(0.1, "on")]}, "command's value 'on'"),
        ({"command": lambda step: None}, "command's value None"),
        ({"command": np.array(["on"] * 301)}, "command has numbers of kind"),
        ({"start": "rest"}, "start 'rest': expected a frame"),
        ({"changes": "core_radius_m"}, "changes 'core_radius_m': expected pairs"),
        ({"changes": {0.1: {"friction.coulomb_nm": 1.0}}}, "changes 0.1: expected pairs"),
        ({"changes": [(0.1, 5)]}, "change at 0.1 s: 5; expected"),
        ({"changes": [(0.1, machine("impact_mass").parameters)]}, "ImpactMass; expected"),
        ({"settings": machine("impact_mass").parameters}, "ImpactMass; expected"),
        ({"columns": [["time_s"]]}, "no column ['time_s']"),
        ({"command": [(1.0, 1.0), (0.5, 0.0)]}, "ascending"),
        ({"changes": [(0.1, {"core_radius_m": 0.09})]}, "cannot change during a run"),
        ({"changes": [(0.1, {"no.such": 1.0})]}, "cannot change during a run"),
        ({"changes": [(0.2, {"friction.coulomb_nm": 1.0}), (0.1, {"friction.coulomb_nm": 2.0})]}, "ascending"),
    ],
)
def test_what_cannot_be_rolled_out_is_said_in_one_line(asked, said):
    with pytest.raises(ValueError, match=re.escape(said)) as told:
        mech_twin.rollout("winding_drum", **{"duration_s": 0.3, **asked})
    assert "\n" not in str(told.value)


def test_every_column_of_a_machine_can_be_asked_for_by_name():
    built = machine("winding_drum")
    names = column_names(built)
    assert names[0] == "time_s"
    assert len(set(names)) == len(names)
    for first, second in itertools.pairwise(names):
        found = roll_out(built, 0.003, columns=[second, first])
        assert set(found.columns) == {"time_s", first, second}


def test_a_run_goes_on_only_with_the_joints_and_elements_that_it_began_with():
    crank, hammer = (
        str(Path(__file__).parents[2] / "config" / "pages" / f"{name}.yaml")
        for name in ("slider_crank", "spring_hammer")
    )
    extra = {"dampers.extra.joint": "crosshead_guide", "dampers.extra.rate_ns_per_m": 3.0}
    for name, other, settings in (
        ("roller_former", "roller_former", {"carts.count": 3}),
        (hammer, crank, {}),
        (hammer, hammer, extra),
    ):
        changed_machine = machine_parameters(other, None, settings)
        with pytest.raises(StudyError, match=r"change at 0.05 s: a machine with .* the same joints and elements"):
            mech_twin.rollout(name, 0.1, changes=[(0.05, changed_machine)])
        with pytest.raises(StudyError, match=r"start: a frame with .* the same joints and elements"):
            mech_twin.rollout(name, 0.1, start=mech_twin.rollout(other, 0.0, settings).final)
