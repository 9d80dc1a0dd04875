# SPDX-License-Identifier: Apache-2.0
"""The system that is integrated: rates of the roller former's state, and the signals whose roots are its events.

Signals are numbers that turn positive when their event has happened.  Which of them can happen is decided when a
stretch begins (`fill_watches`).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mech_twin.engine.events import RISING, UNKNOWN, signals_of
from mech_twin.engine.integration import rates_of
from mech_twin.engine.tableaus import DORMAND_PRINCE_8
from mech_twin.kernel import borrowing_kernel, inline_kernel, kernel
from mech_twin.machines.roller_former.cart_statics import branching_terms, plain_terms, rod_weight_moment
from mech_twin.machines.roller_former.dynamics import (
    SIZE,
    TWIST_RATE,
    Array,
    DriveLine,
    Former,
    Modes,
    TravelStretch,
    coupling_moment,
    drive_band,
    gear_may_stick,
    may_stick,
    shaft_torque,
    state_of,
)
from mech_twin.parts.friction import sliding_torque

(
    HIGH,
    LOW,
    CRANK_TURNS,
    LOAD_ENGAGES,
    QUICKENS,
    SLACKENS,
    CRANK_AHEAD,
    CRANK_BACK,
    DRIVE_TURNS,
    DRIVE_AHEAD,
    DRIVE_BACK,
    SHAFT_TURNS,
) = range(12)
MOST_WATCHES = 12
RELEASE_MARGIN = 1e-9  # of what holds: a mass let go must not be held again by rounding
IDLE = 1e-4  # of the tolerance of a speed: what a kink of the gear's loss may change it by and not be looked for
FAR = 4.0  # times what the larger rate at either end of a step would change a signal by: it is not zero in between


class FormerMotion(NamedTuple):
    """The system during a stretch; ``sides`` are the half turns of the carts."""

    former: Former
    torque: DriveLine
    stretch: TravelStretch
    sides: Array


@rates_of(FormerMotion, DORMAND_PRINCE_8)
def motion_rates(motion: FormerMotion, t: float, y: Array, out: Array) -> None:
    """Fill ``out`` with the time derivative of the state; a sense of 0 is a mass that is stuck."""
    former, stretch, now = motion.former, motion.stretch, state_of(y)
    speed, rate = now.crank_speed_rad_per_s, now.twist_rate_rad_per_s
    transmitted = coupling_moment(former, now)
    load, friction, acceleration = 0.0, 0.0, 0.0
    if stretch.direction != 0.0:
        bank = former.bank
        if bank.plain:  # called here and not through shaft_terms, so that the compiler puts it in line
            inertia, slope, full = plain_terms(bank, now.crank_rad, motion.sides, stretch.direction)
        else:
            inertia, slope, full = branching_terms(bank, now.crank_rad, motion.sides, stretch.direction)
        load = full * (stretch.share + stretch.share_rate * (t - stretch.start_s))
        friction = -sliding_torque(former.coulomb_nm, former.viscous_nms_per_rad, speed, stretch.direction)
        opposing = load + friction + speed * speed * slope
        if bank.gravity_m_per_s2 > 0.0:
            opposing += rod_weight_moment(bank, now.crank_rad)
        acceleration = (transmitted - opposing) / inertia
    moment, drive_acceleration = transmitted, 0.0
    if stretch.drive_direction != 0.0:
        shaft = shaft_torque(former, motion.torque, t, speed + rate)
        moment = geared_smoothly(former, shaft, stretch.shaft_sense * stretch.drive_direction)
        drive_acceleration = (moment - transmitted) / former.motor_inertia_kg_m2
    out[0] = speed
    out[1] = rate
    out[2] = acceleration
    out[3] = drive_acceleration - acceleration
    out[4] = moment * (speed + rate)
    out[5] = former.damping_nms_per_rad * rate * rate
    out[6] = load * speed
    out[7] = friction * speed


@inline_kernel
def geared_smoothly(former: Former, shaft_nm: float, power_sense: float) -> float:
    """Return the moment at the crank (N m), the loss of the gear as at one sign of power: smooth over a stretch."""
    if former.loss_by_power and power_sense < 0.0:
        return shaft_nm * former.ratio / former.efficiency
    return shaft_nm * former.ratio * former.efficiency


@borrowing_kernel
def least_moment(former: Former) -> float:
    """Return a moment (N m) that is nothing, but more than 0: a moment of 0 that stays 0 is no event."""
    return 1e-18 * former.motor.breakdown_torque_nm


@borrowing_kernel
def release_signal(motion: FormerMotion, index: int, t: float, y: Array) -> float:
    """Return how far the moment in the coupling is beyond what holds a stuck crank (N m)."""
    former, stretch, now = motion.former, motion.stretch, state_of(y)
    share = stretch.share + stretch.share_rate * (t - stretch.start_s)
    load = share * (stretch.forward_nm if index == CRANK_AHEAD else stretch.backward_nm)
    rest = coupling_moment(former, now) - rod_weight_moment(former.bank, now.crank_rad)
    friction = former.coulomb_nm + RELEASE_MARGIN * (abs(load) + former.coulomb_nm) + least_moment(former)
    return rest - load - friction if index == CRANK_AHEAD else load - friction - rest


@borrowing_kernel
def drive_release_signal(motion: FormerMotion, index: int, t: float, y: Array) -> float:
    """Return how far the moment in the coupling is beyond what the gear of a stuck drive holds (N m)."""
    low, high = drive_band(motion.former, motion.torque, t)
    transmitted = coupling_moment(motion.former, state_of(y))
    least = least_moment(motion.former)
    if index == DRIVE_AHEAD:
        return low - abs(low) * RELEASE_MARGIN - least - transmitted
    return transmitted - high - abs(high) * RELEASE_MARGIN - least


@kernel
def turn_signal(motion: FormerMotion, index: int, t: float, y: Array) -> tuple[float, float]:
    """Return speed and acceleration of crank or drive against the sense of the stretch."""
    out = np.empty(SIZE)
    motion_rates(motion, t, y, out)
    now, rate = state_of(y), state_of(out)
    if index == CRANK_TURNS:
        sense = -motion.stretch.direction
        return sense * now.crank_speed_rad_per_s, sense * rate.crank_speed_rad_per_s
    sense = -motion.stretch.drive_direction
    return (
        sense * (now.crank_speed_rad_per_s + now.twist_rate_rad_per_s),
        sense * (rate.crank_speed_rad_per_s + rate.twist_rate_rad_per_s),
    )


@borrowing_kernel
def plain_signal(motion: FormerMotion, index: int, t: float, y: Array) -> float:
    """Return the signal of an event that cannot be missed between two steps: releases, and speeds that are reached."""
    former, now = motion.former, state_of(y)
    if index in (CRANK_AHEAD, CRANK_BACK):
        return release_signal(motion, index, t, y)
    if index in (DRIVE_AHEAD, DRIVE_BACK):
        return drive_release_signal(motion, index, t, y)
    if index == LOAD_ENGAGES:
        return now.crank_speed_rad_per_s - former.engage_speed_rad_per_s
    first = now.crank_speed_rad_per_s + now.twist_rate_rad_per_s
    if index == SHAFT_TURNS:
        return -motion.stretch.shaft_sense * shaft_torque(former, motion.torque, t, first) - least_moment(former)
    spare = first - former.slow_speed_rad_per_s * motion.torque.command
    return spare if index == QUICKENS else -spare


@signals_of(FormerMotion)
def motion_signals(motion: FormerMotion, index: int, t: float, y: Array) -> tuple[float, float]:
    """Return a number that turns positive when event ``index`` has happened, and its time derivative where needed."""
    now = state_of(y)
    if index in (CRANK_TURNS, DRIVE_TURNS):
        return turn_signal(motion, index, t, y)
    if index == HIGH:
        return now.crank_rad - motion.stretch.high_rad, now.crank_speed_rad_per_s
    if index == LOW:
        return motion.stretch.low_rad - now.crank_rad, -now.crank_speed_rad_per_s
    return plain_signal(motion, index, t, y), UNKNOWN


@borrowing_kernel
def watch_signal(watches: NDArray[np.int64], count: int, index: int, at_root: bool) -> int:
    """Add a signal to those that are watched; return their number."""
    watches[count, 0], watches[count, 1], watches[count, 2] = index, RISING, int(at_root)
    return count + 1


@borrowing_kernel
def fill_watches(motion: FormerMotion, modes: Modes, y: Array, watches: NDArray[np.int64]) -> int:
    """Fill ``watches`` (12, 3) with the events that may end the stretch; return their number."""
    former, stretch, now = motion.former, motion.stretch, state_of(y)
    count = 0
    if stretch.direction == 0.0:
        count = watch_signal(watches, count, CRANK_AHEAD, False)
        count = watch_signal(watches, count, CRANK_BACK, False)
    else:
        speed = now.crank_speed_rad_per_s  # away from a dead centre it stands on, to which it may come back
        count = watch_signal(watches, count, HIGH, now.crank_rad == stretch.high_rad and speed < 0.0)
        count = watch_signal(watches, count, LOW, now.crank_rad == stretch.low_rad and speed > 0.0)
        if may_stick(former, modes):
            count = watch_signal(watches, count, CRANK_TURNS, now.crank_speed_rad_per_s == 0.0)
    if gear_may_stick(former):
        if stretch.drive_direction == 0.0:
            count = watch_signal(watches, count, DRIVE_AHEAD, False)
            count = watch_signal(watches, count, DRIVE_BACK, False)
        else:
            at_rest = now.crank_speed_rad_per_s + now.twist_rate_rad_per_s == 0.0
            count = watch_signal(watches, count, DRIVE_TURNS, at_rest)
            count = watch_signal(watches, count, SHAFT_TURNS, False)
    if not modes.load_on:
        count = watch_signal(watches, count, LOAD_ENGAGES, False)
    if motion.torque.command > 0.0:
        count = watch_signal(watches, count, SLACKENS if modes.slow_s < 0.0 else QUICKENS, False)
    return count


@borrowing_kernel
def may_dip(before: float, after: float, rate_before: float, rate_after: float, span: float) -> bool:
    """Return whether a number that is positive at both ends of a step of ``span`` (s) may reach zero within it.

    It may not where it is far from zero at both ends, in what its rates there would change it by over the step.
    """
    return min(before, after) <= FAR * span * max(abs(rate_before), abs(rate_after))


@borrowing_kernel
def returned(sense: float, before: float, after: float, rate_before: float, rate_after: float, span: float) -> bool:
    """Return whether a speed may have gone through zero and back between two instants, ``span`` (s) apart."""
    return (
        sense * rate_before < 0.0 < sense * rate_after
        and sense * before >= 0.0
        and sense * after >= 0.0
        and may_dip(sense * before, sense * after, rate_before, rate_after, span)
    )


@borrowing_kernel
def may_release(motion: FormerMotion, y: Array, end_s: float, end: Array, span: float, rates: Array) -> bool:
    """Return whether what holds a stuck crank or drive may let go in a step."""
    former, torque, stretch = motion.former, motion.torque, motion.stretch
    start_s, begin, late = end_s - span, state_of(rates[0]), state_of(rates[12])
    rate_before, rate_after = coupling_moment(former, begin), coupling_moment(former, late)
    if stretch.direction == 0.0:
        load_rate = stretch.share_rate * max(abs(stretch.forward_nm), abs(stretch.backward_nm))
        before, after = abs(rate_before) + load_rate, abs(rate_after) + load_rate
        for index in (CRANK_AHEAD, CRANK_BACK):
            held, left = release_signal(motion, index, start_s, y), release_signal(motion, index, end_s, end)
            if may_dip(-held, -left, before, after, span):
                return True
    if stretch.drive_direction == 0.0:
        line_rate = 0.0 if torque.coupled else abs(torque.slope_nm_per_s) * former.ratio / former.efficiency
        before, after = abs(rate_before) + line_rate, abs(rate_after) + line_rate
        for index in (DRIVE_AHEAD, DRIVE_BACK):
            held = drive_release_signal(motion, index, start_s, y)
            left = drive_release_signal(motion, index, end_s, end)
            if may_dip(-held, -left, before, after, span):
                return True
    return False


@borrowing_kernel
def may_pass(motion: FormerMotion, modes: Modes, y: Array, end: Array, span: float, rates: Array) -> bool:
    """Return whether a speed may have passed a threshold within a step, or the crank a dead centre, and gone back."""
    former, stretch = motion.former, motion.stretch
    past, now, begin, late = state_of(y), state_of(end), state_of(rates[0]), state_of(rates[12])
    speed_before, speed_after = past.crank_speed_rad_per_s, now.crank_speed_rad_per_s
    if stretch.direction != 0.0 and speed_before * speed_after <= 0.0:
        return True
    rate_before, rate_after = begin.crank_speed_rad_per_s, late.crank_speed_rad_per_s
    engage = former.engage_speed_rad_per_s
    if not modes.load_on and may_dip(engage - speed_before, engage - speed_after, rate_before, rate_after, span):
        return True
    before, after = speed_before + past.twist_rate_rad_per_s, speed_after + now.twist_rate_rad_per_s
    rate_before, rate_after = rate_before + begin.twist_rate_rad_per_s, rate_after + late.twist_rate_rad_per_s
    slow, sense = former.slow_speed_rad_per_s * motion.torque.command, 1.0 if modes.slow_s < 0.0 else -1.0
    if motion.torque.command > 0.0 and may_dip(
        sense * (before - slow), sense * (after - slow), rate_before, rate_after, span
    ):
        return True
    if stretch.drive_direction == 0.0 or not (gear_may_stick(former) and motion.torque.coupled):
        return False
    reach = FAR * span * max(abs(rate_before), abs(rate_after))
    lowest = shaft_torque(former, motion.torque, 0.0, max(before, after) + reach)
    highest = shaft_torque(former, motion.torque, 0.0, min(before, after) - reach)
    return min(stretch.shaft_sense * lowest, stretch.shaft_sense * highest) <= 0.0


@borrowing_kernel
def something_happened(
    motion: FormerMotion, modes: Modes, y: Array, end_s: float, end: Array, span: float, rates: Array
) -> bool:
    """Return whether anything watched may have happened in a step from ``y`` to ``end``; most steps end here.

    ``end_s`` is the time at the end, ``span`` the step (s); ``rates`` holds the rates of the stages, after the last of
    them those at the end.
    """
    former, stretch, now = motion.former, motion.stretch, state_of(end)
    first = now.crank_speed_rad_per_s + now.twist_rate_rad_per_s
    fast = first >= former.slow_speed_rad_per_s * motion.torque.command
    turns, driven = stretch.direction != 0.0, stretch.drive_direction != 0.0
    crank, gear = turns and may_stick(former, modes), driven and gear_may_stick(former)
    ahead = stretch.direction * now.crank_speed_rad_per_s > 0.0 and stretch.drive_direction * first > 0.0
    if (
        (turns and (now.crank_rad >= stretch.high_rad or now.crank_rad <= stretch.low_rad))
        or (crank and stretch.direction * now.crank_speed_rad_per_s <= 0.0)
        or (gear and stretch.drive_direction * first <= 0.0)
        or (not modes.load_on and now.crank_speed_rad_per_s >= former.engage_speed_rad_per_s)
        or fast == (modes.slow_s >= 0.0)
    ):
        return True
    if gear and stretch.shaft_sense * shaft_torque(former, motion.torque, end_s, first) < 0.0:
        return True
    if not (turns and driven) and may_release(motion, y, end_s, end, span, rates):
        return True
    if not (ahead and modes.load_on) and may_pass(motion, modes, y, end, span, rates):
        return True
    past, begin, late = state_of(y), state_of(rates[0]), state_of(rates[12])
    if crank and returned(
        stretch.direction,
        past.crank_speed_rad_per_s,
        now.crank_speed_rad_per_s,
        begin.crank_speed_rad_per_s,
        late.crank_speed_rad_per_s,
        span,
    ):
        return True
    return gear and returned(
        stretch.drive_direction,
        past.crank_speed_rad_per_s + past.twist_rate_rad_per_s,
        first,
        begin.crank_speed_rad_per_s + begin.twist_rate_rad_per_s,
        late.crank_speed_rad_per_s + late.twist_rate_rad_per_s,
        span,
    )


@borrowing_kernel
def turned_idly(motion: FormerMotion, y: Array, end_s: float, end: Array, span: float) -> bool:
    """Return whether the motor's torque has changed its sign in a step in which the gear loses next to nothing.

    Of a motor that turns without load that is the noise of the integration, in step after step.
    """
    former, past, now = motion.former, state_of(y), state_of(end)
    if not gear_may_stick(former) or motion.stretch.drive_direction == 0.0:
        return False
    first = past.crank_speed_rad_per_s + past.twist_rate_rad_per_s
    last = now.crank_speed_rad_per_s + now.twist_rate_rad_per_s
    before = shaft_torque(former, motion.torque, end_s - span, first)
    after = shaft_torque(former, motion.torque, end_s, last)
    kink = former.ratio * (1.0 / former.efficiency - former.efficiency) * max(abs(before), abs(after))
    idle = kink * span <= IDLE * former.motor_inertia_kg_m2 * former.tolerances[TWIST_RATE]
    return motion.stretch.shaft_sense * after < 0.0 and idle


@kernel
def without_shaft(motion: FormerMotion) -> FormerMotion:
    """Return the motion with a torque of the motor whose sign is not looked at."""
    s = motion.stretch
    stretch = TravelStretch(
        s.start_s,
        s.direction,
        s.drive_direction,
        0.0,
        s.share,
        s.share_rate,
        s.low_rad,
        s.high_rad,
        s.forward_nm,
        s.backward_nm,
    )
    return FormerMotion(motion.former, motion.torque, stretch, motion.sides)
