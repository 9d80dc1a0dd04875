# SPDX-License-Identifier: Apache-2.0
"""Sticking, sliding or separation of each law: a linear complementarity problem with lower and upper bounds.

    a = A lam + c,   low <= lam <= high:    lam = low => a >= 0,   lam = high => a <= 0,   between => a = 0

A = W M^-1 W' is positive definite where the active directions are independent.  Then the solution is unique, and
principal pivoting by least index (K. G. Murty, Linear Complementarity, Linear and Nonlinear Programming, 1988,
chapter 4) terminates.  Where they are dependent (two stops on one body) the laws declared first carry the force, and
the others take the admissible force nearest to zero.  Where they turn apart (friction under two feet of a body)
pivoting may go round: then each law yields a little by itself, `YIELDING`, which makes A definite.  Inconsistent laws
without bounds give `CONTRADICTION`.

Impacts are the same problem in velocities and impulses, for all contacts that close at one instant.

    u+ = u- + M^-1 sum_i w_i P_i,    v_i+ + e_i v_i- >= 0,    P_i >= 0,    P_i (v_i+ + e_i v_i-) = 0

for struck contacts (v_i- < 0), with e = 0 for those already closed (J. J. Moreau, with Newton's restitution).
Friction, gears and yielding walls have bounded forces and hence no impulse.
"""

import math

from mech_twin.engine.hybrid.laws import HIGH, HOLD, LOW, OPEN, Array, Equations, Indices, only_freedom
from mech_twin.kernels.kernel import borrowing_kernel, embedded_kernel

SOLVED, CONTRADICTION = 0, -1
DEPENDENT = 1e-11  # relative pivot below which a law counts as linearly dependent on earlier holding ones
SAME = 1e-14  # relative pivot below which a law moves with the holding ones alone, but for rounding
NEAR = 1e-11  # relative to the terms summed: a smaller acceleration or force is rounding
YIELDING = 1e-10  # of its mobility: what a law yields by itself, where pivoting does not end
STRUCK, CLOSED = 1, 2  # what an impact did to a law
CLOSED_M = 1e-12  # a gap up to this counts as closed


@embedded_kernel
def factorise(matrix: Array, factor: Array) -> None:
    """Fill the LDL' factorisation of a symmetric positive definite matrix (n, n), with 1 / D on the diagonal."""
    for i in range(len(matrix)):
        for j in range(i):  # of this row the products L D
            total = matrix[i, j]
            for k in range(j):
                total -= factor[i, k] * factor[j, k]
            factor[i, j] = total
        total = matrix[i, i]
        for k in range(i):
            share = factor[i, k] * factor[k, k]
            total -= factor[i, k] * share
            factor[i, k] = share
        factor[i, i] = 1.0 / total


@embedded_kernel
def back_substitute(factor: Array, vector: Array) -> None:
    """Solve a linear system in place with a factor of `factorise`."""
    n = len(vector)
    for i in range(n):
        total = vector[i]
        for k in range(i):
            total -= factor[i, k] * vector[k]
        vector[i] = total
    for i in range(n - 1, -1, -1):
        total = vector[i] * factor[i, i]
        for k in range(i + 1, n):
            total -= factor[k, i] * vector[k]
        vector[i] = total


@embedded_kernel
def fill_mobilities(at: Equations, all_laws: bool) -> None:
    """Fill M^-1 w and W M^-1 W' (``at.matrix``) of the laws that are not `OPEN` in ``at.status``, or of all."""
    m, n = at.directions.shape
    for i in range(m):
        if at.status[i] == OPEN and not all_laws:
            continue
        for k in range(n):
            at.mobility[i, k] = at.directions[i, k]
        back_substitute(at.factor, at.mobility[i])
        for j in range(i + 1):
            if at.status[j] != OPEN or all_laws:
                total = 0.0
                for k in range(n):
                    total += at.directions[j, k] * at.mobility[i, k]
                at.matrix[i, j] = at.matrix[j, i] = total


@embedded_kernel
def nearest_to_zero(low: float, high: float) -> float:
    """Return the number between the bounds that is nearest to zero."""
    return min(max(0.0, low), high)


@embedded_kernel
def holds_by_itself(at: Equations, law: int) -> bool:
    """Return whether a law holds and is linearly independent of the holding laws before it."""
    return bool(at.status[law] == HOLD and at.hold_factor[law, law] != 0.0)


@embedded_kernel
def factor_holding(at: Equations, force: Array) -> None:
    """Fill the Cholesky factor of ``at.matrix`` over the holding laws, and the force of dependent ones (zero pivot)."""
    factor = at.hold_factor
    for i in range(len(force)):
        factor[i, i] = 0.0
        if at.status[i] != HOLD:
            continue
        for j in range(i):
            factor[i, j] = 0.0
            if holds_by_itself(at, j):
                total = at.matrix[i, j]
                for k in range(j):
                    total -= factor[i, k] * factor[j, k]
                factor[i, j] = total / factor[j, j]
        rest = at.matrix[i, i]
        for k in range(i):
            rest -= factor[i, k] * factor[i, k]
        if rest > DEPENDENT * at.matrix[i, i]:
            factor[i, i] = rest**0.5
        else:
            force[i] = nearest_to_zero(at.least[i], at.most[i])


@borrowing_kernel
def is_held_by_others(at: Equations, regimes: Indices, law: int, room: Array) -> bool:
    """Return whether the holding laws allow no motion of another law; the mass matrix is factorised, ``room`` is (m,).

    So it is with friction under two feet of a body: where one holds, the other one does not move either.
    """
    m, factor = len(room), at.hold_factor
    for i in range(m):
        at.status[i], at.least[i], at.most[i] = HOLD if regimes[i] == HOLD else OPEN, 0.0, 0.0
    fill_mobilities(at, True)
    factor_holding(at, room)
    rest = at.matrix[law, law]
    for j in range(m):
        room[j] = 0.0
        if holds_by_itself(at, j):
            total = at.matrix[law, j]
            for k in range(j):
                total -= room[k] * factor[j, k]
            room[j] = total / factor[j, j]
            rest -= room[j] * room[j]
    return bool(at.matrix[law, law] > 0.0 and rest <= SAME * at.matrix[law, law])


@embedded_kernel
def solve_holding(at: Equations, force: Array) -> None:
    """Fill the forces for zero acceleration of the holding laws (``at.status``), given the forces at bounds.

    A law linearly dependent on those before it takes the admissible force nearest to zero.
    """
    m, factor = len(force), at.hold_factor
    factor_holding(at, force)
    for i in range(m):
        if not holds_by_itself(at, i):
            continue
        total = -at.free[i]
        for j in range(m):
            if holds_by_itself(at, j):
                total -= factor[i, j] * force[j] if j < i else 0.0
            elif at.status[j] != OPEN:
                total -= at.matrix[i, j] * force[j]
        force[i] = total / factor[i, i]
    for i in range(m - 1, -1, -1):
        if holds_by_itself(at, i):
            for k in range(i + 1, m):
                if holds_by_itself(at, k):
                    force[i] -= factor[k, i] * force[k]
            force[i] /= factor[i, i]


@embedded_kernel
def acceleration_of(at: Equations, force: Array, law: int) -> tuple[float, float]:
    """Return the acceleration of a law under the forces, and the sum of the magnitudes of its terms (for rounding)."""
    total, size = at.free[law], abs(at.free[law])
    for j in range(len(force)):
        if at.status[j] != OPEN:
            term = at.matrix[law, j] * force[j]
            total, size = total + term, size + abs(term)
    return total, size


@borrowing_kernel
def largest_terms(at: Equations, force: Array) -> float:
    """Return the largest sum of magnitudes in the acceleration of a law: a force is found from all of them."""
    largest = 0.0
    for i in range(len(force)):
        if at.status[i] != OPEN:
            largest = max(largest, acceleration_of(at, force, i)[1])
    return largest


@embedded_kernel
def better_status(at: Equations, force: Array, law: int, terms: float) -> int:
    """Return the status a law changes to if it violates complementarity, else its present one.

    An acceleration is rounding, too, below `NEAR` times ``terms``.
    """
    better = int(at.status[law])
    if holds_by_itself(at, law):
        rounding = NEAR * terms / at.matrix[law, law]
        if force[law] < at.least[law] - NEAR * (abs(force[law]) + abs(at.least[law])) - rounding:
            better = LOW
        elif force[law] > at.most[law] + NEAR * (abs(force[law]) + abs(at.most[law])) + rounding:
            better = HIGH
        return better
    a, size = acceleration_of(at, force, law)
    size = max(size, terms)
    if better == HOLD and abs(a) > NEAR * size:
        better = LOW if a > 0.0 else HIGH
    elif (better == LOW and a < -NEAR * size) or (better == HIGH and a > NEAR * size):
        better = HOLD
    return better


@embedded_kernel
def earlier_law(at: Equations, law: int) -> int:
    """Return the first earlier holding law that is coupled and may reach its lower bound, -1 for none."""
    for j in range(law):
        if at.status[j] == HOLD and abs(at.least[j]) < math.inf and at.matrix[law, j] != 0.0:
            return j
    return -1


@embedded_kernel
def let_yield(at: Equations) -> None:
    """Let each law yield by itself, by `YIELDING` of its mobility."""
    for i in range(len(at.matrix)):
        at.matrix[i, i] *= 1.0 + YIELDING


@borrowing_kernel
def solve_laws(at: Equations, force: Array) -> int:
    """Solve for forces and status of the laws that are not `OPEN`; return `SOLVED` or `CONTRADICTION`.

    Parameters
    ----------
    at : Equations
        ``matrix``, ``free``, ``least`` and ``most`` are input.  ``status`` is the initial guess and the result:
        `HOLD`, `LOW` or `HIGH` (at that bound), `OPEN` where the law is left out.
    force : (m,) array
        Filled with the forces of the laws.
    """
    m, turns = len(force), 50 + 50 * len(force)
    for turn in range(2 * turns):
        for i in range(m):
            if at.status[i] == LOW:
                force[i] = at.least[i]
            elif at.status[i] == HIGH:
                force[i] = at.most[i]
            else:
                force[i] = 0.0
        solve_holding(at, force)
        terms = 0.0 if turn < turns else largest_terms(at, force)  # pivoting ends but for rounding
        if turn == turns:
            let_yield(at)
        wrong = -1
        for i in range(m):
            if at.status[i] == OPEN:
                continue
            better = better_status(at, force, i, terms)
            if better != at.status[i]:
                bound = at.least[i] if better == LOW else at.most[i]
                wrong = i
                if better != HOLD and abs(bound) == math.inf:
                    wrong, better = earlier_law(at, i), LOW
                    if wrong < 0:
                        return CONTRADICTION
                at.status[wrong] = better
                break
        if wrong < 0:
            return SOLVED
    return CONTRADICTION


@borrowing_kernel
def add_impulses(at: Equations, y: Array, impulse: Array) -> None:
    """Add the velocity changes M^-1 W' P of impulses P (m,) to the state, and update the velocities of the laws."""
    m, n = at.mobility.shape
    for i in range(m):
        if impulse[i] != 0.0:
            for k in range(n):
                y[n + k] += at.mobility[i, k] * impulse[i]
    for i in range(m):
        total = at.drift[i]
        for k in range(n):
            total += at.directions[i, k] * y[n + k]
        at.velocity[i] = total


@borrowing_kernel
def seek_impulses(regimes: Indices, at: Equations, struck: Indices, rebounds: float) -> int:
    """Solve for the impulses (``at.multiplier``) of all closing contacts; ``rebounds`` scales their restitution.

    ``struck`` (m,) is filled: `STRUCK` for a contact with an impact, `CLOSED` for one closed before, else 0.
    """
    m = len(at.gap)
    for i in range(m):
        e, struck[i], at.status[i] = at.restitution[i], 0, OPEN
        at.free[i], at.least[i], at.most[i] = at.velocity[i], 0.0, math.inf
        if e < 0.0:
            continue
        if regimes[i] == OPEN and at.gap[i] <= CLOSED_M and at.velocity[i] < 0.0:
            struck[i], at.status[i], at.free[i] = STRUCK, HOLD, (1.0 + rebounds * e) * at.velocity[i]
        elif regimes[i] == HOLD:
            struck[i], at.status[i] = CLOSED, HOLD
    fill_mobilities(at, True)
    answer = solve_laws(at, at.multiplier)
    for i in range(m):
        if struck[i] == 0:
            at.multiplier[i] = 0.0
    return answer


@borrowing_kernel
def strike(y: Array, regimes: Indices, at: Equations, struck: Indices) -> int:
    """Apply the impacts of all closing contacts to the velocities; ``at`` is prepared, ``struck`` is filled."""
    answer = seek_impulses(regimes, at, struck, 1.0)
    add_impulses(at, y, at.multiplier)
    return answer


@borrowing_kernel
def halt(y: Array, regimes: Indices, at: Equations, halted: Indices, room: Array) -> None:
    """Stop marked and holding laws by impulses, which are filled in ``room``; ``at`` is prepared."""
    for i in range(len(at.gap)):
        at.status[i] = HOLD if halted[i] == 1 or regimes[i] == HOLD else OPEN
        at.free[i], at.least[i], at.most[i] = at.velocity[i], -math.inf, math.inf
        room[i] = 0.0
    fill_mobilities(at, True)
    solve_holding(at, room)
    add_impulses(at, y, room)
    for i in range(len(at.gap)):  # exact if the law acts on one freedom
        k = only_freedom(at, i) if at.status[i] == HOLD else -1
        if k >= 0:
            y[len(at.force) + k], at.velocity[i] = -at.drift[i] / at.directions[i, k], 0.0
