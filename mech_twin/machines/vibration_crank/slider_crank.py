# SPDX-License-Identifier: Apache-2.0
r"""Crank that drives a mass: vertical slider (finite or infinite rod) or boom as a rocker, with a counterweight.

::

          m_s  [ ]  y(th)             slider on x = e, above (sigma +1) or below (-1)
                |                     y = r sin th + sigma sqrt(L^2 - (r cos th - e)^2); infinite rod y = r sin th
            L  /                      boom instead: pivot P, length b, psi = angle(A - P) + side arccos(...),
              /                         m_j at b, m_t at kb b
             o A, m_r                 th from +x, counter-clockwise; x to the right, y up
            / r
           + O       everything else is without mass: halves of the rod sit at its ends
          /
         # m_p at r_p, th + 180 degrees

Which body acts on which: the frame on the crank (bearing), the crank on the rod (crank pin), the rod on the follower
(follower pin), the frame on the follower (guide or boom pivot).  The force on the frame leaves weights out.

The counterweight balances part of the masses::

        | slider: m_s = tree + stand + boom/2 + rod/2 + extra            (reciprocating)
        o
         \  rod                           m_r = rod/2 + crank + pin + bearing + lever, at the crank radius r
          \
           o  m_r at r, angle th          m_p = (m_r + kappa m_s) r/r_p, at r_p, angle th + 180 degrees
          /
         + crank bearing                   volume = m_p/density
        /
       # m_p at r_p
"""

import math
from typing import NamedTuple

from mech_twin.declarations.quantity import Parameters, quantity
from mech_twin.engine.compiled_steps import Work, copy_numbers, force_step, step_of
from mech_twin.engine.crank_linkage import route_miss
from mech_twin.engine.crank_state import (
    mechanism_drive_moment,
    mechanism_load_speed,
    mechanism_reduced,
    mechanism_state,
    memory_of,
)
from mech_twin.engine.sample_vectors import LINKAGE_JOINTS, Array
from mech_twin.kernels.kernel import borrowing_kernel, embedded_kernel, kernel

INFINITE_ROD, FINITE_ROD, BOOM = 0, 1, 2
QUANTITIES = (
    "reduced_inertia_kg_m2",
    "reduced_inertia_slope_kg_m2_per_rad",
    "reduced_moment_nm",
    "crank_acceleration_rad_per_s2",
    "drive_torque_nm",
    "drive_torque_without_counterweight_nm",
    "drive_power_w",
    "shaking_force_x_n",
    "shaking_force_y_n",
    "shaking_force_n",
)


class MovingMasses(Parameters):
    """Masses of the parts; ``rotating_kg`` overrides the sum of the rotating ones."""

    tree_kg: float = quantity("kg", "held tree", ge=0.0, le=1e6)
    stand_kg: float = quantity("kg", "stand of the gripping-cutting device", ge=0.0, le=1e6)
    boom_kg: float = quantity("kg", "boom; half of it reciprocates", ge=0.0, le=1e6)
    rod_kg: float = quantity("kg", "connecting rod; half of it reciprocates, half of it turns", ge=0.0, le=1e6)
    extra_kg: float = quantity("kg", "further reciprocating mass", ge=0.0, le=1e6)
    crank_kg: float = quantity("kg", "crank", ge=0.0, le=1e6)
    pin_kg: float = quantity("kg", "crank pin", ge=0.0, le=1e6)
    bearing_kg: float = quantity("kg", "bearing", ge=0.0, le=1e6)
    lever_kg: float = quantity("kg", "lever", ge=0.0, le=1e6)
    rotating_kg: float | None = quantity(
        "kg", "rotating mass at the crank pin (derived if absent)", default=None, ge=0.0, le=1e6
    )

    @property
    def reciprocating(self) -> float:
        """Reciprocating mass m_s (kg)."""
        return self.tree_kg + self.stand_kg + 0.5 * self.boom_kg + 0.5 * self.rod_kg + self.extra_kg

    @property
    def rotating_from_parts(self) -> float:
        """Rotating mass m_r as the parts add up (kg)."""
        return 0.5 * self.rod_kg + self.crank_kg + self.pin_kg + self.bearing_kg + self.lever_kg

    @property
    def rotating(self) -> float:
        """Rotating mass m_r in force (kg)."""
        return self.rotating_from_parts if self.rotating_kg is None else self.rotating_kg

    @property
    def at_rod_joint(self) -> float:
        """Mass m_j at the joint of rod and boom, where the boom is a rocker (kg)."""
        return 0.5 * self.boom_kg + 0.5 * self.rod_kg + self.extra_kg

    @property
    def carried(self) -> float:
        """Mass m_t that the boom carries, where it is a rocker (kg)."""
        return self.tree_kg + self.stand_kg


class Counterweight(Parameters):
    """Counterweight on the crank, opposite to the crank pin; ``mass_kg`` overrides the derived mass."""

    radius_m: float = quantity("m", "radius r_p of its centroid", ge=1e-3, le=10.0)
    balancing_fraction: float = quantity("1", "share kappa of the reciprocating mass it balances", ge=0.0, le=1.0)
    mass_kg: float | None = quantity("kg", "mass m_p (derived if absent)", default=None, ge=0.0, le=1e6)
    density_kg_per_m3: float = quantity("kg/m3", "density", ge=1.0, le=1e5)


class SliderCrank(NamedTuple):
    """Constants (SI): ``joint_mass`` and ``load_mass`` at b and kb b of a boom; their sum is a slider's mass."""

    kind: int
    crank_m: float
    rod_m: float
    offset_m: float
    sigma: float
    pivot_x_m: float
    pivot_y_m: float
    boom_m: float
    load_ratio: float
    side: float
    joint_mass: float
    load_mass: float
    rotating_mass: float
    counter_mass: float
    counter_m: float
    working_force: float
    gravity: float


class Follower(NamedTuple):
    """Follower coordinate (m or rad) with its two derivatives in th, and the joint of rod and follower (m)."""

    z: float
    z1: float
    z2: float
    x: float
    y: float


class SliderCrankPins(NamedTuple):
    """Pin forces (N), the guide's moment about the slider (N m), force on the frame (N), drive moment (N m)."""

    bearing_x: float
    bearing_y: float
    pin_x: float
    pin_y: float
    ground_x: float
    ground_y: float
    ground_moment: float
    frame_x: float
    frame_y: float
    moment: float


@embedded_kernel
def follower(s: SliderCrank, th: float) -> Follower:
    """Return the follower at crank angle ``th`` (rad)."""
    a_x, a_y = s.crank_m * math.cos(th), s.crank_m * math.sin(th)
    if s.kind == INFINITE_ROD:
        return Follower(a_y, a_x, -a_y, s.offset_m, a_y)
    if s.kind == FINITE_ROD:
        q = a_x - s.offset_m
        root = s.sigma * math.sqrt(s.rod_m * s.rod_m - q * q)
        # q' = -a_y, q'' = -a_x; root' = -q q'/root
        root1 = q * a_y / root
        root2 = (-a_y * a_y + q * a_x - root1 * root1) / root
        y = a_y + root
        return Follower(y, a_x + root1, -a_y + root2, s.offset_m, y)
    d_x, d_y = a_x - s.pivot_x_m, a_y - s.pivot_y_m
    square = d_x * d_x + d_y * d_y
    cosine = (s.boom_m * s.boom_m + square - s.rod_m * s.rod_m) / (2.0 * s.boom_m * math.sqrt(square))
    psi = math.atan2(d_y, d_x) + s.side * math.acos(cosine)
    c, n = s.boom_m * math.cos(psi), s.boom_m * math.sin(psi)
    # rod vector rho = J - A of constant length: rho . (J' - A') = 0, and once more
    rho_x, rho_y = s.pivot_x_m + c - a_x, s.pivot_y_m + n - a_y
    across = -rho_x * n + rho_y * c
    psi1 = (-rho_x * a_y + rho_y * a_x) / across
    v_x, v_y = -n * psi1 + a_y, c * psi1 - a_x
    psi2 = -(v_x * v_x + v_y * v_y + rho_x * (a_x - c * psi1 * psi1) + rho_y * (a_y - n * psi1 * psi1)) / across
    return Follower(psi, psi1, psi2, s.pivot_x_m + c, s.pivot_y_m + n)


@kernel
def rod_error(s: SliderCrank, th: float) -> float:
    """Return the error of the rod's length (m); 0 for an infinite rod."""
    if s.kind == INFINITE_ROD:
        return 0.0
    at = follower(s, th)
    return abs(math.hypot(at.x - s.crank_m * math.cos(th), at.y - s.crank_m * math.sin(th)) - s.rod_m)


@embedded_kernel
def follower_inertia(s: SliderCrank) -> float:
    """Return the follower's inertia in its own coordinate (kg or kg m2)."""
    if s.kind == BOOM:
        return (s.joint_mass + s.load_mass * s.load_ratio * s.load_ratio) * s.boom_m * s.boom_m
    return s.joint_mass + s.load_mass


@embedded_kernel
def follower_load(s: SliderCrank, z: float) -> float:
    """Return weight and working force against the follower's coordinate (N or N m)."""
    if s.kind == BOOM:
        arm = s.joint_mass * s.gravity + (s.load_mass * s.gravity + s.working_force) * s.load_ratio
        return arm * s.boom_m * math.cos(z)
    return (s.joint_mass + s.load_mass) * s.gravity + s.working_force


@embedded_kernel
def reduced(s: SliderCrank, th: float) -> tuple[float, float, float]:
    """Return I_pr (kg m2), dI_pr/dth (kg m2) and M_pr (N m) of the crank.

    I_pr = m_r r^2 + m_p r_p^2 + m_f z'^2; M_pr = -[weight and working force] z' - (m_r r - m_p r_p) g cos th.
    """
    at = follower(s, th)
    inertia = follower_inertia(s)
    first = s.rotating_mass * s.crank_m**2 + s.counter_mass * s.counter_m**2
    turning = (s.rotating_mass * s.crank_m - s.counter_mass * s.counter_m) * s.gravity * math.cos(th)
    return first + inertia * at.z1 * at.z1, 2.0 * inertia * at.z1 * at.z2, -follower_load(s, at.z) * at.z1 - turning


@kernel
def drive_moment(s: SliderCrank, th: float, w: float, e: float) -> float:
    """Return M = I_pr e + w^2/2 dI_pr/dth - M_pr (N m).

    At uniform speed M = m_s (w^2 y' y'' + g y') + (m_r r - m_p r_p) g cos th, [vibration_crank].
    """
    inertia, slope, load = reduced(s, th)
    return inertia * e + 0.5 * w * w * slope - load


@kernel
def stored_energy(s: SliderCrank, th: float, w: float) -> float:
    """Return kinetic energy and the potential of weights and working force (J)."""
    at = follower(s, th)
    inertia, _, _ = reduced(s, th)
    height = s.boom_m * math.sin(at.z) if s.kind == BOOM else at.z
    weights = s.joint_mass * s.gravity * height
    lift = s.load_ratio * height if s.kind == BOOM else height
    weights += (s.load_mass * s.gravity + s.working_force) * lift
    turning = (s.rotating_mass * s.crank_m - s.counter_mass * s.counter_m) * s.gravity * math.sin(th)
    return 0.5 * inertia * w * w + weights + turning


@embedded_kernel
def pin_forces(s: SliderCrank, th: float, w: float, e: float) -> SliderCrankPins:
    """Return every pin force from equilibrium, follower first, then the crank; independent of `reduced`."""
    a_x, a_y = s.crank_m * math.cos(th), s.crank_m * math.sin(th)
    at = follower(s, th)
    speed, rate = at.z1 * w, at.z1 * e + at.z2 * w * w
    if s.kind == BOOM:
        c, n = at.x - s.pivot_x_m, at.y - s.pivot_y_m
        rod_x, rod_y = (at.x - a_x) / s.rod_m, (at.y - a_y) / s.rod_m
        push = (follower_inertia(s) * rate + follower_load(s, at.z)) / (c * rod_y - n * rod_x)
        pin_x, pin_y = push * rod_x, push * rod_y
        moving = s.joint_mass + s.load_mass * s.load_ratio
        inertia_x, inertia_y = moving * (-rate * n - speed * speed * c), moving * (rate * c - speed * speed * n)
        ground_x, ground_moment = inertia_x - pin_x, 0.0
    else:
        mass = s.joint_mass + s.load_mass
        inertia_x, inertia_y = 0.0, mass * rate
        pin_y = mass * rate + mass * s.gravity + s.working_force
        if s.kind == INFINITE_ROD:
            pin_x, ground_moment = 0.0, -(a_x - s.offset_m) * pin_y
        else:
            pin_x, ground_moment = pin_y * (at.x - a_x) / (at.y - a_y), 0.0
        ground_x = -pin_x
    weight = (s.joint_mass + s.load_mass) * s.gravity + s.working_force
    ground_y = inertia_y - pin_y + weight if s.kind == BOOM else 0.0
    arm = s.rotating_mass - s.counter_mass * s.counter_m / s.crank_m
    turn_x, turn_y = arm * (-e * a_y - w * w * a_x), arm * (e * a_x - w * w * a_y)
    bearing_x = turn_x + pin_x
    bearing_y = turn_y + pin_y + (s.rotating_mass + s.counter_mass) * s.gravity
    first = s.rotating_mass * s.crank_m**2 + s.counter_mass * s.counter_m**2
    moment = first * e + a_x * pin_y - a_y * pin_x + arm * s.gravity * a_x
    return SliderCrankPins(
        bearing_x,
        bearing_y,
        pin_x,
        pin_y,
        ground_x,
        ground_y,
        ground_moment,
        -turn_x - inertia_x,
        -turn_y - inertia_y,
        moment,
    )


class LoadedCrank(NamedTuple):
    """Constants of the force analysis: mechanism, also without its counterweight; largest torque of a cycle (N m)."""

    mechanism: SliderCrank
    unbalanced: SliderCrank
    moment_scale_nm: float


@step_of(force_step, LoadedCrank, borrowing_kernel)
def crank_forces(
    model: LoadedCrank, step: int, linkage: Array, log: Array, count: int, out: Array, loads: Array, work: Work
) -> int:
    """Fill ``out`` with the pin forces at the crank's angle, rate and acceleration, and its torque by both routes."""
    memory, s = memory_of(linkage, 3), model.mechanism
    th, w, torque = linkage[LINKAGE_JOINTS], linkage[LINKAGE_JOINTS + 1], linkage[LINKAGE_JOINTS + 2]
    inertia, slope, load = reduced(s, th)
    e = memory.crank_acceleration_rad_per_s2
    at = pin_forces(s, th, w, e)
    size = (at.frame_x * at.frame_x + at.frame_y * at.frame_y) ** 0.5
    numbers = (
        0.0,
        at.bearing_x, at.bearing_y, 0.0,
        at.pin_x, at.pin_y, 0.0,
        at.pin_x, at.pin_y, 0.0,
        at.ground_x, at.ground_y, at.ground_moment,
        inertia,
        slope,
        load,
        e,
        torque,
        torque + drive_moment(model.unbalanced, th, w, e) - drive_moment(s, th, w, e),
        torque * w,
        at.frame_x,
        at.frame_y,
        size,
        route_miss(at.moment, torque, inertia, memory, model.moment_scale_nm),
    )  # fmt: skip
    copy_numbers(numbers, out)
    return 0


@step_of(mechanism_state, SliderCrank)
def crank_state(
    mechanism: SliderCrank, f: float, w: float, e: float, regime: int
) -> tuple[tuple[float, float, float], tuple[float, float, float], float, float, float]:
    """Return positions and rates of crank, rod, follower; crank torque (N m), energy (J), rod length error (m)."""
    s = mechanism
    at = follower(s, f)
    a_x, a_y = s.crank_m * math.cos(f), s.crank_m * math.sin(f)
    rod, rod_rate = 0.5 * math.pi, 0.0
    if s.kind >= FINITE_ROD:
        x, y = at.x - a_x, at.y - a_y
        rod = math.atan2(y, x)
        if s.kind == FINITE_ROD:
            v_x, v_y = a_y * w, (at.z1 - a_x) * w
        else:
            v_x = (-(at.y - s.pivot_y_m) * at.z1 + a_y) * w
            v_y = ((at.x - s.pivot_x_m) * at.z1 - a_x) * w
        rod_rate = (x * v_y - y * v_x) / (s.rod_m * s.rod_m)
    return (f, rod, at.z), (w, rod_rate, at.z1 * w), drive_moment(s, f, w, e), stored_energy(s, f, w), rod_error(s, f)


@step_of(mechanism_load_speed, SliderCrank)
def crank_load_speed(mechanism: SliderCrank, f: float, w: float) -> float:
    """Return the speed of the follower (m/s, or rad/s of a boom)."""
    return follower(mechanism, f).z1 * w


@step_of(mechanism_drive_moment, SliderCrank)
def crank_drive_moment(mechanism: SliderCrank, f: float, w: float, e: float, regime: int) -> float:
    """Return the moment (N m) at the crank that the pin forces give."""
    return pin_forces(mechanism, f, w, e).moment


@step_of(mechanism_reduced, SliderCrank)
def crank_reduced(mechanism: SliderCrank, f: float, regime: int) -> tuple[float, float, float]:
    """Return inertia (kg m2), its slope (kg m2/rad) and moment (N m) reduced to the crank."""
    return reduced(mechanism, f)
