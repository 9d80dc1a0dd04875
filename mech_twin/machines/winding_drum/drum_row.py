# SPDX-License-Identifier: Apache-2.0
"""The drum as rows of numbers: a coupling step of its linkage and its force analysis, as kernels."""

from __future__ import annotations

from math import cos, sin
from typing import NamedTuple

from mech_twin.engine.compiled_steps import force_step, linkage_step, log_event, step_of
from mech_twin.engine.sample_vectors import (
    COMMAND,
    EVENT_WIDTH,
    LINKAGE_JOINTS,
    MOTOR_COMMAND,
    MOTOR_JOINTS,
    REGIME,
    SIDES,
    Array,
)
from mech_twin.kernel import kernel
from mech_twin.machines.winding_drum.dynamics import coasted, drive_torque, driven, start_sense
from mech_twin.machines.winding_drum.wound_package import (
    Package,
    gravity_moment,
    package_inertia,
    package_mass,
    radius_after,
    rate_of_momentum,
    speed_terms,
    tangent_arm,
    time_of_length,
    torque_terms,
)
from mech_twin.parts.friction import sliding_torque

RUNNING, ENDED, STUCK = 0, 1, 2
END_KIND, STICK_KIND, RELEASE_KIND = 0, 1, 2
PACKAGE_CONTACT, DRUM_CONTACT = 0, 1
# places in a row: drum, yarn that has run, radius of the package; memory; residuals
DRUM_AT, YARN_AT, RADIUS_AT, MEMORY_AT = (LINKAGE_JOINTS + 3 * joint for joint in range(4))
ACCELERATION, DRIVE_WORK, GRAVITY_WORK, FRICTION_LOSS, INITIAL_ENERGY, LARGEST_ENERGY = range(MEMORY_AT, MEMORY_AT + 6)
AREA_BALANCE, ENERGY_BALANCE = MEMORY_AT + 6, MEMORY_AT + 7
FAILURES = ("winding_drum: no integration step is small enough for the drum",)
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


@kernel
def turning_energy(p: Package, radius: float, omega: float) -> float:
    """Return the kinetic energy of the drum (J)."""
    return 0.5 * package_inertia(p, radius) * (omega * omega)


@kernel
def fill_row(model: Drum, regime: int, command: float, out: Array) -> None:
    """Fill in what follows from angle, rates, radius and memory, which are in place: efforts, residuals."""
    p, radius, theta = model.package, out[RADIUS_AT], out[YARN_AT + 1]
    out[REGIME], out[COMMAND] = regime, command
    out[DRUM_AT + 2], out[YARN_AT + 2], out[RADIUS_AT + 1], out[RADIUS_AT + 2] = 0.0, 0.0, 0.0, 0.0
    if regime == RUNNING:
        out[RADIUS_AT + 1] = -p.layer_m * theta / radius
        out[DRUM_AT + 2] = drive_torque(p, radius, out[DRUM_AT], theta, out[ACCELERATION])
    first, last = model.start_radius_m, model.end_radius_m
    lost = first * first - radius * radius
    out[AREA_BALANCE] = (lost - 2.0 * p.layer_m * out[YARN_AT]) / abs(first * first - last * last)
    work = out[DRIVE_WORK] + out[GRAVITY_WORK] - out[FRICTION_LOSS]
    turned_over = out[INITIAL_ENERGY] + abs(out[DRIVE_WORK]) + out[FRICTION_LOSS]
    held = turning_energy(p, radius, out[DRUM_AT + 1])
    out[LARGEST_ENERGY] = max(out[LARGEST_ENERGY], held)
    turned_over = max(turned_over, out[LARGEST_ENERGY])  # a stop gives the drive back what it gave
    out[ENERGY_BALANCE] = (out[INITIAL_ENERGY] + work - held) / max(1.0, turned_over)


@kernel
def start_row(model: Drum, theta: float, command: float, out: Array) -> None:
    """Fill the row of the package at its first radius, the yarn at a speed (m/s)."""
    out[:] = 0.0
    omega = theta / tangent_arm(model.package, model.start_radius_m, 0.0)
    out[DRUM_AT + 1], out[YARN_AT + 1], out[RADIUS_AT] = omega, theta, model.start_radius_m
    out[INITIAL_ENERGY] = turning_energy(model.package, model.start_radius_m, omega)
    fill_row(model, RUNNING, command, out)


@kernel
def drive(model: Drum, a: float, h: float, run: float, speed: float, out: Array) -> bool:
    """Carry the drum on under the yarn for h (s); return whether every step was small enough.

    ``run`` is the yarn (m) that runs meanwhile, ``speed`` its speed at the end (m/s).
    """
    p, radius = model.package, out[RADIUS_AT]
    done, good = driven(p, radius, out[DRUM_AT], out[YARN_AT + 1], a, h)
    radius = radius_after(p, radius, run)
    out[DRUM_AT], out[YARN_AT], out[RADIUS_AT] = done.angle_rad, out[YARN_AT] + run, radius
    out[DRUM_AT + 1], out[YARN_AT + 1] = speed / tangent_arm(p, radius, done.angle_rad), speed
    out[ACCELERATION] = a
    out[DRIVE_WORK] += done.drive_work_j
    out[GRAVITY_WORK] += done.gravity_work_j
    out[FRICTION_LOSS] += done.friction_loss_j
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
    p, radius, step_s = model.package, out[RADIUS_AT], model.step_s
    begin = step * step_s
    while step_s - done > 1e-15 * step_s:
        if out[DRUM_AT + 1] == 0.0:
            sense = start_sense(p, radius, out[DRUM_AT])
            if (regime == STUCK) == (sense != 0.0):
                regime = ENDED if sense != 0.0 else STUCK
                kind = RELEASE_KIND if sense != 0.0 else STICK_KIND
                log = log_drum(log, count, begin + done, kind, DRUM_CONTACT, out[DRUM_AT], 0.0)
                count += 1
            if sense == 0.0:
                break
        piece = coasted(p, radius, out[DRUM_AT], out[DRUM_AT + 1], step_s - done)
        if piece.time_s < 0.0:
            return log, TOO_SHORT, regime
        done += piece.time_s
        out[DRUM_AT], out[DRUM_AT + 1] = piece.phi_rad, piece.omega_rad_per_s
        out[GRAVITY_WORK] += piece.gravity_work_j
        out[FRICTION_LOSS] += piece.friction_loss_j
    return log, count, regime


@step_of(linkage_step, Drum)
def drum_step(
    model: Drum, step: int, linkage: Array, motor: Array, body: Array, out: Array, log: Array
) -> tuple[Array, int]:
    """Fill in the drum one step later; the end of the package is located exactly inside the step."""
    p, h, regime, command = model.package, model.step_s, int(linkage[REGIME]), motor[MOTOR_COMMAND]
    out[:] = linkage
    count, done = 0, 0.0
    if regime == RUNNING:
        theta, radius, speed = linkage[YARN_AT + 1], linkage[RADIUS_AT], motor[MOTOR_JOINTS + 1]
        a, run = (speed - theta) / h, 0.5 * (theta + speed) * h
        left = (radius * radius - model.end_radius_m * model.end_radius_m) / (2.0 * p.layer_m)
        if run < left:
            good = drive(model, a, h, run, speed, out)
            fill_row(model, RUNNING, command, out)
            return log, 0 if good else TOO_SHORT
        done = time_of_length(theta, a, left)
        if not drive(model, a, done, left, theta + a * done, out):
            return log, TOO_SHORT
        out[RADIUS_AT], regime, count = model.end_radius_m, ENDED, 1
        torque = drive_torque(p, model.end_radius_m, out[DRUM_AT], out[YARN_AT + 1], a)
        log = log_drum(log, 0, step * h + done, END_KIND, PACKAGE_CONTACT, out[DRUM_AT], torque)
        log[0, 3], log[0, EVENT_WIDTH + 1], log[0, EVENT_WIDTH + 4] = (
            out[YARN_AT + 1],
            out[DRUM_AT + 1],
            out[DRUM_AT + 1],
        )
        out[YARN_AT + 1], out[ACCELERATION] = 0.0, 0.0
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
    p, torque, theta, a = model.package, linkage[DRUM_AT + 2], linkage[YARN_AT + 1], linkage[ACCELERATION]
    phi, radius, omega = linkage[DRUM_AT], linkage[RADIUS_AT], linkage[DRUM_AT + 1]
    gravity, inertia, mass = gravity_moment(p, radius, phi), package_inertia(p, radius), package_mass(p, radius)
    terms, (first, second, third) = torque_terms(p, radius, phi, theta, a), speed_terms(p, radius, phi, theta, a)
    alpha, friction, difference = first + second + third, 0.0, 0.0
    if linkage[REGIME] == RUNNING:
        friction = torque - terms.total + gravity
        if omega > 0.0 or a > 0.0:
            friction = -sliding_torque(p.coulomb_nm, p.viscous_nms_per_rad, omega, 1.0)
            route = rate_of_momentum(p, radius, phi, theta, a) - gravity + friction
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
