"""Synthesis of a one-impact cycle of the impact mass: as published, and one that survives.

The published synthesis with v0 = 0 always lands on P2 = R^2 P1, where the blow falls on the change of the force: the
border of existence.  The robust synthesis keeps v-, T and t1 and so <A> = v- (1 + R)/T; that leaves P2 free, with
P1 = (m <A> T - P2 (T - t1))/t1.  P2 is scanned over its stable range; a candidate passes if its cycle exists, is
admissible, has the asked margin 1 - |multiplier| and the asked basin.  The chosen one has the largest margin among
those whose neighbours within the reserve pass too, so no small error of the forces ends it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from mech_twin.engine.coupling import Coupling
from mech_twin.machines.impact_mass.cycle_verdict import (
    CycleVerdict,
    Endurance,
    StartBox,
    basin,
    default_box,
    endurance,
    phase2_cycle,
    verdict,
)
from mech_twin.machines.impact_mass.one_impact_cycle import least_stability_number, synthesised_cycle
from mech_twin.machines.impact_mass.parameters import ImpactMass
from mech_twin.parts.supply import SupplyParameters

CANDIDATES = 240
STEPS_PER_PERIOD = 50.0
SCREEN = 40  # starts tried first; a candidate whose failures among them are too many already is not tried further


@dataclass(frozen=True)
class CycleSpec:
    """What the cycle shall be: mass, stop, start of the stroke, speed of the blow, restitution."""

    mass_kg: float
    stop_position_m: float
    initial_position_m: float
    initial_velocity_m_per_s: float
    impact_speed_m_per_s: float
    restitution: float

    @property
    def stroke_m(self) -> float:
        """Distance d = xc - x0, m."""
        return self.stop_position_m - self.initial_position_m


@dataclass(frozen=True)
class RobustnessSpec:
    """What a robust cycle shall stand: margin 1 - |multiplier|, share of the starts that reach it, reserve of P2.

    ``force_reserve`` is a share of the mean force m <A>: P2 may move by so much, with v- kept, and all still holds.
    """

    margin: float = 0.2
    basin_fraction: float = 0.999
    force_reserve: float = 0.02
    starts: int = 1000
    seed: int = 1


@dataclass(frozen=True)
class CycleDesign:
    """A cycle: the configuration that runs it, its verdict, and its endurance at T in full and at T as printed."""

    name: str
    parameters: ImpactMass
    impact_speed_m_per_s: float
    impact_tau_s: float
    verdict: CycleVerdict
    endurance: tuple[Endurance, ...]


@dataclass(frozen=True)
class Synthesis:
    """Both cycles side by side, for the same spec, judged in the same box."""

    spec: CycleSpec
    robustness: RobustnessSpec
    published: CycleDesign
    robust: CycleDesign


def published_parameters(spec: CycleSpec) -> ImpactMass:
    """Return the configuration of the published synthesis; see `synthesised_cycle` for its errors."""
    w = spec
    found = synthesised_cycle(
        w.mass_kg,
        w.stop_position_m,
        w.initial_position_m,
        w.initial_velocity_m_per_s,
        w.impact_speed_m_per_s,
        w.restitution,
    )
    return ImpactMass(
        mass_kg=w.mass_kg,
        stop_position_m=w.stop_position_m,
        restitution=w.restitution,
        period_s=found.period_s,
        phase1_duration_s=found.phase1_duration_s,
        phase1_force_n=found.phase1_force_n,
        phase2_force_n=found.phase2_force_n,
        initial_position_m=w.initial_position_m,
        initial_velocity_m_per_s=w.initial_velocity_m_per_s,
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
    total_ns = p.mass_kg * impact_speed_m_per_s * (1.0 + p.restitution)
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
    parameters: ImpactMass
    stability_number: float
    margin: float
    fraction: float


def _screened_fraction(parameters: ImpactMass, box: StartBox, robustness: RobustnessSpec) -> float:
    """Return the share of the starts that reach the cycle; of the first few alone where these already fail it."""
    cycle = phase2_cycle(parameters)
    few = basin(parameters.system, cycle, replace(box, starts=min(SCREEN, box.starts)))
    if few.box.starts - few.reached > (1.0 - robustness.basin_fraction) * box.starts:
        return few.fraction
    return basin(parameters.system, cycle, box).fraction


def _candidates(spec: CycleSpec, published: ImpactMass, box: StartBox, robustness: RobustnessSpec) -> list[_Candidate]:
    """Return the candidates over the stable range of q = A2/<A>; no basin where the margin is not met."""
    mean_n = spec.mass_kg * spec.impact_speed_m_per_s * (1.0 + spec.restitution) / published.period_s
    low = least_stability_number(spec.restitution)
    found = []
    for i in range(1, CANDIDATES):
        q = low + (1.0 - low) * i / CANDIDATES
        parameters = with_phase2_force(published, spec.impact_speed_m_per_s, q * mean_n)
        judged = verdict(parameters, None)
        margin = judged.margin if judged.stable else -math.inf
        fraction = _screened_fraction(parameters, box, robustness) if margin >= robustness.margin else 0.0
        found.append(_Candidate(parameters, q, margin, fraction))
    return found


def robust_parameters(spec: CycleSpec, robustness: RobustnessSpec) -> ImpactMass:
    """Return the configuration of the robust cycle with the spec's v- and the published T and t1.

    Raises
    ------
    ValueError
        If no forces meet the robustness, naming the inequality that fails and the best that was found.
    """
    if robustness.margin > 1.0 - spec.restitution:
        raise ValueError(
            "no robust cycle: margin <= 1 - restitution does not hold (the product of the multipliers is R^2): "
            f"{robustness.margin!r}, {1.0 - spec.restitution!r}"
        )
    published = published_parameters(spec)
    box = default_box(spec.stroke_m, spec.impact_speed_m_per_s, robustness.starts, robustness.seed)
    found = _candidates(spec, published, box, robustness)
    passing = [c for c in found if c.margin >= robustness.margin and c.fraction >= robustness.basin_fraction]
    numbers = np.array([c.stability_number for c in found])
    safe = [c for c in passing if _neighbours_pass(c, passing, numbers, robustness.force_reserve)]
    if not safe:
        raise ValueError(_refusal(found, passing, robustness))
    return max(safe, key=lambda c: c.margin).parameters


def _neighbours_pass(
    one: _Candidate, passing: list[_Candidate], numbers: np.ndarray[tuple[int], np.dtype[np.float64]], reserve: float
) -> bool:
    asked = numbers[np.abs(numbers - one.stability_number) <= reserve + 1e-12]
    good = {c.stability_number for c in passing}
    outside = one.stability_number - reserve <= numbers[0] or one.stability_number + reserve >= numbers[-1]
    return not outside and all(float(number) in good for number in asked)


def _refusal(found: list[_Candidate], passing: list[_Candidate], robustness: RobustnessSpec) -> str:
    if passing:
        return (
            f"no robust cycle: force_reserve = {robustness.force_reserve!r} does not hold: no candidate passes with "
            f"all its neighbours; {len(passing)} of {len(found)} pass alone"
        )
    margin = max(c.margin for c in found)
    fraction = max((c.fraction for c in found if c.margin >= robustness.margin), default=0.0)
    return (
        f"no robust cycle: margin >= {robustness.margin!r} and basin_fraction >= {robustness.basin_fraction!r} do not "
        f"both hold: largest margin {margin!r}; largest basin fraction at the asked margin {fraction!r}"
    )


def printed_periods(period_s: float) -> tuple[float, ...]:
    """Return T as a paper prints it: rounded to four decimals, and cut to three."""
    return round(period_s, 4), math.floor(period_s * 1000.0) / 1000.0


def design(name: str, parameters: ImpactMass, box: StartBox, periods: int) -> CycleDesign:
    """Return a cycle with its verdict and its endurance at T in full precision and at T as printed."""
    cycle = phase2_cycle(parameters)
    lasting = tuple(
        endurance(parameters.model_copy(update={"period_s": period_s}), periods)
        for period_s in (parameters.period_s, *printed_periods(parameters.period_s))
        if period_s > parameters.phase1_duration_s
    )
    judged = verdict(parameters, box)
    return CycleDesign(name, parameters, cycle.impact_speed_m_per_s, cycle.impact_tau_s, judged, lasting)


def synthesise(spec: CycleSpec, robustness: RobustnessSpec | None = None, periods: int = 1_000_000) -> Synthesis:
    """Return the published and the robust cycle side by side.

    Parameters
    ----------
    spec : CycleSpec
        The cycle that is wanted.
    robustness : RobustnessSpec, optional
        What the robust cycle shall stand, and the box and seed of the basin.
    periods : int
        How long the endurance runs are.

    Raises
    ------
    ValueError
        If one of them has no solution, naming the inequality and its numbers.
    """
    robustness = robustness or RobustnessSpec()
    box = default_box(spec.stroke_m, spec.impact_speed_m_per_s, robustness.starts, robustness.seed)
    published = design("published", published_parameters(spec), box, periods)
    robust = design("robust", robust_parameters(spec, robustness), box, periods)
    return Synthesis(spec, robustness, published, robust)
