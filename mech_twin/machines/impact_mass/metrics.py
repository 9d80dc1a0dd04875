# SPDX-License-Identifier: Apache-2.0
"""Metrics of the impact mass in closed form: report of the configuration, state at one angle of the period."""

from __future__ import annotations

import math
from typing import Any

from mech_twin.machines.impact_mass.batch import next_period, strikes_once_a_period
from mech_twin.machines.impact_mass.contact_estimate import contact_estimate, merging_speed
from mech_twin.machines.impact_mass.dynamics import (
    ImpactSystem,
    MassMotion,
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
from mech_twin.machines.impact_mass.states import FLIGHT, IMPACT, MODE_NAMES, STUCK
from mech_twin.machines.impact_mass.wave_stop import StopRod, blow_numbers

SETTLING_PERIODS = 1000
FIRST_EVENTS = 100  # among which the first impact is looked for
BLOW_TOLERANCE = 1e-9  # of a period: how near the next blow must be to one period after the last


def after_blow(cycle: OneImpactCycle, system: ImpactSystem) -> MassMotion:
    """Return the motion right after the blow of a one-impact cycle."""
    tau, speed, phase = cycle.impact_tau_s, cycle.impact_speed_m_per_s, float(cycle.phase)
    before = MassMotion(0.0, tau, phase, 0.0, speed, FLIGHT, 0.0, 0.0, 0.0)
    return after_impact(before, system, tau, speed)[1]


def admissible(cycle: OneImpactCycle, system: ImpactSystem) -> bool:
    """Return whether a one-impact cycle has no further impact in its period."""
    return strikes_once_a_period(after_blow(cycle, system), system, BLOW_TOLERANCE * system.period_s)


def one_impact_cycles(system: ImpactSystem) -> list[OneImpactCycle]:
    """Return the admissible one-impact motions (at most two): the blow within its phase, no further impact."""
    accelerations = (system.acceleration1, system.acceleration2)
    found = (
        one_impact_cycle(system.period_s, system.phase1_s, accelerations, system.restitution, phase) for phase in (0, 1)
    )
    return [
        cycle
        for cycle in found
        if cycle is not None and 0.0 <= cycle.position_share <= 1.0 and admissible(cycle, system)
    ]


def cycle_metrics(system: ImpactSystem, mass_kg: float, gap_m: float, velocity_m_per_s: float) -> dict[str, float]:
    """Return the closed-form metrics: means, stability limits, one-impact motions, the first blow."""
    mean = mean_level(system.period_s, system.phase1_s, system.acceleration1, system.acceleration2)
    share = phase1_chatter_share((system.acceleration1, system.acceleration2), system.restitution)
    metrics = {
        "period_s": system.period_s,
        "phase1_acceleration_m_per_s2": system.acceleration1,
        "phase2_acceleration_m_per_s2": system.acceleration2,
        "mean_acceleration_m_per_s2": mean,
        "mean_force_n": mean * mass_kg,
        "least_stable_blow_acceleration_m_per_s2": least_stability_number(system.restitution) * mean,
        "greatest_stable_blow_acceleration_m_per_s2": mean,
    }
    if math.isfinite(share):
        metrics["chatter_completes_from_phase1_duration_s"] = share * system.period_s / (1.0 + share)
    for cycle in one_impact_cycles(system):
        name = f"one_impact_phase{cycle.phase + 1}"
        metrics[f"{name}_speed_m_per_s"] = cycle.impact_speed_m_per_s
        metrics[f"{name}_impact_tau_s"] = cycle.impact_tau_s
        metrics[f"{name}_largest_multiplier_1"] = abs(cycle.multipliers[0])
        metrics[f"{name}_blow_energy_j"] = 0.5 * mass_kg * cycle.impact_speed_m_per_s**2
    motion = initial_motion(gap_m, velocity_m_per_s, system)
    for _ in range(FIRST_EVENTS):
        event, motion = next_event(motion, system)
        if event.kind == IMPACT:
            metrics["first_impact_time_s"] = event.period * system.period_s + event.tau_s
            metrics["first_impact_speed_m_per_s"] = event.pre_m_per_s
            break
    return metrics


def contact_metrics(system: ImpactSystem, mass_kg: float, stiffness_n_per_m: float) -> dict[str, float]:
    """Return peak force, contact time and loss of the one-impact motions, and the speed below which contacts merge."""
    forces_n = (system.acceleration1 * mass_kg, system.acceleration2 * mass_kg)
    metrics = {}
    for cycle in one_impact_cycles(system):
        name, speed = f"one_impact_phase{cycle.phase + 1}", cycle.impact_speed_m_per_s
        found = contact_estimate(mass_kg, speed, system.restitution, stiffness_n_per_m, forces_n[cycle.phase])
        metrics[f"{name}_peak_force_n"] = found.peak_force_n
        metrics[f"{name}_contact_time_s"] = found.contact_time_s
        metrics[f"{name}_penetration_m"] = found.penetration_m
        metrics[f"{name}_contact_loss_j"] = found.loss_j
    for number, force_n in enumerate(forces_n, 1):
        merging = merging_speed(mass_kg, system.restitution, stiffness_n_per_m, force_n)
        metrics[f"phase{number}_merging_speed_m_per_s"] = merging
    return metrics


def wave_metrics(system: ImpactSystem, mass_kg: float, rod: StopRod) -> dict[str, float]:
    """Return the restitution of a stop that is a rod, and the results of the one-impact motions' blows."""
    found = {"stop_restitution": system.restitution}
    for cycle in one_impact_cycles(system):
        numbers = blow_numbers(rod, mass_kg, cycle.impact_speed_m_per_s)
        found.update({f"one_impact_phase{cycle.phase + 1}_{name}": value for name, value in numbers.items()})
    return found


def position_metrics(
    system: ImpactSystem, mass_kg: float, stop_m: float, gap_m: float, velocity_m_per_s: float, angle_rad: float
) -> dict[str, Any]:
    """Return the state at phase angle 2 pi tau/T after a thousand periods from the configured start."""
    motion = initial_motion(gap_m, velocity_m_per_s, system)
    for _ in range(SETTLING_PERIODS):
        motion = next_period(motion, system).motion
    tau = angle_rad / (2.0 * math.pi) * system.period_s
    event, after = next_event(motion, system)
    number = motion.period
    while event.period == number and event.tau_s <= tau:
        motion = after
        event, after = next_event(motion, system)
    gap, velocity = gap_after(motion, system, tau - motion.tau_s)
    a = acceleration(motion, system)
    stuck = motion.mode == STUCK
    return {
        "angle_rad": angle_rad,
        "time_in_period_s": tau,
        "phase": int(motion.phase) + 1,
        "regime": MODE_NAMES[int(motion.mode)],
        "position_m": stop_m - gap,
        "gap_m": gap,
        "velocity_m_per_s": velocity,
        "acceleration_m_per_s2": 0.0 if stuck else a,
        "drive_force_n": a * mass_kg,
        "stop_force_n": a * mass_kg if stuck else 0.0,
        "kinetic_energy_j": 0.5 * mass_kg * velocity**2,
        "settled_periods": SETTLING_PERIODS,
    }
