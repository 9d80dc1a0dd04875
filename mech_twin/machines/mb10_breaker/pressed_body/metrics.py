# SPDX-License-Identifier: Apache-2.0
"""Metrics of the body on its collar: of each cycle and the steady cycle, and the rational range of the preload."""

import math
from dataclasses import dataclass
from typing import NamedTuple

from mech_twin.kernels.kernel import kernel
from mech_twin.machines.mb10_breaker.pressed_body.collar_contact import (
    BLOW,
    CONTACT,
    FREE,
    SETTLED,
    SETTLING,
    TOUCHDOWN,
    ContactPiece,
    next_piece,
    planned_piece,
    resting_piece,
    stretch_from,
)
from mech_twin.machines.mb10_breaker.pressed_body.flight import SwingStretch, highest, motion, touchdown
from mech_twin.machines.mb10_breaker.pressed_body.parameters import PressedBody

COUNTED_CUT = 1e-2  # returns slower than this part of their series' first are the tail of a completed series
LONGEST_REPEAT = 8  # cycles after which a motion may repeat to be called periodic
PATIENCE = 400  # cycles waited for a repetition
SAME = 1e-10  # relative difference of state taken as repetition
SOFT = 1e-3  # k/omega that stands for the limit of a soft spring; its error is of the order of its square


class CycleMetrics(NamedTuple):
    """One cycle on the collar; times in s from the start of the cycle, nan where nothing of the kind happens.

    ``return_s`` is the time of the fastest return.  ``contact_share`` is the part of the cycle at rest on the collar.
    ``impacts`` counts returns at or above ``COUNTED_CUT`` of their series' first; slower ones are counted only if the
    series does not settle in the cycle.
    """

    gap_at_blow_m: float
    return_speed_m_per_s: float
    largest_force_n: float
    rest_force_n: float
    contact_share: float
    impacts: int
    lift_m: float
    return_s: float
    settled_s: float

    @property
    def flight_share(self) -> float:
        """Part of the cycle in which the body is not at rest on its collar."""
        return 1.0 - self.contact_share


@kernel
def cycle_metrics(body: PressedBody, piece: ContactPiece) -> tuple[ContactPiece, CycleMetrics]:
    """Return the first piece of the next cycle and the metrics of the cycle that begins with ``piece``."""
    top, fastest, rested, returned, settled = piece.angle, 0.0, 0.0, math.nan, math.nan
    counted, slow, gap = 0, 0, 0.0
    while True:
        duration = max(piece.end - piece.start, 0.0)
        if piece.regime == CONTACT:
            rested += duration
        else:
            stretch = stretch_from(body, piece.start, piece.angle, piece.rate, piece.loaded)
            if piece.regime == FREE:
                top = max(top, highest(body, stretch, duration)[1])
            if piece.cause == BLOW:
                gap = max(motion(body, stretch, duration)[0], 0.0)
        after, ending = next_piece(body, piece)
        if ending.cause == TOUCHDOWN:
            if -ending.pre > fastest:
                returned, fastest = piece.end, -ending.pre
            if -ending.pre >= COUNTED_CUT * body.radius * after.series:
                counted += 1
            else:
                slow += 1
        elif ending.cause == SETTLED:
            settled, slow = piece.end, 0
        piece = after
        if ending.cause == BLOW:
            break
    force = body.rate * (body.arm * top + body.deflection)
    return piece, CycleMetrics(
        body.radius * gap,
        fastest,
        force,
        body.rate * body.deflection,
        rested / body.period,
        counted + slow,
        body.radius * top,
        returned,
        settled,
    )


@dataclass(frozen=True)
class SteadyMetrics:
    """Metrics of the steady cycle, or the worst of the cycles if the motion does not become steady.

    ``repeats_after`` is the number of cycles after which the motion repeats, 0 if it does not within the cycles tried.
    """

    metrics: CycleMetrics
    repeats_after: int
    cycles: int


def steady_metrics(body: PressedBody) -> SteadyMetrics:
    """Return the metrics of the steady cycle, started from rest on the tool.

    A motion that repeats after several cycles, or does not repeat, is given by its worst cycle: largest gap, speed,
    force and impacts, least contact.
    """
    if not body.one_sided:
        raise ValueError("metrics of a cycle need contact: one_sided; the free swing has its own regime")
    piece = resting_piece(body, 0)
    states: list[tuple[float, float]] = []
    cycles: list[CycleMetrics] = []
    for cycle in range(PATIENCE):
        states.append((piece.angle, piece.rate / body.k))
        for back in range(1, min(LONGEST_REPEAT, cycle) + 1):
            if _same(states[-1], states[-1 - back]):
                return SteadyMetrics(_worst(cycles[-back:]), back, cycle)
        piece, found = cycle_metrics(body, piece)
        cycles.append(found)
    return SteadyMetrics(_worst(cycles[PATIENCE // 2 :]), 0, PATIENCE)


def _same(one: tuple[float, float], other: tuple[float, float]) -> bool:
    size = max(abs(other[0]), abs(other[1]))
    return max(abs(one[0] - other[0]), abs(one[1] - other[1])) <= SAME * size


def _worst(cycles: list[CycleMetrics]) -> CycleMetrics:
    if len(cycles) == 1:
        return cycles[0]
    fastest = max(cycles, key=lambda cycle: cycle.return_speed_m_per_s)
    settled = [cycle.settled_s for cycle in cycles]
    return CycleMetrics(
        max(cycle.gap_at_blow_m for cycle in cycles),
        fastest.return_speed_m_per_s,
        max(cycle.largest_force_n for cycle in cycles),
        cycles[0].rest_force_n,
        min(cycle.contact_share for cycle in cycles),
        max(cycle.impacts for cycle in cycles),
        max(cycle.lift_m for cycle in cycles),
        fastest.return_s,
        math.nan if any(math.isnan(value) for value in settled) else max(settled),
    )


def with_preload(body: PressedBody, ratio: float, k: float | None = None) -> PressedBody:
    """Return the body with preload ratio p = c a l/|H|, and with another natural frequency k (rad/s) if given."""
    k = body.k if k is None else k
    rate = body.inertia * k * k / (body.arm * body.arm)
    deflection = ratio * body.amplitude / (rate * body.arm)
    return body._replace(k=k, rate=rate, deflection=deflection, rest_angle=deflection / body.arm)


def _first_cycle(body: PressedBody) -> ContactPiece:
    piece = resting_piece(body, 0)
    while piece.cycle == 0 and piece.cause not in {TOUCHDOWN, BLOW}:
        piece, _ = next_piece(body, piece)
    return piece


def first_return_after_blow(body: PressedBody) -> float:
    """Return the time (s) of the first return to the collar in a cycle from rest, relative to the blow that ends it."""
    piece = _first_cycle(body)
    if piece.cause == TOUCHDOWN:
        return piece.end - body.period
    after, _ = next_piece(body, piece)
    if after.regime == CONTACT:
        return -body.period
    return touchdown(body, SwingStretch(after.angle, after.rate, 0.0, 0.0), math.inf if body.damping == 0.0 else 1e3)[0]


def settled_after_blow(body: PressedBody) -> float:
    """Return the time (s) from the blow that ends a cycle from rest until the body settles, without a further load."""
    piece = resting_piece(body, 0)
    while piece.cycle == 0:
        piece, _ = next_piece(body, piece)
    if piece.regime == CONTACT:
        return 0.0
    long = body._replace(amplitude=0.0, onset=1e3 * body.period, period=1e4 * body.period)
    piece = planned_piece(long, 1, 0.0, piece.angle, piece.rate, FREE, 0, piece.series)
    while piece.regime not in {CONTACT, SETTLING}:
        if piece.cause != TOUCHDOWN:
            return math.inf
        piece, _ = next_piece(long, piece)
    return piece.end if piece.regime == SETTLING else piece.start


@dataclass(frozen=True)
class PreloadRange:
    """Preload ratios p = c a l/|H| from which on the spring is rational, up to 1: then the load lifts no more.

    Attributes
    ----------
    settled : float
        Least p with which the body has settled when the next load begins: every blow finds the tool seated, the
        cycle repeats exactly.
    returned : float
        Least p with which the first return is before the blow itself.
    """

    settled: float
    returned: float


def preload_range(body: PressedBody, k: float | None = None) -> PreloadRange:
    """Return the rational range of the preload ratio at natural frequency k (rad/s); None: the limit of a soft spring.

    Both bounds are roots in p of a body thrown up from rest: settled at t1, and first return at t = T.
    """
    k = SOFT * 2.0 * math.pi / body.period if k is None else k

    def settles_late(ratio: float) -> float:
        return settled_after_blow(with_preload(body, ratio, k)) - body.onset

    def returns_late(ratio: float) -> float:
        return first_return_after_blow(with_preload(body, ratio, k))

    from scipy.optimize import brentq  # 0.2 s

    low, high = 1e-3, 1.0 - 1e-9
    settled = low if settles_late(low) < 0.0 else brentq(settles_late, low, high, xtol=1e-13, rtol=1e-13)
    returned = low if returns_late(low) < 0.0 else brentq(returns_late, low, high, xtol=1e-13, rtol=1e-13)
    return PreloadRange(float(settled), float(returned))
