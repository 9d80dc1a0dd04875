"""Motion of the vibration crank over one step: prescribed speed, or driven by a torque."""

from __future__ import annotations

import math

from mech_twin.kernel import kernel
from mech_twin.parts.slider_crank import FINITE_ROD, Shaker, drive_moment, follower, reduced, rod_error, shaker_forces
from mech_twin.parts.slider_crank import stored_energy as energy

# Gauss, three points on (0, 1)
NODE = 0.5 * math.sqrt(0.6)
MIDDLE, OUTER = 4.0 / 9.0, 5.0 / 18.0


@kernel
def crank_state(
    s: Shaker, f: float, w: float, e: float, regime: int
) -> tuple[tuple[float, float, float], tuple[float, float, float], float, float, float]:
    """Return positions and rates of crank, rod, follower; crank torque (N m), energy (J), miss of the rod (m)."""
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
    return (f, rod, at.z), (w, rod_rate, at.z1 * w), drive_moment(s, f, w, e), energy(s, f, w), rod_error(s, f)


@kernel
def prescribed_step(
    s: Shaker, f: float, w: float, e: float, h: float, regime: int
) -> tuple[float, float, float, float]:
    """Return angle and speed after ``h`` seconds at constant acceleration, drive work, load work (J, always 0).

    The work is integrated from the moment that the pin forces give, so the energy book is a proof of its own.
    """
    work = 0.0
    for i in range(3):
        t = h * (0.5 + (i - 1) * NODE)
        speed = w + e * t
        weight = MIDDLE if i == 1 else OUTER
        work += weight * h * speed * shaker_forces(s, f + (w + 0.5 * e * t) * t, speed, e).moment
    return f + (w + 0.5 * e * h) * h, w + e * h, work, 0.0


@kernel
def _acceleration(s: Shaker, shaft: float, f: float, w: float, torque: float) -> float:
    inertia, slope, load = reduced(s, f)
    return (torque + load - 0.5 * w * w * slope) / (inertia + shaft)


@kernel
def driven_step(
    s: Shaker, shaft: float, f: float, w: float, torque: float, slope: float, h: float, regime: int
) -> tuple[float, float, float, float, float]:
    """Return angle, speed, acceleration after ``h`` seconds under torque + slope t, drive work, load work (always 0).

    (I_pr + shaft) w' + w^2/2 dI_pr/df = M_pr + torque; Dormand and Prince's fifth-order weights, two halves.
    """
    g, work = 0.5 * h, 0.0
    for half in range(2):
        now = torque + slope * half * g
        k1 = _acceleration(s, shaft, f, w, now)
        w2 = w + g * k1 / 5.0
        k2 = _acceleration(s, shaft, f + g * w / 5.0, w2, now + slope * g / 5.0)
        w3 = w + g * (3.0 * k1 + 9.0 * k2) / 40.0
        k3 = _acceleration(s, shaft, f + g * (3.0 * w + 9.0 * w2) / 40.0, w3, now + 0.3 * slope * g)
        w4 = w + g * (44.0 / 45.0 * k1 - 56.0 / 15.0 * k2 + 32.0 / 9.0 * k3)
        f4 = f + g * (44.0 / 45.0 * w - 56.0 / 15.0 * w2 + 32.0 / 9.0 * w3)
        k4 = _acceleration(s, shaft, f4, w4, now + 0.8 * slope * g)
        a1, a2, a3, a4 = 19372.0 / 6561.0, -25360.0 / 2187.0, 64448.0 / 6561.0, -212.0 / 729.0
        w5 = w + g * (a1 * k1 + a2 * k2 + a3 * k3 + a4 * k4)
        f5 = f + g * (a1 * w + a2 * w2 + a3 * w3 + a4 * w4)
        k5 = _acceleration(s, shaft, f5, w5, now + 8.0 / 9.0 * slope * g)
        a1, a2, a3, a4, a5 = 9017.0 / 3168.0, -355.0 / 33.0, 46732.0 / 5247.0, 49.0 / 176.0, -5103.0 / 18656.0
        w6 = w + g * (a1 * k1 + a2 * k2 + a3 * k3 + a4 * k4 + a5 * k5)
        f6 = f + g * (a1 * w + a2 * w2 + a3 * w3 + a4 * w4 + a5 * w5)
        k6 = _acceleration(s, shaft, f6, w6, now + slope * g)
        b1, b3, b4, b5, b6 = 35.0 / 384.0, 500.0 / 1113.0, 125.0 / 192.0, -2187.0 / 6784.0, 11.0 / 84.0
        power = b1 * (now - shaft * k1) * w + b3 * (now + 0.3 * slope * g - shaft * k3) * w3
        power += b4 * (now + 0.8 * slope * g - shaft * k4) * w4
        power += b5 * (now + 8.0 / 9.0 * slope * g - shaft * k5) * w5 + b6 * (now + slope * g - shaft * k6) * w6
        work += g * power
        f += g * (b1 * w + b3 * w3 + b4 * w4 + b5 * w5 + b6 * w6)
        w += g * (b1 * k1 + b3 * k3 + b4 * k4 + b5 * k5 + b6 * k6)
    return f, w, _acceleration(s, shaft, f, w, torque + slope * h), work, 0.0
