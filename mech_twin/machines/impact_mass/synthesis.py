# SPDX-License-Identifier: Apache-2.0
"""Synthesis of a one-impact cycle of the impact mass: the published one, and a robust one.

The published synthesis with v0 = 0 always gives P2 = R^2 P1.  There the blow coincides with the change of the force,
which is the border of existence.  The robust synthesis keeps v-, T and t1 and so <A> = v- (1 + R)/T; P2 stays free,
with P1 = (m <A> T - P2 (T - t1))/t1.  P2 is searched over its stable range.  A cycle needs the required stroke and
margin 1 - |multiplier|, and its basin must hold in the worst case tried over a box of tolerances of P1, P2, t1, T
and R.  Of those the one that holds over the widest box is chosen, and certified (see `tolerance_box`).
"""

import math
from dataclasses import dataclass, replace

from mech_twin.capabilities.progress import tell
from mech_twin.engine.coupling import Coupling
from mech_twin.errors import StudyError
from mech_twin.machines.impact_mass.cycle_verdict import (
    CycleVerdict,
    Endurance,
    StartBox,
    default_box,
    endurance,
    phase2_cycle,
    verdict,
)
from mech_twin.machines.impact_mass.dynamics import acceleration, gap_after, next_event, phase_end
from mech_twin.machines.impact_mass.metrics import after_blow
from mech_twin.machines.impact_mass.one_impact_cycle import CycleSpec, least_stability_number, synthesised_cycle
from mech_twin.machines.impact_mass.parameters import ImpactMass
from mech_twin.machines.impact_mass.tolerance_box import (
    NOMINAL,
    Certificate,
    certified,
    corners,
    faces,
    inside,
    outcome,
)
from mech_twin.parts.induction_motor import SupplyParameters

CANDIDATES = 120
STEPS_PER_PERIOD = 50.0
SCREEN_STARTS, SCREEN_INSIDE = 40, 24  # random starts and random points of the box in a first look
TOLERANCE_MULTIPLES = (1.0, 1.5, 2.0, 3.0, 4.0, 5.0)  # of the asked tolerance, over which a candidate may hold too
CERTIFIED_MOST = 8  # candidates tried in full before the search gives up


@dataclass(frozen=True)
class RobustnessSpec:
    """Requirements on a robust cycle.

    ``margin`` is 1 - |multiplier| of the nominal cycle; ``basin_fraction`` the share of the random starts that reach
    the cycle, at every point tried of the box P1, P2, t1, T, R each within the relative ``tolerance``.
    ``stroke_ratio`` bounds the largest gap of the cycle over the asked stroke, ``start_speed_ratio`` its speed at the
    start of a period over the asked impact speed.  ``inside`` is the number of random points in the certificate.
    """

    margin: float = 0.1
    basin_fraction: float = 0.999
    tolerance: float = 0.01
    stroke_ratio: float = 2.5
    start_speed_ratio: float = 1.0
    starts: int = 1000
    seed: int = 1
    inside: int = 300


@dataclass(frozen=True)
class CycleDesign:
    """A cycle: the configuration that runs it, its verdict, and its endurance at T in full and at T as printed.

    ``stroke_m`` is the largest gap of the cycle; ``certificate`` is None where no box was tried.
    """

    name: str
    parameters: ImpactMass
    impact_speed_m_per_s: float
    impact_tau_s: float
    stroke_m: float
    verdict: CycleVerdict
    endurance: tuple[Endurance, ...]
    certificate: Certificate | None


@dataclass(frozen=True)
class Synthesis:
    """Both cycles side by side, for the same spec, judged in the same box."""

    spec: CycleSpec
    robustness: RobustnessSpec
    published: CycleDesign
    robust: CycleDesign


def cycle_spec(parameters: ImpactMass, impact_speed_m_per_s: float) -> CycleSpec:
    """Return the specification of a cycle of this impact speed for the configured mass, stop, start and restitution."""
    p = parameters
    start = p.initial_position_m, p.initial_velocity_m_per_s
    return CycleSpec(p.mass_kg, p.stop_position_m, *start, impact_speed_m_per_s, p.rebound)


def published_parameters(spec: CycleSpec) -> ImpactMass:
    """Return the configuration of the published synthesis; see `synthesised_cycle` for its errors."""
    found = synthesised_cycle(spec)
    return ImpactMass(
        mass_kg=spec.mass_kg,
        stop_position_m=spec.stop_position_m,
        restitution=spec.restitution,
        period_s=found.period_s,
        phase1_duration_s=found.phase1_duration_s,
        phase1_force_n=found.phase1_force_n,
        phase2_force_n=found.phase2_force_n,
        initial_position_m=spec.initial_position_m,
        initial_velocity_m_per_s=spec.initial_velocity_m_per_s,
        supply=SupplyParameters(initial_fraction=1.0, rate_per_s=2.0),
        coupling=Coupling(step_s=_handy_step(found.period_s)),
    )


def _handy_step(period_s: float) -> float:
    """Return a power of ten times 1, 2 or 5 near a fiftieth of the period, at most 1 ms."""
    wanted = min(period_s / STEPS_PER_PERIOD, 0.001)
    decade = 10.0 ** math.floor(math.log10(wanted))
    return float(f"{max(f for f in (1.0, 2.0, 5.0) if f * decade <= wanted * (1.0 + 1e-12)) * decade:.3g}")


def with_phase2_force(published: ImpactMass, impact_speed_m_per_s: float, phase2_force_n: float) -> ImpactMass:
    """Return the configuration with the same v-, T and t1 and this P2, started on its own cycle."""
    p = published
    total_ns = p.mass_kg * impact_speed_m_per_s * (1.0 + p.rebound)
    phase1_force_n = (total_ns - phase2_force_n * (p.period_s - p.phase1_duration_s)) / p.phase1_duration_s
    changed = p.model_copy(update={"phase1_force_n": phase1_force_n, "phase2_force_n": phase2_force_n})
    cycle = phase2_cycle(changed)
    start = {
        "initial_position_m": p.stop_position_m - max(cycle.start_gap_m, 0.0),
        "initial_velocity_m_per_s": cycle.start_velocity_m_per_s,
    }
    return ImpactMass.model_validate({**changed.model_dump(), **start})


@dataclass(frozen=True)
class _Candidate:
    """A choice of P2, its basin, and the largest multiple of the tolerance over which it passes the screening."""

    parameters: ImpactMass
    margin: float
    fraction: float
    widest: float


def _nominal_candidates(spec: CycleSpec, published: ImpactMass, robustness: RobustnessSpec) -> list[ImpactMass]:
    """Return the candidates over the stable range of q = A2/<A> that keep margin, stroke and start speed."""
    mean_n = spec.mass_kg * spec.impact_speed_m_per_s * (1.0 + spec.restitution) / published.period_s
    low = least_stability_number(spec.restitution)
    numbers = [low + (1.0 - low) * i / CANDIDATES for i in range(1, CANDIDATES)]
    made = [with_phase2_force(published, spec.impact_speed_m_per_s, q * mean_n) for q in numbers]
    judged = [(parameters, verdict(parameters, None)) for parameters in made]
    steady = [(parameters, found) for parameters, found in judged if found.stable]
    keeping = [parameters for parameters, found in steady if found.margin >= robustness.margin]
    if not keeping:
        largest = max((found.margin for _, found in steady), default=-math.inf)
        raise StudyError(
            f"no robust cycle: margin >= {robustness.margin!r} does not hold: largest margin of an admissible "
            f"stable cycle {largest!r}"
        )
    bounded = [
        parameters
        for parameters in keeping
        if cycle_stroke(parameters) <= robustness.stroke_ratio * spec.stroke_m
        and abs(parameters.initial_velocity_m_per_s) <= robustness.start_speed_ratio * spec.impact_speed_m_per_s
    ]
    if not bounded:
        stroke = min(cycle_stroke(parameters) for parameters in keeping) / spec.stroke_m
        speed = min(abs(parameters.initial_velocity_m_per_s) for parameters in keeping) / spec.impact_speed_m_per_s
        raise StudyError(
            f"no robust cycle: stroke_ratio <= {robustness.stroke_ratio!r} and start_speed_ratio <= "
            f"{robustness.start_speed_ratio!r} do not both hold: smallest that were found {stroke!r}, {speed!r}"
        )
    return bounded


def _screened(parameters: ImpactMass, box: StartBox, robustness: RobustnessSpec) -> _Candidate:
    """Return a candidate with the widest box over which a screening finds no failure (0: it fails nominally).

    A screening has few starts; it fails if these alone have more failures than are allowed for all starts.
    """
    few = replace(box, starts=min(SCREEN_STARTS, box.starts))
    least = 1.0 - (1.0 - robustness.basin_fraction) * box.starts / few.starts
    nominal = outcome(parameters, NOMINAL, few)
    if nominal.fraction < least:
        return _Candidate(parameters, nominal.margin, nominal.fraction, -1.0)
    widest = 0.0
    for multiple in TOLERANCE_MULTIPLES:
        tolerance = multiple * robustness.tolerance
        points = [*corners(tolerance), *faces(tolerance), *inside(tolerance, SCREEN_INSIDE, box.seed)]
        if any(outcome(parameters, point, few).fraction < least for point in points):
            break
        widest = multiple
    return _Candidate(parameters, nominal.margin, nominal.fraction, widest)


def robust_parameters(spec: CycleSpec, robustness: RobustnessSpec) -> tuple[ImpactMass, Certificate]:
    """Return the configuration of the robust cycle with the asked v- and the published T and t1, and its certificate.

    Raises
    ------
    StudyError
        If no forces meet the demand, naming the inequality that fails and the best that was found.
    """
    if robustness.margin > 1.0 - spec.restitution:
        raise StudyError(
            "no robust cycle: margin <= 1 - restitution does not hold (the product of the multipliers is R^2): "
            f"{robustness.margin!r}, {1.0 - spec.restitution!r}"
        )
    if not 0.0 <= robustness.tolerance < 1.0:
        raise StudyError(f"no robust cycle: 0 <= tolerance < 1 does not hold: {robustness.tolerance!r}")
    published = published_parameters(spec)
    box = default_box(spec.stroke_m, spec.impact_speed_m_per_s, robustness.starts, robustness.seed)
    screened = [_screened(p, box, robustness) for p in _nominal_candidates(spec, published, robustness)]
    if all(candidate.widest < 0.0 for candidate in screened):
        largest = max(candidate.fraction for candidate in screened)
        raise StudyError(
            f"no robust cycle: basin_fraction >= {robustness.basin_fraction!r} does not hold with margin >= "
            f"{robustness.margin!r} even without any deviation: largest that was found {largest!r}"
        )
    tried: list[Certificate] = []
    least = TOLERANCE_MULTIPLES[0] if robustness.tolerance > 0.0 else 0.0
    holding = [candidate for candidate in screened if candidate.widest >= least]
    for candidate in sorted(holding, key=lambda c: (c.widest, c.margin), reverse=True)[:CERTIFIED_MOST]:
        found = certified(candidate.parameters, robustness.tolerance, box, robustness.inside)
        if found.worst_fraction >= robustness.basin_fraction:
            return candidate.parameters, found
        tried.append(found)
    best = max((found.worst_fraction for found in tried), default=0.0)
    raise StudyError(
        f"no robust cycle: tolerance = {robustness.tolerance!r} does not hold: of {len(screened)} candidates "
        f"{len(holding)} keep basin_fraction >= {robustness.basin_fraction!r} at the points of a first look and none "
        f"at all points tried; best worst case {best!r}"
    )


def cycle_stroke(parameters: ImpactMass) -> float:
    """Return the largest gap of the one-impact cycle with its blow in phase 2, m."""
    system = parameters.system
    motion = after_blow(phase2_cycle(parameters), system)
    largest = 0.0
    for _ in range(3):  # what is left of phase 2, phase 1, and phase 2 up to the next impact
        a, end = acceleration(motion, system), phase_end(motion, system)
        turning_s = -motion.velocity_m_per_s / a if a != 0.0 else -1.0
        ends_s = (end - motion.tau_s, turning_s if 0.0 < turning_s < end - motion.tau_s else 0.0)
        largest = max(largest, *(gap_after(motion, system, duration)[0] for duration in ends_s))
        event, motion = next_event(motion, system)
        if event.impacts > 0.0:
            break
    return largest


def printed_periods(period_s: float) -> tuple[float, ...]:
    """Return T with the digits of print: rounded to four decimals, and truncated to three."""
    return round(period_s, 4), math.floor(period_s * 1000.0) / 1000.0


def design(
    name: str, parameters: ImpactMass, box: StartBox, periods: int, certificate: Certificate | None
) -> CycleDesign:
    """Return a cycle with its verdict and its endurance at T in full precision and at T as printed."""
    cycle = phase2_cycle(parameters)
    lasting = tuple(
        endurance(parameters.model_copy(update={"period_s": period_s}), periods)
        for period_s in (parameters.period_s, *printed_periods(parameters.period_s))
        if period_s > parameters.phase1_duration_s
    )
    judged = verdict(parameters, box)
    speed, tau = cycle.impact_speed_m_per_s, cycle.impact_tau_s
    return CycleDesign(name, parameters, speed, tau, cycle_stroke(parameters), judged, lasting, certificate)


def synthesise(spec: CycleSpec, robustness: RobustnessSpec | None = None, periods: int = 1_000_000) -> Synthesis:
    """Return the published and the robust cycle side by side.

    Parameters
    ----------
    spec : CycleSpec
        The cycle that is wanted.
    robustness : RobustnessSpec, optional
        What the robust cycle shall stand, its tolerance, and the seed of the basin.
    periods : int
        How long the endurance runs are.

    Raises
    ------
    StudyError
        If one of them has no solution, naming the inequality and its numbers.
    """
    robustness = robustness or RobustnessSpec()
    box = default_box(spec.stroke_m, spec.impact_speed_m_per_s, robustness.starts, robustness.seed)
    published = design("published", published_parameters(spec), box, periods, None)
    tell(1, 3)
    found, certificate = robust_parameters(spec, robustness)
    tell(2, 3)
    robust = design("robust", found, box, periods, certificate)
    return Synthesis(spec, robustness, published, robust)
