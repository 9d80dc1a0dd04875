# SPDX-License-Identifier: Apache-2.0
"""The motion against a second implementation: own kinematics, own Kloss curve, own load, scipy's DOP853 at 1e-12.

Nothing here comes from `mech_twin.parts` or `mech_twin.machines` but the numbers of the configuration.  The second
implementation runs from dead centre to dead centre, where the load has its kinks.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from roller_former_cases import machine_for, parameters_for
from scipy.integrate import solve_ivp

from mech_twin.engine.run import frames
from mech_twin.machines.roller_former.parameters import RollerFormer

AT_SPEED = {"start.speed_fraction": 0.97, "start.load_from_fraction": 0.0, "coupling.step_s": 5e-5}
DURATION_S = 0.4


def cart(p: RollerFormer, psi: float) -> tuple[float, float, float]:
    """Return dx/dpsi, d2x/dpsi2 (m) and the moment arm of the rod force (m), by the angles of crank and rod."""
    r, ratio = p.carts.crank_m, p.carts.crank_m / p.carts.rod_m
    beta = math.asin(ratio * math.sin(psi))
    turn = ratio * math.cos(psi) / math.cos(beta)  # d beta/d psi
    first = -r * math.sin(psi + beta) / math.cos(beta)
    second = -r * (math.cos(psi + beta) * (1.0 + turn) + math.sin(psi + beta) * math.tan(beta) * turn) / math.cos(beta)
    return first, second, r * math.sin(psi + beta)


def load_moment(p: RollerFormer, psi: float, side: float) -> float:
    """Return the load of a cart that reverses with the travel, turning forward (N m)."""
    c = p.carts
    beta = math.asin(c.crank_m / c.rod_m * math.sin(psi))
    base = (2.0 * c.roller_force_y_n - c.weight_n) * c.friction + 2.0 * c.roller_force_x_n
    force = side * base / (math.cos(beta) - side * c.friction * math.sin(beta))
    return force * c.crank_m * math.sin(psi + beta)


def kloss(p: RollerFormer, crank_speed: float) -> float:
    """Return the motor's moment behind the gear (N m), which loses by the sign of power."""
    motor, u, eta = p.motor, p.drive.ratio, p.drive.efficiency
    synchronous = motor.synchronous_speed_rpm * math.pi / 30.0
    slip = 1.0 - crank_speed * u / synchronous
    most = motor.breakdown_torque_nm
    torque = 2.0 * most / (slip / motor.breakdown_slip + motor.breakdown_slip / slip) if slip != 0.0 else 0.0
    return torque * u * (eta if torque * crank_speed > 0.0 else 1.0 / eta)


def independent(p: RollerFormer, offsets: list[float], weight: bool) -> np.ndarray:
    """Return crank angle, twist, crank speed and twist rate at the end."""
    c, d = p.carts, p.drive
    half = 0.5 * c.rod_mass_kg
    first = (p.motor.rotor_inertia_kg_m2 + d.coupling_inertia_kg_m2) * d.inertia_factor * d.ratio**2

    def slope(_: float, y: np.ndarray, sides: list[float]) -> list[float]:
        crank, twist, speed, rate = y
        inertia, half_slope, against = len(offsets) * half * c.crank_m**2, 0.0, 0.0
        for offset, side in zip(offsets, sides, strict=True):
            x1, x2, _arm = cart(p, crank + offset)
            inertia += (c.mass_kg + half) * x1 * x1
            half_slope += (c.mass_kg + half) * x1 * x2
            against += load_moment(p, crank + offset, side)
            if weight:
                against += half * c.gravity_m_per_s2 * c.crank_m * math.cos(crank + offset)
        against += math.copysign(p.friction.coulomb_nm, speed) + p.friction.viscous_nms_per_rad * speed
        passed = d.stiffness_nm_per_rad * twist + d.damping_nms_per_rad * rate
        ahead = (passed - against - half_slope * speed * speed) / inertia
        return [speed, rate, ahead, (kloss(p, speed + rate) - passed) / first - ahead]

    synchronous = p.motor.synchronous_speed_rpm * math.pi / 30.0 / d.ratio
    y, t = np.array([math.radians(p.start.crank_deg), 0.0, p.start.speed_fraction * synchronous, 0.0]), 0.0
    while t < DURATION_S:
        middle = y[0] + 1e-7
        sides = [1.0 if math.sin(middle + offset) >= 0.0 else -1.0 for offset in offsets]
        ahead = min(math.floor((middle + o) / math.pi + 1.0) * math.pi - o for o in offsets)

        def centre(_: float, state: np.ndarray, _sides: list[float], at: float = ahead) -> float:
            return float(state[0] - at)

        centre.terminal = True  # type: ignore[attr-defined]
        run = solve_ivp(
            slope, (t, DURATION_S), y, "DOP853", rtol=1e-12, atol=1e-14, events=centre, args=(sides,), max_step=2e-3
        )
        assert run.success
        y, t = run.y[:, -1], float(run.t[-1])
    return y


CASES: tuple[dict[str, Any], ...] = (
    {"start.crank_deg": 77.0, "friction.coulomb_nm": 25.0, "friction.viscous_nms_per_rad": 2.0},
    {"start.crank_deg": -130.0, "carts.gravity_m_per_s2": 9.81, "carts.rod_mass_kg": 90.0, "carts.crank_m": 0.35},
    {"drive.stiffness_nm_per_rad": 25000.0, "drive.damping_nms_per_rad": 300.0, "carts.roller_force_x_n": 600.0},
    {"drive.efficiency": 0.6, "carts.friction": 0.2, "carts.roller_force_x_n": 300.0, "start.crank_deg": 200.0},
)


@pytest.mark.parametrize(
    "changes",
    [{}, *(pytest.param(changes, marks=pytest.mark.slow) for changes in CASES)],
    ids=["default", "friction", "rods", "soft", "lossy"],
)
@pytest.mark.parametrize("carts", [1, *(pytest.param(carts, marks=pytest.mark.slow) for carts in (2, 3))])
def test_the_motion_is_that_of_a_second_implementation(carts: int, changes: dict[str, Any]) -> None:
    overrides = {**AT_SPEED, **changes, "integrator.tolerance": 1e-12}
    p = parameters_for(carts, overrides)
    offsets = [math.radians(i * p.carts.offset_deg) for i in range(carts)]
    expected = independent(p, offsets, p.carts.gravity_m_per_s2 > 0.0)
    *_, frame = frames(machine_for(carts, overrides), DURATION_S)
    joints, rates = frame.linkage.position, frame.linkage.velocity
    found = np.array([joints[1], joints[2], rates[1], rates[2]])
    scale = np.array([1.0, 1e-3, 10.0, 0.1])
    assert np.max(np.abs(found - expected) / scale) < 1e-5  # what the exchange of torque once in 0.05 ms leaves
