# SPDX-License-Identifier: Apache-2.0
"""Checks whether a measured run fits the machine: clock, units, swapped channels, another machine, no whole cycle."""

from collections.abc import Mapping
from itertools import permutations
from typing import NamedTuple

import numpy as np

from mech_twin.measurements.blocks import Array
from mech_twin.measurements.measurement_map import FREE, PER_RUN
from mech_twin.measurements.model_turn import TURNING, Following, ModelTurn, following
from mech_twin.measurements.quality import LONG_INTERVAL
from mech_twin.measurements.runs import ABOUT_TURN, MeasuredChannel, MeasuredRun, range_of_turn
from mech_twin.measurements.units import TURN, UNITS, is_event, joint_column

FOLLOWS = 0.8  # least correlation with the model's motion
CLEARLY = 0.15  # increase of the correlation that indicates swapped channels
FACTOR = 4.0  # amplitude over the model's: beyond it, the unit is wrong or the machine another
TIME_FACTORS = (1e3, 1e6, 1e9, 1e-3, 1e-6, 1e-9)  # of stamps in another unit of time than the map's
SPEED_FACTOR = 12.0  # largest ratio of the crank speed to the model's
RATE_FACTOR = 1.5  # largest ratio of the speed to the differences of the position
MOST_COMPARED = 4000
LATE_SAMPLES = 10  # left out for each stamp that goes back: so many are no samples that arrived late
BURSTS = 0.005  # gaps for each sample: with more, and most of the time in them, samples come in packets
GOING_ON = 0.02  # of a turn: a crank this near to where it was going has not turned during a gap
GAP_TURN = 0.25  # of a turn: least motion in a gap that tells whether time has passed
SPEED_TURN = 0.125  # of a turn: before and after a gap, from which the speed is taken
ROUNDING = 1e-9  # of the largest number of the model in a unit: a column that moves less stands still


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
        One turn of the model; without it, only the clock is checked, and speeds are compared with positions.
    units : mapping
        SI unit of each column of the machine.
    """
    if packets := _packets(run):
        return packets
    names = TURNING if turn is None else (turn.crank,)
    crank = next((channel for name in names if (channel := run.channel(name)) is not None), None)
    found = _clock(run, crank) + _apart(run, crank) + _speeds(run, units)
    if turn is None or crank is None:
        return found
    turned = float(np.ptp(crank.values))
    if turned < TURN:
        return [*found, *(_swinging_crank(run, crank, units) or [_no_cycle(crank, turned, turn)])]
    return found + _standing_still(run, turn, units) + _turning_speed(crank, turn) + _following(run, crank, turn, units)


def _clock(run: MeasuredRun, crank: MeasuredChannel | None) -> list[str]:
    """Name a clock that has gone back, or that has gone on while the crank has not."""
    for channel in run.channels:
        quality = channel.quality
        late = quality.samples - quality.nan - quality.repeats - len(channel.times_s)
        if quality.back and late >= LATE_SAMPLES * quality.back:
            return [
                f"{channel.name}: stamps go back {quality.back} times, {late} samples earlier than those before are "
                "left out: has the clock been set back, or the machine begun anew? Cut the run there"
            ]
    if crank is None or isinstance(crank.channel.gain, str):
        return []
    return [
        f"{crank.name}: in the gap of {gap_s:.4g} s after {at_s:.6g} s the crank turns no further than in one "
        "interval: has the clock been set forward? Cut the run there"
        for at_s, gap_s in _gaps_without_motion(crank)
    ]


def _packets(run: MeasuredRun) -> list[str]:
    """Name the first channel whose stamps stand in bursts: no speed follows from them."""
    for channel in run.channels:
        quality = channel.quality
        usual = quality.rate_hz * quality.span_s  # samples in all of the time
        filled = quality.samples / usual if usual > 0.0 and not is_event(channel.name) else 1.0
        if filled < 1.0 / FACTOR and quality.gaps > BURSTS * quality.samples:
            share = f"{quality.samples} samples at {quality.rate_hz:.4g} Hz fill {100.0 * filled:.3g} % of the time"
            return [f"{channel.name}: {share}: are its stamps those of packets? Expected one of each sample"]
    return []


def _no_cycle(crank: MeasuredChannel, turned_rad: float, turn: ModelTurn) -> str:
    """Return the remark on the crank's turn, with the unit that makes it one turn or the model's range."""
    turned = f"no cycle: {crank.name} moves through {turned_rad / TURN:.3g} of a turn, expected a whole one"
    usual_rad = abs(turn.speed_rad_per_s) * float(crank.times_s[-1] - crank.times_s[0])
    if turned_rad > usual_rad / SPEED_FACTOR:
        return turned
    name = _nearest_unit(crank, "rad", turned_rad, TURN, ABOUT_TURN)  # an angle that starts anew at each turn
    name = name or _nearest_unit(crank, "rad", turned_rad, usual_rad, SPEED_FACTOR)
    return f"{turned}: is its unit {name}?" if name else turned


def _apart(run: MeasuredRun, crank: MeasuredChannel | None) -> list[str]:
    """Name each channel that has no time in common with the crank, else with the first channel."""
    first = run.channels[0] if crank is None else crank
    from_s, to_s = float(first.times_s[0]), float(first.times_s[-1])
    return [
        f"{each.name}: none of its samples is from {from_s:.6g} to {to_s:.6g} s, the time of {first.name}: two clocks? "
        "The log of a bag has one, time: {stamps: log}"
        for each in run.channels
        if len(each.times_s) and not (each.times_s[0] <= to_s and each.times_s[-1] >= from_s)
    ]


def _gaps_without_motion(crank: MeasuredChannel) -> list[tuple[float, float]]:
    """Return begin and length of each gap across which a turning crank goes on as if no time had passed."""
    quality, times_s, angle = crank.quality, crank.times_s, crank.values
    wrapped = quality.high - quality.low <= range_of_turn(crank.channel)
    usual_s, intervals = 1.0 / quality.rate_hz, np.diff(times_s)
    fastest = float(np.max(np.abs(np.diff(angle)[intervals <= LONG_INTERVAL * usual_s]), initial=0.0)) / usual_s
    long = (intervals > LONG_INTERVAL * usual_s) & (intervals * fastest > GAP_TURN * TURN)
    found = []
    for i in np.flatnonzero(long):
        first, last = i, i + 1
        while first > 0 and abs(angle[i] - angle[first]) < SPEED_TURN * TURN:
            first -= 1
        while last < len(angle) - 1 and abs(angle[last] - angle[i + 1]) < SPEED_TURN * TURN:
            last += 1
        if first == i or last == i + 1:
            continue
        speeds = (
            (angle[i] - angle[first]) / (times_s[i] - times_s[first]),
            (angle[last] - angle[i + 1]) / (times_s[last] - times_s[i + 1]),
        )
        speed, gap_s = min(speeds, key=abs), float(intervals[i])
        if speeds[0] * speeds[1] <= 0.0:
            continue
        unturned = abs(speed) * (gap_s - usual_s)  # what the crank would have turned more in a gap of time
        on = angle[i + 1] - angle[i] - speed * usual_s
        if wrapped:
            unturned, on = (abs(each - TURN * round(each / TURN)) for each in (unturned, on))
        if abs(on) < GOING_ON * TURN and unturned > GAP_TURN * TURN:
            found.append((float(times_s[i]), gap_s))
    return found


def _speeds(run: MeasuredRun, units: Mapping[str, str]) -> list[str]:
    """Compare each measured speed with the differences of the same joint's measured position."""
    lines = []
    for channel in run.channels:
        parts = joint_column(channel.name)
        if parts is None or parts.field != "velocity":
            continue
        position = run.channel(f"{parts.role}.{parts.joint}.position")
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
    name = _nearest_unit(channel, si, found, expected, factor)
    return f": expected unit {name}?" if name else ": expected the same, is a unit or gain wrong?"


def _nearest_unit(channel: MeasuredChannel, si: str, found: float, expected: float, factor: float) -> str | None:
    """Return the other unit that brings a number nearest to the one expected, if it is within a factor of it."""
    others = {name: unit.factor for name, unit in UNITS.items() if unit.si == si and name != channel.channel.unit}
    if not (found > 0.0 and expected > 0.0 and others):
        return None
    off = {name: abs(np.log(found * size / channel.channel.si_factor / expected)) for name, size in others.items()}
    nearest = min(off, key=lambda name: float(off[name]))
    return nearest if off[nearest] < np.log(factor) else None


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
    intervals, moved, usual = np.diff(crank.times_s), np.diff(crank.values), turn.speed_rad_per_s
    speed = float(moved.sum() / intervals.sum())
    regular = intervals <= LONG_INTERVAL / crank.quality.rate_hz
    without_gaps = float(moved[regular].sum() / intervals[regular].sum())
    slowest, fastest = abs(usual) / SPEED_FACTOR, abs(usual) * SPEED_FACTOR
    if abs(speed) < slowest < abs(without_gaps) < fastest:
        gap = int(np.argmax(intervals))
        words = f"but for a gap of {intervals[gap]:.4g} s after {crank.times_s[gap]:.6g} s: two clocks, or two runs?"
        turning = f"{crank.name} turns at {without_gaps:.4g} rad/s {words} Cut the run there"
        return [] if _gaps_without_motion(crank) else [turning]
    usually = float(np.median(moved / intervals))
    if abs(usually) > SPEED_FACTOR * abs(usual):
        speed = usually  # an angle that starts anew at each turn, in another unit, has hardly any mean speed
    turning = f"{crank.name} turns at {speed:.4g} rad/s, the model at {usual:.4g}"
    if (beyond := next((each for each in TIME_FACTORS if 0.5 < each * abs(speed / usual) < 2.0), None)) is not None:
        apart = f"{beyond:g} times too far apart" if beyond > 1.0 else f"{1.0 / beyond:g} times too close"
        return [f"{turning}: the stamps are {apart}, is the unit of the time wrong?"]
    if not slowest < abs(speed) < fastest:
        return [f"{turning}{_fitting_unit(crank, 'rad', abs(speed), abs(usual), SPEED_FACTOR)}"]
    return [] if speed * usual > 0.0 else [f"{turning}: expected sign {-crank.channel.sign}"]


def _swinging_crank(run: MeasuredRun, crank: MeasuredChannel, units: Mapping[str, str]) -> list[str]:
    turning = [
        each.name
        for each in run.channels
        if each is not crank and units.get(each.name) == "rad" and np.ptp(each.values) >= TURN
    ]
    swapped = "turns round: expected the other way round, are they swapped?"
    return [f"{crank.name} swings while {name} {swapped}" for name in turning[:1]]


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
    if zero is not None and following(turn, pair.channel.name, pair.crank_rad, pair.values).correlation >= FOLLOWS:
        return f"it does with another zero of {turn.crank}; expected `zero: per_run` there if it is unknown"
    return ""
