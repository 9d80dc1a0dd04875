# SPDX-License-Identifier: Apache-2.0
"""Motion of the drum within a step: driven by the yarn's prescribed speed, or coasting once yarn and drive let go."""

from __future__ import annotations

from math import copysign, exp, expm1, inf, log1p, sqrt
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mech_twin.engine.events import FALLING, RISING, Step, Watch, crossing, signals_of
from mech_twin.engine.integration import (
    Workspace,
    controlled_step,
    method_of,
    rates_of,
    start_step,
    take_step,
)
from mech_twin.engine.tableaus import DORMAND_PRINCE_8
from mech_twin.kernel import inline_kernel, kernel
from mech_twin.machines.winding_drum.wound_package import (
    Package,
    Wound,
    gravity_moment,
    package_inertia,
    package_mass,
    tangent_arm,
    torque_terms,
    wound_after,
)
from mech_twin.parts.friction import released, sliding_torque

Array = NDArray[np.float64]
MOST_STEPS = 100_000
STATE_SIZE = 4  # of a drum under the yarn, and of one that coasts
RELATIVE = 1e-13  # error of a step over the size of what it integrates
SURE_RAD = 0.5  # turned in a step: up to here the eighth order is right to about RELATIVE, whatever its estimate says


class DrivenState(NamedTuple):
    """What is integrated under the yarn: the drum's angle, and works meanwhile."""

    angle_rad: float
    drive_work_j: float
    gravity_work_j: float
    friction_loss_j: float


class CoastingState(NamedTuple):
    """What is integrated without yarn and drive."""

    angle_rad: float
    speed_rad_per_s: float
    gravity_work_j: float
    friction_loss_j: float


@kernel
def driven_state(y: Array) -> DrivenState:
    """Return a state under the yarn (4,) by name."""
    return DrivenState(y[0], y[1], y[2], y[3])


@kernel
def coasting_state(y: Array) -> CoastingState:
    """Return a coasting state (4,) by name."""
    return CoastingState(y[0], y[1], y[2], y[3])


@kernel
def fill_state(y: Array, state: DrivenState | CoastingState) -> None:
    """Put either state, or its rates, into an array (4,)."""
    for i in range(STATE_SIZE):
        y[i] = state[i]


class Driven(NamedTuple):
    """Drum under yarn of speed theta + a t; its state is a `DrivenState`."""

    package: Package
    wound: Wound
    theta_m_per_s: float
    acceleration_m_per_s2: float


class Coasting(NamedTuple):
    """Drum without yarn and drive; its state is a `CoastingState`.

    ``direction`` is the sense of turning, +1 or -1.
    """

    package: Package
    wound: Wound
    direction: float


@inline_kernel
def drive_torque(p: Package, wound: Wound, phi: float, theta: float, a: float) -> float:
    """Return the torque the drive gives (N m): the dynamic torque, less gravity's moment, and friction overcome.

    At rest friction takes what it can hold of it.
    """
    wanted = torque_terms(p, wound, phi, theta, a).total - gravity_moment(p, wound, phi)
    omega = theta / tangent_arm(p, wound.radius_m, phi)
    if omega > 0.0 or a > 0.0:
        return wanted - sliding_torque(p.coulomb_nm, p.viscous_nms_per_rad, omega, 1.0)
    return wanted - min(max(wanted, -p.coulomb_nm), p.coulomb_nm)


@rates_of(Driven, DORMAND_PRINCE_8)
def driven_rates(system: Driven, t: float, y: Array, out: Array) -> None:
    """Fill the rates of angle (rad/s), work of the drive, work of gravity and friction loss (W)."""
    p, theta, a = system.package, system.theta_m_per_s, system.acceleration_m_per_s2
    wound, speed = wound_after(p, system.wound, (theta + 0.5 * a * t) * t), theta + a * t
    phi = driven_state(y).angle_rad
    omega = speed / tangent_arm(p, wound.radius_m, phi)
    drive, gravity = drive_torque(p, wound, phi, speed, a), gravity_moment(p, wound, phi)
    lost = -sliding_torque(p.coulomb_nm, p.viscous_nms_per_rad, omega, 1.0) * omega
    fill_state(out, DrivenState(omega, drive * omega, gravity * omega, lost))


@rates_of(Coasting, DORMAND_PRINCE_8)
def coasting_rates(system: Coasting, t: float, y: Array, out: Array) -> None:
    """Fill the rates of angle, speed, work of gravity and friction loss."""
    p, now = system.package, coasting_state(y)
    speed, gravity = now.speed_rad_per_s, gravity_moment(p, system.wound, now.angle_rad)
    friction = sliding_torque(p.coulomb_nm, p.viscous_nms_per_rad, speed, system.direction)
    acceleration = (gravity + friction) / package_inertia(p, system.wound)
    fill_state(out, CoastingState(speed, acceleration, gravity * speed, -friction * speed))


@signals_of(Coasting)
def coasting_signal(system: Coasting, index: int, t: float, y: Array) -> tuple[float, float]:
    """Return the speed and its derivative: it comes to rest where the speed is zero."""
    p, now = system.package, coasting_state(y)
    speed, gravity = now.speed_rad_per_s, gravity_moment(p, system.wound, now.angle_rad)
    friction = sliding_torque(p.coulomb_nm, p.viscous_nms_per_rad, speed, system.direction)
    return speed, (gravity + friction) / package_inertia(p, system.wound)


@kernel
def sure_step(
    system: Driven | Coasting, t: float, y: Array, wanted: float, sure: float, tolerance: Array, work: Workspace
) -> tuple[float, float]:
    """Take a step like `controlled_step`, one beyond ``sure`` (s) only if its fifth-order error alone is small enough.

    All that is integrated varies with the angle of the drum and hardly else, so that the fifth-order errors of all are
    zero at the same angles.  There the estimate, which falls with their square, says nothing of a step of radians.
    """
    h, following = controlled_step(system, t, y, wanted, tolerance, work)
    if h <= sure:
        return h, following
    weights, square = method_of(system).errors[0], 0.0
    for i in range(STATE_SIZE):
        total = 0.0
        for j in range(len(weights)):
            total += weights[j] * work.rates[j, i]
        square += (h * total / tolerance[i]) ** 2
    if square <= STATE_SIZE:
        return h, following
    return controlled_step(system, t, y, sure, tolerance, work)


@kernel
def drive_drum(system: Driven, y: Array, span: float, sure: float, tolerance: Array) -> bool:
    """Advance ``y`` by ``span`` (s); return whether a step was found that is small enough.  ``sure``: `sure_step`."""
    work = Workspace(np.empty((len(method_of(system).nodes), STATE_SIZE)), np.empty(STATE_SIZE), np.empty(STATE_SIZE))
    t, wanted = 0.0, span
    for _ in range(MOST_STEPS):
        if span - t <= 1e-15 * span:
            return True
        start_step(system, t, y, work)
        h, wanted = sure_step(system, t, y, min(wanted, span - t), sure, tolerance, work)
        if h == 0.0 or not np.isfinite(driven_state(work.end).drive_work_j):
            return False
        y[:] = work.end
        t += h
    return False


@kernel
def coast_drum(system: Coasting, y: Array, span: float, sure: float, tolerance: Array) -> tuple[float, bool]:
    """Advance ``y`` until ``span`` (s) is over or the drum comes to rest; return the time (s) and whether it went well.

    At rest the speed is exactly 0.  ``sure``: `sure_step`.
    """
    work = Workspace(np.empty((len(method_of(system).nodes), STATE_SIZE)), np.empty(STATE_SIZE), np.empty(STATE_SIZE))
    end = np.empty(STATE_SIZE)
    t, wanted = 0.0, span
    for _ in range(MOST_STEPS):
        if span - t <= 1e-15 * span:
            return span, True
        start_step(system, t, y, work)
        h, wanted = sure_step(system, t, y, min(wanted, span - t), sure, tolerance, work)
        if h == 0.0 or not np.isfinite(coasting_state(work.end).speed_rad_per_s):
            return t, False
        end[:] = work.end
        stands = coasting_state(y).speed_rad_per_s == 0.0
        watch = Watch(0, FALLING if system.direction > 0.0 else RISING, stands)
        rest = crossing(Step(system, t, y, h, work), watch, end)
        if rest >= 0.0 and (rest > 0.0 or not stands):
            take_step(system, t, y, rest, work)
            now = coasting_state(work.end)
            fill_state(y, CoastingState(now.angle_rad, 0.0, now.gravity_work_j, now.friction_loss_j))
            return t + rest, True
        y[:] = end
        t += h
    return t, False


@kernel
def driven(package: Package, wound: Wound, phi: float, theta: float, a: float, h: float) -> tuple[DrivenState, bool]:
    """Return the drum's angle after h seconds, and the works meanwhile.

    Parameters
    ----------
    package : Package
        Constants.
    wound : Wound
        What is on the drum at the start.
    phi : float
        Drum angle at the start (rad).
    theta, a : float
        Yarn speed at the start (m/s) and its acceleration (m/s2).
    h : float
        Time (s).

    Returns
    -------
    DrivenState, bool
        The state, and whether every step was small enough.
    """
    y, tolerance = np.empty(STATE_SIZE), np.empty(STATE_SIZE)
    fill_state(y, DrivenState(phi, 0.0, 0.0, 0.0))
    speed = (theta + max(a, 0.0) * h) / (wound.radius_m - package.eccentricity_m)
    # an angle keeps no more digits than it has
    digits = max(1e-13 * max(1.0, speed * h), 1e-15 * abs(phi))
    work = _work_error(package, wound, theta + max(a, 0.0) * h, h)
    fill_state(tolerance, DrivenState(digits, work, work, work))
    sure = SURE_RAD / speed if speed > 0.0 else h
    good = drive_drum(Driven(package, wound, theta, a), y, h, sure, tolerance)
    return driven_state(y), good


class Coasted(NamedTuple):
    """How a coasting piece ended: its time, the state, and the work meanwhile; at rest the speed is exactly 0.

    The time is negative where no step was small enough.
    """

    time_s: float
    phi_rad: float
    omega_rad_per_s: float
    gravity_work_j: float
    friction_loss_j: float


@kernel
def coasted(package: Package, wound: Wound, phi: float, omega: float, h: float) -> Coasted:
    """Return the drum after ``h`` seconds without yarn and drive, or where it comes to rest before."""
    direction = 1.0 if omega > 0.0 else -1.0 if omega < 0.0 else start_sense(package, wound, phi)
    if direction == 0.0:
        return Coasted(h, phi, 0.0, 0.0, 0.0)
    inertia = package_inertia(package, wound)
    unbalance = package_mass(package, wound) * package.gravity * package.eccentricity_m
    if unbalance == 0.0:
        return _run_down(package, inertia, phi, omega, h)
    y, tolerance = np.empty(STATE_SIZE), np.empty(STATE_SIZE)
    fill_state(y, CoastingState(phi, omega, 0.0, 0.0))
    swing = sqrt(2.0 * package_mass(package, wound) * package.gravity * package.eccentricity_m / inertia)
    work = _energy_error(inertia, omega)
    fill_state(tolerance, CoastingState(1e-13, RELATIVE * (abs(omega) + swing + 1e-6), work, work))
    sure = SURE_RAD / (abs(omega) + swing + 1e-6)
    time, good = coast_drum(Coasting(package, wound, direction), y, h, sure, tolerance)
    now = coasting_state(y)
    ended = time if good else -1.0
    return Coasted(ended, now.angle_rad, now.speed_rad_per_s, now.gravity_work_j, now.friction_loss_j)


@kernel
def _run_down(package: Package, inertia: float, phi: float, omega: float, h: float) -> Coasted:
    """Return a balanced drum after ``h`` seconds, or at rest before: J u' = -c - v u in closed form, u = |omega|.

    With x = v t/J and f1(x) = (1 - exp(-x))/x, f2(x) = (1 - f1(x))/x: u = u0 exp(-x) - (c/J) t f1, and the way is
    u0 t f1 - (c/J) t^2 f2.  It rests at t = (J/v) ln(1 + v u0/c).
    """
    c, v, u = package.coulomb_nm, package.viscous_nms_per_rad, abs(omega)
    rest = inf
    if c > 0.0:
        ratio = v * u / c
        rest = inertia * u / c * (log1p(ratio) / ratio if ratio > 0.0 else 1.0)
    t = min(h, rest)
    x = v * t / inertia
    f1 = -expm1(-x) / x if x > 0.0 else 1.0
    f2 = (1.0 - f1) / x if x > 1e-3 else 0.5 - x / 6.0 + x * x / 24.0
    after = 0.0 if rest <= h else u * exp(-x) - c / inertia * t * f1
    way = u * t * f1 - c / inertia * t * t * f2
    loss = 0.5 * inertia * (u - after) * (u + after)
    return Coasted(t, phi + copysign(way, omega), copysign(after, omega) if after != 0.0 else 0.0, 0.0, loss)


@kernel
def start_sense(package: Package, wound: Wound, phi: float) -> float:
    """Return the sense (+1, -1) in which a drum at rest starts under the weight of its package, 0 where it sticks."""
    return released(package.coulomb_nm, gravity_moment(package, wound, phi))


@kernel
def _work_error(package: Package, wound: Wound, theta: float, h: float) -> float:
    """Return the error (J) of the works of a step, whose size is the energy held or moved in ``h`` (s)."""
    speed = theta / (wound.radius_m - package.eccentricity_m)
    gravity = package_mass(package, wound) * package.gravity * package.eccentricity_m
    moved = (gravity + package.coulomb_nm + package.viscous_nms_per_rad * speed) * speed * h
    end = wound_after(package, wound, theta * h) if package.layer_m < 0.0 else wound  # a full one is heavier
    return max(_energy_error(package_inertia(package, end), speed), RELATIVE * moved)


@kernel
def _energy_error(inertia: float, omega: float) -> float:
    return RELATIVE * max(1.0, 0.5 * inertia * omega * omega)
