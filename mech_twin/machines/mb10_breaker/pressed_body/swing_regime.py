# SPDX-License-Identifier: Apache-2.0
"""What the freely swinging body comes to: a periodic regime, a beat about it, or growth without end."""

from __future__ import annotations

import math
from dataclasses import dataclass

from mech_twin.machines.mb10_breaker.pressed_body.free_swing import (
    amplitudes,
    amplitudes_of_cycle,
    cycle_map,
    growth_per_cycle,
    largest_angle,
    pressing_force,
)
from mech_twin.machines.mb10_breaker.pressed_body.parameters import PressedBody

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
    """Return after how many cycles a start is forgotten to 1e-9, at least 1 and at most 1000."""
    return min(1000, max(1, math.ceil(20.0 / (body.damping * body.k * body.period))))
