# SPDX-License-Identifier: Apache-2.0
"""The period of a motion that is released from rest, in many digits: own event walk, no code shared with the twin."""

from __future__ import annotations

from mpmath import mp, mpf, sqrt

DIGITS = 200


def periods_between_releases(case: dict[str, float | str], most: int, digits: int = DIGITS) -> int:
    """Return the number of periods from one release to the next, or 0 if none comes within ``most`` periods.

    ``case`` holds T, t1, A1 (towards the stop), A2 (away from it) and R, as doubles or decimals, taken exactly.  The
    mass leaves the stop with gap 0 and speed 0 at the start of phase 2; from there its motion is always the same.
    ``digits`` must be more than those by which a difference grows until the next release.
    """
    with mp.workdps(digits):
        t1, period, r = mpf(case["t1"]), mpf(case["T"]), mpf(case["R"])
        push, pull = mpf(case["A1"]), mpf(case["A2"])
        gap, speed = mpf(0), mpf(0)
        for number in range(1, most + 1):
            gap, speed, _ = _phase(gap, speed, pull, period - t1, r)
            gap, speed, rests = _phase(gap, speed, push, t1, r)
            if rests:
                return number
        return 0


def _phase(gap, speed, a, duration, r):
    """Return gap, speed and whether the mass rests at the end of a phase; positive speeds close the gap."""
    if gap == 0 and speed == 0 and a >= 0:  # came to rest by grazing at the end of the phase before
        return gap, speed, True
    left, first = duration, True
    while True:
        hit = _hit(gap, speed, a)
        if hit is None or hit[0] > left:
            return gap - speed * left - a * left**2 / 2, speed + a * left, False
        wait, before = hit
        left -= wait
        if first and a > 0 and 2 * r * before / (a * (1 - r)) <= left:
            return mpf(0), mpf(0), True
        gap, speed, first = mpf(0), -r * before, False


def _hit(gap, speed, a):
    """Return time to the stop and speed there, or None."""
    square = speed**2 + 2 * a * gap
    if square <= 0 or (speed <= 0 and a <= 0):
        return None
    before = sqrt(square)
    if gap == 0 and speed > 0:
        return mpf(0), before
    return (2 * gap / (speed + before) if speed + before > 0 else (before - speed) / a), before
