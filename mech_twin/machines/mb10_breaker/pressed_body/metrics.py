# SPDX-License-Identifier: Apache-2.0
"""The rational range of the preload of a body on its collar."""

import math
from dataclasses import dataclass

from mech_twin.machines.mb10_breaker.pressed_body.collar_contact import (
    BLOW,
    CONTACT,
    FREE,
    SETTLING,
    TOUCHDOWN,
    next_piece,
    planned_piece,
    resting_piece,
)
from mech_twin.machines.mb10_breaker.pressed_body.flight import SwingStretch, touchdown
from mech_twin.machines.mb10_breaker.pressed_body.parameters import PressedBody

SOFT = 1e-3  # k/omega that stands for the limit of a soft spring; its error is of the order of its square


def with_preload(body: PressedBody, ratio: float, k: float | None = None) -> PressedBody:
    """Return the body with preload ratio p = c a l/|H|, and with another natural frequency k (rad/s) if given."""
    k = body.k if k is None else k
    rate = body.inertia * k * k / (body.arm * body.arm)
    deflection = ratio * body.amplitude / (rate * body.arm)
    return body._replace(k=k, rate=rate, deflection=deflection, rest_angle=deflection / body.arm)


def first_return_after_blow(body: PressedBody) -> float:
    """Return the time (s) of the first return to the collar in a cycle from rest, relative to the blow that ends it."""
    piece = resting_piece(body, 0)
    while piece.cycle == 0 and piece.cause not in {TOUCHDOWN, BLOW}:
        piece, _ = next_piece(body, piece)
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
