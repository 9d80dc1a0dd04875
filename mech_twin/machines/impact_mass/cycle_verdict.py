# SPDX-License-Identifier: Apache-2.0
"""Assessment of one-impact cycles of the impact mass: multipliers, stability margin, basin, endurance."""

from dataclasses import dataclass

import numpy as np

from mech_twin.errors import StudyError
from mech_twin.machines.impact_mass.dynamics import (
    AT_REST,
    FLIGHT,
    LEFT,
    ImpactSystem,
    MassMotion,
    fates,
    rests_for_good,
)
from mech_twin.machines.impact_mass.metrics import admissible
from mech_twin.machines.impact_mass.one_impact_cycle import OneImpactCycle, one_impact_cycle
from mech_twin.machines.impact_mass.parameters import ImpactMass
from mech_twin.machines.impact_mass.regimes import GOING, recorded

BORDER = 1e-9  # of a phase: a blow this near the change of the force stands on the border of existence
NEAR = 1e-6  # of the stroke and of the blow's speed: a start this near the cycle at three period starts is at it
BASIN_PERIODS = 5000
BATCH_STARTS = 1000  # of one kernel call: between two calls a signal is answered
BATCH_PERIODS = 100_000


@dataclass(frozen=True)
class StartBox:
    """Box of uniform random initial states at the start of a period: gap (m), velocity (m/s), number, seed."""

    gap_max_m: float
    velocity_min_m_per_s: float
    velocity_max_m_per_s: float
    starts: int
    seed: int


@dataclass(frozen=True)
class Basin:
    """Outcomes of the random initial states; ``fraction`` is the share that reached the cycle."""

    box: StartBox
    reached: int
    at_rest: int
    left: int
    other: int
    fraction: float
    slowest_periods: int


@dataclass(frozen=True)
class CycleVerdict:
    """Judgement of a one-impact cycle.

    ``margin`` is 1 - |largest multiplier|.  On the border the blow coincides with the change of the force: a late
    blow is under A2 and an early one under A1.  The worse of both counts, and the cycle is not stable.
    """

    exists: bool
    admissible: bool
    on_border: bool
    stable: bool
    margin: float
    multipliers: tuple[complex, complex]
    other_side_multipliers: tuple[complex, complex] | None
    basin: Basin | None
    reason: str


@dataclass(frozen=True)
class Endurance:
    """Endurance of a cycle: periods in a row with exactly one impact; ``rests_in_period`` counts from 1, 0: never."""

    period_s: float
    periods: int
    held_periods: int
    rests_in_period: int
    least_blow_m_per_s: float
    largest_blow_m_per_s: float


def phase2_cycle(parameters: ImpactMass) -> OneImpactCycle:
    """Return the closed form of the one-impact motion with its blow in phase 2.

    Raises
    ------
    StudyError
        If there is none, naming the inequality and its numbers.
    """
    p, cycle = parameters, one_impact_cycle(parameters.system, 1)
    if cycle is None:
        mean = p.phase1_force_n * p.phase1_duration_s + p.phase2_force_n * (p.period_s - p.phase1_duration_s)
        raise StudyError(
            "no cycle: P1 t1 + P2 (T - t1) > 0 and P1 != P2 do not both hold: "
            f"{mean!r} N s, P1 = {p.phase1_force_n!r} N, P2 = {p.phase2_force_n!r} N"
        )
    return cycle


def default_box(stroke_m: float, impact_speed_m_per_s: float, starts: int, seed: int) -> StartBox:
    """Return the box gap 0 to 2 strokes, velocity -v- to v-."""
    return StartBox(2.0 * stroke_m, -impact_speed_m_per_s, impact_speed_m_per_s, starts, seed)


def basin(system: ImpactSystem, cycle: OneImpactCycle, box: StartBox) -> Basin:
    """Return the outcomes of the seeded random initial states of a box within `BASIN_PERIODS`."""
    random = np.random.default_rng(box.seed)
    gaps = random.uniform(0.0, box.gap_max_m, box.starts)
    velocities = random.uniform(box.velocity_min_m_per_s, box.velocity_max_m_per_s, box.starts)
    tolerances = (NEAR * box.gap_max_m, NEAR * cycle.impact_speed_m_per_s)
    gap, velocity = max(cycle.start_gap_m, 0.0), cycle.start_velocity_m_per_s
    target = MassMotion(0.0, 0.0, 0.0, gap, velocity, FLIGHT, 0.0, 0.0, 0.0)
    batches = (slice(i, i + BATCH_STARTS) for i in range(0, box.starts, BATCH_STARTS))
    found = np.concatenate(
        [fates(gaps[part], velocities[part], system, target, tolerances, BASIN_PERIODS) for part in batches]
    )
    reached, rest, left = int(np.sum(found >= 0)), int(np.sum(found == AT_REST)), int(np.sum(found == LEFT))
    slowest = int(found.max()) if reached else 0
    other = box.starts - reached - rest - left
    return Basin(box, reached, rest, left, other, reached / box.starts, slowest)


def verdict(parameters: ImpactMass, box: StartBox | None) -> CycleVerdict:
    """Return the judgement of the one-impact cycle with its blow in phase 2; no basin where ``box`` is None."""
    cycle = phase2_cycle(parameters)
    system = parameters.system
    share = cycle.position_share
    border = min(abs(share), abs(1.0 - share)) <= BORDER
    exists = border or 0.0 < share < 1.0
    clear = exists and admissible(cycle, system)
    early = one_impact_cycle(system, 0) if border else None
    other = early and early.multipliers
    worst = max(abs(m) for pair in (cycle.multipliers, other or ()) for m in pair)
    stable = clear and not border and worst < 1.0
    found = basin(system, cycle, box) if box is not None and exists else None
    reason = _reason(exists, clear, border, worst, share)
    return CycleVerdict(exists, clear, border, stable, 1.0 - worst, cycle.multipliers, other, found, reason)


def _reason(exists: bool, clear: bool, border: bool, worst: float, share: float) -> str:
    if not exists:
        return f"no such motion: 0 <= w/(T - t1) <= 1 does not hold for the blow's place: {share!r}"
    if not clear:
        return "not admissible: something strikes between the blows"
    if border:
        return f"on the border of existence: the blow falls on the change of the force; largest multiplier {worst:.6g}"
    if worst >= 1.0:
        return f"unstable: largest multiplier < 1 does not hold: {worst:.6g}"
    return f"stable: largest multiplier {worst:.6g} < 1"


def endurance(parameters: ImpactMass, periods: int) -> Endurance:
    """Return the number of one-impact periods from the configured start, and the period in which the mass rests."""
    system, motion = parameters.system, parameters.start
    walked, ended, ends, single, blows, held = 0, GOING, False, True, [0.0, 0.0], 0
    while walked < periods and ended == GOING:
        motion, ended, count, table = recorded(motion, system, min(periods - walked, BATCH_PERIODS))
        others = np.flatnonzero((table.impacts[:count] != 1.0) | (table.chatter_ends[:count] > 0.0))
        alone = table.hardest_m_per_s[: others[0] if len(others) else count] if single else np.empty(0)
        if len(alone):
            blows = [min(blows[0] if held else np.inf, alone.min()), max(blows[1], alone.max())]
        single, held, walked = single and not len(others), held + len(alone), walked + count
        ends = bool(table.chatter_ends[count - 1] > 0.0) if count else ends
    since = walked - 1 if ends else walked  # a series that ended within a period, or a rest from its start
    rests = since < periods and rests_for_good(motion, system)
    return Endurance(parameters.period_s, periods, held, since + 1 if rests else 0, float(blows[0]), float(blows[1]))
