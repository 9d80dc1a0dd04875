# SPDX-License-Identifier: Apache-2.0
"""The body as published: a free swing over whole cycles, the half sine at the end of each.

::

     M |             _         phi1 = A1 sin kt + A2 cos kt - phi0                         on (0, t1)
       |            / .        phi2 = B1 sin kt + B2 cos kt + C1 sin mu t + C2 cos mu t - phi0   on (t1, T)
       |___________/   .___ t
       0          t1    T      with damping the A and B parts fade as e^(-zeta k t), k in them being k sqrt(1 - zeta^2)

Here the collar does not stop the body.  t restarts with each cycle.  The amplitudes form one complex number
Z = A1 + i A2.  A cycle maps it to q Z + g, q = e^((i w - zeta k) T).  This linear cycle map holds for any onset,
either form of the load and any damping, k = mu included.

Its long-run motion is a periodic regime, a beat about it, or unbounded growth.
"""

import cmath
import math
from dataclasses import dataclass

from mech_twin.machines.mb10_breaker.pressed_body.flight import SwingStretch, highest, motion, ring_frequency
from mech_twin.machines.mb10_breaker.pressed_body.parameters import PressedBody

NEAR = 1e-9


@dataclass(frozen=True)
class CycleMap:
    """The linear map Z -> q Z + g of Z = A1 + i A2 over one cycle; ``exponent`` is log q before wrapping."""

    exponent: complex
    gain: complex

    @property
    def resonant(self) -> bool:
        """Whether q = 1: every cycle adds the same, there is no fixed point."""
        return self.exponent.real == 0.0 and abs(math.remainder(self.exponent.imag, 2.0 * math.pi)) < NEAR

    @property
    def fixed_point(self) -> complex:
        """Z* = g/(1 - q)."""
        if self.resonant:
            raise ValueError("no fixed point: k is a whole multiple of the cycle frequency and damping is zero")
        z, half = self.exponent, math.sin(0.5 * self.exponent.imag)
        less_one = math.expm1(z.real) * math.cos(z.imag) - 2.0 * half * half  # of e^z, without cancellation
        return -self.gain / complex(less_one, math.exp(z.real) * math.sin(z.imag))

    def after(self, start: complex, cycles: int) -> complex:
        """Return Z after a number of cycles, without going through them."""
        if self.resonant:
            return start + cycles * self.gain
        rest = self.fixed_point
        return rest + cmath.exp(cycles * self.exponent) * (start - rest)


def amplitudes(body: PressedBody, angle: float, rate: float) -> complex:
    """Return Z = A1 + i A2 of a free swing that has this state (rad, rad/s) at t = 0."""
    a2 = angle + body.rest_angle
    return complex((rate + body.damping * body.k * a2) / ring_frequency(body), a2)


def start_state(body: PressedBody, z: complex) -> tuple[float, float]:
    """Return angle and rate at the start of a cycle with amplitudes Z; at rest on the tool Z = i phi0."""
    return z.imag - body.rest_angle, ring_frequency(body) * z.real - body.damping * body.k * z.imag


def load_stretch(body: PressedBody, angle: float = 0.0, rate: float = 0.0) -> SwingStretch:
    """Return the loaded part of the cycle from a state at t1."""
    return SwingStretch(angle, rate, body.amplitude, body.mu * body.onset + body.phase)


def cycle_map(body: PressedBody) -> CycleMap:
    """Return the linear cycle map; its gain is the response to the load of a body in equilibrium before it."""
    angle, rate = motion(body, load_stretch(body, -body.rest_angle, 0.0), body.period - body.onset)
    exponent = complex(-body.damping * body.k, ring_frequency(body)) * body.period
    return CycleMap(exponent, amplitudes(body, angle, rate))


def amplitudes_of_cycle(body: PressedBody, cycle: int) -> complex:
    """Return Z at the start of a cycle counted from 0, the first beginning at rest on the tool (A1 = 0, A2 = phi0)."""
    return cycle_map(body).after(amplitudes(body, 0.0, 0.0), cycle)


def resonance_rate(body: PressedBody, order: int) -> float:
    """Return the spring rate (N/m) at which k = n omega: c = J (n omega)^2/l^2."""
    return body.inertia * (2.0 * math.pi * order / body.period) ** 2 / body.arm**2


def growth_per_cycle(body: PressedBody) -> float:
    """Return |g| (rad), the increment of Z in a cycle: the growth at a resonance, for any onset, form and damping."""
    return abs(cycle_map(body).gain)


def largest_angle(body: PressedBody, z: complex) -> tuple[float, float]:
    """Return time in the cycle (s) and value (rad) of the largest angle of a cycle, the load phase searched too."""
    angle, rate = start_state(body, z)
    free = SwingStretch(angle, rate, 0.0, 0.0)
    at, best = highest(body, free, body.onset)
    angle, rate = motion(body, free, body.onset)
    later, peak = highest(body, load_stretch(body, angle, rate), body.period - body.onset)
    return (body.onset + later, peak) if peak > best else (at, best)


def pressing_force(body: PressedBody, angle: float) -> float:
    """Return the spring force P = c (l phi + a), N."""
    return body.rate * (body.arm * angle + body.deflection)


SILENT = 1e-12  # gain of a cycle, as part of the load's static deflection scale, below which a resonance is silent


@dataclass(frozen=True)
class SwingRegime:
    """The motion without a collar, from rest on the tool.

    Attributes
    ----------
    kind : str
        ``periodic`` (damped: settles to it), ``beat`` (undamped from rest: never settles), ``grows`` (resonance),
        ``silent resonance`` (k a multiple of the cycle frequency on which the load has no effect).
    periodic_angle_rad, periodic_force_n : float
        Largest angle and pressing force of the periodic regime; inf where there is none.
    amplitude_rad : float
        Amplitude of the periodic regime's free phase, |As|; inf where there is none.
    largest_angle_rad, largest_force_n : float
        Bounds approached from rest, however long it runs; inf if it grows.
    """

    kind: str
    periodic_angle_rad: float
    periodic_force_n: float
    amplitude_rad: float
    largest_angle_rad: float
    largest_force_n: float


def swing_regime(body: PressedBody) -> SwingRegime:
    """Return the regime of the swing from rest.

    Undamped, Z goes round Z* on a circle of radius |Z0 - Z*|; over many cycles every phase of it comes up, so the
    angle's bound is the periodic regime's largest angle plus that radius.
    """
    mapping = cycle_map(body)
    start = amplitudes(body, 0.0, 0.0)
    if mapping.resonant:
        growth = growth_per_cycle(body)
        silent = growth <= SILENT * body.amplitude / (body.inertia * body.mu**2)
        top = largest_angle(body, start)[1] if silent else math.inf
        force = pressing_force(body, top)
        kind = "silent resonance" if silent else "grows"
        return SwingRegime(kind, top, force, math.inf, top, force)
    rest = mapping.fixed_point
    top = largest_angle(body, rest)[1]
    if body.damping > 0.0:
        fading = min(1000, max(1, math.ceil(20.0 / (body.damping * body.k * body.period))))  # cycles, down to 1e-9
        highest = max(largest_angle(body, amplitudes_of_cycle(body, cycle))[1] for cycle in range(fading))
        highest = max(highest, top)
        kind = "periodic"
    else:
        highest = top + abs(start - rest)
        kind = "beat"
    forces = pressing_force(body, top), pressing_force(body, highest)
    return SwingRegime(kind, top, forces[0], abs(rest), highest, forces[1])
