# SPDX-License-Identifier: Apache-2.0
"""Where within a step of a motion its first signal crosses zero.

Signals are sought on the dense output of the step taken, and the first is polished by integrating from the start of the
step.  A signal that dips below zero within the step is found by its derivative.  One that starts at its root (a body
that has just left its stop) is divided by the time.

Source: E. Hairer, S. Norsett, G. Wanner, Solving Ordinary Differential Equations I, 2nd ed., Springer 1993, II.6.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from mech_twin.engine.hybrid.laws import Array
from mech_twin.engine.hybrid.motion import UNKNOWN, PieceAt, piece_rates, read_signals
from mech_twin.engine.integration import (
    SHORTEST_S,
    Workspace,
    controlled_step,
    finish_step,
    interpolate,
    method_of,
    prepare_dense_output,
    start_step,
    take_step,
)
from mech_twin.kernels.kernel import borrowing_kernel, inline_kernel

NOTHING = -1


class Signals(NamedTuple):
    """Room for the signals of a step: at its start, its end, at another instant; (s,) each; the state y (n,)."""

    start: Array
    start_rate: Array
    end: Array
    end_rate: Array
    now: Array
    now_rate: Array
    middle: Array
    at_root: Array  # 1 where the signal starts the piece at its root
    state: Array
    rate: Array
    lost: Array  # (2 n,) what rounding took from coordinates and velocities


@borrowing_kernel
def dense_signal(
    piece: PieceAt, t: float, y: Array, h: float, share: float, which: int, work: Workspace, search: Signals
) -> tuple[float, float]:
    """Return a signal and its derivative at a share of the step taken, from the dense output."""
    interpolate(piece, y, h, share, work, search.state)
    piece_rates(piece, t + share * h, search.state, search.rate)
    read_signals(piece, t + share * h, search.state, search.now, search.now_rate)
    return search.now[which], search.now_rate[which]


@inline_kernel
def divided(value: float, shift: float, span: float, at_root: bool) -> float:
    """Return a signal, or what is left of it when the root it starts from is divided out."""
    return (value - shift) / span if at_root else value


@inline_kernel
def lowest_share(first: float, rate: float, last: float, last_rate: float, h: float) -> tuple[float, float]:
    """Return the share of the step at which the cubic through both ends and rates is lowest, and its value there."""
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
    """Fill the signals in the middle of the step, the state there from states and rates at both ends (cubic)."""
    last = len(method_of(piece).weights)
    for i in range(len(y)):
        search.state[i] = 0.5 * (y[i] + end[i]) + 0.125 * h * (work.rates[0, i] - work.rates[last, i])
    piece_rates(piece, t + 0.5 * h, search.state, search.rate)
    read_signals(piece, t + 0.5 * h, search.state, search.middle, search.now_rate)


@inline_kernel
def may_dip(search: Signals, which: int, h: float) -> bool:
    """Tell whether a signal that is positive at both ends of the step comes near zero in between."""
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
    """Return a share of the step at which a signal that is positive at both ends is not positive, or -1."""
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
    """Return the share of the step of the first root before ``high``, by the dense output (Illinois)."""
    at_root, shift = search.at_root[which] == 1.0, search.start[which]
    rate = search.start_rate[which]
    low, side = 0.0, 0
    low_value = search.start[which]
    if at_root:
        low_value = rate if rate > 0.0 else 1e-300
    value = search.end[which] if high == 1.0 else dense_signal(piece, t, y, h, high, which, work, search)[0]
    high_value = divided(value, shift, high * h, at_root)
    for turn in range(80):
        width = high - low
        if width <= 1e-13 or high_value == 0.0:
            break
        middle = high - high_value * width / (high_value - low_value)
        if turn % 4 == 3 or not low < middle < high:
            middle = 0.5 * (low + high)
        value, _ = dense_signal(piece, t, y, h, middle, which, work, search)
        value = divided(value, shift, middle * h, at_root)
        if value <= 0.0:
            high, high_value = middle, value
            if side == 1:
                low_value *= 0.5
            side = 1
        else:
            low, low_value = middle, value
            if side == -1:
                high_value *= 0.5
            side = -1
    return high


@inline_kernel
def is_beyond(first: float, rate: float, last: float, at_root: bool) -> bool:
    """Tell whether a signal has its event at the start of the step, from its values at both ends and its rate."""
    if at_root:  # a rate of rounding is none: what begins at its root has been found to leave it
        return bool(rate < 0.0 and last < 0.0)
    if first < 0.0:  # by rounding, where it becomes positive by itself: a gap that opens as friction lets go
        return not (rate >= 0.0 and last > 0.0)
    return bool(first == 0.0 and (rate < 0.0 or last < 0.0))


@inline_kernel
def mark_roots(search: Signals) -> None:
    """Mark signals that come from their root, to which they may fall back within the step."""
    for which in range(len(search.start)):
        if search.start[which] == 0.0 and search.start_rate[which] > 0.0:
            search.at_root[which] = 1.0


@borrowing_kernel
def first_signal(piece: PieceAt, t: float, y: Array, h: float, work: Workspace, search: Signals) -> tuple[int, float]:
    """Return the signal that crosses first within the step taken, and the share of the step; `NOTHING` for none."""
    found, share, dense, middle = NOTHING, 1.0, False, False
    mark_roots(search)
    for which in range(len(search.start)):
        first, last = search.start[which], search.end[which]
        rate = search.start_rate[which]
        if first == math.inf:
            continue
        at_root = search.at_root[which] == 1.0
        if is_beyond(first, rate, last, at_root):
            return which, 0.0
        if (first <= 0.0 and not at_root) or (at_root and rate == 0.0 and last == first):
            continue  # a gap that other laws keep as it is stays open
        high = 1.0
        if divided(last, first, h, at_root) > 0.0:
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
def land_on(
    piece: PieceAt, t: float, y: Array, h: float, share: float, which: int, work: Workspace, search: Signals
) -> float:
    """Integrate to the root of a signal: return the length of the step that ends there, its state in ``work.end``."""
    span, slope = share * h, UNKNOWN
    if math.isnan(search.start_rate[which]):
        step = 1e-3
        low = max(share - step, 0.0)
        a = dense_signal(piece, t, y, h, low, which, work, search)[0]
        b = dense_signal(piece, t, y, h, share, which, work, search)[0]
        slope = (b - a) / ((share - low) * h) if share > low else UNKNOWN
    for turn in range(3):
        take_step(piece, t, y, span, work)
        finish_step(piece, t, span, work)
        if turn == 2:
            break
        read_signals(piece, t + span, work.end, search.now, search.now_rate)
        value, rate = search.now[which], search.now_rate[which]
        rate = slope if math.isnan(rate) else rate
        better = span - value / rate if rate < 0.0 else span
        if not 0.0 < better <= h or better == span:
            break
        span = better
    return span


@borrowing_kernel
def carry_on(piece: PieceAt, h: float, y: Array, work: Workspace, search: Signals) -> None:
    """Give ``y`` the state at the end of the step; coordinates and velocities keep what rounding took before."""
    weights = method_of(piece).weights
    for i in range(len(search.lost)):
        change = 0.0
        for stage in range(len(weights)):
            change += weights[stage] * work.rates[stage, i]
        change = h * change + search.lost[i]
        after = y[i] + change
        search.lost[i] = change - (after - y[i])
        y[i] = after
    for i in range(len(search.lost), len(y)):
        y[i] = work.end[i]


@borrowing_kernel
def advance_piece(
    piece: PieceAt,
    t: float,
    y: Array,
    left: float,
    wanted: float,
    tolerance: Array,
    most_steps: int,
    work: Workspace,
    search: Signals,
) -> tuple[float, float, int, int]:
    """Advance ``y`` by a smooth piece of at most ``left`` (s), the first step of at most ``wanted`` (s).

    Return its length, the step to try next, its signal, and the steps it took: -1 where none is short enough, -2 where
    there are too many.
    """
    done = 0.0
    for steps in range(most_steps):
        start_step(piece, t + done, y, work)
        read_signals(piece, t + done, y, search.start, search.start_rate)
        h, trial = 0.0, min(wanted, left - done)
        following = trial
        if trial > SHORTEST_S:
            h, following = controlled_step(piece, t + done, y, trial, tolerance, work)
        if h == 0.0:
            h, following = min(trial, SHORTEST_S), 10.0 * SHORTEST_S
            take_step(piece, t + done, y, h, work)
            finish_step(piece, t + done, h, work)
        if h < trial or following > wanted:  # a step that the end of the time cut short tells nothing
            wanted = following
        for i in range(len(y)):
            if not math.isfinite(work.end[i]):
                return done, wanted, NOTHING, -1
        read_signals(piece, t + done + h, work.end, search.end, search.end_rate)
        which, share = first_signal(piece, t + done, y, h, work, search)
        if which != NOTHING:
            if share == 0.0:
                piece_rates(piece, t + done, y, search.rate)
                return done, wanted, which, steps
            h = land_on(piece, t + done, y, h, share, which, work, search)
        carry_on(piece, h, y, work, search)
        done += h
        if which != NOTHING:
            return min(done, left), wanted, which, steps
        for i in range(len(search.at_root)):
            search.at_root[i] = 0.0
        if left - done <= 1e-15 * left:
            return left, wanted, NOTHING, steps
    return done, wanted, NOTHING, -2
