# SPDX-License-Identifier: Apache-2.0
"""Where within a step of a motion something happens: signals, their roots, and the first event of several.

A signal is a smooth function of the state that crosses zero at the instant of its event; a machine declares the value
and, where it has one, the time derivative of each of its signals with `signals_of`.  A root is followed by integrating
from the start of the step to the time asked for (no interpolant), so it is as exact as the motion itself.

Three things are handled here once:

* A signal that dips through zero and back within the step has an extreme there: the sign of its derivative at both ends
  shows it (without a derivative, the parabola through three points), the extreme is followed and its sign taken.
  The middle point of the parabola is estimated from the states and rates at both ends, which costs one evaluation of
  the rates and not a whole step; only where that parabola comes near zero is the motion followed to the middle.
* A signal that starts the step at its root (a body that leaves its collar, a striker that has just given its blow) is
  divided by the time since the start, which takes that root out and leaves the next.
* Of several events the first in time ends the step; of equal times the one that is watched first.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numba.extending import overload
from numpy.typing import NDArray

from mech_twin.engine.integration import Array, Function, Workspace, declared_kernel, rates, take_step
from mech_twin.kernels.kernel import borrowing_kernel, kernel

FALLING, RISING = -1, 1  # direction of a crossing
NONE = -1
UNKNOWN = math.nan  # the derivative of a signal that has none to offer
_ROUNDS = 200
_NEAR_ZERO = 0.25  # of the lesser end value; the estimated middle misses some 1e-8 of it in a step as they are taken


class Watch(NamedTuple):
    """What is watched over a step: the signal, the direction of its crossing, whether it starts at its root."""

    signal: int
    direction: int
    starts_at_root: bool


class Step(NamedTuple):
    """A step under examination: system, start (s), state and length (s); ``work`` holds the rates at the start."""

    system: Any
    start_s: float
    state: Array
    span_s: float
    work: Workspace


def signal(system: Any, index: int, t: float, y: Array) -> tuple[float, float]:
    """Return value and time derivative (`UNKNOWN` if there is none) of a signal; compiled: the function of its type."""
    return _declared[type(system)](system, index, t, y)  # type: ignore[no-any-return]


_declared: dict[type, Callable[..., Any]] = {}


def signals_of(system_type: type) -> Callable[[Function], Function]:
    """Declare ``f(system, index, t, y)``, which returns value and derivative, as the signals of a type of system."""

    def declare(function: Function) -> Function:
        compiled = _declared[system_type] = declared_kernel(system_type, function)

        def call(system: Any, index: Any, t: Any, y: Any) -> Any:
            return compiled(system, index, t, y)

        @overload(signal)
        def chosen(system: Any, index: Any, t: Any, y: Any) -> Any:  # numba asks with types
            return call if getattr(system, "instance_class", None) is system_type else None

        return compiled

    return declare


@borrowing_kernel
def signal_at(step: Step, watch: Watch, span: float) -> tuple[float, float]:
    """Return signal and derivative a span (s) into the step, positive before the event; fills ``work.end``."""
    take_step(step.system, step.start_s, step.state, span, step.work)
    value, rate = signal(step.system, watch.signal, step.start_s + span, step.work.end)
    return -watch.direction * value, -watch.direction * rate


@borrowing_kernel
def sought(step: Step, watch: Watch, span: float, shift: float, of_rate: bool) -> float:
    """Return what shall be zero: the derivative, the signal, or the signal less its start divided by the span."""
    value, rate = signal_at(step, watch, span)
    if of_rate:
        return rate
    return (value - shift) / span if watch.starts_at_root else value


@borrowing_kernel
def root_between(
    step: Step, watch: Watch, low_value: float, high: float, high_value: float, shift: float, of_rate: bool
) -> float:
    """Return the span (s) of a root between the start of the step and ``high``, the values there of opposite sign.

    Secant with halved memory (Illinois), bisection each fourth round; the bracket shrinks to neighbouring numbers and
    its far end is returned, where the event has happened.
    """
    low, side = 0.0, 0
    for turn in range(_ROUNDS):
        width = high - low
        if width <= 4e-16 * high or high_value == 0.0:
            break
        middle = high - high_value * width / (high_value - low_value)
        if turn % 4 == 3 or not low < middle < high:
            middle = 0.5 * (low + high)
        if middle in (low, high):
            break
        value = sought(step, watch, middle, shift, of_rate)
        if (value > 0.0) == (high_value > 0.0):
            high, high_value = middle, value
            if side == 1:
                low_value *= 0.5
            side = 1
        else:
            low, low_value = middle, value
            if side == -1:
                high_value *= 0.5
            side = -1
            if value == 0.0:
                return low
    return high


@kernel
def lowest_of_parabola(first: float, middle: float, last: float) -> tuple[float, float]:
    """Return the share of the step at which the parabola through start, middle and end is lowest, and its value there.

    The share is -1 and the value that of the lower end if the parabola has no lowest point within.
    """
    curve = first - 2.0 * middle + last
    share = 0.5 - 0.25 * (last - first) / curve if curve > 0.0 else -1.0
    if not 0.0 < share < 1.0:
        return -1.0, min(first, last)
    return share, first + share * (last - first - 2.0 * curve * (1.0 - share))


@borrowing_kernel
def estimated_middle(step: Step, watch: Watch, end: Array) -> float:
    """Return a signal in the middle of the step, the state there from states and rates at both ends (cubic)."""
    work, state, half = step.work, step.work.stage, 0.5 * step.span_s
    rates(step.system, step.start_s + step.span_s, end, work.rates[1])
    for i in range(len(state)):
        state[i] = 0.5 * (step.state[i] + end[i]) + 0.25 * half * (work.rates[0, i] - work.rates[1, i])
    value, _ = signal(step.system, watch.signal, step.start_s + half, state)
    return -watch.direction * value


@borrowing_kernel
def lowest_span(step: Step, watch: Watch, start: tuple[float, float], final: tuple[float, float], end: Array) -> float:
    """Return the span at which a signal that is positive at both ends is lowest within the step, or -1.

    Without a derivative -1 also where it is lowest far from zero.
    """
    value, rate = start
    last, last_rate = final
    if not math.isnan(rate):
        if not rate < 0.0 < last_rate:
            return -1.0
        return root_between(step, watch, rate, step.span_s, last_rate, 0.0, True)
    _, lowest = lowest_of_parabola(value, estimated_middle(step, watch, end), last)
    if lowest > _NEAR_ZERO * min(value, last):
        return -1.0
    middle, _ = signal_at(step, watch, 0.5 * step.span_s)
    share, _ = lowest_of_parabola(value, middle, last)
    return share * step.span_s


@borrowing_kernel
def crossing(step: Step, watch: Watch, end: Array) -> float:
    """Return the span (s) at which a signal first crosses zero its way within the step, or -1.

    ``end`` is the state at the end of the step.

    A signal already beyond zero at the start, and moving further if it tells its derivative, has its event at once, at
    span 0.
    """
    value, rate = signal(step.system, watch.signal, step.start_s, step.state)
    value, rate = -watch.direction * value, -watch.direction * rate
    last, last_rate = signal(step.system, watch.signal, step.start_s + step.span_s, end)
    last, last_rate = -watch.direction * last, -watch.direction * last_rate
    shift = 0.0
    if watch.starts_at_root:
        shift = value
        if rate < 0.0:
            return 0.0
        value, last = (rate if rate > 0.0 else 1e-300), (last - shift) / step.span_s
    elif value <= 0.0:
        beyond = value < 0.0 or last < 0.0 if math.isnan(rate) else rate == 0.0 and last < value
        return 0.0 if rate < 0.0 or beyond else -1.0
    span = step.span_s
    if last > 0.0:
        if watch.starts_at_root:
            return -1.0
        span = lowest_span(step, watch, (value, rate), (last, last_rate), end)
        if span < 0.0:
            return -1.0
        last, _ = signal_at(step, watch, span)
        if last > 0.0:
            return -1.0
    return root_between(step, watch, value, span, last, shift, False)


@borrowing_kernel
def first_event(step: Step, watches: NDArray[np.int64], count: int, end: Array) -> tuple[int, float]:
    """Return which of the first ``count`` watches sees its event first, and the span (s); (`NONE`, span) for none.

    ``watches`` (m, 3) has the fields of `Watch` in its rows; ``end`` is the state at the end of the step, in an array
    of its own, since ``work.end`` is written on.
    """
    which, when = NONE, step.span_s
    for i in range(count):
        watch = Watch(watches[i, 0], watches[i, 1], watches[i, 2] != 0)
        found = crossing(step, watch, end)
        if found >= 0.0 and (found < when or which == NONE):
            which, when = i, found
    return which, when
