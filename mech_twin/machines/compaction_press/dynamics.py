"""Motion of the press: reduced quantities, one step at prescribed speed, one step under a driving torque."""

from __future__ import annotations

import math
from typing import NamedTuple

from mech_twin.kernel import kernel
from mech_twin.machines.compaction_press.stroke_load import StrokeLoad, layer_force, layer_work
from mech_twin.parts.four_bar import (
    FourBar,
    Link,
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

FREE, CONTACT, CONTACT_REVERSED = 0, 1, 2
NODE = 0.5 * math.sqrt(0.6)
MIDDLE, OUTER = 4.0 / 9.0, 5.0 / 18.0


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


@kernel
def loaded_height(press: Press, f: float) -> tuple[float, float]:
    """Return the height of the loaded point (m) and its derivative in the crank angle (m)."""
    at = position(press.bar, f)
    g2 = coefficients(at).g2
    r1 = press.bar.coupler_m
    x = (press.along_m * at.u_x - press.across_m * at.u_y) / r1
    y = (press.along_m * at.u_y + press.across_m * at.u_x) / r1
    return at.a_y + y, at.a_x + g2 * x


@kernel
def press_reduced(press: Press, f: float, regime: int) -> Reduced:
    """Return inertia and moment reduced to the crank; the layer resists where the regime is one of contact.

    M_pr = [sum over links 1, 2, 3 of m_i g . V_i + Q . V_Q]/w1.
    """
    at = position(press.bar, f)
    by = coefficients(at)
    inertia, slope = reduced_inertia(press.bar, press.crank, press.plate, press.pendulum, at, by)
    r1 = press.bar.coupler_m
    x = (press.along_m * at.u_x - press.across_m * at.u_y) / r1
    y = (press.along_m * at.u_y + press.across_m * at.u_x) / r1
    height, rate = at.a_y + y, at.a_x + by.g2 * x
    force = layer_force(press.load, height) if regime != FREE else 0.0
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


@kernel
def press_pins(press: Press, f: float, w: float, e: float, force: float) -> Reactions:
    """Return every pin force and the drive moment from equilibrium, under an upward force (N) on the plate."""
    at = position(press.bar, f)
    by = motion(press.bar, press.crank, press.plate, press.pendulum, at, coefficients(at), w, e)
    r1 = press.bar.coupler_m
    x = at.a_x + (press.along_m * at.u_x - press.across_m * at.u_y) / r1
    y = at.a_y + (press.along_m * at.u_y + press.across_m * at.u_x) / r1
    return pin_forces(
        press.bar,
        press.crank,
        press.plate,
        press.pendulum,
        at,
        by,
        e,
        0.0,
        -press.gravity,
        0.0,
        force,
        x,
        y,
    )


@kernel
def press_state(
    press: Press, f: float, w: float, e: float, regime: int
) -> tuple[tuple[float, float, float], tuple[float, float, float], float, float, float]:
    """Return positions and rates of crank, plate, pendulum; crank torque (N m), energy (J), miss of the rods (m)."""
    at = position(press.bar, f)
    by = coefficients(at)
    plate, pendulum = link_angles(at)
    now = press_reduced(press, f, regime)
    torque = now.inertia * e + 0.5 * w * w * now.slope - now.moment
    energy = 0.5 * now.inertia * w * w + press_weights(press, f)
    return (f, plate, pendulum), (w, by.g2 * w, by.g3 * w), torque, energy, closure_error(press.bar, at)


@kernel
def _layer_share(press: Press, before: float, after: float, regime: int) -> float:
    if regime == FREE:
        return 0.0
    y0, _ = loaded_height(press, before)
    y1, _ = loaded_height(press, after)
    return layer_work(press.load, y0) - layer_work(press.load, y1)


@kernel
def prescribed_step(
    press: Press, f: float, w: float, e: float, h: float, regime: int
) -> tuple[float, float, float, float]:
    """Return angle and speed after ``h`` seconds at constant acceleration, drive work, work of the layer (J).

    The drive's work is integrated from the moment that the pin forces give, the layer's is in closed form, so the
    energy book is a proof of its own.
    """
    work = 0.0
    for i in range(3):
        t = h * (0.5 + (i - 1) * NODE)
        speed, angle = w + e * t, f + (w + 0.5 * e * t) * t
        force = press_reduced(press, angle, regime).force
        work += (MIDDLE if i == 1 else OUTER) * h * speed * press_pins(press, angle, speed, e, force).moment
    end = f + (w + 0.5 * e * h) * h
    return end, w + e * h, work, _layer_share(press, f, end, regime)


@kernel
def _acceleration(press: Press, shaft: float, f: float, w: float, torque: float, regime: int) -> float:
    now = press_reduced(press, f, regime)
    return (torque + now.moment - 0.5 * w * w * now.slope) / (now.inertia + shaft)


@kernel
def driven_step(
    press: Press, shaft: float, f: float, w: float, torque: float, slope: float, h: float, regime: int
) -> tuple[float, float, float, float, float]:
    """Return angle, speed, acceleration after ``h`` seconds under torque + slope t, drive work, work of the layer.

    (I_pr + shaft) w' + w^2/2 dI_pr/df = M_pr + torque; Dormand and Prince's fifth-order weights, two halves.
    """
    g, work, start = 0.5 * h, 0.0, f
    for half in range(2):
        now = torque + slope * half * g
        k1 = _acceleration(press, shaft, f, w, now, regime)
        w2 = w + g * k1 / 5.0
        k2 = _acceleration(press, shaft, f + g * w / 5.0, w2, now + slope * g / 5.0, regime)
        w3 = w + g * (3.0 * k1 + 9.0 * k2) / 40.0
        k3 = _acceleration(press, shaft, f + g * (3.0 * w + 9.0 * w2) / 40.0, w3, now + 0.3 * slope * g, regime)
        w4 = w + g * (44.0 / 45.0 * k1 - 56.0 / 15.0 * k2 + 32.0 / 9.0 * k3)
        f4 = f + g * (44.0 / 45.0 * w - 56.0 / 15.0 * w2 + 32.0 / 9.0 * w3)
        k4 = _acceleration(press, shaft, f4, w4, now + 0.8 * slope * g, regime)
        a1, a2, a3, a4 = 19372.0 / 6561.0, -25360.0 / 2187.0, 64448.0 / 6561.0, -212.0 / 729.0
        w5 = w + g * (a1 * k1 + a2 * k2 + a3 * k3 + a4 * k4)
        f5 = f + g * (a1 * w + a2 * w2 + a3 * w3 + a4 * w4)
        k5 = _acceleration(press, shaft, f5, w5, now + 8.0 / 9.0 * slope * g, regime)
        a1, a2, a3, a4, a5 = 9017.0 / 3168.0, -355.0 / 33.0, 46732.0 / 5247.0, 49.0 / 176.0, -5103.0 / 18656.0
        w6 = w + g * (a1 * k1 + a2 * k2 + a3 * k3 + a4 * k4 + a5 * k5)
        f6 = f + g * (a1 * w + a2 * w2 + a3 * w3 + a4 * w4 + a5 * w5)
        k6 = _acceleration(press, shaft, f6, w6, now + slope * g, regime)
        b1, b3, b4, b5, b6 = 35.0 / 384.0, 500.0 / 1113.0, 125.0 / 192.0, -2187.0 / 6784.0, 11.0 / 84.0
        power = b1 * (now - shaft * k1) * w + b3 * (now + 0.3 * slope * g - shaft * k3) * w3
        power += b4 * (now + 0.8 * slope * g - shaft * k4) * w4
        power += b5 * (now + 8.0 / 9.0 * slope * g - shaft * k5) * w5 + b6 * (now + slope * g - shaft * k6) * w6
        work += g * power
        f += g * (b1 * w + b3 * w3 + b4 * w4 + b5 * w5 + b6 * w6)
        w += g * (b1 * k1 + b3 * k3 + b4 * k4 + b5 * k5 + b6 * k6)
    e = _acceleration(press, shaft, f, w, torque + slope * h, regime)
    return f, w, e, work, _layer_share(press, start, f, regime)
