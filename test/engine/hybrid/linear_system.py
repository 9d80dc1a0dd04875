# SPDX-License-Identifier: Apache-2.0
"""A linear system with any laws, declared to the one loop: masses, springs, dampers, stops, friction, belts."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from work_arrays import room_for

from mech_twin.engine.hybrid import laws
from mech_twin.engine.hybrid.laws import HOLD, OPEN
from mech_twin.engine.hybrid.loop import advance
from mech_twin.engine.hybrid.motion import find_accelerations
from mech_twin.engine.hybrid.type_erasure import declared
from mech_twin.kernels.kernel import kernel

NO_GAP = -1.0
STRUCK, CHANGED, PASSED = 0, 1, 2  # kinds of the rows in the log
TIME, KIND, LAW, BEFORE, AFTER, IMPULSE = range(6)


class Linear(NamedTuple):
    """M u' = load + load_rate t - K q - C u + sum w lam; laws: w, v0, gap at q = 0, bounds, e; a mark of q[0]."""

    mass: np.ndarray
    stiffness: np.ndarray
    damping: np.ndarray
    load: np.ndarray
    load_rate: np.ndarray
    directions: np.ndarray
    drift: np.ndarray
    gap: np.ndarray
    low: np.ndarray
    high: np.ndarray
    e: np.ndarray
    mark: float


@laws.declares(laws.evaluate, Linear)
def evaluate_linear(system, t, y, regimes, at):
    """Fill in masses, forces and laws."""
    n = len(system.load)
    for i in range(n):
        at.force[i] = system.load[i] + system.load_rate[i] * t
        for j in range(n):
            at.mass[i, j] = system.mass[i, j]
            at.force[i] -= system.stiffness[i, j] * y[j] + system.damping[i, j] * y[n + j]
    for i in range(len(system.gap)):
        at.drift[i], at.gap[i], at.low[i], at.high[i] = system.drift[i], system.gap[i], system.low[i], system.high[i]
        at.restitution[i] = system.e[i]
        for j in range(n):
            at.directions[i, j] = system.directions[i, j]
            at.gap[i] += system.directions[i, j] * y[j]


@laws.declares(laws.accumulate, Linear)
def accumulate_loss(system, t, y, regimes, at, out):
    """Fill in the power of the laws on the masses."""
    n = len(system.load)
    power = 0.0
    for i in range(len(system.gap)):
        power += at.multiplier[i] * (at.velocity[i] - at.drift[i])
    out[2 * n] = power


@laws.declares(laws.fill_signals, Linear)
def signal_mark(system, t, y, regimes, at, values, rates):
    """Fill in the way of the first coordinate to its mark, from below."""
    place = 2 * len(system.gap)
    values[place] = math.inf
    if regimes[len(system.gap)] == 0:
        values[place], rates[place] = system.mark - y[0], -y[len(system.load)]


@laws.declares(laws.begin_piece, Linear)
def begin_nothing(system, t, y, regimes):
    """Prepare nothing."""


@laws.declares(laws.end_piece, Linear)
def end_nothing(system, t, before, y, regimes):
    """Book nothing."""


@laws.declares(laws.pass_signal, Linear)
def pass_mark(system, which, t, y, regimes, log, count):
    """Log that the mark was passed, and stand on it."""
    log[count, TIME], log[count, KIND], log[count, LAW] = t, PASSED, which
    y[0], regimes[len(system.gap)] = system.mark, 1
    return count + 1


@laws.declares(laws.change_regimes, Linear)
def log_change(system, t, y, past, regimes, at, log, count):
    """Log each law that has changed."""
    for i in range(len(past)):
        if past[i] != regimes[i]:
            log[count, TIME], log[count, KIND], log[count, LAW] = t, CHANGED, i
            log[count, BEFORE], log[count, AFTER] = past[i], regimes[i]
            count += 1
    return count


@laws.declares(laws.note_impact, Linear)
def log_impact(system, t, before, y, at, log, count):
    """Log each impulse with the velocity of the first freedom on either side."""
    for i in range(len(system.gap)):
        if at.multiplier[i] != 0.0:
            log[count, TIME], log[count, KIND], log[count, LAW] = t, STRUCK, i
            log[count, BEFORE], log[count, AFTER] = before[len(system.load)], y[len(system.load)]
            log[count, IMPULSE] = at.multiplier[i]
            count += 1
    return count


@laws.of_size(2, 2)
class TwoByTwo(Linear):
    """A linear system of two freedoms and two laws, known as such to the compiler."""


FUNCTIONS = {
    laws.evaluate: evaluate_linear,
    laws.accumulate: accumulate_loss,
    laws.fill_signals: signal_mark,
    laws.begin_piece: begin_nothing,
    laws.end_piece: end_nothing,
    laws.pass_signal: pass_mark,
    laws.change_regimes: log_change,
    laws.note_impact: log_impact,
}
for generic, compiled in FUNCTIONS.items():
    laws.declares(generic, TwoByTwo)(getattr(compiled, "py_func", compiled))


def linear(mass, directions, **more):
    """Return a system of point masses (kg) with the laws of these directions; the rest is nothing unless told."""
    n, m = len(mass), len(directions)
    matrix = np.diag(np.array(mass, dtype=float)) if np.ndim(mass) == 1 else np.array(mass, dtype=float)
    parts = {
        "stiffness": np.zeros((n, n)), "damping": np.zeros((n, n)), "load": np.zeros(n), "load_rate": np.zeros(n),
        "drift": np.zeros(m), "gap": np.zeros(m), "low": np.zeros(m), "high": np.full(m, math.inf),
        "e": np.full(m, NO_GAP), "mark": math.inf,
    }  # fmt: skip
    for name, value in more.items():
        parts[name] = value if name == "mark" else np.array(value, dtype=float).reshape(parts[name].shape)
    return Linear(mass=matrix, directions=np.array(directions, dtype=float).reshape(m, n), **parts)


@kernel
def advance_linear(system, t, span, y, regimes, room, log):
    """Return the number of events of a step."""
    return advance(declared(system, room.at), t, span, y, regimes, room, log, 0)


@kernel
def accelerations_of(system, t, y, regimes, room):
    """Fill in accelerations and forces for given regimes."""
    find_accelerations(declared(system, room.at), t, y, regimes, room.at)


def run(system, q, u, regimes, span, steps=1, most_events=4000):
    """Return the state, the regimes and the rows of the log after so many steps of ``span`` (s) in all."""
    n, m = len(system.load), len(system.gap)
    y, state = np.concatenate([q, u, [0.0]]).astype(float), np.array([*regimes, 0], dtype=np.int64)
    rows = []
    for k in range(steps):
        room, log = room_for(n, m, 1, 2 * n + 1), np.zeros((most_events, 8))
        room.tolerance[:] = 1e-12
        count = advance_linear(system, k * span / steps, span / steps, y, state, room, log)
        assert count >= 0, f"failed with {count}"
        rows.append(log[:count].copy())
    return y, state[:m], np.concatenate(rows)


__all__ = ["CHANGED", "HOLD", "NO_GAP", "OPEN", "PASSED", "STRUCK", "TwoByTwo", "accelerations_of", "linear", "run"]
