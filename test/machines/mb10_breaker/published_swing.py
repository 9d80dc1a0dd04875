# SPDX-License-Identifier: Apache-2.0
"""The body's swing by the integration constants of the paper, beside the cycle map of the package."""

from __future__ import annotations

import cmath
import math
from typing import NamedTuple

from mech_twin.machines.mb10_breaker.pressed_body.flight import ring_frequency
from mech_twin.machines.mb10_breaker.pressed_body.free_swing import cycle_map
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
