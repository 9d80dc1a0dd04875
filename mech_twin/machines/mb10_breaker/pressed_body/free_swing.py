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

from __future__ import annotations

import cmath
import math
from dataclasses import dataclass
from typing import NamedTuple

from mech_twin.machines.mb10_breaker.pressed_body.flight import SwingStretch, highest, motion
from mech_twin.machines.mb10_breaker.pressed_body.parameters import PressedBody

COINCIDENCE = 1e-12  # relative distance of k from mu, undamped, below which B and C are written in their secular form
PAPER_RATIO = 5.0  # mu/omega in print
NEAR = 1e-9


class CycleConstants(NamedTuple):
    """Integration constants of one cycle, rad.

    With ``secular`` (k = mu without damping) the C terms are multiplied by (t - t1).
    """

    a1: float
    a2: float
    b1: float
    b2: float
    c1: float
    c2: float
    secular: bool


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
        return -self.gain / _exponential_less_one(self.exponent)

    def after(self, start: complex, cycles: int) -> complex:
        """Return Z after a number of cycles, without going through them."""
        if self.resonant:
            return start + cycles * self.gain
        rest = self.fixed_point
        return rest + cmath.exp(cycles * self.exponent) * (start - rest)


def _exponential_less_one(z: complex) -> complex:
    half = math.sin(0.5 * z.imag)
    return complex(math.expm1(z.real) * math.cos(z.imag) - 2.0 * half * half, math.exp(z.real) * math.sin(z.imag))


def ring_frequency(body: PressedBody) -> float:
    """Return k sqrt(1 - zeta^2), rad/s."""
    return body.k * math.sqrt((1.0 - body.damping) * (1.0 + body.damping))


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


def load_constants(body: PressedBody) -> tuple[float, float]:
    """Return C1, C2 (rad), or their secular form (rad/s) at k = mu.

    For M = H sin(mu t): C1 = (H/J)(k^2 - mu^2)/den, C2 = -(H/J) 2 zeta k mu/den with
    den = (k^2 - mu^2)^2 + (2 zeta k mu)^2; the shifted form turns the pair by its phase.
    At k = mu undamped the load term is -(H/2 J mu)(t - t1) cos mu t.
    """
    push = body.amplitude / body.inertia
    sine, cosine = math.sin(body.phase), math.cos(body.phase)
    if coincident(body):
        rise = push / (2.0 * body.mu)
        return rise * sine, -rise * cosine
    apart = (body.k - body.mu) * (body.k + body.mu)
    drag = 2.0 * body.damping * body.k * body.mu
    size = apart * apart + drag * drag
    in_phase, across = push * apart / size, -push * drag / size
    return in_phase * cosine - across * sine, in_phase * sine + across * cosine


def coincident(body: PressedBody) -> bool:
    """Return whether k = mu without damping, the removable point."""
    return body.damping == 0.0 and abs(body.k - body.mu) <= COINCIDENCE * body.mu


def cycle_constants(body: PressedBody, z: complex) -> CycleConstants:
    """Return all constants of a cycle with amplitudes Z = A1 + i A2.

    B follows from A by continuity of angle and rate at t1.  Undamped, in the printed form,
    B1 = A1 - C1 [sin mu t1 sin k t1 + (mu/k) cos mu t1 cos k t1],
    B2 = A2 - C1 [sin mu t1 cos k t1 - (mu/k) cos mu t1 sin k t1].
    """
    c1, c2 = load_constants(body)
    secular = coincident(body)
    at = body.mu * body.onset
    wave = c1 * math.sin(at) + c2 * math.cos(at)
    slope = wave if secular else body.mu * (c1 * math.cos(at) - c2 * math.sin(at))
    if secular:
        wave = 0.0
    ring = ring_frequency(body)
    # amplitudes of the free swing that equals the load term at t1, carried back to t = 0
    across = (slope + body.damping * body.k * wave) / ring
    mark = complex(across, wave) * cmath.exp(complex(body.damping * body.k, -ring) * body.onset)
    b = z - mark
    return CycleConstants(z.real, z.imag, b.real, b.imag, c1, c2, secular)


def next_amplitudes(body: PressedBody, constants: CycleConstants) -> complex:
    """Return Z of the next cycle from B and C: the recurrence.

    Undamped, printed: A1' = B1 cos kT - B2 sin kT + (mu/k) C1 cos mu T, A2' = B1 sin kT + B2 cos kT + C1 sin mu T.
    """
    at, ring = body.mu * body.period, ring_frequency(body)
    wave = constants.c1 * math.sin(at) + constants.c2 * math.cos(at)
    slope = body.mu * (constants.c1 * math.cos(at) - constants.c2 * math.sin(at))
    if constants.secular:
        span = body.period - body.onset
        wave, slope = span * wave, wave + span * slope
    turned = complex(constants.b1, constants.b2) * cmath.exp(complex(-body.damping * body.k, ring) * body.period)
    return turned + complex((slope + body.damping * body.k * wave) / ring, wave)


def swing(body: PressedBody, z: complex, time: float) -> tuple[float, float]:
    """Return angle and rate (rad, rad/s) at a time (s) of a cycle with amplitudes Z."""
    angle, rate = start_state(body, z)
    if time <= body.onset:
        return motion(body, SwingStretch(angle, rate, 0.0, 0.0), time)
    angle, rate = motion(body, SwingStretch(angle, rate, 0.0, 0.0), body.onset)
    return motion(body, load_stretch(body, angle, rate), time - body.onset)


def published_fixed_point(body: PressedBody) -> tuple[complex, float]:
    """Return Z* = i As e^(-i k t1/2) and As (rad) in the closed form of the half sine of a tenth of the cycle.

    As = G cos(k (T - t1)/2)/sin(kT/2), G = (mu/k) C1.  Undamped, mu = 5 omega only; otherwise solve the cycle map.
    """
    gain = _published_gain(body)
    resonance = math.sin(0.5 * body.k * body.period)
    if cycle_map(body).resonant:
        raise ValueError("no fixed point: k is a whole multiple of the cycle frequency and damping is zero")
    size = gain * math.cos(0.5 * body.k * (body.period - body.onset)) / resonance
    return 1j * size * cmath.exp(-0.5j * body.k * body.onset), size


def published_growth(body: PressedBody) -> float:
    """Return the growth of |Z| per cycle at a resonance k = n omega, rad: 2 |G cos(k (T - t1)/2)|.

    It is zero at n = 15, 25, 35, ... and pi |H|/(2 J mu^2) at k = mu.  Undamped, mu = 5 omega only.
    """
    if coincident(body):
        return math.pi * body.amplitude / (2.0 * body.inertia * body.mu**2)
    return 2.0 * abs(_published_gain(body) * math.cos(0.5 * body.k * (body.period - body.onset)))


def _published_gain(body: PressedBody) -> float:
    omega = 2.0 * math.pi / body.period
    if body.damping != 0.0 or abs(body.mu - PAPER_RATIO * omega) > NEAR * omega:
        raise ValueError(
            f"the closed form holds for mu = {PAPER_RATIO:g} omega without damping; "
            f"got mu = {body.mu / omega:.9g} omega, damping {body.damping:g}: solve the cycle map"
        )
    if coincident(body):
        raise ValueError("k = mu is a resonance of the closed form: solve the cycle map")
    return body.mu / body.k * load_constants(body)[0]


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
    statement : str
        The same in words, to stand beside any figure.
    periodic_angle_rad, periodic_force_n : float
        Largest angle and pressing force of the periodic regime; inf where there is none.
    amplitude_rad : float
        Amplitude of the periodic regime's free phase, |As|; inf where there is none.
    largest_angle_rad, largest_force_n : float
        Bounds approached from rest, however long it runs; inf if it grows.
    growth_rad : float
        What each cycle adds at a resonance, else 0.
    """

    kind: str
    statement: str
    periodic_angle_rad: float
    periodic_force_n: float
    amplitude_rad: float
    largest_angle_rad: float
    largest_force_n: float
    growth_rad: float


def swing_regime(body: PressedBody) -> SwingRegime:
    """Return the regime of the swing from rest.

    Undamped, Z goes round Z* on a circle of radius |Z0 - Z*|; over many cycles every phase of it comes up, so the
    angle's bound is the periodic regime's largest angle plus that radius.
    """
    mapping = cycle_map(body)
    start = amplitudes(body, 0.0, 0.0)
    if mapping.resonant:
        growth = growth_per_cycle(body)
        order = round(body.k * body.period / (2.0 * math.pi))
        silent = growth <= SILENT * body.amplitude / (body.inertia * body.mu**2)
        top = largest_angle(body, start)[1] if silent else math.inf
        words = (
            f"k = {order} omega, where the load adds nothing over a cycle: every cycle repeats the first"
            if silent
            else f"resonance k = {order} omega: grows by {growth:.4g} rad each cycle, no steady regime"
        )
        force = pressing_force(body, top)
        kind = "silent resonance" if silent else "grows"
        return SwingRegime(kind, words, top, force, math.inf, top, force, 0.0 if silent else growth)
    rest = mapping.fixed_point
    top = largest_angle(body, rest)[1]
    if body.damping > 0.0:
        highest = max(largest_angle(body, amplitudes_of_cycle(body, cycle))[1] for cycle in range(_memory(body)))
        highest = max(highest, top)
        kind, words = "periodic", "damped: settles to the periodic regime"
    else:
        highest = top + abs(start - rest)
        kind = "beat"
        words = f"undamped from rest: never settles, beats about the periodic regime by {abs(start - rest):.4g} rad"
    return SwingRegime(
        kind,
        words,
        top,
        pressing_force(body, top),
        abs(rest),
        highest,
        pressing_force(body, highest),
        0.0,
    )


def _memory(body: PressedBody) -> int:
    """Return the number of cycles (1 to 1000) in which a transient decays to 1e-9."""
    return min(1000, max(1, math.ceil(20.0 / (body.damping * body.k * body.period))))
