# SPDX-License-Identifier: Apache-2.0
"""Guides of the carts: friction that would drive, guides that lock, and what they carry before the load is on."""

from __future__ import annotations

import math

import pytest
from roller_former_cases import joints_of, machine_for, parameters_for

from mech_twin.declarations.configuration_tree import ConfigurationError
from mech_twin.engine.run import frames
from mech_twin.machines.roller_former.metrics import moment_metrics
from mech_twin.machines.roller_former.parameters import former_of

DRIVING = {"carts.roller_force_x_n": 5.0, "carts.roller_force_y_n": 100.0, "carts.weight_n": 4000.0}


def test_signed_friction_that_would_drive_is_refused_with_the_inequality():
    message = r"\(2 roller_force_y_n - weight_n\) friction \+ 2 roller_force_x_n >= 0 needed, got -20.4 N for cart 1"
    with pytest.raises(ConfigurationError, match=message):
        parameters_for(2, DRIVING)


def test_friction_on_the_size_of_the_reactions_opposes_where_the_signed_would_drive():
    metrics = moment_metrics(former_of(parameters_for(1, {**DRIVING, "guide_friction": "rail_change"})))
    assert metrics["moment_mean_nm"] > 0.0
    friction = 0.008 * (4000.0 - 200.0) + 10.0  # N along the travel, but for the side force of the rod
    assert metrics["moment_mean_nm"] * 2.0 * math.pi == pytest.approx(friction * 4.0 * 0.2, rel=5e-3)  # over a turn


def test_guides_that_lock_are_named():
    long_arm = {"guide_friction": "rail_change", "carts.friction": 0.3, "carts.p_m": 6.0}
    with pytest.raises(ConfigurationError, match=r"the guides lock themselves: friction 0\.3"):
        parameters_for(2, long_arm)
    assert parameters_for(2, {**long_arm, "carts.p_m": 4.0}).carts.p_m == 4.0
    with pytest.raises(ConfigurationError, match="the guides lock themselves"):
        parameters_for(2, {"carts.friction": 0.49, "carts.crank_m": 0.78})


def test_just_below_locking_the_reactions_still_agree_with_themselves():
    """The largest force is finite and positive, and the moment opposes the travel all the way round."""
    former = former_of(parameters_for(1, {"guide_friction": "rail_change", "carts.friction": 0.3, "carts.p_m": 4.3}))
    metrics = moment_metrics(former)
    assert 0.0 < metrics["moment_mean_nm"] < metrics["moment_max_nm"] < 1e5


def test_before_the_load_is_on_no_friction_is_in_the_guide_reactions():
    """Weight and side force of the rod alone: moments about the rod pin, without an arm of friction."""
    machine = machine_for(1, {"carts.friction": 0.3, "carts.guide_roller_m": 0.2})
    checked = 0
    for frame in frames(machine, 0.7):
        if frame.linkage.memory["load_on_1"] > 0.0 or joints_of(frame.linkage.velocity).crank == 0.0:
            continue
        pins = dict(zip(machine.forces.pins, frame.forces.wrenches, strict=True))
        front, rear = -pins["guide_front_1"].force_y_n, -pins["guide_rear_1"].force_y_n
        side = frame.forces.quantities["rod_force_1_n"] * math.sin(joints_of(frame.linkage.position).rods[0])
        weight = machine.parameters.carts.weight_n
        assert front + rear == pytest.approx(side - weight, abs=1e-8)
        assert -front * (0.52 - 0.37) - rear * (0.52 + 0.37) - weight * 0.52 == pytest.approx(0.0, abs=1e-8)
        checked += 1
    assert checked > 300


def test_under_load_the_friction_in_the_guides_is_that_of_the_motion():
    """Moments about the rod pin with the friction that drives the equation of motion: of the static reactions."""
    machine = machine_for(1, {"start.speed_fraction": 1.0, "start.load_from_fraction": 0.0})
    carts = machine.parameters.carts
    for frame in frames(machine, 0.6):
        pins = dict(zip(machine.forces.pins, frame.forces.wrenches, strict=True))
        front, rear = -pins["guide_front_1"].force_y_n, -pins["guide_rear_1"].force_y_n
        (pull,) = joints_of(frame.linkage.effort).carts
        sense = math.copysign(1.0, pull)
        rubbing = pull - sense * 2.0 * carts.roller_force_x_n  # N of guide friction along the travel
        moment = -front * (0.52 - 0.37) - rear * (0.52 + 0.37) - rubbing * 0.023
        moment += sense * 2.0 * carts.roller_force_x_n * 0.21 + (2.0 * carts.roller_force_y_n - carts.weight_n) * 0.52
        assert moment == pytest.approx(0.0, abs=1e-7)
