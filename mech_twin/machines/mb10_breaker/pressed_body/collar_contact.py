# SPDX-License-Identifier: Apache-2.0
r"""The body on the one-sided collar of the tool: phi >= 0, restitution e, every event exact.

::

     M |           _            phi |             .-.
       |          / \               |    settled /   \   first   bounces, each (2/k) atan(w/(k phi0))
     cal|- - - - /- -\- -           |           /     \ return
       |________/     \___ t        |__________/       \_/\_.____ t        a finite limit when phi0 > 0
       0       t1      T            0      lift-off         settled

A motion is a chain of pieces.  Each ends with an event found in closed form, or by a search that cannot step over it.
The chain depends only on the constants and the initial state, not on the sampling times.

Energy balance of the free swing: change of kinetic energy against the work of spring, load and damper by quadrature.

::

    J (w1^2 - w0^2)/2  =  int_t0^t1 [M(t) - c l^2 (phi + phi0) - d w] w dt

The closed form enters only through its values.  A wrong solution, or a rate that is not the derivative of the angle,
leaves an error in the balance.
"""

import math
from typing import NamedTuple

import numpy as np

from mech_twin.kernels.kernel import kernel
from mech_twin.machines.mb10_breaker.pressed_body.flight import (
    ROUNDING,
    SwingStretch,
    motion,
    net_acceleration,
    touchdown,
)
from mech_twin.machines.mb10_breaker.pressed_body.parameters import PressedBody

CONTACT, FREE, SETTLING = 0, 1, 2
REGIMES = ("contact", "free", "settling")
ONSET, BLOW, LIFT_OFF, TOUCHDOWN, SETTLED = 0, 1, 2, 3, 4
CAUSES = ("onset", "blow", "lift_off", "touchdown", "settled")

TAIL_CUT = 1e-3  # returns slower than this part of their series' first are reported as one settling, not one by one
SERIES_END = 1e-12  # speed, as part of its first, at which a series is taken to its geometric limit
LONGEST_SERIES = 1_000_000


class ContactPiece(NamedTuple):
    """A piece of the chain: its start, the state there, and the event that ends it.

    Times in s from the start of the cycle; ``loaded`` is 1 after the onset; ``series`` is the fastest approach (rad/s)
    of the running series of returns.
    """

    cycle: int
    start: float
    angle: float
    rate: float
    regime: int
    loaded: int
    series: float
    end: float
    cause: int


class PieceEnd(NamedTuple):
    """Event at the end of a piece: kind, velocities at the tool before and after (m/s), impulse on the body (N s)."""

    cause: int
    pre: float
    post: float
    impulse: float


@kernel
def stretch_from(body: PressedBody, start: float, angle: float, rate: float, loaded: int) -> SwingStretch:
    """Return the free stretch that begins at a time of the cycle."""
    if loaded == 0:
        return SwingStretch(angle, rate, 0.0, 0.0)
    at_onset = body.mu * body.onset + body.phase  # exactly 0 in the shifted form
    return SwingStretch(angle, rate, body.amplitude, body.mu * (start - body.onset) + at_onset)


@kernel
def stretch_of(body: PressedBody, piece: ContactPiece) -> SwingStretch:
    """Return the free stretch of a piece."""
    return stretch_from(body, piece.start, piece.angle, piece.rate, piece.loaded)


@kernel
def stage_end(body: PressedBody, loaded: int) -> float:
    """Return when the load ends, or begins (s)."""
    return body.period if loaded == 1 else body.onset


@kernel
def _leaves(body: PressedBody, stretch: SwingStretch) -> bool:
    """Return whether the load lifts a body resting on the collar at once."""
    net, push = net_acceleration(body, stretch), stretch.load / body.inertia
    return net > ROUNDING * push or (net >= 0.0 and push > 0.0 and math.cos(stretch.theta) > 0.0)


@kernel
def lift_off(body: PressedBody, start: float) -> float:
    """Return the time in the cycle at which a body resting from ``start`` under the load leaves the collar, or inf.

    In the shifted form t1 + asin(p)/mu with p = c a l/|H|; a body with p >= 1, up to rounding, never leaves.
    """
    stretch = stretch_from(body, start, 0.0, 0.0, 1)
    if _leaves(body, stretch):
        return start
    needed = body.k * body.k * body.rest_angle * body.inertia
    if needed >= (1.0 - ROUNDING) * body.amplitude:
        return math.inf
    return start + (math.asin(needed / body.amplitude) - stretch.theta) % (2.0 * math.pi) / body.mu


@kernel
def series_limit(body: PressedBody, stretch: SwingStretch, first: float, room: float) -> tuple[float, float]:
    """Return duration (s) and summed impulse (N m s) of the returns that remain, or (inf, 0).

    ``stretch`` starts on the collar with the speed after a return.  Durations are summed until the speed is below
    ``SERIES_END`` of the first, the rest is its geometric limit 2 w/(g (1 - e)), g being the net pressing
    acceleration.  Infinite if the limit lies beyond ``room`` or the load leaves no pressing.
    """
    elapsed, moment, speed = 0.0, 0.0, stretch.rate
    theta = stretch.theta
    for _ in range(LONGEST_SERIES):
        current = SwingStretch(0.0, speed, stretch.load, theta)
        pressing = -net_acceleration(body, current)
        if pressing <= 0.0:
            return math.inf, 0.0
        if speed <= SERIES_END * first:
            remainder = 2.0 * speed / (pressing * (1.0 - body.restitution))
            moment += body.inertia * speed * (1.0 + body.restitution) / (1.0 - body.restitution)
            elapsed += remainder
            return (elapsed, moment) if elapsed <= room else (math.inf, 0.0)
        duration, approach = touchdown(body, current, room - elapsed)
        if duration == math.inf:
            return math.inf, 0.0
        elapsed += duration
        theta += body.mu * duration
        moment += body.inertia * approach * (1.0 + body.restitution)
        speed = body.restitution * approach
    return math.inf, 0.0


@kernel
def _settling_motion(body: PressedBody, stretch: SwingStretch, s: float) -> tuple[float, float]:
    """Return angle and rate (rad, rad/s) within a complete series of bounces; after the last one the body rests."""
    first, speed, theta, left = stretch.rate, stretch.rate, stretch.theta, s
    while speed > SERIES_END * first:
        current = SwingStretch(0.0, speed, stretch.load, theta)
        duration, approach = touchdown(body, current, body.period)
        if left < duration:
            return motion(body, current, left)
        left -= duration
        theta += body.mu * duration
        speed = body.restitution * approach
    return 0.0, 0.0


@kernel
def planned_piece(
    body: PressedBody, cycle: int, start: float, angle: float, rate: float, regime: int, loaded: int, series: float
) -> ContactPiece:
    """Return the piece that begins with this state, with the event that ends it."""
    end, cause = stage_end(body, loaded), BLOW if loaded == 1 else ONSET
    room = max(end - start, 0.0)
    if regime == CONTACT:
        if loaded == 1:
            leaving = lift_off(body, start)
            if leaving <= end:
                end, cause = leaving, LIFT_OFF
    elif body.one_sided:
        stretch = stretch_from(body, start, angle, rate, loaded)
        if regime == SETTLING:
            duration = 0.0 if rate == 0.0 else series_limit(body, stretch, series, room)[0]
            end, cause = start + duration, SETTLED
        else:
            duration, _ = touchdown(body, stretch, room)
            if duration < math.inf:
                end, cause = start + duration, TOUCHDOWN
    return ContactPiece(cycle, start, angle, rate, regime, loaded, series, end, cause)


@kernel
def state_at(body: PressedBody, piece: ContactPiece, time: float) -> tuple[float, float]:
    """Return angle and rate (rad, rad/s) at a time of the cycle within the piece."""
    if piece.regime == CONTACT:
        return 0.0, 0.0
    stretch = stretch_of(body, piece)
    s = max(time - piece.start, 0.0)
    angle, rate = _settling_motion(body, stretch, s) if piece.regime == SETTLING else motion(body, stretch, s)
    return (max(angle, 0.0) if body.one_sided else angle), rate


@kernel
def residuals_at(body: PressedBody, piece: ContactPiece, time: float, span: float) -> tuple[float, float]:
    """Return two residuals, zero but for rounding: penetration of the collar (rad), and the relative energy error.

    The energy is balanced over the last ``span`` (s) of free swing before ``time``, within the piece.
    """
    if piece.regime != FREE:
        return 0.0, 0.0
    stretch = stretch_of(body, piece)
    end = max(time - piece.start, 0.0)
    depth = max(-motion(body, stretch, end)[0], 0.0) if body.one_sided else 0.0
    return depth, energy_left_open(body, stretch, max(end - span, 0.0), end)


@kernel
def _after_return(body: PressedBody, piece: ContactPiece) -> tuple[ContactPiece, PieceEnd]:
    """Return the piece after a touchdown: another flight, a complete series of bounces, or rest."""
    stretch = stretch_of(body, piece)
    stage = stage_end(body, piece.loaded)
    _, approach = touchdown(body, stretch, max(stage - piece.start, 0.0))
    first = max(piece.series, approach)
    speed = body.restitution * approach
    landed = stretch_from(body, piece.end, 0.0, speed, piece.loaded)
    pressed = net_acceleration(body, landed) < 0.0
    regime = FREE
    if speed == 0.0 or (pressed and speed <= SERIES_END * first):
        regime, speed = (FREE, 0.0) if _leaves(body, landed) else (SETTLING, 0.0)
    elif pressed and approach < TAIL_CUT * first and series_limit(body, landed, first, stage - piece.end)[0] < math.inf:
        regime = SETTLING
    ending = PieceEnd(
        TOUCHDOWN, -body.radius * approach, body.radius * speed, body.inertia * (approach + speed) / body.radius
    )
    return planned_piece(body, piece.cycle, piece.end, 0.0, speed, regime, piece.loaded, first), ending


@kernel
def _after_blow(body: PressedBody, piece: ContactPiece) -> tuple[ContactPiece, PieceEnd]:
    """Return the piece after the end of the cycle: the blow changes the body's rate by S/J."""
    angle, before = state_at(body, piece, piece.end)
    after = before + body.impulse / body.inertia
    thrown = piece.regime == CONTACT and body.impulse > 0.0
    regime, series = (FREE, 0.0) if thrown else (piece.regime, piece.series)
    ending = PieceEnd(BLOW, body.radius * before, body.radius * after, body.impulse / body.radius)
    return planned_piece(body, piece.cycle + 1, 0.0, angle, after, regime, 0, series), ending


@kernel
def next_piece(body: PressedBody, piece: ContactPiece) -> tuple[ContactPiece, PieceEnd]:
    """Return the following piece, and the event between the two."""
    if piece.cause == TOUCHDOWN:
        return _after_return(body, piece)
    if piece.cause == BLOW:
        return _after_blow(body, piece)
    angle, rate, regime, loaded, series, moment = 0.0, 0.0, FREE, piece.loaded, 0.0, 0.0
    if piece.cause == ONSET:
        angle, rate = state_at(body, piece, piece.end)
        regime, loaded, series = piece.regime, 1, piece.series
    elif piece.cause == SETTLED:
        regime = CONTACT
        if piece.rate > 0.0:
            room = stage_end(body, piece.loaded) - piece.start
            moment = series_limit(body, stretch_of(body, piece), piece.series, room)[1]
    after = planned_piece(body, piece.cycle, piece.end, angle, rate, regime, loaded, series)
    return after, PieceEnd(piece.cause, 0.0, 0.0, moment / body.radius)


@kernel
def resting_piece(body: PressedBody, cycle: int) -> ContactPiece:
    """Return the first piece of a body that rests on the tool at the start of a cycle."""
    return planned_piece(body, cycle, 0.0, 0.0, 0.0, CONTACT if body.one_sided else FREE, 0, 0.0)


NODES, WEIGHTS = np.polynomial.legendre.leggauss(8)  # good to rounding over a radian of the fastest oscillation


@kernel
def work_per_inertia(body: PressedBody, stretch: SwingStretch, start: float, end: float) -> float:
    """Return the work of load, spring and damper on the body between two times of a stretch, over J (rad2/s2)."""
    fastest = max(body.k, body.mu) if stretch.load > 0.0 else body.k
    panels = max(math.ceil((end - start) * fastest), 1)
    half = 0.5 * (end - start) / panels
    total = 0.0
    for panel in range(panels):
        for j in range(len(NODES)):
            s = start + half * (2.0 * panel + 1.0 + NODES[j])
            angle, rate = motion(body, stretch, s)
            pushed = stretch.load / body.inertia * math.sin(stretch.theta + body.mu * s)
            pressed = body.k * body.k * (angle + body.rest_angle) + 2.0 * body.damping * body.k * rate
            total += half * WEIGHTS[j] * (pushed - pressed) * rate
    return total


@kernel
def energy_left_open(body: PressedBody, stretch: SwingStretch, start: float, end: float) -> float:
    """Return the relative error of the energy balance between two times (s) of a stretch.

    Its scale is the largest energy at the two ends and of the seated body, whose phi0 sets the rounding of phi + phi0.
    """
    angle0, rate0 = motion(body, stretch, start)
    angle1, rate1 = motion(body, stretch, end)
    work = work_per_inertia(body, stretch, start, end)
    before = 0.5 * (rate0 * rate0 + (body.k * (angle0 + body.rest_angle)) ** 2)
    after = 0.5 * (rate1 * rate1 + (body.k * (angle1 + body.rest_angle)) ** 2)
    seated = 0.5 * (body.k * body.rest_angle) ** 2
    scale = max(before, after, seated)
    return (0.5 * (rate1 * rate1 - rate0 * rate0) - work) / scale if scale > 0.0 else 0.0
