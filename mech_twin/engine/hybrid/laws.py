# SPDX-License-Identifier: Apache-2.0
r"""Interface of a hybrid mechanical system: equations of motion, and one set-valued force law for all its contacts.

Coordinates q (n,), velocities u (n,), quadratures (k,) stand one after the other in the state y::

    M(q) u' = h(t, q, u) + sum_i w_i(q) lam_i,    v_i = w_i . u + v0_i(t),    a_i = w_i . u' + b_i(q, u)

    v_i > 0: lam_i = low_i        v_i < 0: lam_i = high_i        v_i = 0: low_i <= lam_i <= high_i, a_i complementary
    with a gap g_i(q):  g_i > 0: the law is open, lam_i = 0

============================================  ====================  ===========================
what it stands for                            w                     [low, high]
============================================  ====================  ===========================
stop, body on its collar, striker on a tool   normal of the gap     [0, inf), restitution e
Coulomb friction                              the joint             [-c, c]
gear of efficiency eta with the moment i M    the geared shaft      i M [eta, 1/eta] less mean
yielding wall without spring-back             travel of the tool    [-F, 0]
brake, one-way clutch                         the joint             [-T, T], [0, inf)
============================================  ====================  ===========================

Laws along one direction are declared as one: their bounds add up.  A machine declares, with `declares`, the functions
below for the type of its constants; `loop.advance` integrates it.  A *piece* is the smooth motion between two events.
State that a machine keeps from piece to piece is an array among its constants.

Sources: F. Pfeiffer, C. Glocker, Multibody Dynamics with Unilateral Contacts, Wiley 1996, chapters 4 to 8;
J. J. Moreau, Unilateral contact and dry friction in finite freedom dynamics, CISM 302, Springer 1988.
"""

from collections.abc import Callable
from typing import Any, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from mech_twin.engine.addresses import view_as
from mech_twin.engine.compiled_steps import step_of
from mech_twin.kernels.dispatcher import generic, overload
from mech_twin.kernels.kernel import borrowing_kernel, embedded_kernel

Array = NDArray[np.float64]
Indices = NDArray[np.int64]
Function = TypeVar("Function", bound=Callable[..., Any])
System = TypeVar("System")

# regime of a law: open; sliding with v > 0 (force at its low bound), v < 0 (at its high bound); holding (sticking)
OPEN, LOW, HIGH, HOLD = 0, 1, 2, 3


class Equations(NamedTuple):
    """The equations of a system at one instant; the fields from ``factor`` on are work arrays.

    There are n freedoms and m laws.  Filled by `evaluate`: ``mass`` (n, n), and ``force`` (n,) of all but the laws.
    For each law it fills ``directions`` (m, n), ``drift`` (m,) v0, ``bias`` (m,) b, ``gap``, ``low`` and ``high`` (m,).
    ``restitution`` (m,) is filled for a law with a gap, and stays negative (initial value) for one without.
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
    rest_factor: Array  # (n, n) the same of the freedoms that no law holds alone
    mobility: Array  # (m, n) M^-1 w
    matrix: Array  # (m, m) w . M^-1 w
    free: Array  # (m,) accelerations, or velocities, without the unknown forces
    least: Array  # (m,) bounds of the unknown forces or impulses
    most: Array
    hold_factor: Array  # (m, m) Cholesky factor of ``matrix`` over the holding laws
    status: Indices  # (m,) regimes during the solution
    holder: Indices  # (n,) law that alone holds a freedom, -1 for none


@borrowing_kernel
def only_freedom(at: Equations, law: int) -> int:
    """Return the only degree of freedom a law acts on, -1 if there are several or none."""
    found = -1
    for k in range(len(at.force)):
        if at.directions[law, k] != 0.0:
            if found >= 0:
                return -1
            found = k
    return found


@embedded_kernel
def regime_of(sense: float) -> int:
    """Return the regime of a law without a gap at a velocity, of which the sign counts."""
    return LOW if sense > 0.0 else HIGH if sense < 0.0 else HOLD


def declares(of: Callable[..., Any], system_type: type) -> Callable[[Function], Function]:
    """Declare a kernel as one of the functions below for a type of system; compiled without reference counting."""
    return step_of(of, system_type, embedded_kernel)


_sizes: dict[type, tuple[int, int]] = {}


def of_size(freedoms: int, laws: int) -> Callable[[type[System]], type[System]]:
    """Declare the numbers of freedoms and laws of a type of system, so that loops over them are unrolled."""

    def declare(system_type: type[System]) -> type[System]:
        _sizes[system_type] = freedoms, laws
        return system_type

    return declare


def sized(system: Any, at: Equations) -> Equations:
    """Return the equations with their sizes as constants, if the type of system declares them (`of_size`)."""
    return at


@overload(sized, forceinline=True)
def _sized(system: Any, at: Any) -> Any:
    def same(system: Any, at: Any) -> Any:
        return at

    sizes = _sizes.get(getattr(system, "instance_class", type(None)))
    if sizes is None:
        return same
    n, m = sizes

    def fixed(system: Any, at: Any) -> Any:
        return Equations(
            view_as(at.mass, n, n), view_as(at.force, n), view_as(at.directions, m, n), view_as(at.drift, m),
            view_as(at.bias, m), view_as(at.gap, m), view_as(at.low, m), view_as(at.high, m),
            view_as(at.restitution, m), view_as(at.acceleration, n), view_as(at.multiplier, m),
            view_as(at.velocity, m), view_as(at.law_acceleration, m), view_as(at.factor, n, n),
            view_as(at.rest_factor, n, n),
            view_as(at.mobility, m, n), view_as(at.matrix, m, m), view_as(at.free, m), view_as(at.least, m),
            view_as(at.most, m), view_as(at.hold_factor, m, m), view_as(at.status, m),
            view_as(at.holder, n),
        )  # fmt: skip

    return fixed


@generic()
def evaluate(system: Any, t: float, y: Array, regimes: Indices, at: Equations) -> None:
    """Fill mass, force, and direction, drift, bias, gap and bounds of each law (constant zeros may be left out)."""


@generic()
def accumulate(system: Any, t: float, y: Array, regimes: Indices, at: Equations, out: Array) -> None:
    """Fill ``out[2 n:]`` with the rates of the quadratures; accelerations and multipliers are known.

    A coordinate whose time derivative is not its velocity (a twist) is given here too, in ``out[:n]``.
    """


@generic()
def fill_signals(system: Any, t: float, y: Array, regimes: Indices, at: Equations, values: Array, rates: Array) -> None:
    """Fill the machine's own event functions, positive before the event, and their time derivatives (nan: unknown).

    They follow those of the laws, from index ``2 m`` on; infinite switches one off.
    """


@generic(embedded_kernel)
def begin_piece(system: Any, t: float, y: Array, regimes: Indices) -> None:
    """Prepare a smooth piece of motion, for instance the next angle at which the load changes; else nothing."""


@generic()
def end_piece(system: Any, t: float, before: Array, y: Array, regimes: Indices) -> None:
    """Add closed-form integrals over a piece, from the state ``before`` to ``y`` at time ``t`` (s)."""


@generic()
def pass_signal(system: Any, which: int, t: float, y: Array, regimes: Indices, log: Array, count: int) -> int:
    """Execute and log the event of the machine's own signal ``which``; return the number of events.

    A negative number ends the motion there; `loop.advance` returns it.
    """
    raise NotImplementedError


@generic()
def change_regimes(
    system: Any, t: float, y: Array, past: Indices, regimes: Indices, at: Equations, log: Array, count: int
) -> int:
    """Handle and log the change of regimes from ``past`` to ``regimes``; return the number of events."""
    raise NotImplementedError


@generic(embedded_kernel)
def begin_impact(system: Any, t: float, y: Array, regimes: Indices, at: Equations) -> None:
    """Fill ``at.restitution`` of contacts before an impact, if it depends on the impact.

    Without a declaration the system has constant coefficients of restitution.
    """


@generic(embedded_kernel)
def note_impact(system: Any, t: float, before: Array, y: Array, at: Equations, log: Array, count: int) -> int:
    """Log an impact and add its loss; ``at.multiplier`` has the impulses (N s, N m s); return the number of events.

    Without a declaration the system has no impacts.
    """
    return count
