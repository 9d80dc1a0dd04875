# SPDX-License-Identifier: Apache-2.0
"""The impact mass in 60 digits: the same law written again, with decimals and no shared code."""

from __future__ import annotations

from decimal import Decimal, getcontext
from typing import NamedTuple

getcontext().prec = 60
SMALLEST = Decimal(10) ** -55


class Seen(NamedTuple):
    kind: str
    time: Decimal
    pre: Decimal


def number(value: float | str) -> Decimal:
    """Return the decimal of a double exactly, or of a text as it is written."""
    return Decimal(value)


def walk(case: dict[str, Decimal], periods: int, listed: float = 1e-12) -> list[Seen]:
    """Return impacts and chatter ends of so many periods; the series is listed down to a share of its first."""
    gap, speed, seen = case["gap"], case["speed"], []
    for n in range(periods):
        ends = (n * case["T"] + case["t1"], (n + 1) * case["T"])
        now = n * case["T"]
        for a, end in zip((case["A1"], case["A2"]), ends, strict=True):
            gap, speed = _phase(case["R"], a, now, end, gap, speed, seen, Decimal(listed))
            now = end
    return seen


def _phase(r, a, now, end, gap, speed, seen, listed):
    if gap == 0 and speed == 0 and a >= 0:
        return gap, speed
    first = None
    while True:
        hit = _flight(gap, speed, a)
        if hit is None or now + hit[0] > end:
            t = end - now
            return max(gap - speed * t - a * t * t / 2, Decimal(0)), speed + a * t
        now, before = now + hit[0], hit[1]
        if first is None:
            first = (now, before)
            limit = now + 2 * r * before / (a * (1 - r)) if a > 0 else None
        if limit is not None and limit <= end and before < listed * first[1]:
            seen.append(Seen("chatter_end", limit, Decimal(0)))
            return Decimal(0), Decimal(0)
        seen.append(Seen("impact", now, before))
        gap, speed = Decimal(0), -r * before


def _flight(gap, speed, a):
    if speed < 0 and a <= 0:
        return None
    square = speed * speed + 2 * a * gap
    if square <= 0:
        return None
    before = square.sqrt()
    if speed >= 0:
        return 2 * gap / (speed + before), before
    return (before - speed) / a, before
