# SPDX-License-Identifier: Apache-2.0
r"""Time integration of ordinary differential equations for every machine: tableaus as data, one compiled step.

A machine declares the constants of its motion as a `NamedTuple`, and with `rates_of` the equation and the method::

    class Pendulum(NamedTuple):
        length_m: float

    @rates_of(Pendulum, DORMAND_PRINCE_5)
    def pendulum_rates(system, t, y, out):
        out[0], out[1] = y[1], -9.81 / system.length_m * math.sin(y[0])

Every kernel here is then compiled for that type of constants, with the equation in line, and kept on disk
(docs/decisions/0009-time-integration-and-events-once.md).  A Runge and Kutta method is its tableau:
``Y_i = y + h sum_j a_ij k_j``, ``k_i = f(t + c_i h, Y_i)``, ``y(t + h) = y + h sum_i b_i k_i``.
Row ``s`` (after the last of ``s`` stages) is the rate at the end of the step; further rows serve the dense output only.

Sources: E. Hairer, S. Norsett, G. Wanner, Solving Ordinary Differential Equations I, 2nd ed., Springer 1993,
II.5, II.6, II.10.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple, TypeVar, cast

import numpy as np
from numpy.typing import NDArray

from mech_twin.kernels.dispatcher import generic, overload, set_kernel
from mech_twin.kernels.kernel import borrowing_kernel, embedded_kernel, kernel

Array = NDArray[np.float64]
Function = TypeVar("Function", bound=Callable[..., Any])
SHORTEST_S = 1e-13  # a step that would have to be shorter than this is given up


class Tableau(NamedTuple):
    """An explicit Runge and Kutta method of ``s`` stages.

    ``nodes`` (S,) and ``stages`` (S, S) are c and a of all stages; those from row ``s`` on serve the dense output.
    ``weights`` (s,) are b; ``errors`` (m, s + 1) are the weights of the m = 1 or 2 embedded error estimates.
    ``interpolant`` (S, p) gives y at the share x of the step: ``y + h sum_i k_i sum_j interpolant[i, j] x^(j + 1)``.
    ``error_order`` is p of the error estimate, which falls as h^(p + 1).
    """

    nodes: Array
    stages: Array
    weights: Array
    errors: Array
    interpolant: Array
    order: int
    error_order: int


class Workspace(NamedTuple):
    """Work arrays of a step: rates of all stages (S, n), the state of a stage (n,), the state at the end (n,).

    ``stage`` may be shorter than n: the rest of the state are quadratures, on which no rate depends.
    """

    rates: Array
    stage: Array
    end: Array


@generic()
def rates(system: Any, t: float, y: Array, out: Array) -> None:
    """Fill ``out`` with dy/dt of the system at time t (s)."""


def method_of(system: Any) -> Tableau:
    """Return the integration method of a system; in compiled code a constant, so that loops over it are unrolled."""
    method = _methods[type(system)]
    return method if isinstance(method, Tableau) else method(system)


_methods: dict[type, Tableau | Callable[[Any], Tableau]] = {}


def rates_of(system_type: type, tableau: Tableau | Callable[[Any], Tableau]) -> Callable[[Function], Function]:
    """Declare ``f(system, t, y, out)``, which fills ``out`` with dy/dt, as the equation of motion of a type of system.

    Parameters
    ----------
    system_type : type
        The `NamedTuple` of the constants, of the same module as the function.
    tableau : Tableau or function
        The method with which these systems are integrated, or a function of the system that returns it.
    """
    _methods[system_type] = tableau

    def declare(function: Function) -> Function:
        compiled = declared_kernel(system_type, function, borrowing_kernel)
        set_kernel(rates, system_type, compiled)

        def constant(system: Any) -> Any:
            return tableau

        method = constant if isinstance(tableau, Tableau) else tableau

        @overload(method_of, inline="always")
        def chosen_method(system: Any) -> Any:
            return method if getattr(system, "instance_class", None) is system_type else None

        return compiled

    return declare


def declared_kernel(system_type: type, function: Function, compiler: Callable[[Any], Any] = kernel) -> Function:
    """Return the function compiled, for one type of constants.

    The cache key is the contents of the modules of the argument types.  A function in another module than its type
    could be edited without recompilation.

    Raises
    ------
    TypeError
        If the function is not defined in the module of the type.
    """
    if function.__module__ != system_type.__module__:
        raise TypeError(
            f"{function.__qualname__} belongs in {system_type.__module__}, beside {system_type.__qualname__}"
        )
    return cast(Function, compiler(function))


def workspace(tableau: Tableau, size: int) -> Workspace:
    """Return work arrays for a system of ``size`` equations."""
    return Workspace(np.empty((len(tableau.nodes), size)), np.empty(size), np.empty(size))


@borrowing_kernel
def start_step(system: Any, t: float, y: Array, work: Workspace) -> None:
    """Evaluate the rates at the start of a step (first stage), shared by trial steps of any length."""
    rates(system, t, y, work.rates[0])


@embedded_kernel
def combine(y: Array, h: float, weights: Array, count: int, slopes: Array, out: Array) -> None:
    """Fill ``out`` with y + h times the weighted sum of the first ``count`` rates."""
    for i in range(len(out)):
        out[i] = y[i]
    for j in range(count):
        weight = h * weights[j]
        if weight != 0.0:
            for i in range(len(out)):
                out[i] += weight * slopes[j, i]


@borrowing_kernel
def take_step(system: Any, t: float, y: Array, h: float, work: Workspace) -> None:
    """Fill ``work.end`` with the state a step of h (s) after ``y``; `start_step` was called for this t and y."""
    tableau = method_of(system)
    count = len(tableau.weights)
    for row in range(1, count):
        combine(y, h, tableau.stages[row], row, work.rates, work.stage)
        rates(system, t + tableau.nodes[row] * h, work.stage, work.rates[row])
    combine(y, h, tableau.weights, count, work.rates, work.end)


@borrowing_kernel
def finish_step(system: Any, t: float, h: float, work: Workspace) -> None:
    """Evaluate the rates at the end of the step taken: for the error estimate, the next step, the dense output."""
    rates(system, t + h, work.end, work.rates[len(method_of(system).weights)])


@borrowing_kernel
def step_error(system: Any, h: float, tolerance: Array, work: Workspace) -> float:
    """Return the RMS norm of the estimated error of a step over the tolerances (n,); accepted up to 1.

    Two estimates are combined as in DOP853, e5^2/sqrt(e5^2 + 0.01 e3^2) (Hairer II.10).
    If the squares overflow the error is infinite: the quotient could be 0.
    """
    tableau = method_of(system)
    count, size = tableau.errors.shape
    first, second = 0.0, 0.0
    for i in range(len(tolerance)):
        for m in range(count):
            total = 0.0
            for j in range(size):
                total += tableau.errors[m, j] * work.rates[j, i]
            if m == 0:
                first += (total / tolerance[i]) ** 2
            else:
                second += (total / tolerance[i]) ** 2
    if first == 0.0:
        return 0.0
    if count == 1:
        return abs(h) * math.sqrt(first / len(tolerance))
    both = (first + 0.01 * second) * len(tolerance)
    return abs(h) * first / math.sqrt(both) if math.isfinite(both) else math.inf


@borrowing_kernel
def controlled_step(
    system: Any, t: float, y: Array, wanted: float, tolerance: Array, work: Workspace
) -> tuple[float, float]:
    """Take a step of at most ``wanted`` whose error is within the tolerances; return it (s) and that error.

    The step is 0 if none above `SHORTEST_S` is good.
    """
    h, exponent = wanted, -1.0 / (method_of(system).error_order + 1.0)
    while h > SHORTEST_S:
        take_step(system, t, y, h, work)
        finish_step(system, t, h, work)
        error = step_error(system, h, tolerance, work)
        if error <= 1.0:
            return h, error
        h *= max(0.2, 0.9 * error**exponent) if math.isfinite(error) else 0.2
    return 0.0, 0.0


@borrowing_kernel
def following_step(system: Any, h: float, error: float) -> float:
    """Return the step (s) to try after one of h (s) with an error within the tolerances."""
    exponent = -1.0 / (method_of(system).error_order + 1.0)
    return float(h * (5.0 if error < 1e-7 else min(5.0, max(0.3, 0.9 * error**exponent))))


@borrowing_kernel
def prepare_dense_output(system: Any, t: float, y: Array, h: float, work: Workspace) -> None:
    """Evaluate the further stages that the interpolant of a finished step needs."""
    tableau = method_of(system)
    for row in range(len(tableau.weights) + 1, len(tableau.nodes)):
        combine(y, h, tableau.stages[row], row, work.rates, work.stage)
        rates(system, t + tableau.nodes[row] * h, work.stage, work.rates[row])


@borrowing_kernel
def interpolate(system: Any, y: Array, h: float, share: float, work: Workspace, out: Array) -> None:
    """Fill ``out`` with the state at a share (0 to 1) of the finished step that began at ``y``."""
    tableau = method_of(system)
    for i in range(len(y)):
        out[i] = y[i]
    rows, powers = tableau.interpolant.shape
    for j in range(rows):
        weight = 0.0
        for power in range(powers - 1, -1, -1):
            weight = (weight + tableau.interpolant[j, power]) * share
        for i in range(len(y)):
            out[i] += h * weight * work.rates[j, i]
