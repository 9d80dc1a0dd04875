# SPDX-License-Identifier: Apache-2.0
"""The press as a mechanism of the crank linkage: state, reduced inertia and moment, pin forces, load, gain; its roles.

The force of a compacted layer grows with the depth of the stroke and is zero on the return.

::

    Q |          * peak         y_t  top of the loaded point's path     y_c = y_t - contact_fraction (y_t - y_b)
      |        .                y_b  bottom
      |     .                   Q = peak ((y_c - y)/(y_c - y_b))^n  for y < y_c on the way down, else 0
      |  .
      +--+-------+--> depth
        y_c     y_b
"""

import math
from math import nan
from typing import Any, NamedTuple

import numpy as np

from mech_twin.engine.compiled_steps import Work, copy_numbers, force_step, step_of
from mech_twin.engine.crank_linkage import FORCE_RESIDUALS, route_miss
from mech_twin.engine.crank_state import (
    Boundary,
    Resisting,
    mechanism_drive_moment,
    mechanism_load_speed,
    mechanism_load_work,
    mechanism_reduced,
    mechanism_state,
    memory_of,
    under_load_share,
)
from mech_twin.engine.sample_vectors import LINKAGE_JOINTS, REGIME, Array, ForceLayout
from mech_twin.kernels.kernel import borrowing_kernel, embedded_kernel, kernel
from mech_twin.parts.four_bar import (
    FourBar,
    Link,
    Position,
    Reactions,
    acute_angles,
    closure_error,
    coefficients,
    link_angles,
    motion,
    offset,
    pin_forces,
    position,
    reduced_inertia,
    weight_moments,
)

FREE, CONTACT, CONTACT_REVERSED, COMPACTED, COMPACTED_REVERSED = range(5)
TURN = 2.0 * math.pi
QUANTITIES = (
    "alpha_rad",
    "beta_rad",
    "gamma_rad",
    "plate_acceleration_rad_per_s2",
    "pendulum_acceleration_rad_per_s2",
    "crank_acceleration_rad_per_s2",
    "reduced_inertia_kg_m2",
    "reduced_inertia_slope_kg_m2_per_rad",
    "reduced_moment_nm",
    "drive_torque_nm",
    "drive_power_w",
    "working_force_n",
    "loaded_point_height_m",
    "loaded_point_speed_m_per_s",
    "gain_k1",
    "gain_k2",
    "gain_paper",
    "gain_normal",
    "gain_vertical",
    "shaking_force_x_n",
    "shaking_force_y_n",
)

LARGEST_GAIN = 1e300  # of the paper's gain, which has no limit where the pendulum's end is at rest
REGIMES = ("free", "contact", "contact_reversed", "compacted", "compacted_reversed")
SET_LAYER = {CONTACT: Resisting(1.0, COMPACTED), CONTACT_REVERSED: Resisting(-1.0, COMPACTED_REVERSED)}


class StrokeLoad(NamedTuple):
    """Peak (N), heights where the layer begins and ends (m), exponent n."""

    peak_n: float
    contact_y_m: float
    bottom_y_m: float
    exponent: float


@embedded_kernel
def layer_force(load: StrokeLoad, y: float) -> float:
    """Return the force (N) at height ``y`` (m) while the layer is in contact.

    The regime decides on contact: with exponent 0 the force is the whole peak on first contact.
    """
    share = max((load.contact_y_m - y) / (load.contact_y_m - load.bottom_y_m), 0.0)
    return load.peak_n * math.pow(share, load.exponent)


@kernel
def layer_work(load: StrokeLoad, y: float) -> float:
    """Return the work (J) done on the layer from first contact down to height ``y`` (m): the force's integral."""
    depth = load.contact_y_m - load.bottom_y_m
    share = (load.contact_y_m - y) / depth
    return load.peak_n * depth / (load.exponent + 1.0) * share ** (load.exponent + 1.0) if share > 0.0 else 0.0


class Stroke(NamedTuple):
    """Crank angles (rad, 0 to 2 pi) of top, bottom, first contact turning forward and backward; heights (m).

    ``risen_m`` is the height by which the loaded point rises above first contact again on its way to the bottom.
    """

    top: float
    bottom: float
    contact: float
    contact_reversed: float
    top_y_m: float
    bottom_y_m: float
    contact_y_m: float
    risen_m: float = 0.0


class Press(NamedTuple):
    """Linkage, links, point of the plate where the force acts (m along and across AB from A), its law, gravity."""

    bar: FourBar
    crank: Link
    plate: Link
    pendulum: Link
    along_m: float
    across_m: float
    load: StrokeLoad
    gravity: float


class Reduced(NamedTuple):
    """At one crank angle: I_pr (kg m2), its slope, M_pr (N m), height of the loaded point (m) and its dy/df (m)."""

    inertia: float
    slope: float
    moment: float
    y: float
    y1: float
    force: float


@embedded_kernel
def is_pressed(regime: int) -> bool:
    """Return whether the layer is in contact in a regime."""
    return regime in (CONTACT, CONTACT_REVERSED)


@embedded_kernel
def loaded_offset(press: Press, at: Position) -> tuple[float, float]:
    """Return the position of the loaded point relative to A (m)."""
    r1 = press.bar.coupler_m
    x = (press.along_m * at.u_x - press.across_m * at.u_y) / r1
    return x, (press.along_m * at.u_y + press.across_m * at.u_x) / r1


@kernel
def loaded_height(press: Press, f: float) -> tuple[float, float]:
    """Return the height of the loaded point (m) and its derivative in the crank angle (m)."""
    at = position(press.bar, f)
    x, y = loaded_offset(press, at)
    return at.a_y + y, at.a_x + coefficients(at).g2 * x


@kernel
def loaded_heights(press: Press, angles: Array) -> Array:
    """Return the heights of the loaded point (m) at crank angles (rad)."""
    heights = np.empty(len(angles))
    for i in range(len(angles)):
        heights[i] = loaded_height(press, angles[i])[0]
    return heights


@embedded_kernel
def press_reduced(press: Press, f: float, regime: int) -> Reduced:
    """Return inertia and moment reduced to the crank; the layer resists where the regime is one of contact.

    M_pr = [sum over links 1, 2, 3 of m_i g . V_i + Q . V_Q]/w1.
    """
    at = position(press.bar, f)
    by = coefficients(at)
    inertia, slope = reduced_inertia(press.bar, press.crank, press.plate, press.pendulum, at, by)
    x, y = loaded_offset(press, at)
    height, rate = at.a_y + y, at.a_x + by.g2 * x
    force = layer_force(press.load, height) if is_pressed(regime) else 0.0
    s1_x, _ = offset(press.crank, at.a_x, at.a_y, press.bar.crank_m)
    s2_x, _ = offset(press.plate, at.u_x, at.u_y, press.bar.coupler_m)
    s3_x, _ = offset(press.pendulum, at.v_x, at.v_y, press.bar.rocker_m)
    lifted = press.crank.mass_kg * s1_x + press.plate.mass_kg * (at.a_x + by.g2 * s2_x)
    lifted += press.pendulum.mass_kg * by.g3 * s3_x
    return Reduced(inertia, slope, force * rate - press.gravity * lifted, height, rate, force)


@kernel
def press_weights(press: Press, f: float) -> float:
    """Return the potential energy of the weights (J), the bearings at height 0 and h."""
    at = position(press.bar, f)
    return press.gravity * weight_moments(press.bar, press.crank, press.plate, press.pendulum, at)[1]


@embedded_kernel
def press_pins(press: Press, f: float, w: float, e: float, force: float) -> Reactions:
    """Return every pin force and the drive moment from equilibrium, under an upward force (N) on the plate."""
    at = position(press.bar, f)
    by = motion(press.bar, press.crank, press.plate, press.pendulum, at, coefficients(at), w, e)
    x, y = loaded_offset(press, at)
    links = press.crank, press.plate, press.pendulum
    return pin_forces(press.bar, *links, at, by, e, 0.0, -press.gravity, 0.0, force, at.a_x + x, at.a_y + y)


@kernel
def gains(press: Press, f: float) -> tuple[float, float, float, float]:
    """Return k1, k2 = R1/a, exact gain of a load normal to the plate, exact gain of a vertical load.

    k1 k2 is the paper's, Q = P k1 k2; it holds only while B is at rest.  The exact gains are inverse velocity ratios
    and grow without bound at the dead centres (kept below 1e300).
    """
    at = position(press.bar, f)
    r, r1 = press.bar.crank_m, press.bar.coupler_m
    # velocities of A and B per unit crank speed; B's from the loop
    g2 = -(-at.a_y * at.v_x + at.a_x * at.v_y) / at.det
    x, y = loaded_offset(press, at)
    normal = (-at.a_y - g2 * y) * (-at.u_y / r1) + (at.a_x + g2 * x) * (at.u_x / r1)
    vertical = loaded_height(press, f)[1]
    k1, k2 = 1.0 / max(np.cos(acute_angles(at)[0]), 1e-300), r1 / max(r1 - press.along_m, 1e-300)
    return k1, k2, 1.0 / max(abs(normal) / r, 1e-300), 1.0 / max(abs(vertical) / r, 1e-300)


@step_of(mechanism_state, Press)
def press_state(
    press: Press, f: float, w: float, e: float, regime: int
) -> tuple[tuple[float, float, float], tuple[float, float, float], float, float, float]:
    """Return positions and rates of crank, plate, pendulum; crank torque (N m), energy (J), loop closure error (m)."""
    at = position(press.bar, f)
    by = coefficients(at)
    plate, pendulum = link_angles(at)
    now = press_reduced(press, f, regime)
    torque = now.inertia * e + 0.5 * w * w * now.slope - now.moment
    energy = 0.5 * now.inertia * w * w + press_weights(press, f)
    return (f, plate, pendulum), (w, by.g2 * w, by.g3 * w), torque, energy, closure_error(press.bar, at)


@step_of(mechanism_load_work, Press)
def press_load_work(press: Press, before: float, after: float, regime: int) -> float:
    """Return the work (J) of the layer on the plate between two crank angles (rad), in closed form."""
    if not is_pressed(regime):
        return 0.0
    y0, _ = loaded_height(press, before)
    y1, _ = loaded_height(press, after)
    return layer_work(press.load, y0) - layer_work(press.load, y1)


@step_of(mechanism_load_speed, Press)
def press_load_speed(press: Press, f: float, w: float) -> float:
    """Return the downward speed of the loaded point (m/s)."""
    return -loaded_height(press, f)[1] * w


@step_of(mechanism_drive_moment, Press)
def press_drive_moment(press: Press, f: float, w: float, e: float, regime: int) -> float:
    """Return the moment (N m) at the crank that the pin forces give."""
    return press_pins(press, f, w, e, press_reduced(press, f, regime).force).moment


@step_of(mechanism_reduced, Press)
def press_at_crank(press: Press, f: float, regime: int) -> tuple[float, float, float]:
    """Return inertia (kg m2), its slope (kg m2/rad) and moment (N m) reduced to the crank."""
    now = press_reduced(press, f, regime)
    return now.inertia, now.slope, now.moment


@step_of(under_load_share, Press)
def with_load_share(press: Press, share: float) -> Press:
    """Return the press under this share of the layer's force."""
    whole = press.load
    load = StrokeLoad(share * whole.peak_n, whole.contact_y_m, whole.bottom_y_m, whole.exponent)
    return Press(
        press.bar, press.crank, press.plate, press.pendulum, press.along_m, press.across_m, load, press.gravity
    )


class LoadedPress(NamedTuple):
    """Constants of the force analysis: the press, and the largest drive torque of a cycle (N m)."""

    press: Press
    moment_scale_nm: float


@step_of(force_step, LoadedPress, borrowing_kernel)
def press_forces(
    model: LoadedPress, step: int, linkage: Array, log: Array, count: int, out: Array, loads: Array, work: Work
) -> int:
    """Fill ``out`` with the pin forces at the crank's angle, rate and acceleration, and its torque by both routes."""
    memory = memory_of(linkage, 3)
    press = with_load_share(model.press, memory.load_share)
    f, w, torque = linkage[LINKAGE_JOINTS], linkage[LINKAGE_JOINTS + 1], linkage[LINKAGE_JOINTS + 2]
    now = press_reduced(press, f, int(linkage[REGIME]))
    e = memory.crank_acceleration_rad_per_s2
    at = position(press.bar, f)
    by = motion(press.bar, press.crank, press.plate, press.pendulum, at, coefficients(at), w, e)
    pins = press_pins(press, f, w, e, now.force)
    k1, k2, normal, vertical = gains(press, f)
    alpha, beta, gamma = acute_angles(at)
    numbers = (
        0.0,
        pins.o_x, pins.o_y, 0.0,
        pins.a_x, pins.a_y, 0.0,
        pins.b_x, pins.b_y, 0.0,
        pins.c_x, pins.c_y, 0.0,
        alpha,
        beta,
        gamma,
        by.e2,
        by.e3,
        e,
        now.inertia,
        now.slope,
        now.moment,
        torque,
        torque * w,
        now.force,
        now.y,
        now.y1 * w,
        k1,
        k2,
        min(k1 * k2, LARGEST_GAIN),
        normal,
        vertical,
        -pins.o_x - pins.c_x,
        -pins.o_y - pins.c_y,
        route_miss(pins.moment, torque, now.inertia, memory, model.moment_scale_nm),
    )  # fmt: skip
    copy_numbers(numbers, out)
    return 0


def regime_at(stroke: Stroke, f: float, direction: float) -> int:
    """Return the regime at crank angle ``f`` (rad) turning in ``direction`` (+1, -1)."""
    if direction >= 0.0:
        inside = (f - stroke.contact) % TURN < (stroke.bottom - stroke.contact) % TURN
        return CONTACT if inside else FREE
    inside = (stroke.contact_reversed - f) % TURN < (stroke.contact_reversed - stroke.bottom) % TURN
    return CONTACT_REVERSED if inside else FREE


# every pin force from one equilibrium of the dyad, then the crank; pins named as in every four-bar
FORCES = ForceLayout(("crank_bearing", "crank_pin", "rocker_pin", "rocker_bearing"), QUANTITIES, FORCE_RESIDUALS)
JOINTS = ("crank", "plate", "pendulum")
ACTS_ON = ("crank", "plate", "plate", "pendulum")


def layer_regimes(stroke: Stroke, direction: float, gives_back: bool = True) -> dict[str, Any]:
    """Return what the layer makes of a crank linkage that starts at angle 0: regimes, boundaries along its turn.

    The boundaries are first contact, bottom, release, new contact.  A layer without spring-back is in contact again
    where the crank reversed, and is a new one after the top.
    """
    first = "top" if stroke.contact == stroke.top else "contact"
    boundaries = [
        Boundary(stroke.contact, 1.0, FREE, CONTACT, first),
        Boundary(stroke.bottom, 1.0, CONTACT, FREE, "bottom"),
        Boundary(stroke.contact_reversed, -1.0, FREE, CONTACT_REVERSED, first),
        Boundary(stroke.bottom, -1.0, CONTACT_REVERSED, FREE, "bottom"),
    ]
    if gives_back:
        boundaries += [
            Boundary(stroke.contact, -1.0, CONTACT, FREE, "release"),
            Boundary(stroke.contact_reversed, 1.0, CONTACT_REVERSED, FREE, "release"),
        ]
    else:
        boundaries += [
            Boundary(nan, 1.0, COMPACTED, CONTACT, first),
            Boundary(stroke.top, -1.0, COMPACTED, FREE, "top"),
            Boundary(nan, -1.0, COMPACTED_REVERSED, CONTACT_REVERSED, first),
            Boundary(stroke.top, 1.0, COMPACTED_REVERSED, FREE, "top"),
        ]
    return {
        "regimes": REGIMES,
        "start_regime": regime_at(stroke, 0.0, direction),
        "boundaries": tuple(boundaries),
        "resisting": {} if gives_back else SET_LAYER,
    }
