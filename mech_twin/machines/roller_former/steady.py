"""Steady turn, start-up and summary of the roller former, motor and mechanism solved together."""

from __future__ import annotations

from dataclasses import dataclass
from math import inf, isfinite, nan, pi

import numpy as np
from numpy.typing import NDArray

from mech_twin.kernel import kernel
from mech_twin.machines.roller_former.cart_parameters import RESIST, REVERSING
from mech_twin.machines.roller_former.cart_statics import load_moments, sides_of_travel
from mech_twin.machines.roller_former.dynamics import (
    CRANK,
    DIRECTION,
    ENGAGED,
    EVENT_ROWS,
    MODES,
    SHARE,
    SIZE,
    SLOW,
    SPEED,
    STALLED,
    TWIST,
    TWIST_RATE,
    Former,
    Stretch,
    Torque,
    coupling_moment,
    motor_moment,
    rates,
)
from mech_twin.machines.roller_former.integration import advance_motion
from mech_twin.machines.roller_former.parameters import RollerFormer
from mech_twin.parts.supply import limited_command

TURN = 2.0 * pi
CRITERION = 1e-11
MOST_TURNS = 2000
NODES = 1440
GRID = 7200
LONGEST_START_S = 60.0
STARTUP_CHUNK_S = 0.001
COLUMNS = (
    "time_s",
    "crank_rad",
    "crank_speed",
    "twist_rad",
    "twist_rate",
    "twist_acceleration",
    "coupling_nm",
    "drive_nm",
)


@dataclass(frozen=True)
class SteadyTurn:
    """One turn of the periodic motion.

    ``columns`` is one row per node of equal time: time (s), crank angle (rad) and speed (rad/s), twist (rad), its rate
    (rad/s) and acceleration (rad/s^2), moment in the coupling and of the drive (N m).  ``change`` is the largest change
    of twist, crank speed and twist rate from the turn before, over their scales.
    """

    turn_time_s: float
    turns_taken: int
    change: float
    columns: NDArray[np.float64]
    stiffness_nm_per_rad: float

    @property
    def mean_speed_rad_per_s(self) -> float:
        """Mean crank speed over the turn."""
        return TURN / self.turn_time_s

    @property
    def elastic_nm(self) -> NDArray[np.float64]:
        """Elastic moment c (phi1 - phi2) at the nodes."""
        return self.stiffness_nm_per_rad * self.columns[:, 3]

    @property
    def coupling_nm(self) -> NDArray[np.float64]:
        """Moment in the coupling at the crank, elastic and damping part, at the nodes."""
        column: NDArray[np.float64] = self.columns[:, 6]
        return column

    def extremes(self, column: int) -> tuple[float, float]:
        """Return smallest and largest value of a column, a parabola laid through the nodes about each."""
        return closed_extremes(self.columns[:, column])


def closed_extremes(values: NDArray[np.float64]) -> tuple[float, float]:
    """Return smallest and largest value of a periodic curve sampled at equal steps."""
    found = []
    for sign in (-1.0, 1.0):
        curve = sign * values
        at = int(np.argmax(curve))
        before, here, after = curve[at - 1], curve[at], curve[(at + 1) % curve.size]
        bend = before - 2.0 * here + after
        lift = (before - after) ** 2 / (8.0 * -bend) if bend < 0.0 else 0.0
        found.append(float(sign * (here + lift)))
    return found[0], found[1]


@kernel
def next_section(
    former: Former, command: float, t: float, y: NDArray[np.float64], modes: NDArray[np.float64], longest_s: float
) -> float:
    """Carry the state on by one whole turn; return the time reached, nan if the turn does not end in time."""
    events = np.zeros((EVENT_ROWS, 3))
    stop = y[CRANK] + TURN
    reached, count = advance_motion(
        former, Torque(True, command, 0.0, 0.0, 0.0), t, t + longest_s, y, modes, events, stop
    )
    if y[CRANK] < stop or count < 0:
        return float(np.nan)
    y[CRANK] = stop - TURN
    return reached


@kernel
def turn_nodes(
    former: Former,
    command: float,
    turn_time_s: float,
    nodes: int,
    start: NDArray[np.float64],
    modes: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Return the columns of `SteadyTurn` over one turn from ``start``."""
    table = np.empty((nodes, 8))
    y, out = start.copy(), np.empty((1, SIZE))
    sides = np.empty(former.bank.carts.shape[0])
    events = np.zeros((EVENT_ROWS, 3))
    torque = Torque(True, command, 0.0, 0.0, 0.0)
    for node in range(nodes):
        t = turn_time_s * node / nodes
        low, high = sides_of_travel(former.bank, y[CRANK], sides)
        rates(former, torque, Stretch(t, modes[DIRECTION], 1.0, 0.0, low, high, 0.0, 0.0), sides, t, y, out, 0)
        table[node, 0], table[node, 1], table[node, 2], table[node, 3] = t, y[CRANK], y[SPEED], y[TWIST]
        table[node, 4], table[node, 5] = y[TWIST_RATE], out[0, TWIST_RATE]
        table[node, 6] = coupling_moment(former, y)
        table[node, 7] = motor_moment(former, torque, t, y[SPEED] + y[TWIST_RATE])
        modes[5] = 0.0
        advance_motion(former, torque, t, turn_time_s * (node + 1) / nodes, y, modes, events, np.inf)
    return table


def steady_turn(
    former: Former, crank_rad: float = 0.0, nodes: int = NODES, most_turns: int = MOST_TURNS
) -> SteadyTurn | None:
    """Return the periodic motion under full load at rated supply, or None if the motor cannot keep it up.

    Started at synchronous speed, untwisted.  Steady means: from one passage of the starting crank angle to the next,
    twist, crank speed and twist rate change by less than 1e-11 of their scales (twist of the rated moment, synchronous
    speed).  None as well if that does not happen within ``most_turns``.
    """
    speed = former.motor.synchronous_speed_rad_per_s / former.ratio
    y = np.array([crank_rad, 0.0, speed, 0.0, 0.0, 0.0, 0.0])
    modes = np.zeros(MODES)
    modes[[DIRECTION, ENGAGED, SHARE, SLOW]] = 1.0, 1.0, 1.0, -1.0
    parts, t = [TWIST, SPEED, TWIST_RATE], 0.0
    scales = np.array([former.scales[part] for part in parts])
    for turns in range(1, most_turns + 1):
        before = y.copy()
        end = next_section(former, 1.0, t, y, modes, 20.0 * TURN / speed)
        if not isfinite(end) or modes[STALLED]:
            return None
        change = float(np.max(np.abs((y - before)[parts]) / scales))
        if change < CRITERION:
            table = turn_nodes(former, 1.0, end - t, nodes, y, modes)
            return SteadyTurn(end - t, turns, change, table, former.stiffness_nm_per_rad)
        y[4:] = 0.0
        t = end
    return None


@dataclass(frozen=True)
class StartUp:
    """A start: whether it stalled, and when crank speed first reached the speed asked for (nan if never)."""

    stalled: bool
    time_s: float


def start_up(parameters: RollerFormer, former: Former, speed_rad_per_s: float) -> StartUp:
    """Return how the configured start goes, up to a crank speed; a stall ends it."""
    p = parameters
    at = p.start.speed_fraction * p.synchronous_crank_speed_rad_per_s
    loaded = former.engage_speed_rad_per_s <= at
    holding = loaded and former.bank.load in (REVERSING, RESIST) and at == 0.0
    y = np.array([np.radians(p.start.crank_deg), 0.0, at, 0.0, 0.0, 0.0, 0.0])
    modes = np.zeros(MODES)
    modes[[DIRECTION, ENGAGED, SHARE, SLOW]] = 0.0 if holding else 1.0, loaded, loaded, -1.0
    events, command = np.zeros((EVENT_ROWS, 3)), p.supply.initial_fraction
    for chunk in range(round(LONGEST_START_S / STARTUP_CHUNK_S)):
        if y[SPEED] >= speed_rad_per_s:
            return StartUp(False, chunk * STARTUP_CHUNK_S)
        if modes[STALLED]:
            return StartUp(True, nan)
        command = limited_command(command, 1.0, p.supply.rate_per_s, STARTUP_CHUNK_S)
        t, before = chunk * STARTUP_CHUNK_S, y[SPEED]
        torque = Torque(True, command, 0.0, 0.0, 0.0)
        advance_motion(former, torque, t, t + STARTUP_CHUNK_S, y, modes, events, inf)
        if y[SPEED] >= speed_rad_per_s > before:
            part = (speed_rad_per_s - before) / (y[SPEED] - before)
            return StartUp(False, float(t + part * STARTUP_CHUNK_S))
    return StartUp(False, nan)


def moment_figures(former: Former) -> dict[str, float]:
    """Return mean and largest load moment over a turn, in all and per cart of the shaft (N m)."""
    angles = np.linspace(0.0, TURN, GRID, endpoint=False)
    moments = load_moments(former.bank, angles, 1.0)
    mean, count = float(np.mean(moments)), former.bank.carts.shape[0]
    most = closed_extremes(moments)[1]
    return {
        "moment_mean_nm": mean,
        "moment_max_nm": most,
        "moment_mean_per_cart_nm": mean / count,
        "moment_max_per_cart_nm": most / count,
    }


def turn_figures(turn: SteadyTurn, former: Former) -> dict[str, float]:
    """Return the dynamic figures of a steady turn."""
    elastic = former.stiffness_nm_per_rad * np.array(turn.extremes(3))
    spans = {name: float(np.ptp(turn.extremes(column))) for name, column in (("twist", 3), ("rate", 4), ("bend", 5))}
    coupling = turn.coupling_nm
    low, high = turn.extremes(6)
    return {
        "elastic_moment_min_nm": float(elastic[0]),
        "elastic_moment_max_nm": float(elastic[1]),
        "elastic_moment_rms_nm": float(np.sqrt(np.mean(turn.elastic_nm**2))),
        "coupling_moment_min_nm": low,
        "coupling_moment_max_nm": high,
        "coupling_moment_mean_nm": float(np.mean(coupling)),
        "coupling_moment_rms_nm": float(np.sqrt(np.mean(coupling**2))),
        "coupling_moment_rms_about_mean_nm": float(np.std(coupling)),
        "coupling_moment_at_motor_max_nm": max(abs(low), abs(high)) / former.ratio,
        "twist_range_rad": spans["twist"],
        "twist_rate_range_rad_per_s": spans["rate"],
        "twist_acceleration_range_rad_per_s2": spans["bend"],
        "steady_speed_rad_per_s": turn.mean_speed_rad_per_s,
        "steady_turns_taken": float(turn.turns_taken),
        "drive_power_mean_w": float(np.mean(turn.columns[:, 7] * (turn.columns[:, 2] + turn.columns[:, 4]))),
    }


def former_report(parameters: RollerFormer, former: Former) -> dict[str, float]:
    """Return the summary: static moments, power, and, where the motor keeps the load up, the steady turn and the start.

    ``steady_1`` and ``start_stalls_1`` are 1 for yes; figures that do not exist are left out.
    """
    figures = moment_figures(former)
    figures["power_required_w"] = (
        figures["moment_mean_nm"] * parameters.rated_crank_speed_rad_per_s / parameters.drive.efficiency
    )
    turn = steady_turn(former)
    figures["steady_1"] = float(turn is not None)
    if turn is not None:
        figures.update(turn_figures(turn, former))
        rated = parameters.drive.coupling_rated_moment_nm
        figures["coupling_load_of_rated_1"] = figures["coupling_moment_at_motor_max_nm"] / rated
    goal = turn.mean_speed_rad_per_s if turn is not None else parameters.rated_crank_speed_rad_per_s
    start = start_up(parameters, former, goal)
    figures["start_stalls_1"] = float(start.stalled)
    if isfinite(start.time_s):
        figures["startup_time_s"] = start.time_s
    return figures
