# SPDX-License-Identifier: Apache-2.0
r"""Equation of motion of the drum for the event loop: driven by the yarn, or coasting after yarn and drive let go.

One law acts on the shaft.  With the yarn it constrains the drum to the yarn's speed; afterwards it is Coulomb friction.

The yarn package gives radius, speed and the torque required by its changing mass::

              yarn, speed theta
        <-----------------------+
                         , - ~ ~| ,
                     , '   c    |   ' ,        R    radius of the package
                   ,        \   | rho   ,      e    offset Oc of its centre from the axis
                  ,        e \phi        ,     phi  drum angle, counter-clockwise from the upright
                  ,           \|        ,     rho = R + e cos(phi), arm of the yarn that leaves at the top
                   ,            O       ,      omega = theta / rho
                     ,                , '      c = (-e sin(phi), e cos(phi)), weight acts downwards there
                       ' - , _ _ , - '

Unwinding (L = layer / (2 pi) > 0) by conservation of area R' = -L theta / R; winding is the same with L negative.
"""

from math import ceil, cos, inf, isfinite, pi, sin, sqrt
from typing import NamedTuple

from mech_twin.engine.compiled_steps import fill_event
from mech_twin.engine.hybrid import laws
from mech_twin.engine.hybrid.laws import HOLD, Array, Equations, Indices, regime_of
from mech_twin.engine.hybrid.loop import MOST_STEPS, TOO_LONG, UNSTEADY, advance, room_in
from mech_twin.engine.hybrid.type_erasure import declared
from mech_twin.engine.integration import DORMAND_PRINCE_5, DORMAND_PRINCE_8
from mech_twin.engine.sample_vectors import EVENT_WIDTH, PRE_VELOCITY, SIDES
from mech_twin.kernels.kernel import borrowing_kernel, embedded_kernel, kernel
from mech_twin.parts.friction_and_gear import sliding_torque

ANGLE, SPEED, DRIVE_WORK, GRAVITY_WORK, FRICTION_LOSS = range(5)  # places in the state
STATE_SIZE = 5
SHAFT, YARN_ON = range(2)  # places in the regimes
LAWS, OWN_SIGNALS = 1, 1
RELATIVE = 1e-13  # error of a step over the size of what it integrates
SURE_RAD = 0.5  # turned in a step: up to here the eighth order is right to about RELATIVE, whatever its estimate says
SMALL_RAD = 0.03  # up to here the fifth order is
END_KIND, STICK_KIND, RELEASE_KIND = 0, 1, 2
PACKAGE_CONTACT, DRUM_CONTACT = 0, 1


class Package(NamedTuple):
    """The constants of a package: SI; ``layer_m`` is L, negative for winding."""

    core_m: float
    width_m: float
    eccentricity_m: float
    layer_m: float
    density: float
    drum_inertia: float
    gravity: float = 9.80665
    coulomb_nm: float = 0.0
    viscous_nms_per_rad: float = 0.0


class Wound(NamedTuple):
    """Size of the package: radius R (m), and R^2 - c^2 (m2) with the core's radius c.

    On a nearly bare drum the differences of squares and of fourth powers lose digits.  Mass and inertia are therefore
    computed from the area, which is integrated with the yarn besides the radius.
    """

    radius_m: float
    square_m2: float


class PackageTorque(NamedTuple):
    """Torque on a package (N m), term by term; ``total`` is their sum."""

    acceleration: float
    radius: float
    eccentric: float
    mass: float
    total: float


@embedded_kernel
def wound_at(p: Package, radius: float) -> Wound:
    """Return the size of the package at a radius (m)."""
    return Wound(radius, (radius - p.core_m) * (radius + p.core_m))


@embedded_kernel
def wound_after(p: Package, wound: Wound, length: float) -> Wound:
    """Return the size of the package after a length of yarn (m) has run: R^2 - 2 L s, the area law integrated."""
    radius = sqrt(wound.radius_m * wound.radius_m - 2.0 * p.layer_m * length)
    return Wound(radius, wound.square_m2 - 2.0 * p.layer_m * length)


@embedded_kernel
def package_inertia(p: Package, wound: Wound) -> float:
    """Return the moment of inertia J0 of drum and package (kg m2), by R^4 - c^4 from the area; e^2 is neglected."""
    quartic = wound.square_m2 * (wound.square_m2 + 2.0 * p.core_m * p.core_m)
    return p.drum_inertia + 0.5 * pi * p.density * p.width_m * quartic


@embedded_kernel
def package_mass(p: Package, wound: Wound) -> float:
    """Return the mass of the yarn on the drum (kg)."""
    return pi * p.density * p.width_m * wound.square_m2


@embedded_kernel
def tangent_arm(p: Package, radius: float, phi: float) -> float:
    """Return rho = R + e cos(phi), the arm of the yarn (m)."""
    return radius + p.eccentricity_m * cos(phi)


@embedded_kernel
def speed_terms(p: Package, radius: float, phi: float, theta: float, a: float) -> tuple[float, float, float]:
    """Return the terms of d(omega)/dt (rad/s2): a/rho, theta^2 L/(rho^2 R), theta^2 e sin(phi)/rho^3."""
    rho, sine = tangent_arm(p, radius, phi), sin(phi)  # one call gives sine and cosine, with no division between them
    square, cube = theta * theta, rho * (rho * rho)
    return a / rho, square * p.layer_m / (rho * rho * radius), square * p.eccentricity_m * sine / cube


@embedded_kernel
def torque_terms(p: Package, wound: Wound, phi: float, theta: float, a: float) -> PackageTorque:
    """Return the torque on drum and package, each term by itself.

    M = J0 [a/rho + theta^2 L/(rho^2 R) + theta^2 e sin(phi)/rho^3] - pi H gamma0/g theta^2 L R^2/rho.

    Parameters
    ----------
    p : Package
        Constants.
    wound : Wound
        Size of the package.
    phi : float
        Drum angle (rad).
    theta, a : float
        Yarn speed (m/s) and acceleration (m/s2).

    Notes
    -----
    After (23)-(25) of [winding_drum], with R^3 in dJ/dR (the printed last term is a force).  The last term is
    omega/2 dJ/dt: the factor 1/2 is the usual variable-mass convention, assumed here; with it M omega is exactly the
    rate of J0 omega^2/2.
    """
    inertia, radius = package_inertia(p, wound), wound.radius_m
    first, second, third = speed_terms(p, radius, phi, theta, a)
    rho = tangent_arm(p, radius, phi)
    mass = -pi * p.width_m * p.density * theta * theta * p.layer_m * radius * radius / rho
    first, second, third = inertia * first, inertia * second, inertia * third
    return PackageTorque(first, second, third, mass, first + second + third + mass)


@kernel
def rate_of_momentum(p: Package, wound: Wound, phi: float, theta: float, a: float) -> float:
    """Return the same torque (N m) by the chain rule: J d(theta/rho)/dt + omega/2 dJ/dR R'."""
    radius = wound.radius_m
    rho = tangent_arm(p, radius, phi)
    omega = theta / rho
    radius_rate = -p.layer_m * theta / radius
    rho_rate = radius_rate - p.eccentricity_m * sin(phi) * omega
    inertia_rate = 2.0 * pi * p.density * p.width_m * (radius * (radius * radius)) * radius_rate
    return package_inertia(p, wound) * (a - omega * rho_rate) / rho + 0.5 * omega * inertia_rate


@embedded_kernel
def gravity_moment(p: Package, wound: Wound, phi: float) -> float:
    """Return the moment of the offset package's weight about the axis, m g e sin(phi), counter-clockwise (N m)."""
    return package_mass(p, wound) * p.gravity * p.eccentricity_m * sin(phi)


@laws.of_size(1, LAWS)
class DrumSystem(NamedTuple):
    """The system: constants, the package at the start of the step; yarn speed theta + a t, remaining yarn ``left_m``.

    ``last`` is the package after the yarn has let go, ``begin_s`` the start of the step (s).
    """

    package: Package
    first: Wound
    last: Wound
    theta_m_per_s: float
    acceleration_m_per_s2: float
    left_m: float
    begin_s: float


@embedded_kernel
def drive_torque(p: Package, wound: Wound, phi: float, theta: float, a: float) -> float:
    """Return the drive torque (N m): the dynamic torque, less gravity's moment, plus friction.

    At rest static friction carries the torque up to its limit.
    """
    wanted = torque_terms(p, wound, phi, theta, a).total - gravity_moment(p, wound, phi)
    omega = theta / tangent_arm(p, wound.radius_m, phi)
    if omega > 0.0 or a > 0.0:
        return wanted - sliding_torque(p.coulomb_nm, p.viscous_nms_per_rad, omega, 1.0)
    return wanted - min(max(wanted, -p.coulomb_nm), p.coulomb_nm)


@embedded_kernel
def yarn_run(motion: DrumSystem, t: float) -> float:
    """Return the length of yarn (m) that has run since the start of the step."""
    return (motion.theta_m_per_s + 0.5 * motion.acceleration_m_per_s2 * t) * t


@embedded_kernel
def yarn_speed(motion: DrumSystem, t: float) -> float:
    """Return the speed of the yarn (m/s)."""
    return motion.theta_m_per_s + motion.acceleration_m_per_s2 * t


@laws.declares(laws.evaluate, DrumSystem)
def evaluate_drum(motion: DrumSystem, t: float, y: Array, regimes: Indices, at: Equations) -> None:
    """Fill inertia, moment, and the bounds of the shaft's law: infinite with the yarn, which sets the acceleration."""
    p, phi = motion.package, y[ANGLE]
    at.directions[SHAFT, 0] = 1.0
    if regimes[YARN_ON] == 1:
        wound, theta = wound_after(p, motion.first, yarn_run(motion, t)), yarn_speed(motion, t)
        first, second, third = speed_terms(p, wound.radius_m, phi, theta, motion.acceleration_m_per_s2)
        at.mass[0, 0], at.force[0] = package_inertia(p, wound), 0.0
        at.bias[SHAFT], at.low[SHAFT], at.high[SHAFT] = -(first + second + third), -inf, inf
        return
    at.mass[0, 0] = package_inertia(p, motion.last)
    at.force[0] = gravity_moment(p, motion.last, phi) - p.viscous_nms_per_rad * y[SPEED]
    at.bias[SHAFT], at.low[SHAFT], at.high[SHAFT] = 0.0, -p.coulomb_nm, p.coulomb_nm


@laws.declares(laws.accumulate, DrumSystem)
def accumulate_work(motion: DrumSystem, t: float, y: Array, regimes: Indices, at: Equations, out: Array) -> None:
    """Fill the power of drive, gravity and friction (W); with the yarn also the drum's speed that it sets (rad/s)."""
    p, phi, omega = motion.package, y[ANGLE], y[SPEED]
    if regimes[YARN_ON] == 1:
        wound, theta = wound_after(p, motion.first, yarn_run(motion, t)), yarn_speed(motion, t)
        gravity, arm = gravity_moment(p, wound, phi), tangent_arm(p, wound.radius_m, phi)
        omega = theta / arm
        out[ANGLE] = omega
        out[DRIVE_WORK] = drive_torque(p, wound, phi, theta, motion.acceleration_m_per_s2) * omega
        out[GRAVITY_WORK] = gravity * omega
        out[FRICTION_LOSS] = -sliding_torque(p.coulomb_nm, p.viscous_nms_per_rad, omega, 1.0) * omega
        return
    out[DRIVE_WORK], out[GRAVITY_WORK] = 0.0, gravity_moment(p, motion.last, phi) * omega
    out[FRICTION_LOSS] = (p.viscous_nms_per_rad * omega - at.multiplier[SHAFT]) * omega


@laws.declares(laws.fill_signals, DrumSystem)
def signal_end(
    motion: DrumSystem, t: float, y: Array, regimes: Indices, at: Equations, values: Array, rates: Array
) -> None:
    """Fill the remaining length of yarn (m)."""
    values[2 * LAWS], rates[2 * LAWS] = inf, 0.0
    if regimes[YARN_ON] == 1:
        values[2 * LAWS], rates[2 * LAWS] = motion.left_m - yarn_run(motion, t), -yarn_speed(motion, t)


@laws.declares(laws.end_piece, DrumSystem)
def follow_yarn(motion: DrumSystem, t: float, before: Array, y: Array, regimes: Indices) -> None:
    """Set the drum's speed (rad/s) from the speed of the yarn."""
    if regimes[YARN_ON] == 1:
        radius = wound_after(motion.package, motion.first, yarn_run(motion, t)).radius_m
        y[SPEED] = yarn_speed(motion, t) / tangent_arm(motion.package, radius, y[ANGLE])


@borrowing_kernel
def log_drum(motion: DrumSystem, t: float, kind: int, contact: int, phi: float, log: Array, count: int) -> None:
    """Log an event with the drum angle before and after it; rates and velocities are 0."""
    fill_event(log, count, motion.begin_s + t, kind, contact, 0.0, 0.0, 0.0, 0.0)
    log[count, SIDES] = 1.0
    for i in range(EVENT_WIDTH, log.shape[1]):
        log[count, i] = 0.0
    log[count, EVENT_WIDTH], log[count, EVENT_WIDTH + 3] = phi, phi


@laws.declares(laws.pass_signal, DrumSystem)
def let_go(motion: DrumSystem, which: int, t: float, y: Array, regimes: Indices, log: Array, count: int) -> int:
    """Release yarn and drive at the end of the package."""
    theta, last = yarn_speed(motion, t), motion.last
    omega = theta / tangent_arm(motion.package, last.radius_m, y[ANGLE])
    y[SPEED], regimes[YARN_ON], regimes[SHAFT] = omega, 0, regime_of(omega)
    log_drum(motion, t, END_KIND, PACKAGE_CONTACT, y[ANGLE], log, count)
    log[count, PRE_VELOCITY], log[count, EVENT_WIDTH + 1], log[count, EVENT_WIDTH + 4] = theta, omega, omega
    log[count, EVENT_WIDTH + 2] = drive_torque(motion.package, last, y[ANGLE], theta, motion.acceleration_m_per_s2)
    return count + 1


@laws.declares(laws.change_regimes, DrumSystem)
def change_sense(
    motion: DrumSystem, t: float, y: Array, past: Indices, regimes: Indices, at: Equations, log: Array, count: int
) -> int:
    """Log that the drum sticks or is released."""
    if (past[SHAFT] == HOLD) == (regimes[SHAFT] == HOLD):
        return count
    log_drum(motion, t, STICK_KIND if regimes[SHAFT] == HOLD else RELEASE_KIND, DRUM_CONTACT, y[ANGLE], log, count)
    return count + 1


@borrowing_kernel
def advance_drum(
    motion: DrumSystem, span: float, y: Array, regimes: Indices, log: Array, numbers: Array,
    marks: Indices,
) -> int:  # fmt: skip
    """Integrate the drum over ``span`` (s); return the number of events, negative for a failure.

    A step turns the drum by no more than `SURE_RAD`: the integrands vary almost only with its angle, so both error
    estimates can vanish together at some angles.
    """
    p = motion.package
    heavy = (
        wound_after(p, motion.first, min(yarn_run(motion, span), motion.left_m)) if p.layer_m < 0.0 else motion.first
    )
    inertia, weight = package_inertia(p, heavy), package_mass(p, heavy) * p.gravity * p.eccentricity_m
    speed = abs(y[SPEED]) + sqrt(2.0 * weight / inertia)
    if regimes[YARN_ON] == 1:
        yarn = max(motion.theta_m_per_s, yarn_speed(motion, span))
        speed = max(speed, yarn / (motion.first.radius_m - p.eccentricity_m))
    method = DORMAND_PRINCE_5 if speed * span <= SMALL_RAD else DORMAND_PRINCE_8
    room = room_in(numbers, marks, 1, LAWS, OWN_SIGNALS, STATE_SIZE, method)
    moved = (weight + p.coulomb_nm + p.viscous_nms_per_rad * speed) * speed * span
    room.tolerance[ANGLE] = max(RELATIVE * max(1.0, speed * span), 1e-15 * abs(y[ANGLE]))  # as many digits as it has
    room.tolerance[SPEED] = RELATIVE * (speed + 1e-6)
    work = RELATIVE * max(1.0, 0.5 * inertia * speed * speed, moved)
    room.tolerance[DRIVE_WORK], room.tolerance[GRAVITY_WORK], room.tolerance[FRICTION_LOSS] = work, work, work
    least = speed * span / SURE_RAD
    if not least <= MOST_STEPS:
        return TOO_LONG
    pieces = max(1, ceil(least))
    system, count, done = declared(motion, room.at), 0, 0.0
    for piece in range(1, pieces + 1):
        until = span * (piece / pieces)
        count = advance(system, done, until - done, y, regimes, room, log, count)
        if count < 0:
            return count
        done = until
    return count if isfinite(y[DRIVE_WORK]) and isfinite(y[SPEED]) else UNSTEADY
