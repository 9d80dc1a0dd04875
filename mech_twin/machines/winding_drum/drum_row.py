# SPDX-License-Identifier: Apache-2.0
"""The drum as rows of numbers: a coupling step of its linkage and its force analysis, as kernels."""

from __future__ import annotations

from math import cos, sin
from typing import NamedTuple

from mech_twin.engine.compiled_steps import force_step, linkage_step, log_event, step_of
from mech_twin.engine.sample_vectors import (
    EVENT_WIDTH,
    MOTOR_COMMAND,
    MOTOR_JOINTS,
    PRE_VELOCITY,
    SIDES,
    Array,
)
from mech_twin.kernel import kernel
from mech_twin.machines.winding_drum.dynamics import coasted, drive_torque, driven, start_sense
from mech_twin.machines.winding_drum.memory import memory_of, motion_of, residuals_of
from mech_twin.machines.winding_drum.wound_package import (
    Package,
    Wound,
    gravity_moment,
    package_inertia,
    package_mass,
    radius_after,
    rate_of_momentum,
    speed_terms,
    tangent_arm,
    time_of_length,
    torque_terms,
    wound_at,
)
from mech_twin.parts.friction import sliding_torque

RUNNING, ENDED, STUCK = 0, 1, 2
END_KIND, STICK_KIND, RELEASE_KIND = 0, 1, 2
PACKAGE_CONTACT, DRUM_CONTACT = 0, 1
FAILURES = (
    "winding_drum: no integration step of 1e-13 s or more is small enough for the drum; friction changes too fast",
)
TOO_SHORT = -1


class Drum(NamedTuple):
    """Constants of the linkage role."""

    package: Package
    start_radius_m: float
    end_radius_m: float
    step_s: float


class LoadedDrum(NamedTuple):
    """Constants of the force analysis."""

    package: Package
    start_radius_m: float


@kernel
def wound_by_yarn(p: Package, first: float, yarn_m: float, radius: float) -> Wound:
    """Return what is on a drum of this radius (m) when this much yarn (m) has run since radius ``first`` (m).

    The area is that of the yarn: what a step winds may be less than the last digit of the radius.
    """
    return Wound(radius, wound_at(p, first).square_m2 - 2.0 * p.layer_m * yarn_m)


@kernel
def turning_energy(model: Drum, yarn_m: float, omega: float) -> float:
    """Return the kinetic energy of the drum (J) when this much yarn (m) has run."""
    wound = wound_by_yarn(model.package, model.start_radius_m, yarn_m, 0.0)
    return 0.5 * package_inertia(model.package, wound) * (omega * omega)


@kernel
def fill_row(model: Drum, regime: int, command: float, out: Array) -> None:
    """Fill in what follows from angle, rates, radius and memory, which are in place: efforts, residuals."""
    p, now, past, residuals = model.package, motion_of(out), memory_of(out), residuals_of(out)
    radius, theta = now.radius_m, now.yarn_m_per_s
    now.regime, now.command = regime, command
    now.drum_nm, now.yarn_n, now.radius_m_per_s, now.radius_n = 0.0, 0.0, 0.0, 0.0
    if regime == RUNNING:
        now.radius_m_per_s = -p.layer_m * theta / radius
        wound = wound_by_yarn(p, model.start_radius_m, now.yarn_m, radius)
        now.drum_nm = drive_torque(p, wound, now.drum_rad, theta, past.yarn_acceleration_m_per_s2)
    first, last = model.start_radius_m, model.end_radius_m
    lost = first * first - radius * radius
    residuals.area_balance = (lost - 2.0 * p.layer_m * now.yarn_m) / abs(first * first - last * last)
    work = past.drive_work_j + past.gravity_work_j - past.friction_loss_j
    turned_over = past.initial_energy_j + abs(past.drive_work_j) + past.friction_loss_j
    held = turning_energy(model, now.yarn_m, now.drum_rad_per_s)
    past.largest_energy_j = max(past.largest_energy_j, held)
    turned_over = max(turned_over, past.largest_energy_j)  # a stop gives the drive back what it gave
    residuals.energy_balance = (past.initial_energy_j + work - held) / max(1.0, turned_over)


@kernel
def start_row(model: Drum, theta: float, command: float, out: Array) -> None:
    """Fill the row of the package at its first radius, the yarn at a speed (m/s)."""
    out[:] = 0.0
    omega, now, past = theta / tangent_arm(model.package, model.start_radius_m, 0.0), motion_of(out), memory_of(out)
    now.drum_rad_per_s, now.yarn_m_per_s, now.radius_m = omega, theta, model.start_radius_m
    past.initial_energy_j = turning_energy(model, 0.0, omega)
    fill_row(model, RUNNING, command, out)


@kernel
def drive(model: Drum, a: float, h: float, run: float, speed: float, out: Array) -> bool:
    """Carry the drum on under the yarn for h (s); return whether every step was small enough.

    ``run`` is the yarn (m) that runs meanwhile, ``speed`` its speed at the end (m/s).
    """
    p, now, past = model.package, motion_of(out), memory_of(out)
    wound = wound_by_yarn(p, model.start_radius_m, now.yarn_m, now.radius_m)
    done, good = driven(p, wound, now.drum_rad, now.yarn_m_per_s, a, h)
    radius = radius_after(p, now.radius_m, run)
    now.drum_rad, now.yarn_m, now.radius_m = done.angle_rad, now.yarn_m + run, radius
    now.drum_rad_per_s, now.yarn_m_per_s = speed / tangent_arm(p, radius, done.angle_rad), speed
    past.yarn_acceleration_m_per_s2 = a
    past.drive_work_j = past.drive_work_j + done.drive_work_j
    past.gravity_work_j = past.gravity_work_j + done.gravity_work_j
    past.friction_loss_j = past.friction_loss_j + done.friction_loss_j
    return good


@kernel
def log_drum(log: Array, count: int, time_s: float, kind: int, contact: int, phi: float, torque_nm: float) -> Array:
    """Write an event with the angle of the drum on either side; rates and velocities are 0."""
    log = log_event(log, count, time_s, kind, contact, 0.0, 0.0, 0.0, 0.0)
    log[count, SIDES], log[count, EVENT_WIDTH:] = 1.0, 0.0
    log[count, EVENT_WIDTH], log[count, EVENT_WIDTH + 3] = phi, phi
    log[count, EVENT_WIDTH + 2] = torque_nm
    return log


@kernel
def coast(
    model: Drum, step: int, regime: int, done: float, out: Array, log: Array, count: int
) -> tuple[Array, int, int]:
    """Let the drum coast from ``done`` (s) of the step on; return the events, their number and the regime."""
    p, step_s, now, past = model.package, model.step_s, motion_of(out), memory_of(out)
    wound, begin = wound_at(p, now.radius_m), step * step_s
    while step_s - done > 1e-15 * step_s:
        if now.drum_rad_per_s == 0.0:
            sense = start_sense(p, wound, now.drum_rad)
            if (regime == STUCK) == (sense != 0.0):
                regime = ENDED if sense != 0.0 else STUCK
                kind = RELEASE_KIND if sense != 0.0 else STICK_KIND
                log = log_drum(log, count, begin + done, kind, DRUM_CONTACT, now.drum_rad, 0.0)
                count += 1
            if sense == 0.0:
                break
        piece = coasted(p, wound, now.drum_rad, now.drum_rad_per_s, step_s - done)
        if piece.time_s < 0.0:
            return log, TOO_SHORT, regime
        done += piece.time_s
        now.drum_rad, now.drum_rad_per_s = piece.phi_rad, piece.omega_rad_per_s
        past.gravity_work_j = past.gravity_work_j + piece.gravity_work_j
        past.friction_loss_j = past.friction_loss_j + piece.friction_loss_j
    return log, count, regime


@step_of(linkage_step, Drum)
def drum_step(
    model: Drum, step: int, linkage: Array, motor: Array, body: Array, out: Array, log: Array
) -> tuple[Array, int]:
    """Fill in the drum one step later; the end of the package is located exactly inside the step."""
    p, h, command = model.package, model.step_s, motor[MOTOR_COMMAND]
    out[:] = linkage
    now, past, count, done = motion_of(out), memory_of(out), 0, 0.0
    regime = int(now.regime)
    if regime == RUNNING:
        theta, radius, speed = now.yarn_m_per_s, now.radius_m, motor[MOTOR_JOINTS + 1]
        a, run = (speed - theta) / h, 0.5 * (theta + speed) * h
        left = (radius * radius - model.end_radius_m * model.end_radius_m) / (2.0 * p.layer_m)
        if run < left:
            good = drive(model, a, h, run, speed, out)
            fill_row(model, RUNNING, command, out)
            return log, 0 if good else TOO_SHORT
        done = time_of_length(theta, a, left)
        if not drive(model, a, done, left, theta + a * done, out):
            return log, TOO_SHORT
        now.radius_m, regime, count = model.end_radius_m, ENDED, 1
        wound, omega = wound_at(p, model.end_radius_m), now.drum_rad_per_s
        torque = drive_torque(p, wound, now.drum_rad, now.yarn_m_per_s, a)
        log = log_drum(log, 0, step * h + done, END_KIND, PACKAGE_CONTACT, now.drum_rad, torque)
        log[0, PRE_VELOCITY], log[0, EVENT_WIDTH + 1], log[0, EVENT_WIDTH + 4] = now.yarn_m_per_s, omega, omega
        now.yarn_m_per_s, past.yarn_acceleration_m_per_s2 = 0.0, 0.0
    log, count, regime = coast(model, step, regime, done, out, log, count)
    fill_row(model, regime, command, out)
    return log, count


@step_of(force_step, LoadedDrum)
def drum_forces(
    model: LoadedDrum, step: int, linkage: Array, log: Array, count: int, out: Array, loads: Array
) -> tuple[Array, int]:
    """Fill in each torque term by itself, and the force that carries the package round its axis.

    The drive torque of the linkage is a sum of terms; the second route is the chain rule on J0 omega.  The shaft's
    force is what accelerates the centre c of the package, and its weight: c'' = -omega^2 c + alpha k x c with
    c = e (-sin(phi), cos(phi)).
    """
    p, now, a = model.package, motion_of(linkage), memory_of(linkage).yarn_acceleration_m_per_s2
    torque, theta, phi, radius, omega = now.drum_nm, now.yarn_m_per_s, now.drum_rad, now.radius_m, now.drum_rad_per_s
    wound = wound_at(p, radius)
    if now.regime == RUNNING:
        wound = wound_by_yarn(p, model.start_radius_m, now.yarn_m, radius)
    gravity, inertia, mass = gravity_moment(p, wound, phi), package_inertia(p, wound), package_mass(p, wound)
    terms, (first, second, third) = torque_terms(p, wound, phi, theta, a), speed_terms(p, radius, phi, theta, a)
    alpha, friction, difference = first + second + third, 0.0, 0.0
    if now.regime == RUNNING:
        friction = torque - terms.total + gravity
        if omega > 0.0 or a > 0.0:
            friction = -sliding_torque(p.coulomb_nm, p.viscous_nms_per_rad, omega, 1.0)
            route = rate_of_momentum(p, wound, phi, theta, a) - gravity + friction
            largest = max(abs(terms.acceleration), abs(terms.radius), abs(terms.eccentric), abs(terms.mass))
            difference = (torque - route) / max(largest, abs(gravity), abs(friction), 1e-9)
    elif omega != 0.0:
        sense = 1.0 if omega > 0.0 else -1.0
        friction = -sliding_torque(p.coulomb_nm, p.viscous_nms_per_rad, omega, sense)
        alpha = (gravity - friction) / inertia
    else:
        friction = gravity
    x, y = -p.eccentricity_m * sin(phi), p.eccentricity_m * cos(phi)
    numbers = (
        0.0,
        mass * (-omega * omega * x - alpha * y),
        mass * (-omega * omega * y + alpha * x + p.gravity),
        torque - friction,
        terms.acceleration,
        terms.radius,
        terms.eccentric,
        terms.mass,
        terms.total,
        gravity,
        friction,
        radius,
        inertia,
        mass,
        tangent_arm(p, radius, phi),
        alpha,
        a,
        torque * omega,
        difference,
    )
    for i in range(len(numbers)):
        out[i] = numbers[i]
    return loads, 0
