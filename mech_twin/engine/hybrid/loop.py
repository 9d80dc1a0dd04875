# SPDX-License-Identifier: Apache-2.0
"""The event loop: integrates any machine over a coupling step, from event to event.

After an event a complementarity problem gives the next regimes: in velocities and impulses where a gap closes
(`impacts.strike`), otherwise in accelerations and forces (`motion.settle_regimes`).
"""

import math
from typing import Any, NamedTuple

from mech_twin.engine.addresses import place_of, view_as
from mech_twin.engine.compiled_steps import LOG_FULL, copy_numbers
from mech_twin.engine.hybrid.complementarity import CLOSED, SOLVED, STRUCK, halt, is_held_by_others, strike
from mech_twin.engine.hybrid.event_location import AT_ROOT, KEPT, NOTHING, Signals, advance_piece
from mech_twin.engine.hybrid.laws import (
    HIGH,
    HOLD,
    LOW,
    OPEN,
    Array,
    Equations,
    Indices,
    begin_impact,
    begin_piece,
    change_regimes,
    end_piece,
    note_impact,
    pass_signal,
)
from mech_twin.engine.hybrid.motion import Piece, PieceAt, prepare_instant, settle_regimes
from mech_twin.engine.integration import DORMAND_PRINCE_5, Tableau, Workspace
from mech_twin.kernels.kernel import borrowing_kernel, embedded_kernel, inline_kernel

TOO_MANY, UNSTEADY, TOO_LONG, CONTRADICTS = -1, -2, -3, -4
ENDED = -101  # by the system
MOST_PIECES = 10_000  # of one coupling step
MOST_STEPS = 20_000  # of one piece
SHORTEST_SERIES_S = 1e-10  # a series of impacts with less time left is replaced by its limit
MOVES = 1e-11  # relative to the velocity changes of the impulses: below, a law still holds
JUMPED = 3  # beside `STRUCK` and `CLOSED`: an impact set the law in motion
LAST, ROUND, FASTEST = range(3)  # rows of `Room.series`
LEAP = 1e3  # times the error of a step: a law that stops may change no velocity by more
INSTANT_S = 1e-12  # so near is a velocity to its root where a step has located it
ROWS = 16  # stages of the largest tableau


class Room(NamedTuple):
    """Work arrays of the loop: equations, integration step, signals; marks and regimes of the laws (m,); states."""

    at: Equations
    work: Workspace
    search: Signals
    candidates: Indices
    struck: Indices
    ended: Indices
    past: Indices
    cut: Array
    series: Array  # (3, m): time of the last impact of each law (s), interval before it (s), closing speed (m/s)
    before: Array
    tolerance: Array
    method: Tableau
    steps: Indices  # (1,) integration steps so far


@inline_kernel
def room_sizes(n: int, m: int, signals: int, size: int) -> tuple[int, int]:
    """Return the lengths of the float and integer arrays that `room_in` needs."""
    numbers = 3 * n * n + 6 * n + 2 * m * m + 2 * m * n + 16 * m + (ROWS + 5) * size + 8 * (2 * m + signals)
    return numbers, 5 * m + n + 1


@inline_kernel
def room_in(numbers: Array, marks: Indices, n: int, m: int, signals: int, size: int, method: Tableau) -> Room:
    """Return work arrays as views of two arrays, for n freedoms, m laws, own signals and state size."""
    s, free = 2 * m + signals, 0
    mass, free = view_as(numbers[free:], n, n), free + n * n
    factor, free = view_as(numbers[free:], n, n), free + n * n
    rest_factor, free = view_as(numbers[free:], n, n), free + n * n
    directions, free = view_as(numbers[free:], m, n), free + m * n
    mobility, free = view_as(numbers[free:], m, n), free + m * n
    matrix, free = view_as(numbers[free:], m, m), free + m * m
    hold_factor, free = view_as(numbers[free:], m, m), free + m * m
    by_freedom, free = view_as(numbers[free:], 2, n), free + 2 * n
    stage, free = view_as(numbers[free:], 2 * n), free + 2 * n
    lost, free = view_as(numbers[free:], 2 * n), free + 2 * n
    by_law, free = view_as(numbers[free:], 13, m), free + 13 * m
    series, free = view_as(numbers[free:], 3, m), free + 3 * m
    stages, free = view_as(numbers[free:], ROWS, size), free + ROWS * size
    by_state, free = view_as(numbers[free:], 5, size), free + 5 * size
    by_signal = view_as(numbers[free:], 8, s)
    for i in range(m):
        by_law[4, i], by_law[5, i] = math.inf, -1.0
    at = Equations(
        mass, by_freedom[0], directions, by_law[0], by_law[1], by_law[4], by_law[2], by_law[3], by_law[5],
        by_freedom[1], by_law[6], by_law[7], by_law[8], factor, rest_factor, mobility, matrix, by_law[9], by_law[10],
        by_law[11], hold_factor, marks[:m], marks[5 * m + 1 : 5 * m + 1 + n],
    )  # fmt: skip
    work = Workspace(stages, stage, by_state[0])
    search = Signals(
        by_signal[0], by_signal[1], by_signal[2], by_signal[3], by_signal[4], by_signal[5], by_signal[6], by_signal[7],
        by_state[1], by_state[2], lost,
    )  # fmt: skip
    return Room(
        at, work, search, marks[m : 2 * m], marks[2 * m : 3 * m], marks[3 * m : 4 * m], marks[4 * m : 5 * m],
        by_law[12], series, by_state[3], by_state[4], method, marks[5 * m : 5 * m + 1],
    )  # fmt: skip


@embedded_kernel
def clear(out: Array) -> None:
    """Fill an array with zeros."""
    for i in range(len(out)):
        out[i] = 0.0


@borrowing_kernel
def let_open(at: Equations, regimes: Indices) -> None:
    """Set contacts with the force at its low bound 0 to `OPEN`."""
    for i in range(len(at.gap)):
        if regimes[i] == LOW and at.restitution[i] >= 0.0:
            regimes[i] = OPEN


@borrowing_kernel
def settle(system: Any, t: float, y: Array, regimes: Indices, room: Room) -> int:
    """Find the regimes of the candidate laws; contacts without force become open."""
    answer = settle_regimes(system, t, y, regimes, room.candidates, room.at)
    let_open(room.at, regimes)
    return answer


@borrowing_kernel
def series_ends(at: Equations, regimes: Indices, law: int) -> bool:
    """Return whether the remaining series of impacts of a bouncing contact takes less than `SHORTEST_SERIES_S`."""
    e, fall = at.restitution[law], -at.law_acceleration[law]
    return bool(
        regimes[law] == OPEN
        and fall > 0.0
        and e < 1.0
        and 2.0 * at.velocity[law] < SHORTEST_SERIES_S * fall * (1.0 - e)
    )


@borrowing_kernel
def mark_turns(at: Equations, t: float, room: Room) -> None:
    """Mark contacts that strike alternately (two bodies and a wall) if the rest of their series is negligibly short.

    Intervals and closing speeds of a contact fall by a constant ratio, so the rest is a geometric series; less than
    `SHORTEST_SERIES_S` is negligible.  Alternate impacts with growing speeds or intervals end by themselves.
    ``room.cut`` holds the velocities before the impact.
    """
    series = room.series
    for i in range(len(at.gap)):
        if room.struck[i] != STRUCK:
            continue
        since, past, slower = t - series[LAST, i], series[ROUND, i], -room.cut[i] < series[FASTEST, i]
        ends = slower and since < past < math.inf and since * since < SHORTEST_SERIES_S * (past - since)
        turns = False
        for j in range(len(at.gap)):
            turns = turns or (j != i and series[LAST, j] >= series[LAST, i] > -math.inf)
        for j in range(len(at.gap)):
            if ends and turns and series[LAST, j] >= series[LAST, i]:
                room.ended[j] = 1
    for i in range(len(at.gap)):
        if room.struck[i] == STRUCK:
            series[ROUND, i], series[LAST, i], series[FASTEST, i] = t - series[LAST, i], t, -room.cut[i]


@embedded_kernel
def moved_by_impact(regime: int, v: float, at: Equations, law: int) -> bool:
    """Return whether an impact has started a holding law without a gap, or reversed the velocity of a sliding one."""
    if regime == HOLD:
        size = 0.0
        for k in range(len(at.multiplier)):
            size += abs(at.matrix[law, k] * at.multiplier[k])
        return abs(v) > MOVES * size
    return (regime == LOW and v < 0.0) or (regime == HIGH and v > 0.0)


@borrowing_kernel
def mark_stopped(at: Equations, regimes: Indices, candidates: Indices) -> None:
    """Set laws without a gap to holding, as candidates, if their velocity is zero but for rounding."""
    for i in range(len(at.gap)):
        if at.restitution[i] < 0.0 and regimes[i] != HOLD:
            size = 0.0
            for k in range(len(at.gap)):
                size += abs(at.matrix[i, k] * at.multiplier[k])
            if abs(at.velocity[i]) <= MOVES * size:
                regimes[i], candidates[i] = HOLD, 1


@borrowing_kernel
def close_gaps(system: Any, t: float, y: Array, regimes: Indices, room: Room) -> int:
    """Apply the impacts of closing contacts, end series that are negligibly short, and find the new regimes."""
    at, m = room.at, len(room.candidates)
    copy_numbers(at.velocity, room.cut)
    answer = strike(y, regimes, at, room.struck)
    for i in range(m):
        room.ended[i] = 0
    mark_turns(at, t, room)
    for i in range(m):
        impulse, v = at.multiplier[i], at.velocity[i]
        room.candidates[i] = 1 if regimes[i] == HOLD else 0
        if room.struck[i] == STRUCK:
            bounces = at.restitution[i] > 0.0 and impulse > 0.0
            room.candidates[i] = 0 if bounces or (impulse == 0.0 and v > 0.0) else 1
            regimes[i] = OPEN if room.candidates[i] == 0 else HOLD
        elif room.struck[i] == CLOSED and impulse == 0.0 and v > 0.0:
            regimes[i], room.candidates[i] = OPEN, 0
        elif at.restitution[i] < 0.0 and moved_by_impact(regimes[i], v, at, i):
            regimes[i], room.candidates[i], room.struck[i] = LOW if v > 0.0 else HIGH, 0, JUMPED
        room.cut[i] = impulse
    mark_stopped(at, regimes, room.candidates)
    answer = min(answer, settle(system, t, y, regimes, room))
    again = False
    for i in range(m):
        if room.struck[i] == STRUCK and series_ends(at, regimes, i):
            room.ended[i] = 1
        again = again or room.ended[i] == 1
    if again:
        halt(y, regimes, at, room.ended, at.multiplier)
        mark_stopped(at, regimes, room.candidates)
        for i in range(m):
            room.cut[i] += at.multiplier[i]
            if room.ended[i] == 1:
                regimes[i], room.candidates[i] = HOLD, 1
        answer = min(answer, settle(system, t, y, regimes, room))
    for i in range(m):
        at.multiplier[i] = room.cut[i]
    return answer


@borrowing_kernel
def velocity_jumps(y: Array, before: Array, tolerance: Array, n: int) -> bool:
    """Return whether a velocity differs from ``before`` by more than `LEAP` times the error of a step."""
    found = False
    for k in range(n, 2 * n):
        found = found or abs(y[k] - before[k]) > LEAP * tolerance[k]
    return found


@borrowing_kernel
def change_law(system: Any, t: float, y: Array, regimes: Indices, law: int, upper: bool, room: Room) -> int:
    """Start sliding where the force of a holding law reaches a bound, or stop a sliding law; find the new regimes.

    At the bound the law slides in any case: its acceleration is 0 but for rounding, which must not decide.
    At a dead centre the law's direction vanishes, and its velocity with it: it slides on with the opposite sign.
    So does a law whose acceleration is 0 but for rounding: slowed down so far, it cannot slide on as before.
    """
    at, m, slid = room.at, len(room.candidates), regimes[law]
    held = slid == HOLD
    for i in range(m):
        room.candidates[i] = 1 if regimes[i] == HOLD or i == law else 0
        room.struck[i] = 1 if i == law else 0
    if held:
        regimes[law], room.candidates[law] = HIGH if upper else LOW, 0
    else:
        copy_numbers(y, room.before)
        halt(y, regimes, at, room.struck, at.multiplier)
        if velocity_jumps(y, room.before, room.tolerance, len(at.force)):
            copy_numbers(room.before, y)
            regimes[law], room.candidates[law] = LOW + HIGH - slid, 0
        else:
            mark_stopped(at, regimes, room.candidates)
            regimes[law] = HOLD
    answer = settle(system, t, y, regimes, room)
    if not held and regimes[law] == slid:
        regimes[law] = LOW + HIGH - slid
    return answer


@borrowing_kernel
def is_still(at: Equations, tolerance: Array, law: int, errors: float) -> bool:
    """Return whether a law has no velocity but so many times the error of a step."""
    error = 0.0
    for k in range(len(at.force)):
        error += abs(at.directions[law, k]) * tolerance[len(at.force) + k]
    return bool(abs(at.velocity[law]) <= errors * error)


@borrowing_kernel
def is_stationary(at: Equations, tolerance: Array, regimes: Indices, law: int) -> bool:
    """Return whether a sliding law has no velocity but the error of a step: another one that holds has kept it so."""
    return bool((regimes[law] == LOW or regimes[law] == HIGH) and is_still(at, tolerance, law, 1.0))


@borrowing_kernel
def begins_at_root(at: Equations, tolerance: Array, regimes: Indices, law: int) -> bool:
    """Return whether the signal of a law that begins is zero; not so of a sliding one that had the wrong sign."""
    a = abs(at.law_acceleration[law])
    return bool(regimes[law] == OPEN or abs(at.velocity[law]) <= INSTANT_S * a or is_still(at, tolerance, law, LEAP))


@borrowing_kernel
def mark_standing(at: Equations, tolerance: Array, regimes: Indices, at_root: Array) -> None:
    """Mark the signals of sliding laws without velocity as zero, unless other laws keep them so."""
    for i in range(len(at.gap)):
        if at_root[2 * i] != KEPT and is_stationary(at, tolerance, regimes, i):
            at_root[2 * i] = AT_ROOT


@borrowing_kernel
def pass_law(system: Any, t: float, y: Array, regimes: Indices, which: int, room: Room, log: Array, count: int) -> int:
    """Execute and log the event of a law's signal; return the number of events, or `CONTRADICTS`."""
    at, search, m, law, answer = room.at, room.search, len(room.candidates), which // 2, SOLVED
    for i in range(m):
        room.past[i] = regimes[i]
    prepare_instant(system, t, y, regimes, at)
    kept = is_stationary(at, room.tolerance, regimes, law) and is_held_by_others(at, regimes, law, room.cut)
    if kept or (regimes[law] == OPEN and at.velocity[law] > 0.0):  # nothing changes
        search.at_root[2 * law] = KEPT if kept else AT_ROOT
        mark_standing(at, room.tolerance, regimes, search.at_root)
        return count
    clear(search.at_root)
    if regimes[law] == OPEN and at.velocity[law] < 0.0:
        at.gap[law] = 0.0
        copy_numbers(y, room.before)
        begin_impact(system, t, y, regimes, at)
        answer = close_gaps(system, t, y, regimes, room)
        count = note_impact(system, t, room.before, y, at, log, count)
    else:
        answer = change_law(system, t, y, regimes, law, which % 2 == 1, room)
    mark_standing(at, room.tolerance, regimes, search.at_root)
    for i in range(m):
        begins = (room.past[i] != regimes[i] or room.struck[i] == STRUCK or i == law) and room.struck[i] != JUMPED
        if begins and regimes[i] != HOLD:
            search.at_root[2 * i] = AT_ROOT if begins_at_root(at, room.tolerance, regimes, i) else 0.0
    if answer != SOLVED:
        return CONTRADICTS
    count = change_regimes(system, t, y, room.past, regimes, at, log, count)
    for i in range(m):  # a law that the machine closes at zero velocity, or makes hold
        if room.past[i] == OPEN < regimes[i] < HOLD and at.restitution[i] < 0.0 and at.velocity[i] == 0.0:
            search.at_root[2 * i] = AT_ROOT
        elif regimes[i] == HOLD:
            search.at_root[2 * i] = 0.0
    return count


@borrowing_kernel
def advance(system: Any, t: float, span: float, y: Array, regimes: Indices, room: Room, log: Array, count: int) -> int:
    """Integrate a system over ``span`` (s) from ``t`` (s); return the number of events, negative for a failure.

    Parameters
    ----------
    system : NamedTuple
        Constants for whose type the functions of `laws` are declared.
    y : (2 n + k,) array
        Coordinates, velocities, quadratures; changed in place.
    regimes : (m + r,) array of int
        Regime of each law, then the machine's own; changed in place.
    room : Room
        From `room_in`; ``tolerance`` holds the largest error of a step.
    log : (rows, width) array
        Table of events, ``count`` of them filled; `LOG_FULL` is returned if it may become too short.
    """
    m, done, wanted = len(room.candidates), 0.0, span
    clear(room.search.lost)
    for i in range(m):
        room.series[LAST, i], room.series[ROUND, i], room.series[FASTEST, i] = -math.inf, math.inf, math.inf
    piece = PieceAt(place_of(Piece(system, regimes, room.at)), place_of(room.method))
    light = PieceAt(piece.place, place_of(DORMAND_PRINCE_5))
    clear(room.search.at_root)
    begin_piece(system, t, y, regimes)
    for _ in range(MOST_PIECES):
        copy_numbers(y, room.before)
        length, wanted, which, steps = advance_piece(
            piece, light, t + done, y, span - done, wanted, room.tolerance, MOST_STEPS, room.work, room.search
        )
        if steps < 0:
            return UNSTEADY if steps == -1 else TOO_LONG
        done += length
        end_piece(system, t + done, room.before, y, regimes)
        room.steps[0] += max(steps, 1)
        if which == NOTHING:
            return count
        if len(log) - count < 2 * m + 2:
            return LOG_FULL
        clear(room.search.lost)  # the state set by an event is exact
        if which >= 2 * m:
            clear(room.search.at_root)
            count = pass_signal(system, which - 2 * m, t + done, y, regimes, log, count)
        else:
            count = pass_law(system, t + done, y, regimes, which, room, log, count)
        if count < 0 or span - done <= 1e-15 * span:
            return count
        begin_piece(system, t + done, y, regimes)
    return TOO_MANY
