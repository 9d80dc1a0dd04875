# SPDX-License-Identifier: Apache-2.0
"""Motion between two events: accelerations under the active laws, and the event functions (signals) that end it.

Signals of a law: open -> gap; holding -> distance of the force from either bound; sliding -> velocity.  The machine
adds its own.
"""

import math
from typing import Any, NamedTuple

from mech_twin.engine.addresses import value_at
from mech_twin.engine.hybrid.complementarity import (
    back_substitute,
    factorise,
    fill_mobilities,
    solve_holding,
    solve_laws,
)
from mech_twin.engine.hybrid.laws import (
    HIGH,
    HOLD,
    LOW,
    OPEN,
    Array,
    Equations,
    Indices,
    accumulate,
    evaluate,
    fill_signals,
    only_freedom,
    sized,
)
from mech_twin.engine.integration import rates_of
from mech_twin.kernels.dispatcher import generic
from mech_twin.kernels.kernel import borrowing_kernel, embedded_kernel

UNKNOWN = math.nan  # derivative of a signal, where it is not available


class Piece(NamedTuple):
    """A smooth piece of motion: constants of the system, regimes of its laws (and of the machine), work arrays."""

    system: Any
    regimes: Indices
    at: Equations


class PieceAt(NamedTuple):
    """Addresses of a piece and of its integration method, which are passed from call to call."""

    place: Any
    method: Any


@embedded_kernel
def fill_velocities(y: Array, at: Equations) -> None:
    """Fill the velocities of the laws."""
    n = len(at.force)
    for i in range(len(at.gap)):
        total = at.drift[i]
        for k in range(n):
            total += at.directions[i, k] * y[n + k]
        at.velocity[i] = total


@embedded_kernel
def prepare_instant(system: Any, t: float, y: Array, regimes: Indices, at: Equations) -> None:
    """Evaluate the equations, factorise the mass matrix, and fill the velocities of the laws."""
    evaluate(system, t, y, regimes, at)
    factorise(at.mass, at.factor)
    fill_velocities(y, at)


@embedded_kernel
def fill_law_accelerations(at: Equations) -> None:
    """Fill the accelerations of the laws."""
    for i in range(len(at.gap)):
        total = at.bias[i]
        for k in range(len(at.force)):
            total += at.directions[i, k] * at.acceleration[k]
        at.law_acceleration[i] = total


@embedded_kernel
def accelerate(at: Equations) -> None:
    """Fill accelerations of coordinates and laws under ``at.multiplier``; the mass matrix is factorised."""
    n, m = len(at.force), len(at.gap)
    for k in range(n):
        total = at.force[k]
        for i in range(m):
            if at.multiplier[i] != 0.0:
                total += at.directions[i, k] * at.multiplier[i]
        at.acceleration[k] = total
    back_substitute(at.factor, at.acceleration)
    fill_law_accelerations(at)


@embedded_kernel
def fill_free_accelerations(at: Equations) -> None:
    """Fill ``at.free`` with the accelerations of the laws without law forces; ``at.multiplier`` becomes zero."""
    for i in range(len(at.gap)):
        at.multiplier[i] = 0.0
    accelerate(at)
    for i in range(len(at.gap)):
        at.free[i] = at.law_acceleration[i]


@embedded_kernel
def hold_alone(regimes: Indices, at: Equations) -> bool:
    """Return whether each holding law acts on one freedom, that no other holds; ``at.holder`` is filled."""
    alone = True
    for k in range(len(at.force)):
        at.holder[k] = -1
    for i in range(len(at.gap)):
        if regimes[i] == HOLD:
            k = only_freedom(at, i)
            if k < 0 or at.holder[k] >= 0:
                alone = False
            else:
                at.holder[k] = i
    return alone


@embedded_kernel
def accelerate_rest(at: Equations) -> None:
    """Fill accelerations: each law in ``at.holder`` sets that of its freedom, the others follow from their own rows."""
    n, m = len(at.force), len(at.gap)
    for k in range(n):
        i = at.holder[k]
        at.acceleration[k] = -at.bias[i] / at.directions[i, k] if i >= 0 else 0.0
    for k in range(n):
        for j in range(k):
            joined = at.holder[k] < 0 and at.holder[j] < 0
            at.rest_factor[k, j] = at.mass[k, j] if joined else 0.0
        at.rest_factor[k, k] = at.mass[k, k] if at.holder[k] < 0 else 1.0
    factorise(at.rest_factor, at.rest_factor)
    for k in range(n):
        if at.holder[k] >= 0:
            continue
        total = at.force[k]
        for i in range(m):
            if at.multiplier[i] != 0.0:
                total += at.directions[i, k] * at.multiplier[i]
        for j in range(n):
            if at.holder[j] >= 0:
                total -= at.mass[k, j] * at.acceleration[j]
        at.acceleration[k] = total
    back_substitute(at.rest_factor, at.acceleration)


@embedded_kernel
def fill_holding_forces(at: Equations) -> None:
    """Fill the multipliers of the laws in ``at.holder`` from the row of the freedom that each holds."""
    n, m = len(at.force), len(at.gap)
    for k in range(n):
        law = at.holder[k]
        if law < 0:
            continue
        total = -at.force[k]
        for j in range(n):
            total += at.mass[k, j] * at.acceleration[j]
        for i in range(m):
            if at.multiplier[i] != 0.0 and i != law:
                total -= at.directions[i, k] * at.multiplier[i]
        at.multiplier[law] = total / at.directions[law, k]


@embedded_kernel
def find_accelerations(system: Any, t: float, y: Array, regimes: Indices, equations: Equations) -> None:
    """Fill accelerations and multipliers for given regimes: sliding laws are at a bound, holding ones are unknown."""
    at = sized(system, equations)
    evaluate(system, t, y, regimes, at)
    fill_velocities(y, at)
    m = len(at.gap)
    for i in range(m):
        at.multiplier[i] = at.low[i] if regimes[i] == LOW else at.high[i] if regimes[i] == HIGH else 0.0
    if hold_alone(regimes, at):
        accelerate_rest(at)
        fill_holding_forces(at)
        fill_law_accelerations(at)
        return
    factorise(at.mass, at.factor)
    for i in range(m):
        at.status[i], at.least[i], at.most[i] = regimes[i], at.low[i], at.high[i]
    fill_mobilities(at, False)
    fill_free_accelerations(at)
    for i in range(m):
        at.multiplier[i] = at.low[i] if regimes[i] == LOW else at.high[i] if regimes[i] == HIGH else 0.0
    solve_holding(at, at.multiplier)
    accelerate(at)
    for i in range(m):  # exact if the law acts on one freedom
        k = only_freedom(at, i) if regimes[i] == HOLD else -1
        if k >= 0:
            at.acceleration[k] = -at.bias[i] / at.directions[i, k]


@embedded_kernel
def motion_rates(system: Any, t: float, y: Array, regimes: Indices, at: Equations, out: Array) -> None:
    """Fill ``out`` with dy/dt: velocities, accelerations and the rates of the quadratures."""
    find_accelerations(system, t, y, regimes, at)
    n = len(at.force)
    for k in range(n):
        out[k], out[n + k] = y[n + k], at.acceleration[k]
    accumulate(system, t, y, regimes, at, out)


@generic(embedded_kernel)
def fill_rates(system: Any, t: float, y: Array, regimes: Indices, at: Equations, out: Array) -> None:
    """Fill ``out`` with `motion_rates`, unless the type of system declares another way to them."""
    motion_rates(system, t, y, regimes, at, out)


@borrowing_kernel
def settle_regimes(system: Any, t: float, y: Array, regimes: Indices, candidates: Indices, at: Equations) -> int:
    """Find the regimes of all laws at zero velocity by complementarity of force and acceleration.

    ``candidates`` (m,): 1 for a closed law of zero velocity; the others keep their regime.  Return `SOLVED`, or a
    negative number if the laws are inconsistent.
    """
    prepare_instant(system, t, y, regimes, at)
    m = len(at.gap)
    for i in range(m):
        at.status[i] = regimes[i] if candidates[i] == 1 else OPEN
    fill_mobilities(at, True)
    fill_free_accelerations(at)
    for i in range(m):  # the force of a sliding law is known
        if candidates[i] == 1:
            at.least[i], at.most[i] = at.low[i], max(at.low[i], at.high[i])  # where they meet, rounding crosses them
            continue
        slides = at.low[i] if regimes[i] == LOW else at.high[i] if regimes[i] == HIGH else 0.0
        at.least[i] = at.most[i] = slides
        if slides != 0.0:
            for j in range(m):
                at.free[j] += at.matrix[j, i] * slides
    answer = solve_laws(at, at.multiplier)
    for i in range(m):
        if candidates[i] == 1:
            regimes[i] = at.status[i]
        else:
            at.multiplier[i] = at.least[i]
    accelerate(at)
    return answer


def method_at(system: Any) -> Any:
    """Return the method of integration."""
    return value_at(system.method)


@rates_of(PieceAt, method_at)
def piece_rates(piece: PieceAt, t: float, y: Array, out: Array) -> None:
    """Fill ``out`` with dy/dt."""
    system, regimes, at = value_at(piece.place)
    fill_rates(system, t, y, regimes, at, out)


@borrowing_kernel
def read_signals(piece: PieceAt, t: float, y: Array, values: Array, rates: Array) -> None:
    """Fill signals and rates at the instant last evaluated by `piece_rates`: two for each law, then the machine's."""
    system, regimes, at = value_at(piece.place)
    for i in range(len(at.gap)):
        first, second = 2 * i, 2 * i + 1
        values[first], rates[first] = math.inf, UNKNOWN
        values[second], rates[second] = math.inf, UNKNOWN
        if regimes[i] == OPEN:
            values[first], rates[first] = at.gap[i], at.velocity[i]
        elif regimes[i] == HOLD:
            values[first], values[second] = at.multiplier[i] - at.low[i], at.high[i] - at.multiplier[i]
        else:
            sign = 1.0 if regimes[i] == LOW else -1.0
            values[first], rates[first] = sign * at.velocity[i], sign * at.law_acceleration[i]
    fill_signals(system, t, y, regimes, at, values, rates)
