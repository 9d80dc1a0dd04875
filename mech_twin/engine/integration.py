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

``DORMAND_PRINCE_8``: 12 stages, order 8 with errors of order 5 and 3, dense output of order 7 (DOP853).
``DORMAND_PRINCE_5``: 6 stages, order 5 with an error of order 4, dense output of order 4.

Their numbers stand here since `scipy.integrate`, which has the same ones, takes 0.3 s to import.

Sources: E. Hairer, S. Norsett, G. Wanner, Solving Ordinary Differential Equations I, 2nd ed., Springer 1993, II.5,
II.6, II.10; the dense output of order 4: L. F. Shampine, Mathematics of Computation 46 (1986) 135.
"""

import math
from collections.abc import Callable, Sequence
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


Rows = Sequence[Sequence[float]]

# fmt: off
STAGES_5 = (
    [1 / 5],
    [3 / 40, 9 / 40],
    [44 / 45, -56 / 15, 32 / 9],
    [19372 / 6561, -25360 / 2187, 64448 / 6561, -212 / 729],
    [9017 / 3168, -355 / 33, 46732 / 5247, 49 / 176, -5103 / 18656],
    [35 / 384, 0, 500 / 1113, 125 / 192, -2187 / 6784, 11 / 84],
)
NODES_5 = [0, 1 / 5, 3 / 10, 4 / 5, 8 / 9, 1, 1]
ERRORS_5 = ([-71 / 57600, 0, 71 / 16695, -71 / 1920, 17253 / 339200, -22 / 525, 1 / 40],)
INTERPOLANT_5 = (
    [1, -8048581381 / 2820520608, 8663915743 / 2820520608, -12715105075 / 11282082432],
    [0, 0, 0, 0],
    [0, 131558114200 / 32700410799, -68118460800 / 10900136933, 87487479700 / 32700410799],
    [0, -1754552775 / 470086768, 14199869525 / 1410260304, -10690763975 / 1880347072],
    [0, 127303824393 / 49829197408, -318862633887 / 49829197408, 701980252875 / 199316789632],
    [0, -282668133 / 205662961, 2019193451 / 616988883, -1453857185 / 822651844],
    [0, 40617522 / 29380423, -110615467 / 29380423, 69997945 / 29380423],
)
STAGES_8 = (  # of the step, of its end, of the dense output
    [0.05260015195876773],
    [0.0197250569845379, 0.0591751709536137],
    [0.02958758547680685, 0.0, 0.08876275643042054],
    [0.2413651341592667, 0.0, -0.8845494793282861, 0.924834003261792],
    [0.037037037037037035, 0.0, 0.0, 0.17082860872947386, 0.12546768756682242],
    [0.037109375, 0.0, 0.0, 0.17025221101954405, 0.06021653898045596, -0.017578125],
    [
        0.03709200011850479, 0.0, 0.0, 0.17038392571223998, 0.10726203044637328, -0.015319437748624402,
        0.008273789163814023
    ],
    [
        0.6241109587160757, 0.0, 0.0, -3.3608926294469414, -0.868219346841726, 27.59209969944671, 20.154067550477894,
        -43.48988418106996
    ],
    [
        0.47766253643826434, 0.0, 0.0, -2.4881146199716677, -0.590290826836843, 21.230051448181193,
        15.279233632882423, -33.28821096898486, -0.020331201708508627
    ],
    [
        -0.9371424300859873, 0.0, 0.0, 5.186372428844064, 1.0914373489967295, -8.149787010746927, -18.52006565999696,
        22.739487099350505, 2.4936055526796523, -3.0467644718982196
    ],
    [
        2.273310147516538, 0.0, 0.0, -10.53449546673725, -2.0008720582248625, -17.9589318631188, 27.94888452941996,
        -2.8589982771350235, -8.87285693353063, 12.360567175794303, 0.6433927460157636
    ],
    [
        0.054293734116568765, 0.0, 0.0, 0.0, 0.0, 4.450312892752409, 1.8915178993145003, -5.801203960010585,
        0.3111643669578199, -0.1521609496625161, 0.20136540080403034, 0.04471061572777259
    ],
    [
        0.056167502283047954, 0.0, 0.0, 0.0, 0.0, 0.0, 0.25350021021662483, -0.2462390374708025,
        -0.12419142326381637, 0.15329179827876568, 0.00820105229563469, 0.007567897660545699, -0.008298
    ],
    [
        0.03183464816350214, 0.0, 0.0, 0.0, 0.0, 0.028300909672366776, 0.053541988307438566, -0.05492374857139099,
        0.0, 0.0, -0.00010834732869724932, 0.0003825710908356584, -0.00034046500868740456, 0.1413124436746325
    ],
    [
        -0.42889630158379194, 0.0, 0.0, 0.0, 0.0, -4.697621415361164, 7.683421196062599, 4.06898981839711,
        0.3567271874552811, 0.0, 0.0, 0.0, -0.0013990241651590145, 2.9475147891527724, -9.15095847217987
    ],
)
NODES_8 = [
    0.0, 0.05260015195876773, 0.0789002279381516, 0.1183503419072274, 0.2816496580927726, 0.3333333333333333, 0.25,
    0.3076923076923077, 0.6512820512820513, 0.6, 0.8571428571428571, 1.0, 1.0, 0.1, 0.2, 0.7777777777777778,
]
ERRORS_8 = (
    [
        0.01312004499419488, 0.0, 0.0, 0.0, 0.0, -1.2251564463762044, -0.4957589496572502, 1.6643771824549864,
        -0.35032884874997366, 0.3341791187130175, 0.08192320648511571, -0.022355307863886294
    ],
    [
        -0.18980075407240762, 0.0, 0.0, 0.0, 0.0, 4.450312892752409, 1.8915178993145003, -5.801203960010585,
        -0.4226823213237919, -0.1521609496625161, 0.20136540080403034, 0.02265179219836082
    ],
)
INTERPOLANT_8 = (
    [
        -8.428938276109013, 0.0, 0.0, 0.0, 0.0, 0.5667149535193777, -3.0689499459498917, 2.38466765651207,
        2.117034582445028, -0.871391583777973, 2.2404374302607883, 0.6315787787694688, -0.08899033645133331,
        18.148505520854727, -9.194632392478356, -4.436036387594894
    ],
    [
        10.427508642579134, 0.0, 0.0, 0.0, 0.0, 242.28349177525817, 165.20045171727028, -374.5467547226902,
        -22.113666853125306, 7.733432668472264, -30.674084731089398, -9.332130526430229, 15.697238121770845,
        -31.139403219565178, -9.35292435884448, 35.81684148639408
    ],
    [
        19.985053242002433, 0.0, 0.0, 0.0, 0.0, -387.0373087493518, -189.17813819516758, 527.8081592054236,
        -11.57390253995963, 6.8812326946963, -1.0006050966910838, 0.7777137798053443, -2.778205752353508,
        -60.19669523126412, 84.32040550667716, 11.99229113618279
    ],
    [
        -25.69393346270375, 0.0, 0.0, 0.0, 0.0, -154.18974869023643, -231.5293791760455, 357.6391179106141,
        93.40532418362432, -37.45832313645163, 104.0996495089623, 29.8402934266605, -43.53345659001114,
        96.32455395918828, -39.17726167561544, -149.72683625798564
    ],
)
# fmt: on


def _filled(rows: Rows, height: int, width: int) -> Array:
    """Return the rows as the last of a matrix, zeros elsewhere."""
    table = np.zeros((height, width))
    for i, row in enumerate(rows, height - len(rows)):
        table[i, : len(row)] = row
    return table


def _dormand_prince_8() -> Tableau:
    """DOP853; its interpolant is y + F0 x + F1 x (1 - x) + F2 x^2 (1 - x) + F3 x^2 (1 - x)^2 + ..., F = h sum w k."""
    stages = _filled(STAGES_8, 16, 16)
    whole, first, last = stages[12], np.eye(16)[0], np.eye(16)[12]
    terms = np.vstack([whole, first - whole, 2.0 * whole - last - first, _filled(INTERPOLANT_8, 4, 16)])
    powers, shape = np.zeros((16, 7)), np.polynomial.Polynomial([1.0])
    for i, term in enumerate(terms):
        shape *= np.polynomial.Polynomial([0.0, 1.0] if i % 2 == 0 else [1.0, -1.0])
        powers[:, : i + 1] += np.outer(term, shape.coef[1:])
    return Tableau(np.array(NODES_8), stages, whole[:12].copy(), _filled(ERRORS_8, 2, 13), powers, 8, 7)


def _dormand_prince_5() -> Tableau:
    stages = _filled(STAGES_5, 7, 7)
    return Tableau(
        np.array(NODES_5), stages, stages[6, :6].copy(), _filled(ERRORS_5, 1, 7), _filled(INTERPOLANT_5, 7, 4), 5, 4
    )


DORMAND_PRINCE_8 = _dormand_prince_8()
DORMAND_PRINCE_5 = _dormand_prince_5()
