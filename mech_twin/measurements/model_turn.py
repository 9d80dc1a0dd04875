# SPDX-License-Identifier: Apache-2.0
"""One crank turn of the model's own run, and whether a measured run fits it.

Compared are signs, zeros and units; swapped channels, another machine and a run without a whole cycle are named.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from itertools import permutations
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from mech_twin.engine.run import frames
from mech_twin.engine.trajectory import Trajectory
from mech_twin.measurements.blocks import Array
from mech_twin.measurements.measurement_map import FREE, PER_RUN
from mech_twin.measurements.runs import MeasuredChannel, MeasuredRun
from mech_twin.measurements.units import TURN, UNITS, joint_column
from mech_twin.roles import Machine

TURNING = ("linkage.crank.position", "linkage.drum.position")  # the joint that turns, if the machine has one
LONGEST_S = 20.0
TURNS = 2.0
REPEATED = 0.01  # of its range: a column that differs less between turns is a function of the crank angle
COARSE = 72  # zeros of the crank tried in the first search
REFINED = 41
SIGN_FACTOR = 4.0  # by which a sign of -1 must reduce the unexplained variance
UNEXPLAINED = 1e-12  # of the variance: rounding error of a channel without noise
FOLLOWS = 0.8  # least correlation with the model's motion
CLEARLY = 0.15  # increase of the correlation that indicates swapped channels
FACTOR = 4.0  # amplitude over the model's: beyond it, the unit is wrong or the machine another
SPEED_FACTOR = 12.0  # largest ratio of the crank speed to the model's
RATE_FACTOR = 1.5  # largest ratio of the speed to the differences of the position
MOST_COMPARED = 4000
ROUNDING = 1e-9  # of the largest number of the model in a unit: a column that moves less stands still


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


def turning_column(columns: Collection[str]) -> str | None:
    """Return the column of the turning joint, if any."""
    return next((name for name in TURNING if name in columns), None)


def model_turn(machine: Machine) -> ModelTurn | None:
    """Return the last turn of the crank in a run of the machine; None without a turning joint or two turns."""
    crank = turning_column([f"linkage.{joint}.position" for joint in machine.linkage.joints])
    if crank is None:
        return None
    place = machine.linkage.joints.index(crank.split(".")[1])
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


class CrankPair(NamedTuple):
    """A channel with its values, and the measured crank angle at the same instants."""

    channel: MeasuredChannel
    crank_rad: Array
    values: Array


def implausible(run: MeasuredRun, turn: ModelTurn | None, units: Mapping[str, str]) -> list[str]:
    """Return the contradictions between the run and the machine, one line each; empty without any.

    Parameters
    ----------
    turn : ModelTurn, optional
        One turn of the model; without it, only speeds are compared with positions.
    units : mapping
        SI unit of each column of the machine.
    """
    found = _speeds(run, units)
    crank = None if turn is None else run.channel(turn.crank)
    if turn is None or crank is None:
        return found
    turned = float(np.ptp(crank.values))
    if turned < TURN:
        swapped = _swinging_crank(run, crank, units)
        if swapped is None:
            return [*found, f"no cycle: {crank.name} moves through {turned / TURN:.3g} of a turn, expected a whole one"]
        return [*found, swapped]
    return found + _standing_still(run, turn, units) + _turning_speed(crank, turn) + _following(run, crank, turn, units)


def _speeds(run: MeasuredRun, units: Mapping[str, str]) -> list[str]:
    """Compare each measured speed with the differences of the same joint's measured position."""
    lines = []
    for channel in run.channels:
        parts = joint_column(channel.name)
        position = (
            None
            if parts is None or parts.field != "velocity"
            else run.channel(channel.name[: -len("velocity")] + "position")
        )
        if position is None or isinstance(channel.channel.gain, str) or isinstance(position.channel.gain, str):
            continue
        differences = np.diff(position.values) / np.diff(position.times_s)
        middles = 0.5 * (position.times_s[1:] + position.times_s[:-1])
        speed = np.interp(middles, channel.times_s, channel.values)
        one, other = float(np.median(np.abs(speed))), float(np.median(np.abs(differences)))
        if one > RATE_FACTOR * other or other > RATE_FACTOR * one:
            lines.append(
                f"{channel.name} is {one:.4g} {units[channel.name]} in the median, differences of {position.name} "
                f"{other:.4g}{_fitting_unit(channel, units[channel.name], one, other)}"
            )
        elif float(speed @ differences) < 0.0:
            lines.append(
                f"{channel.name} has the opposite sign of the differences of {position.name}: expected sign "
                f"{-channel.channel.sign}"
            )
    return lines


def _fitting_unit(channel: MeasuredChannel, si: str, found: float, expected: float, factor: float = RATE_FACTOR) -> str:
    """Return the unit for which the number would fit, as the end of a line."""
    for name, unit in UNITS.items():
        if unit.si == si and name != channel.channel.unit and found > 0.0:
            ratio = found * unit.factor / channel.channel.si_factor / expected if expected else 0.0
            if 1.0 / factor < ratio < factor:
                return f": expected unit {name}?"
    return ": expected the same, is a unit or gain wrong?"


def _standing_still(run: MeasuredRun, turn: ModelTurn, units: Mapping[str, str]) -> list[str]:
    """Name each channel that has a single value in the run, but moves in the model."""
    return [
        f"{each.name} stands still at {each.values[0]:.6g} {units[each.name]}, the model's moves by "
        f"{np.ptp(turn.columns[each.name]):.4g} in a turn: is its sensor stuck?"
        for each in run.channels
        if each.name in turn.columns and np.ptp(each.values) == 0.0 and _moves(turn, each.name, units)
    ]


def _moves(turn: ModelTurn, name: str, units: Mapping[str, str]) -> bool:
    """Return whether a column of the model moves by more than the rounding of the largest number in its unit."""
    largest = max(float(np.abs(turn.columns[each]).max()) for each in turn.columns if units.get(each) == units[name])
    return float(np.ptp(turn.columns[name])) > ROUNDING * largest


def _turning_speed(crank: MeasuredChannel, turn: ModelTurn) -> list[str]:
    """Compare the speed of the crank with the model's: its sense, and its size within a wide factor."""
    if isinstance(crank.channel.gain, str):
        return []
    duration_s = float(crank.times_s[-1] - crank.times_s[0])
    speed, usual = float(crank.values[-1] - crank.values[0]) / duration_s, turn.speed_rad_per_s
    told = f"{crank.name} turns at {speed:.4g} rad/s in the mean, the model at {usual:.4g}"
    if not 1.0 / SPEED_FACTOR < abs(speed / usual) < SPEED_FACTOR:
        return [f"{told}{_fitting_unit(crank, 'rad', abs(speed), abs(usual), SPEED_FACTOR)}"]
    return [] if speed * usual > 0.0 else [f"{told}: expected sign {-crank.channel.sign}"]


def _swinging_crank(run: MeasuredRun, crank: MeasuredChannel, units: Mapping[str, str]) -> str | None:
    for channel in run.channels:
        if channel is not crank and units.get(channel.name) == "rad" and np.ptp(channel.values) >= TURN:
            return (
                f"{crank.name} swings while {channel.name} turns round: expected the other way round, are they swapped?"
            )
    return None


def _following(run: MeasuredRun, crank: MeasuredChannel, turn: ModelTurn, units: Mapping[str, str]) -> list[str]:
    pairs = pairs_with_crank(run, turn)
    zero = None if crank.channel.zero in (FREE, PER_RUN) else 0.0
    lines = []
    for pair in pairs:
        own = following(turn, pair.channel.name, pair.crank_rad, pair.values, zero)
        if own.correlation >= FOLLOWS:
            lines += _scale_line(pair.channel, own, units[pair.channel.name]) or _sign_line(pair.channel, own)
            continue
        other = _better_elsewhere(pair, [each.channel for each in pairs], turn, own, zero, units)
        lines.append(
            f"{pair.channel.name} does not follow the crank as in the model (correlation {own.correlation:.2f}, "
            f"expected {FOLLOWS:g}): {other or 'another machine, or a wrong channel'}"
        )
    return lines


def pairs_with_crank(run: MeasuredRun, turn: ModelTurn) -> list[CrankPair]:
    """Return the positions driven by the crank, each with the crank angle; empty if the crank is not measured."""
    crank = run.channel(turn.crank)
    if crank is None:
        return []
    pairs = [_paired(channel, crank) for channel in run.channels if channel is not crank and _compares(channel, turn)]
    return [pair for pair in pairs if len(pair.values) > 2 and np.ptp(pair.values) > 0.0]


def _compares(channel: MeasuredChannel, turn: ModelTurn) -> bool:
    parts = joint_column(channel.name)
    return (
        parts is not None
        and parts.field == "position"
        and channel.name in turn.led
        and float(np.ptp(turn.columns[channel.name])) > 0.0
    )


def _paired(channel: MeasuredChannel, crank: MeasuredChannel) -> CrankPair:
    """Return the channel with the crank angle at its instants, decimated for the comparison."""
    inside = (channel.times_s >= crank.times_s[0]) & (channel.times_s <= crank.times_s[-1])
    places = np.flatnonzero(inside)
    places = places[:: max(1, len(places) // MOST_COMPARED)]
    return CrankPair(channel, np.interp(channel.times_s[places], crank.times_s, crank.values), channel.values[places])


def _scale_line(channel: MeasuredChannel, own: Following, si: str) -> list[str]:
    if isinstance(channel.channel.gain, str) or 1.0 / FACTOR < own.scale < FACTOR:
        return []
    fitting = [
        name
        for name, unit in UNITS.items()
        if unit.si == si and 1.0 / FACTOR < own.scale * unit.factor / channel.channel.si_factor < FACTOR
    ]
    hint = f"is its unit {' or '.join(fitting)}?" if fitting else "a wrong unit, or another machine?"
    return [f"{channel.name} swings {own.scale:.3g} times as far as the model's, expected about 1: {hint}"]


def _sign_line(channel: MeasuredChannel, own: Following) -> list[str]:
    if own.sign > 0 and own.crank_sign > 0:
        return []
    turned = " and ".join(word for word, sign in ((channel.name, own.sign), ("the crank", own.crank_sign)) if sign < 0)
    return [f"{channel.name} follows the model with the sign of {turned} turned round: is a sign of the map wrong?"]


def _better_elsewhere(
    pair: CrankPair,
    channels: list[MeasuredChannel],
    turn: ModelTurn,
    own: Following,
    zero: float | None,
    units: Mapping[str, str],
) -> str:
    """Return a hint if the channel fits another column of the map better."""
    for this, other in permutations(channels, 2):
        if this is not pair.channel or units[other.name] != units[this.name]:
            continue
        if following(turn, other.name, pair.crank_rad, pair.values, zero).correlation > max(
            FOLLOWS, own.correlation + CLEARLY
        ):
            return f"it follows as {other.name} does, are they swapped?"
    return ""
