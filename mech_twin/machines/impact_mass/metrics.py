"""Figures of the impact mass: closed-form report, state at one angle of the period, drawing, observer of a run."""

from __future__ import annotations

import math
from typing import Any

from mech_twin.machines.impact_mass.batch import next_period, strikes_once_a_period
from mech_twin.machines.impact_mass.events import (
    FLIGHT,
    Drive,
    Motion,
    acceleration,
    after_impact,
    gap_after,
    initial_motion,
    next_event,
)
from mech_twin.machines.impact_mass.force_generator import mean_level
from mech_twin.machines.impact_mass.one_impact_cycle import (
    OneImpactCycle,
    least_stability_number,
    one_impact_cycle,
    phase1_chatter_share,
)
from mech_twin.samples import Frame, LinkageSample, Shape

SETTLING_PERIODS = 1000
BLOW_TOLERANCE = 1e-9  # of a period: how near the next blow must be to one period after the last
MASS_COLOUR, STOP_COLOUR, PUSH_COLOUR, PULL_COLOUR = (60, 90, 180), (90, 90, 90), (200, 60, 40), (240, 160, 40)
MASS_M = 0.08  # side of the drawn mass
SCALE_S = 0.02  # drawn height of 1 m/s in the phase portrait
STUCK_REGIME = 3


def after_blow(cycle: OneImpactCycle, acting: Drive) -> Motion:
    """Return the motion right after the blow of a one-impact cycle."""
    tau, speed, phase = cycle.impact_tau_s, cycle.impact_speed_m_per_s, float(cycle.phase)
    before = Motion(0.0, tau, phase, 0.0, speed, FLIGHT, 0.0, 0.0, 0.0)
    return after_impact(before, acting, tau, speed)[1]


def admissible(cycle: OneImpactCycle, acting: Drive) -> bool:
    """Return whether nothing strikes between the blows of a one-impact cycle."""
    return strikes_once_a_period(after_blow(cycle, acting), acting, BLOW_TOLERANCE * acting.period_s)


def one_impact_cycles(acting: Drive) -> list[OneImpactCycle]:
    """Return the one-impact motions there are: the blow within its phase, nothing striking between (at most two)."""
    accelerations = (acting.acceleration1, acting.acceleration2)
    found = (
        one_impact_cycle(acting.period_s, acting.phase1_s, accelerations, acting.restitution, phase) for phase in (0, 1)
    )
    return [
        cycle
        for cycle in found
        if cycle is not None and 0.0 <= cycle.position_share <= 1.0 and admissible(cycle, acting)
    ]


def cycle_report(acting: Drive, mass_kg: float, gap_m: float, velocity_m_per_s: float) -> dict[str, float]:
    """Return the closed-form figures: means, stability limits, one-impact motions, the first blow."""
    mean = mean_level(acting.period_s, acting.phase1_s, acting.acceleration1, acting.acceleration2)
    share = phase1_chatter_share((acting.acceleration1, acting.acceleration2), acting.restitution)
    figures = {
        "period_s": acting.period_s,
        "phase1_acceleration_m_per_s2": acting.acceleration1,
        "phase2_acceleration_m_per_s2": acting.acceleration2,
        "mean_acceleration_m_per_s2": mean,
        "mean_force_n": mean * mass_kg,
        "least_stable_blow_acceleration_m_per_s2": least_stability_number(acting.restitution) * mean,
        "greatest_stable_blow_acceleration_m_per_s2": mean,
    }
    if math.isfinite(share):
        figures["chatter_completes_from_phase1_duration_s"] = share * acting.period_s / (1.0 + share)
    for cycle in one_impact_cycles(acting):
        name = f"one_impact_phase{cycle.phase + 1}"
        figures[f"{name}_speed_m_per_s"] = cycle.impact_speed_m_per_s
        figures[f"{name}_impact_tau_s"] = cycle.impact_tau_s
        figures[f"{name}_largest_multiplier_1"] = abs(cycle.multipliers[0])
        figures[f"{name}_blow_energy_j"] = 0.5 * mass_kg * cycle.impact_speed_m_per_s**2
    motion = initial_motion(gap_m, velocity_m_per_s, acting)
    for _ in range(100):
        event, motion = next_event(motion, acting)
        if event.kind == 0.0:
            figures["first_impact_time_s"] = event.period * acting.period_s + event.tau_s
            figures["first_impact_speed_m_per_s"] = event.pre_m_per_s
            break
    return figures


def position_figures(
    acting: Drive, mass_kg: float, stop_m: float, gap_m: float, velocity_m_per_s: float, angle_rad: float
) -> dict[str, Any]:
    """Return the state at an angle 2 pi tau/T of the period after a thousand, from the configured start."""
    motion = initial_motion(gap_m, velocity_m_per_s, acting)
    for _ in range(SETTLING_PERIODS):
        motion = next_period(motion, acting).motion
    tau = angle_rad / (2.0 * math.pi) * acting.period_s
    event, after = next_event(motion, acting)
    number = motion.period
    while event.period == number and event.tau_s <= tau:
        motion = after
        event, after = next_event(motion, acting)
    gap, velocity = gap_after(motion, acting, tau - motion.tau_s)
    a = acceleration(motion, acting)
    stuck = motion.mode == 2.0
    return {
        "angle_rad": angle_rad,
        "time_in_period_s": tau,
        "phase": int(motion.phase) + 1,
        "regime": ("free", "chatter", "stuck")[int(motion.mode)],
        "position_m": stop_m - gap,
        "gap_m": gap,
        "velocity_m_per_s": velocity,
        "acceleration_m_per_s2": 0.0 if stuck else a,
        "drive_force_n": a * mass_kg,
        "stop_force_n": a * mass_kg if stuck else 0.0,
        "kinetic_energy_j": 0.5 * mass_kg * velocity**2,
        "settled_periods": SETTLING_PERIODS,
    }


def _box(x0: float, y0: float, x1: float, y1: float) -> tuple[tuple[float, float], ...]:
    return ((x0, y0), (x1, y0), (x1, y1), (x0, y1), (x0, y0))


def _portrait(stop_m: float, base_m: float, sample: LinkageSample) -> tuple[Shape, ...]:
    """Return axes, the arc since the last event and the present point of the phase portrait, below the mass."""
    memory = sample.memory.values
    motion = Motion(*memory[:9])
    a = memory[16 + int(motion.phase)]  # phase1_acceleration, phase2_acceleration
    v0, v1 = motion.velocity_m_per_s, sample.velocity[0]
    x0, x1 = stop_m - motion.gap_m, sample.position[0]
    arc = []
    for i in range(13):
        v = v0 + (v1 - v0) * i / 12.0
        x = x0 + (v - v0) * (v + v0) / (2.0 * a) if a else x0 + (x1 - x0) * i / 12.0
        arc.append((min(x, stop_m), base_m + SCALE_S * v))
    return (
        Shape("portrait_axis", "line", ((stop_m - 1.0, base_m), (stop_m + 0.05, base_m)), STOP_COLOUR, 0.002),
        Shape("portrait_arc", "line", tuple(arc), MASS_COLOUR, 0.004),
        Shape("portrait_point", "points", ((x1, base_m + SCALE_S * v1),), PUSH_COLOUR, 0.02),
    )


def mass_drawing(stop_m: float, sample: LinkageSample) -> tuple[Shape, ...]:
    """Return mass, stop, an arrow for the phase of the force, and the phase portrait with its present point."""
    x = sample.position[0]
    force = sample.effort[0]
    tail = x - MASS_M
    reach = math.copysign(0.15, force) if force else 0.0
    arrow = ((tail - reach, 0.0), (tail, 0.0)) if reach >= 0.0 else ((tail, 0.0), (tail + reach, 0.0))
    colour = PUSH_COLOUR if sample.memory.values[2] == 0.0 else PULL_COLOUR
    return (
        Shape("stop", "line", ((stop_m, -0.15), (stop_m, 0.15)), STOP_COLOUR, 0.012),
        Shape("mass", "line", _box(tail, -MASS_M / 2.0, x, MASS_M / 2.0), MASS_COLOUR, 0.008),
        Shape("force", "arrow", arrow, colour, 0.008),
        *_portrait(stop_m, -0.9, sample),
    )


class MassObserver:
    """Running figures of a run; the velocity's extremes lie at events, so they are exact."""

    def __init__(self, mass_kg: float, stop_m: float) -> None:
        self._mass = mass_kg
        self._stop = stop_m
        self._speed_sum = 0.0
        self._numbers = {
            "impacts": 0.0,
            "chatter_ends": 0.0,
            "releases": 0.0,
            "periods": 0.0,
            "last_period_impacts": 0.0,
            "hardest_blow_m_per_s": 0.0,
            "last_blow_m_per_s": 0.0,
            "mean_blow_m_per_s": 0.0,
            "velocity_min_m_per_s": 0.0,
            "velocity_max_m_per_s": 0.0,
            "gap_max_m": 0.0,
            "stop_impulse_ns": 0.0,
            "mean_stop_force_n": 0.0,
            "blow_energy_lost_j": 0.0,
            "rests_for_good": 0.0,
        }

    def observe(self, frame: Frame) -> None:
        """Take one frame into account."""
        now, linkage = self._numbers, frame.linkage
        memory = linkage.memory.values
        for event in linkage.events:
            low, high = sorted((event.pre_velocity_m_per_s, event.post_velocity_m_per_s))
            now["velocity_min_m_per_s"] = min(now["velocity_min_m_per_s"], low)
            now["velocity_max_m_per_s"] = max(now["velocity_max_m_per_s"], high)
            if event.kind == "impact":
                self._struck(high, low)
                now["last_impact_time_s"] = event.time_s
            elif event.kind in ("chatter_end", "release"):
                now[f"{event.kind}s"] += 1.0
        velocity = linkage.velocity[0]
        now["velocity_min_m_per_s"] = min(now["velocity_min_m_per_s"], velocity)
        now["velocity_max_m_per_s"] = max(now["velocity_max_m_per_s"], velocity)
        now["gap_max_m"] = max(now["gap_max_m"], self._stop - linkage.position[0])
        now["stop_impulse_ns"] += frame.forces.quantities.values[0]
        now["periods"] = memory[0]
        now["last_period_impacts"] = memory[12]
        if linkage.time_s > 0.0:
            now["mean_stop_force_n"] = now["stop_impulse_ns"] / linkage.time_s
        resting = linkage.regime == STUCK_REGIME and min(memory[16], memory[17]) >= 0.0
        if resting and not now["rests_for_good"]:
            now["rests_for_good_from_s"] = linkage.time_s
        now["rests_for_good"] = 1.0 if resting else 0.0

    def _struck(self, before: float, after: float) -> None:
        now = self._numbers
        now["impacts"] += 1.0
        self._speed_sum += before
        now["hardest_blow_m_per_s"] = max(now["hardest_blow_m_per_s"], before)
        now["last_blow_m_per_s"] = before
        now["mean_blow_m_per_s"] = self._speed_sum / now["impacts"]
        now["blow_energy_lost_j"] += 0.5 * self._mass * (before - after) * (before + after)

    def numbers(self) -> dict[str, float]:
        """Return the figures so far."""
        return dict(self._numbers)
