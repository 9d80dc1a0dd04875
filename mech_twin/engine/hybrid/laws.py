# SPDX-License-Identifier: Apache-2.0
r"""What a hybrid mechanical system declares, and the law that its contacts, frictions and stops share.

Coordinates q (n,), velocities u (n,), quadratures (k,) stand one after the other in the state y::

    M(q) u' = h(t, q, u) + sum_i w_i(q) lam_i,    v_i = w_i . u + v0_i(t),    a_i = w_i . u' + b_i(q, u)

    v_i > 0: lam_i = low_i        v_i < 0: lam_i = high_i        v_i = 0: low_i <= lam_i <= high_i, a_i complementary
    with a gap g_i(q):  g_i > 0: the law is open, lam_i = 0

============================================  ====================  ===========================
what it stands for                            w                     [low, high]
============================================  ====================  ===========================
stop, body on its collar, striker on a tool   normal of the gap     [0, inf), restitution e
Coulomb friction                              the joint             [-c, c]
gear with loss eta about the moment i M       the geared shaft      i M [eta, 1/eta] less mean
wall that gives way and never comes back      travel of the tool    [-F, 0]
brake, one-way clutch                         the joint             [-T, T], [0, inf)
============================================  ====================  ===========================

Laws along one direction are declared as one: their bounds add up.  A machine declares, with `declares`, the functions
below for the type of its constants; the loop (`loop.advance`) does the rest.  What a machine keeps from piece to piece
is an array among those constants.

Sources: F. Pfeiffer, C. Glocker, Multibody Dynamics with Unilateral Contacts, Wiley 1996, chapters 4 to 8;
J. J. Moreau, Unilateral contact and dry friction in finite freedom dynamics, CISM 302, Springer 1988.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple, TypeVar

import numpy as np
from numba.extending import overload
from numpy.typing import NDArray

from mech_twin.engine.compiled_steps import chosen, is_declared, step_of
from mech_twin.kernels.kernel import borrowing_kernel, embedded_kernel

Array = NDArray[np.float64]
Indices = NDArray[np.int64]
Function = TypeVar("Function", bound=Callable[..., Any])

# regime of a law: open; sliding with v > 0 (force at its low bound), with v < 0 (at its high bound); holding, v = 0
OPEN, LOW, HIGH, HOLD = 0, 1, 2, 3


class Equations(NamedTuple):
    """The equations of a system at one instant; the fields from ``factor`` on are room to compute in.

    There are n freedoms and m laws.  Filled by `evaluate`: ``mass`` (n, n), and ``force`` (n,) of all but the laws.
    Of each law it fills ``directions`` (m, n), ``drift`` (m,) v0, ``bias`` (m,) b, ``gap``, ``low`` and ``high`` (m,);
    ``restitution`` (m,) of a law with a gap, less than 0 (as it begins) for a law without one.
    Found by the loop: ``acceleration`` (n,), ``multiplier``, ``velocity`` and ``law_acceleration`` (m,).
    """

    mass: Array
    force: Array
    directions: Array
    drift: Array
    bias: Array
    gap: Array
    low: Array
    high: Array
    restitution: Array
    acceleration: Array
    multiplier: Array
    velocity: Array
    law_acceleration: Array
    factor: Array  # (n, n) Cholesky factor of the mass
    mobility: Array  # (m, n) M^-1 w
    matrix: Array  # (m, m) w . M^-1 w
    free: Array  # (m,) accelerations, or velocities, without the forces that are sought
    least: Array  # (m,) bounds of the forces or impulses sought
    most: Array
    hold_factor: Array  # (m, m)
    status: Indices  # (m,)


@borrowing_kernel
def only_freedom(at: Equations, law: int) -> int:
    """Return the one freedom that a law acts on, -1 where there are several."""
    found = -1
    for k in range(len(at.force)):
        if at.directions[law, k] != 0.0:
            if found >= 0:
                return -1
            found = k
    return found


def declares(generic: Callable[..., Any], system_type: type) -> Callable[[Function], Function]:
    """Declare a kernel as one of the functions below for a type of system; it counts no references to arrays."""
    return step_of(generic, system_type, embedded_kernel)


def evaluate(system: Any, t: float, y: Array, regimes: Indices, at: Equations) -> None:
    """Fill mass, force, and direction, drift, bias, gap and bounds of each law (entries that stay zero are zero)."""
    chosen(evaluate, system)(system, t, y, regimes, at)


def accumulate(system: Any, t: float, y: Array, regimes: Indices, at: Equations, out: Array) -> None:
    """Fill ``out[2 n:]`` with the rates of the quadratures; acceleration and multipliers are known.

    A coordinate whose rate is not its velocity (a twist) gets it here too, in ``out[:n]``.
    """
    chosen(accumulate, system)(system, t, y, regimes, at, out)


def fill_signals(system: Any, t: float, y: Array, regimes: Indices, at: Equations, values: Array, rates: Array) -> None:
    """Fill the machine's own signals, positive before their event, and their time derivatives (nan: not known).

    They stand behind those of the laws, from ``2 m`` on; infinite where none is sought.
    """
    chosen(fill_signals, system)(system, t, y, regimes, at, values, rates)


def begin_piece(system: Any, t: float, y: Array, regimes: Indices) -> None:
    """Prepare a smooth piece of motion: for instance the next angle at which the load changes."""
    chosen(begin_piece, system)(system, t, y, regimes)


def end_piece(system: Any, t: float, before: Array, y: Array, regimes: Indices) -> None:
    """Book what is known in closed form of a piece that ended at time ``t`` and began in the state ``before``."""
    chosen(end_piece, system)(system, t, before, y, regimes)


def pass_signal(system: Any, which: int, t: float, y: Array, regimes: Indices, log: Array, count: int) -> int:
    """Do what an own signal of the machine stands for, and log it; return the number of events.

    A number below 0 ends the motion there, and is what `loop.advance` returns.
    """
    return int(chosen(pass_signal, system)(system, which, t, y, regimes, log, count))


def change_regimes(
    system: Any, t: float, y: Array, past: Indices, regimes: Indices, at: Equations, log: Array, count: int
) -> int:
    """Take note of laws that have changed from ``past`` to ``regimes``, and log it; return the number of events."""
    return int(chosen(change_regimes, system)(system, t, y, past, regimes, at, log, count))


def begin_impact(system: Any, t: float, y: Array, regimes: Indices, at: Equations) -> None:
    """Fill ``at.restitution`` of contacts that are about to strike, where it follows from the impact.

    A system for which nothing is declared has given restitutions.
    """
    if is_declared(begin_impact, type(system)):
        chosen(begin_impact, system)(system, t, y, regimes, at)


@overload(begin_impact, jit_options={"forceinline": True})
def _given_restitutions(system: Any, t: float, y: Array, regimes: Indices, at: Equations) -> Any:
    kind = getattr(system, "instance_class", None)

    def keep(system: Any, t: float, y: Array, regimes: Indices, at: Equations) -> None:
        return None

    return keep if kind is not None and not is_declared(begin_impact, kind) else None


def note_impact(system: Any, t: float, before: Array, y: Array, at: Equations, log: Array, count: int) -> int:
    """Log an impact and book its loss; ``at.multiplier`` holds the impulses (N s, N m s); return the number."""
    return int(chosen(note_impact, system)(system, t, before, y, at, log, count))
