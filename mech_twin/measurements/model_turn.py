# SPDX-License-Identifier: Apache-2.0
"""One crank turn of the model's own run, for comparison with a measured run: sign, zero, plausibility."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from mech_twin.engine.run import frames
from mech_twin.engine.trajectory import Trajectory
from mech_twin.errors import StudyError
from mech_twin.measurements.blocks import Array
from mech_twin.measurements.units import TURN
from mech_twin.parameters.load import catalogue_entry
from mech_twin.roles import Machine

TURNING = ("linkage.crank.position", "linkage.drum.position")  # the joint that turns in the machines of the catalogue
LONGEST_S = 20.0
TURNS = 2.0
REPEATED = 0.01  # of its range: a column that differs less between turns is a function of the crank angle
COARSE = 72  # zeros of the crank tried in the first search
REFINED = 41
SIGN_FACTOR = 4.0  # by which a sign of -1 must reduce the unexplained variance
UNEXPLAINED = 1e-12  # of the variance: rounding error of a channel without noise


@dataclass(frozen=True)
class ModelTurn:
    """Columns of the model over one turn of its crank.

    Attributes
    ----------
    crank : str
        Column of the turning joint.
    angles_rad : ndarray
        Shape (n,): ascending, 0 to one turn.
    columns : mapping
        Each column at these angles, shape (n,).
    speed_rad_per_s : float
        Mean speed over the turn, negative if the angle falls.
    led : frozenset
        Columns that repeat from turn to turn, as functions of the crank angle at any speed.
    """

    crank: str
    angles_rad: Array
    columns: Mapping[str, Array]
    speed_rad_per_s: float
    led: frozenset[str]

    def at(self, column: str, crank_rad: Array) -> Array:
        """Return a column of the model at angles of the crank."""
        return np.interp(crank_rad, self.angles_rad, self.columns[column], period=TURN)


class Following(NamedTuple):
    """Correlation of a channel with the model, evaluated at ``crank_sign * (measured angle - crank_zero_rad)``.

    ``sign`` and ``scale`` (amplitude over the model's) are those of the channel, ``correlation`` is at least 0.
    """

    correlation: float
    sign: int
    scale: float
    crank_sign: int
    crank_zero_rad: float


def cycle_joint(machine: Machine) -> str | None:
    """Return the joint whose turns are the machine's cycles, if any."""
    features = catalogue_entry(machine.name).capabilities.features
    if features is None:
        return None
    try:
        reference = features(machine.parameters).reference
    except StudyError:  # no drive of the page turns a joint
        return None
    role, _, rest = reference.column.partition(".")
    return rest.removesuffix(".position") if role == "linkage" and reference.kind == "turn" else None


def model_turn(machine: Machine) -> ModelTurn | None:
    """Return the last turn of the crank in a run of the machine; None without a turning joint or two turns."""
    names = [f"linkage.{joint}.position" for joint in (cycle_joint(machine), *machine.linkage.joints)]
    crank = next((name for name in (names[0], *TURNING) if name in names[1:]), None)
    if crank is None:
        return None
    place = names.index(crank, 1) - 1
    trajectory, turned, former_rad = Trajectory(), 0.0, machine.linkage.start().position[place]
    for frame in frames(machine, LONGEST_S):
        trajectory.append(frame)
        now = frame.linkage.position[place]
        turned += now - former_rad - TURN * round((now - former_rad) / TURN)  # some machines wrap angles at one turn
        former_rad = now
        if abs(turned) > TURNS * TURN:
            break
    columns = {name: np.asarray(values) for name, values in trajectory.columns().items()}
    angle = np.unwrap(columns.pop(crank))
    if abs(angle[-1] - angle[0]) < TURNS * TURN:
        return None
    last, before = (np.abs(angle - angle[-1] + sign * TURN) for sign in (0.0, np.sign(angle[-1] - angle[0])))
    times_s, place = columns.pop("time_s"), last < TURN
    speed = float(angle[place][-1] - angle[place][0]) / float(times_s[place][-1] - times_s[place][0])
    newest, former = (_by_angle(angle, columns, turn < TURN) for turn in (last, before))
    led = frozenset(name for name in columns if _same(newest, former, name))
    return ModelTurn(crank, *newest, speed, led)


def _by_angle(
    angle: Array, columns: Mapping[str, Array], chosen: npt.NDArray[np.bool_]
) -> tuple[Array, dict[str, Array]]:
    """Return ascending angles within one turn, and the columns at them."""
    wrapped = np.mod(angle[chosen], TURN)
    order = np.argsort(wrapped)
    kept = order[np.concatenate([[True], np.diff(wrapped[order]) > 0.0])]
    return wrapped[kept], {name: values[chosen][kept] for name, values in columns.items()}


def _same(newest: tuple[Array, dict[str, Array]], former: tuple[Array, dict[str, Array]], name: str) -> bool:
    """Return whether a column had the same values at the same angles one turn earlier."""
    values = newest[1][name]
    before = np.interp(newest[0], former[0], former[1][name], period=TURN)
    return float(np.abs(values - before).max()) <= REPEATED * float(np.ptp(values))


def following(
    turn: ModelTurn,
    column: str,
    crank_rad: Array,
    values: Array,
    zero_rad: float | None = None,
    *,
    signs_known: bool = False,
) -> Following:
    """Return the correlation of values with a column of the model, over zeros and senses of the crank angle.

    A sign of -1, of the channel or of the crank, must fit better by `SIGN_FACTOR`, since a nearly harmonic motion fits
    almost equally with either sign.

    Parameters
    ----------
    column : str
        The column that the values may belong to.
    crank_rad, values : ndarray
        Shape (n,): measured crank angle (rad) and the channel at the same instants.
    zero_rad : float, optional
        Known zero of the crank angle; estimated if absent.
    signs_known : bool
        Whether both signs are fixed to 1.
    """
    found: dict[tuple[int, int], Following] = {}
    for crank_sign in (1,) if signs_known else (1, -1):
        for zero in np.arange(COARSE) * TURN / COARSE if zero_rad is None else (zero_rad,):
            tried = Following(
                *_compared(turn, column, crank_sign * (crank_rad - zero), values), crank_sign, float(zero)
            )
            kind = (tried.sign, crank_sign)
            if signs_known and tried.sign < 0:
                continue
            if kind not in found or tried.correlation > found[kind].correlation:
                found[kind] = tried
    simple = min(found.values(), key=_unlikeliness, default=Following(0.0, 1, 0.0, 1, 0.0))
    return simple if zero_rad is not None else _refined(turn, column, crank_rad, values, simple)


def _unlikeliness(each: Following) -> float:
    """Return the share of unexplained variance, increased for each sign of -1."""
    return max(1.0 - each.correlation**2, UNEXPLAINED) * SIGN_FACTOR ** ((each.sign < 0) + (each.crank_sign < 0))


def _refined(turn: ModelTurn, column: str, crank_rad: Array, values: Array, coarse: Following) -> Following:
    """Return the result with the zero refined between its neighbours."""
    step = TURN / COARSE
    zeros = coarse.crank_zero_rad + np.linspace(-step, step, REFINED)
    tried = [_compared(turn, column, coarse.crank_sign * (crank_rad - zero), values) for zero in zeros]
    best = max(range(REFINED), key=lambda i: tried[i][0])
    return Following(*tried[best], coarse.crank_sign, float(np.mod(zeros[best], TURN)))


def _compared(turn: ModelTurn, column: str, crank_rad: Array, values: Array) -> tuple[float, int, float]:
    """Return correlation, sign and scale of values against the model's column at these crank angles."""
    model = turn.at(column, crank_rad)
    a, b = model - model.mean(), values - values.mean()
    size = float(np.sqrt((a @ a) * (b @ b)))
    if size == 0.0:
        return 0.0, 1, 0.0
    product = float(a @ b)
    return abs(product) / size, 1 if product >= 0.0 else -1, abs(product) / float(a @ a)
