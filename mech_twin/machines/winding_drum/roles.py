# SPDX-License-Identifier: Apache-2.0
"""The drum as rows of numbers: a coupling step of its linkage and its force analysis, as kernels and as roles.

The numbers of the linkage row have names: motion, memory, residuals.
"""

from dataclasses import dataclass
from functools import cached_property
from math import cos, inf, sin
from typing import Any, NamedTuple

import numpy as np

from mech_twin.engine.addresses import record_at, record_of
from mech_twin.engine.compiled_roles import CompiledLinkage
from mech_twin.engine.compiled_steps import Work, copy_numbers, force_step, linkage_step, step_of, work_room
from mech_twin.engine.hybrid.laws import HOLD, regime_of
from mech_twin.engine.hybrid.loop import MOST_PIECES, MOST_STEPS, room_sizes
from mech_twin.engine.sample_vectors import (
    MOTOR_COMMAND,
    MOTOR_JOINTS,
    REGIME,
    Array,
    EventLayout,
    ForceLayout,
    LinkageLayout,
)
from mech_twin.kernels.kernel import borrowing_kernel, kernel
from mech_twin.machines.winding_drum.dynamics import (
    ANGLE,
    DRIVE_WORK,
    FRICTION_LOSS,
    GRAVITY_WORK,
    LAWS,
    OWN_SIGNALS,
    SHAFT,
    SPEED,
    STATE_SIZE,
    YARN_ON,
    DrumSystem,
    Package,
    Wound,
    advance_drum,
    drive_torque,
    gravity_moment,
    package_inertia,
    package_mass,
    rate_of_momentum,
    speed_terms,
    tangent_arm,
    torque_terms,
    wound_after,
    wound_at,
)
from mech_twin.parts.friction_and_gear import sliding_torque
from mech_twin.samples import LinkageSample

REGIMES = ("running", "ended", "stuck")
RUNNING, ENDED, STUCK = range(len(REGIMES))
JOINTS, COORDINATES = ("drum", "yarn", "package_radius"), ("drum",)
QUANTITIES = (
    "acceleration_torque_nm",
    "radius_torque_nm",
    "eccentric_torque_nm",
    "mass_torque_nm",
    "dynamic_torque_nm",
    "gravity_moment_nm",
    "friction_torque_nm",
    "package_radius_m",
    "package_inertia_kg_m2",
    "package_mass_kg",
    "tangent_arm_m",
    "angular_acceleration_rad_per_s2",
    "yarn_acceleration_m_per_s2",
    "drive_power_w",
)
FAILURES = (
    f"winding_drum: more than {MOST_PIECES} changes of regime in a step; shorten coupling.step_s",
    "winding_drum: no integration step of 1e-13 s or more is small enough: friction.coulomb_nm or "
    "friction.viscous_nms_per_rad is too large for the drum's inertia",
    f"winding_drum: coupling.step_s takes more than {MOST_STEPS} steps of integration; shorten it",
)


class DrumMemory(NamedTuple):
    """State of the linkage besides its joints."""

    yarn_acceleration_m_per_s2: float
    drive_work_j: float
    gravity_work_j: float
    friction_loss_j: float
    initial_energy_j: float
    largest_energy_j: float


# regime, command of the motor; position, rate, effort of drum, yarn that has run, radius of the package
MOTION = (
    "regime", "command", "drum_rad", "drum_rad_per_s", "drum_nm", "yarn_m", "yarn_m_per_s", "yarn_n",
    "radius_m", "radius_m_per_s", "radius_n",
)  # fmt: skip
# zero but for rounding: area of the layers against the yarn, energy balance
RESIDUALS = ("area_balance", "energy_balance")
NAMES = (*MOTION, *DrumMemory._fields, *RESIDUALS)
ROW = record_of(NAMES)


@borrowing_kernel
def named(row: Array) -> Any:
    """Return a linkage row as a record that shares its numbers."""
    return record_at(row, 0, ROW)


class Drum(NamedTuple):
    """Constants of linkage and force analysis."""

    package: Package
    start_radius_m: float
    end_radius_m: float
    step_s: float


@kernel
def wound_by_yarn(p: Package, first: float, yarn_m: float, radius: float) -> Wound:
    """Return the package at a radius (m) after a length of yarn (m) has run since radius ``first`` (m).

    Its area follows from the yarn: the layer of a step may be less than the last digit of the radius.
    """
    return Wound(radius, wound_at(p, first).square_m2 - 2.0 * p.layer_m * yarn_m)


@kernel
def turning_energy(model: Drum, yarn_m: float, omega: float) -> float:
    """Return the kinetic energy of the drum (J) after a length of yarn (m) has run."""
    wound = wound_by_yarn(model.package, model.start_radius_m, yarn_m, 0.0)
    return 0.5 * package_inertia(model.package, wound) * (omega * omega)


@kernel
def fill_row(model: Drum, regime: int, command: float, out: Array) -> None:
    """Fill efforts and residuals of a row whose angle, rates, radius and memory are set."""
    p, now = model.package, named(out)
    radius, theta = now.radius_m, now.yarn_m_per_s
    now.regime, now.command = regime, command
    now.drum_nm, now.yarn_n, now.radius_m_per_s, now.radius_n = 0.0, 0.0, 0.0, 0.0
    if regime == RUNNING:
        now.radius_m_per_s = -p.layer_m * theta / radius
        wound = wound_by_yarn(p, model.start_radius_m, now.yarn_m, radius)
        now.drum_nm = drive_torque(p, wound, now.drum_rad, theta, now.yarn_acceleration_m_per_s2)
    first, last = model.start_radius_m, model.end_radius_m
    lost = first * first - radius * radius
    now.area_balance = (lost - 2.0 * p.layer_m * now.yarn_m) / abs(first * first - last * last)
    work = now.drive_work_j + now.gravity_work_j - now.friction_loss_j
    turned_over = now.initial_energy_j + abs(now.drive_work_j) + now.friction_loss_j
    held = turning_energy(model, now.yarn_m, now.drum_rad_per_s)
    now.largest_energy_j = max(now.largest_energy_j, held)
    turned_over = max(turned_over, now.largest_energy_j)  # a stop gives the drive back what it gave
    now.energy_balance = (now.initial_energy_j + work - held) / max(1.0, turned_over)


@kernel
def start_row(model: Drum, theta: float, command: float, out: Array) -> None:
    """Fill the row of the package at its initial radius, the yarn at a speed (m/s)."""
    out[:] = 0.0
    omega, now = theta / tangent_arm(model.package, model.start_radius_m, 0.0), named(out)
    now.drum_rad_per_s, now.yarn_m_per_s, now.radius_m = omega, theta, model.start_radius_m
    now.initial_energy_j = turning_energy(model, 0.0, omega)
    fill_row(model, RUNNING, command, out)


@step_of(work_room, Drum, borrowing_kernel)
def room_of_step(model: Drum) -> tuple[int, int]:
    """Return the lengths of the work arrays of `drum_step`, those that `advance_drum` needs among them."""
    size, places = room_sizes(1, LAWS, OWN_SIGNALS, STATE_SIZE)
    return STATE_SIZE + size, 2 + places


@step_of(linkage_step, Drum, borrowing_kernel)
def drum_step(
    model: Drum, step: int, linkage: Array, motor: Array, body: Array, out: Array, log: Array, work: Work
) -> int:
    """Fill ``out`` with the drum one step later; the end of the package is located exactly within the step."""
    p, h, command, start = model.package, model.step_s, motor[MOTOR_COMMAND], model.start_radius_m
    y, regimes = work.numbers[:STATE_SIZE], work.marks[:2]
    copy_numbers(linkage, out)
    now, regime = named(out), int(linkage[REGIME])
    last, first, theta, a, left = wound_at(p, now.radius_m), wound_at(p, now.radius_m), 0.0, 0.0, inf
    regimes[SHAFT], regimes[YARN_ON] = regime_of(now.drum_rad_per_s), 0
    if regime == RUNNING:
        last, first = wound_at(p, model.end_radius_m), wound_by_yarn(p, start, now.yarn_m, now.radius_m)
        theta, a = now.yarn_m_per_s, (motor[MOTOR_JOINTS + 1] - now.yarn_m_per_s) / h
        left = (now.radius_m * now.radius_m - last.radius_m * last.radius_m) / (2.0 * p.layer_m)
        regimes[SHAFT], regimes[YARN_ON] = HOLD, 1
    y[ANGLE], y[SPEED] = now.drum_rad, now.drum_rad_per_s
    y[DRIVE_WORK], y[GRAVITY_WORK], y[FRICTION_LOSS] = 0.0, 0.0, 0.0
    motion = DrumSystem(p, first, last, theta, a, left, step * h)
    count = advance_drum(motion, h, y, regimes, log, work.numbers[STATE_SIZE:], work.marks[2:])
    if count < 0:
        return count
    now.drum_rad, now.drum_rad_per_s = y[ANGLE], y[SPEED]
    now.drive_work_j = now.drive_work_j + y[DRIVE_WORK]
    now.gravity_work_j = now.gravity_work_j + y[GRAVITY_WORK]
    now.friction_loss_j = now.friction_loss_j + y[FRICTION_LOSS]
    if regimes[YARN_ON] == 1:
        run = 0.5 * (theta + motor[MOTOR_JOINTS + 1]) * h
        now.yarn_m, now.yarn_m_per_s, now.radius_m = (
            now.yarn_m + run,
            motor[MOTOR_JOINTS + 1],
            wound_after(p, first, run).radius_m,
        )
        now.yarn_acceleration_m_per_s2 = a
    elif regime == RUNNING:
        now.yarn_m, now.yarn_m_per_s, now.radius_m = now.yarn_m + left, 0.0, last.radius_m
        now.yarn_acceleration_m_per_s2 = 0.0
    regime = RUNNING if regimes[YARN_ON] == 1 else STUCK if regimes[SHAFT] == HOLD else ENDED
    fill_row(model, regime, command, out)
    return count


@step_of(force_step, Drum, borrowing_kernel)
def drum_forces(
    model: Drum, step: int, linkage: Array, log: Array, count: int, out: Array, loads: Array, work: Work
) -> int:
    """Fill ``out`` with each torque term, and the reaction of the shaft.

    The drive torque of the linkage is a sum of terms; the second route is the chain rule on J0 omega.  The shaft's
    reaction accelerates the centre c of the package and carries its weight: c'' = -omega^2 c + alpha k x c with
    c = e (-sin(phi), cos(phi)).
    """
    p, now = model.package, named(linkage)
    a = now.yarn_acceleration_m_per_s2
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
    copy_numbers(numbers, out)
    return 0


# the weight of the bare drum and the tension of the yarn are not known and left out
FORCES = ForceLayout(("shaft",), QUANTITIES, ("drive_torque_routes",))


@dataclass(frozen=True)
class DrumLinkage(CompiledLinkage):
    """Drum, package and yarn; the package radius is part of its state.

    When the package is empty (or full) yarn and drive let go: the drum coasts under its weight and friction.
    """

    model: Drum
    step_s: float
    start_speed_m_per_s: float
    start_command: float
    joints = JOINTS
    coordinates = COORDINATES
    regimes = REGIMES
    failures = FAILURES
    residual_limits = dict.fromkeys(RESIDUALS, 1e-9)

    @cached_property
    def layout(self) -> LinkageLayout:
        """Row of the samples; the package ends full or empty."""
        kinds = ("full" if self.model.package.layer_m < 0.0 else "empty", "stick", "release")
        events = EventLayout(kinds, ("package", "drum"), len(COORDINATES))
        return LinkageLayout(JOINTS, DrumMemory._fields, RESIDUALS, events)

    def start(self, step: int = 0) -> LinkageSample:
        """Return the package at its initial radius, the yarn at the configured share of its speed."""
        out = np.empty(self.layout.size)
        start_row(self.model, self.start_speed_m_per_s, self.start_command, out)
        return self.layout.sample(step, step * self.step_s, out.tolist(), ())
