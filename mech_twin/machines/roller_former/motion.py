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
    share = (stretch.share + stretch.share_rate * (t - stretch.start_s)) * (1.0 + RELEASE_MARGIN)
    friction = former.coulomb_nm * (1.0 + RELEASE_MARGIN)
    rest = coupling_moment(former, now) - rod_weight_moment(former.bank, now.crank_rad)
    friction += least_moment(former)
    if index == CRANK_AHEAD:
        return rest - stretch.forward_nm * share - friction
    return stretch.backward_nm * share - friction - rest


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
        count = watch_signal(watches, count, HIGH, False)
        count = watch_signal(watches, count, LOW, False)
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
def returned(sense: float, before: float, after: float, rate_before: float, rate_after: float) -> bool:
    """Return whether a speed may have gone through zero and back between two instants."""
    return sense * rate_before < 0.0 < sense * rate_after and sense * before >= 0.0 and sense * after >= 0.0


@borrowing_kernel
def something_happened(motion: FormerMotion, modes: Modes, y: Array, end_s: float, end: Array, rates: Array) -> bool:
    """Return whether anything watched may have happened in a step from ``y`` to ``end``; most steps end here.

    ``end_s`` is the time at the end, ``rates`` holds the rates of the stages, after the last of them those at the end.
    """
    former, stretch, now = motion.former, motion.stretch, state_of(end)
    first = now.crank_speed_rad_per_s + now.twist_rate_rad_per_s
    fast = first >= former.slow_speed_rad_per_s * motion.torque.command
    if (
        stretch.direction == 0.0
        or stretch.drive_direction == 0.0
        or now.crank_rad >= stretch.high_rad
        or now.crank_rad <= stretch.low_rad
        or stretch.direction * now.crank_speed_rad_per_s <= 0.0
        or stretch.drive_direction * first <= 0.0
        or not modes.load_on
        or fast == (modes.slow_s >= 0.0)
    ):
        return True
    gear = gear_may_stick(former)
    if gear and stretch.shaft_sense * shaft_torque(former, motion.torque, end_s, first) < 0.0:
        return True
    past, begin, late = state_of(y), state_of(rates[0]), state_of(rates[12])
    if may_stick(former, modes) and returned(
        stretch.direction,
        past.crank_speed_rad_per_s,
        now.crank_speed_rad_per_s,
        begin.crank_speed_rad_per_s,
        late.crank_speed_rad_per_s,
    ):
        return True
    return gear and returned(
        stretch.drive_direction,
        past.crank_speed_rad_per_s + past.twist_rate_rad_per_s,
        first,
        begin.crank_speed_rad_per_s + begin.twist_rate_rad_per_s,
        late.crank_speed_rad_per_s + late.twist_rate_rad_per_s,
    )
