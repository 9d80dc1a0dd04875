# SPDX-License-Identifier: Apache-2.0
"""A mass on a straight line in front of a rigid stop: flight, blow, chatter, all in closed form.

::

      P ->  +-----+                     |//
     -----> |  m  |  ---> x             |//  stop at x = stop_position_m
            +-----+                     |//
               x <---- gap g = xc - x ->|

x is positive towards the stop, so the gap is never negative.  Velocities are positive towards the stop: a blow has
v- > 0 and leaves with v+ = -R v- < 0.  Under a constant acceleration A = P/m the path is a parabola, so nothing here
steps through time.

Conventions for every machine with a stop:

- *Grazing* (contact with exactly zero speed) is no impact: no event, the flight continues.  Its discriminant
  v^2 + 2 A g is formed with error-free products, so its sign is exact for the given numbers.
- Zero gap and zero speed: *stuck* while A >= 0, leaving the moment A < 0.
- An impact at exactly the end of an interval belongs to the interval that ends.

Source: manzhosov_novikov, eqs. (4)-(19).
"""

import math
from typing import NamedTuple

from mech_twin.declarations.quantity import Parameters, quantity
from mech_twin.kernels.kernel import kernel

LISTED_RATIO = 1e-12  # impacts of a series slower than this share of its first are booked with the end of the series
LEAST_RESTITUTION, LARGEST_RESTITUTION = 1e-6, 0.999999  # a millionth of the speed, or all but a millionth, is lost
TIE_TOLERANCE = 1e-9  # of one impact, when a cut-off equals a power of R up to rounding: the impact is kept
SPLITTER = 134217729.0  # 2^27 + 1, halves a double for the error-free product


class StopParameters(Parameters):
    """The mass and its stop."""

    mass_kg: float = quantity("kg", "impact mass", live=True, gt=0)
    stop_position_m: float = quantity("m", "position xc of the stop")
    restitution: float = quantity(
        "1", "speed after a blow over the speed before it, R", live=True, ge=LEAST_RESTITUTION, le=LARGEST_RESTITUTION
    )
    contact_stiffness_n_per_m: float | None = quantity(
        "N/m",
        "stiffness of the stop, for peak force and contact time (rigid if absent)",
        default=None,
        gt=0,
    )
    chatter_cutoff: float = quantity(
        "1", "relative speed below which a chatter series is cut off; 0: its exact limit", default=0.0, ge=0, lt=1
    )


class Arrival(NamedTuple):
    """Flight to the stop: whether it reaches it, duration (s) and speed v- (m/s)."""

    reaches: bool
    duration_s: float
    speed_m_per_s: float


@kernel
def exact_product(a: float, b: float) -> tuple[float, float]:
    """Return the product and its rounding error: a b = high + low exactly (Dekker).

    Valid while neither the halves overflow nor the error underflows (|a b| between 1e-290 and 1e290).
    """
    high = a * b
    c = SPLITTER * a
    a1 = c - (c - a)
    a2 = a - a1
    c = SPLITTER * b
    b1 = c - (c - b)
    b2 = b - b1
    return high, a2 * b2 - (((high - a1 * b1) - a2 * b1) - a1 * b2)


@kernel
def exact_sum(a: float, b: float) -> tuple[float, float]:
    """Return the sum and its rounding error: a + b = high + low exactly (Knuth)."""
    high = a + b
    c = high - a
    return high, (a - (high - c)) + (b - c)


@kernel
def discriminant(gap_m: float, velocity_m_per_s: float, acceleration_m_per_s2: float) -> float:
    """Return v^2 + 2 A g in m2/s2, its sign exact for the numbers given.

    Both products are formed without error, so a near-grazing flight loses no digits to cancellation.
    """
    p, p_low = exact_product(velocity_m_per_s, velocity_m_per_s)
    q, q_low = exact_product(2.0 * acceleration_m_per_s2, gap_m)
    high, low = exact_sum(p, q)
    rest, rest_low = exact_sum(p_low, q_low)
    total, lost = exact_sum(high, rest)
    return total + (lost + (low + rest_low))


@kernel
def arrival(gap_m: float, velocity_m_per_s: float, acceleration_m_per_s2: float) -> Arrival:
    """Return the flight to the stop under a constant acceleration.

    v- = +sqrt(v^2 + 2 A g); t = 2 g/(v + v-) for v >= 0, else (v- - v)/A, so that no form subtracts what is nearly
    equal.  There is no impact if v^2 + 2 A g < 0, if v < 0 with A <= 0, or if v- = 0 (grazing, or rest at the stop).

    Parameters
    ----------
    gap_m : float
        xc - x >= 0.
    velocity_m_per_s, acceleration_m_per_s2 : float
        Positive towards the stop.

    Notes
    -----
    manzhosov_novikov eqs. (5), (7), (13), (15); the form for v >= 0 is ours, valid for A = 0 too.
    """
    if velocity_m_per_s < 0.0 and acceleration_m_per_s2 <= 0.0:
        return Arrival(False, math.inf, 0.0)
    if gap_m == 0.0 and velocity_m_per_s != 0.0:  # v- = |v| exactly, however small (its square may vanish)
        speed = abs(velocity_m_per_s)
        return Arrival(True, 0.0 if velocity_m_per_s > 0.0 else 2.0 * speed / acceleration_m_per_s2, speed)
    squared = discriminant(gap_m, velocity_m_per_s, acceleration_m_per_s2)
    if squared <= 0.0:
        return Arrival(False, math.inf, 0.0)
    speed = math.sqrt(squared)
    if velocity_m_per_s >= 0.0:
        return Arrival(True, 2.0 * gap_m / (velocity_m_per_s + speed), speed)
    return Arrival(True, (speed - velocity_m_per_s) / acceleration_m_per_s2, speed)


@kernel
def flown_gap(gap_m: float, velocity_m_per_s: float, acceleration_m_per_s2: float, duration_s: float) -> float:
    """Return the gap after a flight without impact, in m; rounding never takes it beyond the stop."""
    gap = gap_m - duration_s * (velocity_m_per_s + 0.5 * acceleration_m_per_s2 * duration_s)
    return max(gap, 0.0)


@kernel
def series_delay(number: float, first_m_per_s: float, acceleration_m_per_s2: float, restitution: float) -> float:
    """Return the time from the first to the i-th impact of a series, in s.

    t_i - t_1 = 2 R v_1/A (1 - R^(i-1))/(1 - R), A > 0, from the intervals 2 R v_(i-1)/A (manzhosov_novikov eq. 11).
    """
    share = -math.expm1((number - 1.0) * math.log(restitution))
    return 2.0 * restitution * first_m_per_s / acceleration_m_per_s2 * share / (1.0 - restitution)


@kernel
def series_length(first_m_per_s: float, acceleration_m_per_s2: float, restitution: float) -> float:
    """Return t_inf - t_1 = 2 R v_1/(A (1 - R)) in s: the endless series ends after this time (A > 0)."""
    return 2.0 * restitution * first_m_per_s / (acceleration_m_per_s2 * (1.0 - restitution))


@kernel
def series_sum(count: float, first_m_per_s: float, restitution: float) -> float:
    """Return the sum of the speeds before n successive impacts, v (1 - R^n)/(1 - R), in m/s."""
    return first_m_per_s * -math.expm1(count * math.log(restitution)) / (1.0 - restitution)


@kernel
def impacts_within(duration_s: float, first_m_per_s: float, acceleration_m_per_s2: float, restitution: float) -> float:
    """Return how many impacts of a series, the first included, lie within a time after the first (inf: all).

    s = A t (1 - R)/(2 R v_1); s >= 1: the series completes; otherwise 1 + floor(ln(1 - s)/ln R).
    """
    s = duration_s / series_length(first_m_per_s, acceleration_m_per_s2, restitution)
    if s >= 1.0:
        return math.inf
    return 1.0 + math.floor(math.log1p(-s) / math.log(restitution))


@kernel
def impacts_kept(ratio: float, restitution: float) -> float:
    """Return how many impacts of a series are no slower than ``ratio`` times its first: floor(ln e/ln R) + 1.

    A speed that equals the ratio up to rounding is kept.
    """
    return math.floor(math.log(ratio) / math.log(restitution) + TIE_TOLERANCE) + 1.0
