# SPDX-License-Identifier: Apache-2.0
"""The press as a mechanism of the crank linkage: its state, reduced inertia and moment, its pin forces, its load.

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
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mech_twin.engine.compiled_steps import step_of
from mech_twin.engine.crank_state import (
    mechanism_drive_moment,
    mechanism_load_speed,
    mechanism_load_work,
    mechanism_reduced,
    mechanism_state,
    under_load_share,
)
from mech_twin.kernels.kernel import embedded_kernel, kernel
from mech_twin.parts.four_bar import (
    FourBar,
    Link,
    Position,
    Reactions,
    closure_error,
    coefficients,
    link_angles,
    motion,
    offset,
    pin_forces,
    position,
    reduced_inertia,
)

FREE, CONTACT, CONTACT_REVERSED, COMPACTED, COMPACTED_REVERSED = 0, 1, 2, 3, 4
Array = NDArray[np.float64]


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
    _, s1_y = offset(press.crank, at.a_x, at.a_y, press.bar.crank_m)
    _, s2_y = offset(press.plate, at.u_x, at.u_y, press.bar.coupler_m)
    _, s3_y = offset(press.pendulum, at.v_x, at.v_y, press.bar.rocker_m)
    height = press.crank.mass_kg * s1_y + press.plate.mass_kg * (at.a_y + s2_y)
    return press.gravity * (height + press.pendulum.mass_kg * (press.bar.pivot_y_m + s3_y))


@embedded_kernel
def press_pins(press: Press, f: float, w: float, e: float, force: float) -> Reactions:
    """Return every pin force and the drive moment from equilibrium, under an upward force (N) on the plate."""
    at = position(press.bar, f)
    by = motion(press.bar, press.crank, press.plate, press.pendulum, at, coefficients(at), w, e)
    x, y = loaded_offset(press, at)
    links = press.crank, press.plate, press.pendulum
    return pin_forces(press.bar, *links, at, by, e, 0.0, -press.gravity, 0.0, force, at.a_x + x, at.a_y + y)


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
