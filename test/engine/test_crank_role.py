# SPDX-License-Identifier: Apache-2.0
"""The role of a crank linkage: what it makes of its configuration, its first sample, and samples of a given motion."""

from __future__ import annotations

from dataclasses import FrozenInstanceError
from math import nan, pi

import numpy as np
import pytest

from mech_twin.engine.crank_linkage import CrankLinkage
from mech_twin.engine.crank_motion import KINDS
from mech_twin.engine.crank_state import Boundary, Resisting, ShaftFriction, Transmission
from mech_twin.errors import MotionError
from mech_twin.machines.vibration_crank.parameters import VibrationCrank, slider_crank_constants
from mech_twin.machines.vibration_crank.slider_crank import SliderCrank
from mech_twin.parameters.load import machine_parameters
from mech_twin.roles import CrankState

BOUNDARIES = (
    Boundary(1.0, 1.0, 0, 1, "begins"),
    Boundary(2.0, 1.0, 1, 0, "ends"),
    Boundary(2.5, -1.0, 0, 2, "begins"),
    Boundary(nan, 1.0, 2, 3, "begins"),
)


def shaking() -> SliderCrank:
    parameters = machine_parameters("vibration_crank")
    assert isinstance(parameters, VibrationCrank)
    return slider_crank_constants(parameters)


def linkage(mechanism: SliderCrank | None = None, **changes: object) -> CrankLinkage:
    """Return a crank that starts at 0.3 rad and 5 rad/s."""
    usual: dict[str, object] = {
        "step_s": 0.002, "start_angle": 0.3, "start_speed": 5.0, "start_command": 0.5,
        "joints": ("crank", "rod", "slider"), "contact": "slider",
    }  # fmt: skip
    return CrankLinkage(mechanism or shaking(), **{**usual, **changes})  # type: ignore[arg-type]


def test_rods_are_as_exact_as_the_linkage_is_large() -> None:
    assert linkage(size_m=0.4).residual_limits == {"loop_closure_m": 1e-12, "energy_balance": 1e-8}
    assert linkage(size_m=3.0).residual_limits == {"loop_closure_m": 3e-12, "energy_balance": 1e-8}


@pytest.mark.parametrize("speed", [15.0, -0.5])
def test_the_energy_balance_is_over_the_largest_energy_of_a_turn(speed: float) -> None:
    crank = linkage()
    energies = [
        abs(crank.guided(0, 0.0, CrankState(angle, speed, 0.0)).memory["energy_j"])
        for angle in np.linspace(0.0, 2.0 * pi, 361).tolist()
    ]
    scale = crank.at_rated_speed(speed).energy_scale_j
    assert scale == pytest.approx(max(energies), rel=1e-3)
    assert scale == pytest.approx(max(energies[::5]), rel=1e-12)  # of every fifth degree
    assert crank.energy_scale_j == 0.0


def test_a_role_is_not_changed_but_made_anew() -> None:
    with pytest.raises(FrozenInstanceError):
        linkage().size_m = 2.0  # type: ignore[misc]


def test_the_kernel_gets_what_the_role_was_told() -> None:
    drive = Transmission(4.0, 0.9, 0.02)
    crank = linkage(
        boundaries=BOUNDARIES, transmission=drive, friction=ShaftFriction(2.0, 0.3), resisting={1: Resisting(-1.0, 4)}
    )
    known, kinds = crank.model.crank, crank.layout.events.kinds
    assert kinds == (*KINDS, "begins", "ends")
    assert (known.step_s, known.start_rad, known.friction) == (0.002, 0.3, (2.0, 0.3))
    assert known.boundaries.shape == (4, 5)
    assert [kinds[int(row[4])] for row in known.boundaries] == [boundary.kind for boundary in BOUNDARIES]
    assert np.array_equal(known.boundaries[:, :4], np.array([b[:4] for b in BOUNDARIES]), equal_nan=True)
    assert known.resisting.tolist() == [[1.0, -1.0, 4.0]]
    assert (known.drive.ratio, known.drive.efficiency, known.drive.shaft_inertia_kg_m2) == (4.0, 0.9, 0.32)
    assert (known.drive.prescribed, linkage().model.crank.drive.prescribed) == (False, True)
    assert linkage().model.crank.boundaries.shape == (0, 5)
    assert linkage().model.crank.resisting.shape == (0, 3)


def test_events_are_of_the_crank_or_of_the_loaded_contact_and_tell_each_coordinate() -> None:
    layout = linkage().layout
    assert layout.bodies == ("crank", "rod", "slider")
    assert layout.events.contacts == ("crank", "slider")
    assert (layout.events.kinds, layout.events.coordinates) == (KINDS, 1)
    assert linkage(coordinates=("crank", "twist")).layout.events.coordinates == 2


def test_it_starts_at_step_0_if_no_other_is_told() -> None:
    assert linkage().start() == linkage().start(0)


@pytest.mark.parametrize("step", [0, 7])
def test_it_starts_where_it_was_told_to_at_the_time_of_its_step(step: int) -> None:
    start = linkage(start_regime=2).start(step)
    assert (start.step, start.time_s) == (step, step * 0.002)
    assert (start.position[0], start.velocity[0], start.command, start.regime) == (0.3, 5.0, 0.5, 2)
    assert start.memory["initial_energy_j"] == start.memory["energy_j"]
    assert (start.memory["load_share"], start.memory["drive_work_j"], start.events) == (1.0, 0.0, ())


@pytest.mark.parametrize("motion", [CrankState(0.8, 12.0, 40.0), CrankState(-2.0, -7.0, 3.0)])
def test_a_given_motion_needs_the_torque_that_changes_its_energy(motion: CrankState) -> None:
    """Torque times speed is dE/dt along the motion, the weights' energy in E."""
    crank, h = linkage(), 1e-5
    f, w, e = motion[:3]

    def energy(t: float) -> float:
        later = CrankState(f + (w + 0.5 * e * t) * t, w + e * t, e)
        return crank.guided(0, 0.0, later).memory["energy_j"]

    sample = crank.guided(3, 0.25, motion)
    assert (sample.step, sample.time_s, sample.command) == (3, 0.25, 0.5)
    assert (sample.position[0], sample.velocity[0]) == (f, w)
    assert sample.memory["crank_acceleration_rad_per_s2"] == e
    assert sample.effort[0] * w == pytest.approx((energy(h) - energy(-h)) / (2.0 * h), rel=1e-7)
    assert abs(sample.residuals["loop_closure_m"]) < 1e-12


@pytest.mark.parametrize(
    ("angle", "speed", "regime"),
    [
        (1.0, 1.0, 1), (1.5, 1.0, 1), (1.99, 1.0, 1), (2.0, 1.0, 0), (2.1, 1.0, 0), (0.9, 1.0, 0),
        (1.5 + 6.0 * pi, 1.0, 1), (1.5 - 2.0 * pi, 1.0, 1), (0.5 - 4.0 * pi, 1.0, 0),
        (2.4, -1.0, 2), (2.6, -1.0, 2), (1.5, -1.0, 2),
    ],
)  # fmt: skip
def test_a_given_motion_is_in_the_regime_after_the_last_boundary_it_met(
    angle: float, speed: float, regime: int
) -> None:
    crank = linkage(boundaries=BOUNDARIES, start_regime=0)
    assert crank.guided(0, 0.0, CrankState(angle, speed, 0.0)).regime == regime


def test_a_motion_that_meets_no_boundary_is_in_the_regime_of_the_start() -> None:
    one_way = linkage(boundaries=BOUNDARIES[:2], start_regime=3)
    assert one_way.guided(0, 0.0, CrankState(1.5, -1.0, 0.0)).regime == 3
    assert one_way.guided(0, 0.0, CrankState(1.5, 1.0, 0.0)).regime == 1


def test_a_torque_that_is_no_number_is_told_with_its_time() -> None:
    broken = shaking()._replace(crank_m=nan)
    with pytest.raises(MotionError, match=r"torque.* from 0\.008 s"):
        linkage(broken).start(4)
    with pytest.raises(MotionError, match=r"torque.* from 0\.7 s"):
        linkage(broken).guided(0, 0.7, CrankState(0.0, 1.0, 0.0))
