# SPDX-License-Identifier: Apache-2.0
"""Event location: the first zero crossing of the event functions (signals) within an integration step.

Roots are bracketed on the dense output of the step.  The step is integrated again up to the first of them.  A signal
with two roots within the step is found through its minimum.  The known root of a signal that starts at zero (a body
that has just left its stop) is divided out (deflation).  A step ends soon after the return of a body in free flight,
and a short step takes a method of fewer stages.

Source: E. Hairer, S. Norsett, G. Wanner, Solving Ordinary Differential Equations I, 2nd ed., Springer 1993, II.6.
"""

import math
from typing import NamedTuple

from mech_twin.engine.addresses import value_at
from mech_twin.engine.hybrid.laws import OPEN, Array
from mech_twin.engine.hybrid.motion import UNKNOWN, PieceAt, piece_rates, read_signals
from mech_twin.engine.integration import (
    SHORTEST_S,
    Workspace,
    controlled_step,
    finish_step,
    following_step,
    interpolate,
    method_of,
    prepare_dense_output,
    start_step,
    take_step,
)
from mech_twin.kernels.kernel import borrowing_kernel, embedded_kernel

NOTHING = -1
AT_ROOT, KEPT = 1.0, 2.0  # a signal that is zero at the start; one that other laws keep at zero
NEXT = 1e-13  # of a step: a root is no better known
BEYOND = 1.25  # times the flight at constant acceleration: a step that holds its end
SOON = 1e-3  # of the step that error control allows: in less a gap may change by less than its rounding
SHORT = 0.125  # of that step: the method of fewer stages is exact enough, or the step fails
UNIFORM = 1e-7  # of a step: over so short a time the second derivative moves nothing above rounding


class Signals(NamedTuple):
    """Work arrays of event location: the signals (s,) and rates at start, end and other instants; states y (n,)."""

    start: Array
    start_rate: Array
    end: Array
    end_rate: Array
    now: Array
    now_rate: Array
    middle: Array
    at_root: Array  # `AT_ROOT`, `KEPT`, or 0
    state: Array
    rate: Array
    lost: Array  # (2 n,) carry of the compensated sums of coordinates and velocities


@borrowing_kernel
def dense_signal(
    piece: PieceAt, t: float, y: Array, h: float, share: float, which: int, work: Workspace, search: Signals
) -> tuple[float, float]:
    """Return a signal and its time derivative at a share (0 to 1) of the step, from the dense output."""
    interpolate(piece, y, h, share, work, search.state)
    piece_rates(piece, t + share * h, search.state, search.rate)
    read_signals(piece, t + share * h, search.state, search.now, search.now_rate)
    return search.now[which], search.now_rate[which]


@embedded_kernel
def deflated(value: float, shift: float, span: float, at_root: bool) -> float:
    """Return a signal, with its root at the start divided out where ``at_root``."""
    return (value - shift) / span if at_root else value


@embedded_kernel
def lowest_share(first: float, rate: float, last: float, last_rate: float, h: float) -> tuple[float, float]:
    """Return place (share of the step, -1 for none) and value of the minimum of the cubic Hermite interpolant."""
    p0, p1 = rate * h, last_rate * h
    c2, c3 = 3.0 * (last - first) - 2.0 * p0 - p1, p0 + p1 - 2.0 * (last - first)
    inner = c2 * c2 - 3.0 * c3 * p0
    if inner < 0.0:
        return -1.0, min(first, last)
    share = -p0 / (c2 + math.sqrt(inner)) if c2 + math.sqrt(inner) != 0.0 else -1.0
    if not 0.0 < share < 1.0:
        return -1.0, min(first, last)
    return share, first + share * (p0 + share * (c2 + share * c3))


@borrowing_kernel
def fill_middle(piece: PieceAt, t: float, y: Array, h: float, end: Array, work: Workspace, search: Signals) -> None:
    """Fill the signals at the midpoint of the step, with the state from cubic Hermite interpolation."""
    last = len(method_of(piece).weights)
    for i in range(len(y)):
        search.state[i] = 0.5 * (y[i] + end[i]) + 0.125 * h * (work.rates[0, i] - work.rates[last, i])
    piece_rates(piece, t + 0.5 * h, search.state, search.rate)
    read_signals(piece, t + 0.5 * h, search.state, search.middle, search.now_rate)


@embedded_kernel
def may_dip(search: Signals, which: int, h: float) -> bool:
    """Return whether a signal positive at both ends may have a minimum near zero within the step."""
    first, last, rate = search.start[which], search.end[which], search.start_rate[which]
    if math.isnan(rate):
        curve = first - 2.0 * search.middle[which] + last
        share = 0.5 - 0.25 * (last - first) / curve if curve > 0.0 else -1.0
        if not 0.0 < share < 1.0:
            return False
        lowest = first + share * (last - first - 2.0 * curve * (1.0 - share))
        return bool(lowest < 0.25 * min(first, last))
    if rate >= 0.0 or search.end_rate[which] <= 0.0:
        return False
    return bool(lowest_share(first, rate, last, search.end_rate[which], h)[1] < 0.5 * min(first, last))


@borrowing_kernel
def dip_share(piece: PieceAt, t: float, y: Array, h: float, which: int, work: Workspace, search: Signals) -> float:
    """Return a share of the step where a signal positive at both ends is zero or negative (at its minimum), or -1."""
    if math.isnan(search.start_rate[which]):
        low, high = 0.0, 1.0
        for _ in range(40):
            left, right = low + (high - low) / 3.0, high - (high - low) / 3.0
            a = dense_signal(piece, t, y, h, left, which, work, search)[0]
            b = dense_signal(piece, t, y, h, right, which, work, search)[0]
            if a <= 0.0 or b <= 0.0:
                return left if a <= 0.0 else right
            if a < b:
                high = right
            else:
                low = left
        return -1.0
    low, high, share = 0.0, 1.0, 0.5
    first = lowest_share(search.start[which], search.start_rate[which], search.end[which], search.end_rate[which], h)[0]
    if first > 0.0:
        share = first
    for _ in range(60):
        value, slope = dense_signal(piece, t, y, h, share, which, work, search)
        if value <= 0.0:
            return share
        if slope > 0.0:
            high = share
        else:
            low = share
        if high - low < 1e-12:
            break
        share = 0.5 * (low + high)
    return -1.0


@borrowing_kernel
def root_share(
    piece: PieceAt, t: float, y: Array, h: float, which: int, high: float, work: Workspace, search: Signals
) -> float:
    """Return the root of a signal before ``high`` as share of the step: Newton's method on the dense output.

    A bracket holds it; a signal without a rate has the slope of the last secant.
    """
    at_root, shift = search.at_root[which] == AT_ROOT, search.start[which]
    low, before = 0.0, 0.0
    last = search.start_rate[which] if at_root else shift
    value = search.end[which] if high == 1.0 else dense_signal(piece, t, y, h, high, which, work, search)[0]
    value = deflated(value, shift, high * h, at_root)
    here = high - value * high / (value - last) if value < last else 0.5 * high
    for turn in range(80):
        if not low < here < high:
            here = 0.5 * (low + high)
        value, rate = dense_signal(piece, t, y, h, here, which, work, search)
        value = deflated(value, shift, here * h, at_root)
        slope = (rate - value) / here if at_root else rate * h
        if math.isnan(rate):
            slope = (value - last) / (here - before)
        if value <= 0.0:
            high = here
        else:
            low = here
        step = -value / slope if slope < 0.0 else math.inf
        if value == 0.0 or abs(step) <= NEXT or high - low <= NEXT:
            break
        before, last = here, value
        here += step if turn % 8 != 7 else math.inf
    return here if low <= here <= high else 0.5 * (low + high)


@embedded_kernel
def is_beyond(first: float, rate: float, last: float, at_root: bool) -> bool:
    """Return whether the event is at the start of the step already, from the signal at both ends and its rate."""
    if at_root:  # the rate alone may be rounding
        return bool(rate < 0.0 and last < 0.0)
    if first < 0.0:  # negative by rounding only if it gets no more so: a gap that opens, or stays, as friction slips
        return not (rate >= 0.0 and last >= first)
    return bool(first == 0.0 and (rate < 0.0 or last < 0.0))


@embedded_kernel
def mark_roots(search: Signals) -> None:
    """Mark signals that are zero and rising at the start; they may return to zero within the step."""
    for which in range(len(search.start)):
        if search.start[which] == 0.0 and search.start_rate[which] > 0.0 and search.at_root[which] != KEPT:
            search.at_root[which] = AT_ROOT


@embedded_kernel
def forget_roots(at_root: Array) -> None:
    """Drop the marks of signals that were zero at the start of a step."""
    for which in range(len(at_root)):
        if at_root[which] == AT_ROOT:
            at_root[which] = 0.0


@borrowing_kernel
def first_signal(piece: PieceAt, t: float, y: Array, h: float, work: Workspace, search: Signals) -> tuple[int, float]:
    """Return the first signal to cross zero within the step, and where (share of the step); `NOTHING` for none."""
    found, share, dense, middle = NOTHING, 1.0, False, False
    mark_roots(search)
    for which in range(len(search.start)):
        first, last = search.start[which], search.end[which]
        rate = search.start_rate[which]
        if first == math.inf or search.at_root[which] == KEPT:
            continue
        at_root = search.at_root[which] == AT_ROOT
        if is_beyond(first, rate, last, at_root):
            return which, 0.0
        if (first <= 0.0 and not at_root) or (at_root and rate == 0.0 and last == first):
            continue  # a gap that other laws hold constant stays open
        high = 1.0
        if deflated(last, first, h, at_root) > 0.0:
            if at_root:
                continue
            if math.isnan(rate) and not middle:
                fill_middle(piece, t, y, h, work.end, work, search)
                middle = True
            if not may_dip(search, which, h):
                continue
            if not dense:
                prepare_dense_output(piece, t, y, h, work)
                dense = True
            high = dip_share(piece, t, y, h, which, work, search)
            if high < 0.0:
                continue
        if not dense:
            prepare_dense_output(piece, t, y, h, work)
            dense = True
        root = root_share(piece, t, y, h, which, high, work, search)
        if found == NOTHING or root < share:
            found, share = which, root
    return found, share


@borrowing_kernel
def integrate_to_root(
    piece: PieceAt, t: float, y: Array, h: float, share: float, which: int, work: Workspace, search: Signals
) -> tuple[float, float]:
    """Integrate to the root of a signal; return the length of the step taken (s), and the rest up to the root (s).

    Over that rest, if it is not zero, the motion is uniform but for less than rounding: ``work.end`` is after it.
    """
    span, slope = share * h, UNKNOWN
    if math.isnan(search.start_rate[which]):
        step = 1e-3
        low = max(share - step, 0.0)
        a = dense_signal(piece, t, y, h, low, which, work, search)[0]
        b = dense_signal(piece, t, y, h, share, which, work, search)[0]
        slope = (b - a) / ((share - low) * h) if share > low else UNKNOWN
    kept, least = span, math.inf
    for turn in range(3):
        take_step(piece, t, y, span, work)
        finish_step(piece, t, span, work)
        read_signals(piece, t + span, work.end, search.now, search.now_rate)
        value, rate = search.now[which], search.now_rate[which]
        if abs(value) > least:  # where the signal is flat, Newton's method leads away from its root
            span = kept
            take_step(piece, t, y, span, work)
            finish_step(piece, t, span, work)
            break
        kept, least = span, abs(value)
        rate = slope if math.isnan(rate) else rate
        rest = -value / rate if rate < 0.0 else 0.0
        if turn == 2 or not 0.0 < span + rest <= h or rest == 0.0:
            break
        if abs(rest) <= UNIFORM * h:
            last = work.rates[len(method_of(piece).weights)]
            for i in range(len(y)):
                work.end[i] += rest * last[i]
            return span, rest
        span += rest
    return span, 0.0


@borrowing_kernel
def add_step(piece: PieceAt, h: float, rest: float, y: Array, work: Workspace, search: Signals) -> None:
    """Update ``y`` to the end of the step, with compensated (Kahan) summation of coordinates and velocities."""
    weights = method_of(piece).weights
    for i in range(len(search.lost)):
        change = 0.0
        for stage in range(len(weights)):
            change += weights[stage] * work.rates[stage, i]
        change = h * change + (rest * work.rates[len(weights), i] + search.lost[i])
        after = y[i] + change
        search.lost[i] = change - (after - y[i])
        y[i] = after
    for i in range(len(search.lost), len(y)):
        y[i] = work.end[i]


@borrowing_kernel
def shortest_flight(piece: PieceAt, search: Signals) -> float:
    """Return the time (s) to the first impact of an open contact at constant acceleration, from the start of a step."""
    _, regimes, at = value_at(piece.place)
    shortest = math.inf
    for i in range(len(at.gap)):
        gap, v, a = max(search.start[2 * i], 0.0), search.start_rate[2 * i], at.law_acceleration[i]
        if regimes[i] != OPEN or not gap < math.inf:
            continue
        inner = v * v - 2.0 * a * gap
        root = math.sqrt(inner) if inner >= 0.0 else math.nan  # it does not come back
        flight = (v + root) / -a if a < 0.0 else 2.0 * gap / (root - v) if v < 0.0 else 0.0
        if flight > 0.0:
            shortest = min(shortest, flight)
    return shortest


@borrowing_kernel
def advance_piece(
    whole: PieceAt,
    light: PieceAt,
    t: float,
    y: Array,
    left: float,
    wanted: float,
    tolerance: Array,
    most_steps: int,
    work: Workspace,
    search: Signals,
) -> tuple[float, float, int, int]:
    """Integrate ``y`` up to the first event or for ``left`` (s), the first step at most ``wanted`` (s).

    ``whole`` and ``light`` are the piece with the method of steps of any length, and with that of short ones.
    Return the time covered (s), the step to try next (s), the signal that ended it or `NOTHING`, and the steps taken.
    The last is -1 if the state is not finite, -2 after ``most_steps``.
    """
    done = 0.0
    for steps in range(most_steps):
        start_step(whole, t + done, y, work)
        read_signals(whole, t + done, y, search.start, search.start_rate)
        flight = max(shortest_flight(whole, search), SOON * wanted)
        h, trial, error = 0.0, min(wanted, left - done, BEYOND * flight), 0.0
        piece = light if trial < SHORT * wanted else whole
        if trial > SHORTEST_S:
            h, error = controlled_step(piece, t + done, y, trial, tolerance, work)
        tried = h
        if h == 0.0:
            h = min(trial, SHORTEST_S)
            take_step(piece, t + done, y, h, work)
            finish_step(piece, t + done, h, work)
        for i in range(len(y)):
            if not math.isfinite(work.end[i]):
                return done, wanted, NOTHING, -1
        read_signals(piece, t + done + h, work.end, search.end, search.end_rate)
        which, share = first_signal(piece, t + done, y, h, work, search)
        rest, ends = 0.0, which == NOTHING and left - (done + h) <= 1e-15 * left
        if not ends:
            following = following_step(piece, tried, error) if tried > 0.0 else 10.0 * SHORTEST_S
            if tried < trial or following > wanted:  # a step cut short by the end does not lower the next
                wanted = following
        if which != NOTHING:
            if share == 0.0:
                piece_rates(piece, t + done, y, search.rate)
                return done, wanted, which, steps
            h, rest = integrate_to_root(piece, t + done, y, h, share, which, work, search)
        add_step(piece, h, rest, y, work, search)
        done += h + rest
        forget_roots(search.at_root)
        if which != NOTHING:
            return min(done, left), wanted, which, steps
        if ends:
            return left, wanted, NOTHING, steps
    return done, wanted, NOTHING, -2
