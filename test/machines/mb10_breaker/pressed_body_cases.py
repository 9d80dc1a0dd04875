# SPDX-License-Identifier: Apache-2.0
"""Bodies to try, and an integrator that knows nothing of the closed forms."""

from math import asin, nan, pi, sin
from typing import NamedTuple

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from mech_twin.machines.mb10_breaker.pressed_body.collar_contact import (
    BLOW,
    CONTACT,
    FREE,
    SETTLED,
    TOUCHDOWN,
    next_piece,
    resting_piece,
    stretch_from,
)
from mech_twin.machines.mb10_breaker.pressed_body.flight import SwingStretch, highest, motion
from mech_twin.machines.mb10_breaker.pressed_body.free_swing import load_stretch, start_state
from mech_twin.machines.mb10_breaker.pressed_body.parameters import (
    BodyParameters,
    ExcitationParameters,
    PressedBody,
    pressed_body,
)

OMEGA = 20.0 * pi
INERTIA, ARM = 0.35, 0.20


def rate_at(ratio: float) -> float:
    """Spring rate at which k = ratio * omega."""
    return INERTIA * (ratio * OMEGA) ** 2 / ARM**2


def parameters(
    rate: float = 3108.9, deflection: float = 0.01, **changed
) -> tuple[BodyParameters, ExcitationParameters]:
    body = {
        "inertia_kg_m2": INERTIA,
        "spring_arm_m": ARM,
        "spring_rate_n_per_m": rate,
        "preload_deflection_m": deflection,
        "restitution": 0.4,
        "tool_radius_m": 0.25,
        "damping_ratio": 0.0,
        "blow_impulse_nms": 0.0,
        "contact": "one_sided",
    }
    excitation = {
        "kind": "approximated",
        "form": "shifted",
        "amplitude_nm": 60.0,
        "onset_fraction": 0.9,
        "frequency_ratio": None,
        "blow_rate_hz": 10.0,
    }
    for key, value in changed.items():
        (body if key in body else excitation)[key] = value
    return BodyParameters(**body), ExcitationParameters(**excitation)


def body_at(ratio: float, preload: float = 0.5, **changed) -> PressedBody:
    """Body with k = ratio * omega and preload ratio p."""
    rate = rate_at(ratio)
    amplitude = abs(changed.get("amplitude_nm", 60.0))
    return pressed_body(*parameters(rate, preload * amplitude / (rate * ARM), **changed))


class WalkedCycle(NamedTuple):
    """A cycle of the chain: gap at its blow (m), return speed (m/s), time at rest and settled (s), largest angle."""

    gap_at_blow_m: float
    return_speed_m_per_s: float
    rested_s: float
    settled_s: float
    top_rad: float


def walked_cycle(body: PressedBody, cycle: int = 0) -> WalkedCycle:
    """Return a cycle of the body started from rest."""
    piece, fastest, rested, settled, top = resting_piece(body, 0), 0.0, 0.0, nan, 0.0
    while piece.cycle <= cycle:
        ended, (piece, ending) = piece, next_piece(body, piece)
        if ended.cycle == cycle:
            rested += (ended.end - ended.start) * (ended.regime == CONTACT)
            if ended.regime == FREE:
                stretch = stretch_from(body, ended.start, ended.angle, ended.rate, ended.loaded)
                top = max(top, highest(body, stretch, ended.end - ended.start)[1])
            fastest = max(fastest, -ending.pre) if ending.cause == TOUCHDOWN else fastest
            settled = ended.end if ending.cause == SETTLED else settled
    assert ending.cause == BLOW
    return WalkedCycle(body.radius * piece.angle, fastest, rested, settled, top)


def swing(body: PressedBody, z: complex, time: float) -> tuple[float, float]:
    """Return angle and rate (rad, rad/s) at a time (s) of a cycle with amplitudes Z."""
    angle, rate = start_state(body, z)
    if time <= body.onset:
        return motion(body, SwingStretch(angle, rate, 0.0, 0.0), time)
    angle, rate = motion(body, SwingStretch(angle, rate, 0.0, 0.0), body.onset)
    return motion(body, load_stretch(body, angle, rate), time - body.onset)


def integrated(body: PressedBody, angle: float, rate: float, start: float, end: float, *, dense: bool = False):
    """DOP853 of J phi'' + 2 J zeta k phi' + c (l phi + a) l = M, M as printed on the page."""

    def slope(time, state):
        moment = body.amplitude * sin(body.mu * time + body.phase) if start >= body.onset else 0.0
        spring = body.rate * (body.arm * state[0] + body.deflection) * body.arm
        return [state[1], (moment - spring) / body.inertia - 2.0 * body.damping * body.k * state[1]]

    step = 0.25 / max(body.k, body.mu)
    return solve_ivp(
        slope, (start, end), [angle, rate], method="DOP853", rtol=1e-13, atol=1e-17, max_step=step, dense_output=dense
    )


def cycle_integrated(body: PressedBody, angle: float, rate: float) -> tuple[float, float]:
    """State after one cycle without a collar."""
    first = integrated(body, angle, rate, 0.0, body.onset).y[:, -1]
    return tuple(integrated(body, *first, body.onset, body.period).y[:, -1])


def _first_return(body, angle, rate, start, end):
    """Return (time, approach) of the first sign change of the integrated angle, or the state at the end."""
    solution = integrated(body, angle, rate, start, end, dense=True)
    times = start + (end - start) * np.geomspace(1e-8, 1.0, 8000)  # the shortest bounces are not stepped over
    values = solution.sol(times)[0]
    off = np.flatnonzero(values > 1e-13)
    if off.size:
        below = np.flatnonzero(values[off[0] :] < 0.0)
        if below.size:
            upper = off[0] + below[0]
            at = brentq(lambda time: solution.sol(time)[0], times[upper - 1], times[upper], xtol=1e-16, rtol=1e-15)
            return at, -solution.sol(at)[1], None
    return None, None, tuple(solution.y[:, -1])


def contact_integrated(body: PressedBody, cycles: int) -> list[tuple[str, float, float]]:
    """(kind, time, approach speed at the tool) of lift-offs and of returns faster than 1e-3 of their series' first.

    The rest of a series is taken at its geometric limit.  Shifted form, preload ratio between 0 and 1.
    """
    events, angle, rate, resting, first = [], 0.0, 0.0, True, 0.0
    for cycle in range(cycles):
        origin = cycle * body.period
        for start, end in ((0.0, body.onset), (body.onset, body.period)):
            time = start
            while time < end:
                if resting:
                    if start == 0.0:
                        break
                    moment = body.rate * body.deflection * body.arm
                    if moment >= body.amplitude or time > body.onset + asin(moment / body.amplitude) / body.mu:
                        break
                    time = body.onset + asin(moment / body.amplitude) / body.mu
                    events.append(("lift_off", origin + time, 0.0))
                    resting, angle, rate, first = False, 0.0, 0.0, 0.0
                at, approach, state = _first_return(body, angle, rate, time, end)
                if at is None:
                    angle, rate = state
                    break
                events.append(("touchdown", origin + at, body.radius * approach))
                first, time, angle, rate = max(first, approach), at, 0.0, body.restitution * approach
                if approach < 1e-3 * first:
                    load = body.amplitude * sin(body.mu * at + body.phase) if start > 0.0 else 0.0
                    pressing = (body.rate * body.deflection * body.arm - load) / body.inertia
                    time += 2.0 * rate / (pressing * (1.0 - body.restitution))
                    events.append(("settled", origin + time, 0.0))
                    resting = True
        events.append(("blow", origin + body.period, 0.0))
    return events
