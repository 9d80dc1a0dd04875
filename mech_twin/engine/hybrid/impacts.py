# SPDX-License-Identifier: Apache-2.0
r"""Impacts: the complementarity problem in velocities and impulses, for all contacts that close at one instant.

    u+ = u- + M^-1 sum_i w_i P_i,    v_i+ + e_i v_i- >= 0,    P_i >= 0,    P_i (v_i+ + e_i v_i-) = 0

for struck contacts (v_i- < 0), with e = 0 for those already closed (J. J. Moreau, with Newton's restitution).
Friction, gears and yielding walls have bounded forces and hence no impulse.
"""

from __future__ import annotations

import math

from mech_twin.engine.hybrid.complementarity import fill_mobilities, solve_holding, solve_laws
from mech_twin.engine.hybrid.laws import HOLD, OPEN, Array, Equations, Indices, only_freedom
from mech_twin.kernels.kernel import borrowing_kernel

STRUCK, CLOSED = 1, 2  # what an impact did to a law
CLOSED_M = 1e-12  # a gap up to this counts as closed


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
