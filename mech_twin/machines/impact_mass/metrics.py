# SPDX-License-Identifier: Apache-2.0
"""Metrics of the impact mass in closed form, and what monitor and shadow ask of it.

A report is that of the configuration, or of one angle of the period.  A monitor asks for features of a cycle and
faults, a shadow for the anchor of the motion.
"""

import math
from collections.abc import Mapping
from typing import Any

from mech_twin.capabilities.cycle import (
    CycleFeatures,
    CycleReference,
    event_ratio,
    event_share,
    event_value,
    gauge_features,
    harmonic,
    mean,
    share_above,
    upper,
)
from mech_twin.capabilities.faults import LESS, MachineFault, added_to_key, share_of_key
from mech_twin.machines.impact_mass.dynamics import (
    FLIGHT,
    IMPACT,
    MODE_NAMES,
    STUCK,
    ImpactSystem,
    MassMotion,
    acceleration,
    after_impact,
    gap_after,
    mean_acceleration,
    next_event,
    next_period,
    strikes_once_a_period,
)
from mech_twin.machines.impact_mass.forces import contact_estimate, merging_speed
from mech_twin.machines.impact_mass.one_impact_cycle import (
    OneImpactCycle,
    least_stability_number,
    one_impact_cycle,
    phase1_chatter_share,
)
from mech_twin.machines.impact_mass.parameters import ImpactMass
from mech_twin.machines.impact_mass.step import anchor_at
from mech_twin.machines.impact_mass.wave_stop import blow_numbers
from mech_twin.roles import AnchoredMotion

FORCE, MASS = "motor.generator.effort", "linkage.mass.position"
TIME, PRE, POST, IMPULSE = (f"event.impact.{what}" for what in ("time", "pre_velocity", "post_velocity", "impulse"))
SETTLING_CYCLES = 8
SETTLING_PERIODS = 1000
FIRST_EVENTS = 100  # among which the first impact is looked for
BLOW_TOLERANCE = 1e-9  # of a period: how near the next blow must be to one period after the last


def features(parameters: ImpactMass) -> CycleFeatures:
    """Return the features of a period of the force, from the rise to its first level on."""
    level = 0.5 * (parameters.phase1_force_n + parameters.phase2_force_n)
    return CycleFeatures(
        CycleReference(FORCE, "rise", level, parameters.period_s),
        (
            mean("force_mean_n", "N", FORCE, "mean force of the generator"),
            upper("force_high_n", "N", FORCE, "force of the first phase", 0.5),
            upper("force_low_n", "N", FORCE, "force of the second phase", -0.2),
            mean("position_mean_m", "m", MASS, "mean position"),
            upper("position_high_m", "m", MASS, "position nearest to the stop", 0.1),
            upper("position_low_m", "m", MASS, "position farthest from the stop", -0.1),
            share_above("near_share", MASS, 0.9, "share of the period in which the mass is at the stop or near it"),
            harmonic("position_cos_1_m", "m", MASS, 1, "cos", "position, cosine of the period"),
            harmonic("position_sin_1_m", "m", MASS, 1, "sin", "position, sine of the period"),
            event_share("impact_share", TIME, "when in the period the first impact comes"),
            event_value("impact_speed_m_per_s", "m/s", PRE, "speed of the hardest impact", "largest"),
            event_ratio("speed_ratio", POST, PRE, "speeds after the impacts over those before"),
            event_value("impulse_ns", "N.s", IMPULSE, "impulse of a period", "sum"),
            *(gauge_features("impact", "stop") if parameters.stop.model == "wave" else ()),
        ),
        SETTLING_CYCLES,
    )


EITHER = (-0.2, -0.1, -0.05, 0.05, 0.1, 0.2)
RIGID_FAULTS = (share_of_key("restitution", "the stop's face has changed", "restitution", EITHER),)


def faults(parameters: ImpactMass) -> tuple[MachineFault, ...]:
    """Return the faults of stop (of one that is a rod its face, its wall) and generator."""
    stop, rod = parameters.stop, "stop.wave"
    found: tuple[MachineFault, ...] = RIGID_FAULTS
    if stop.model == "wave":
        found = (share_of_key("face_worn", "the stop's face is softer", f"{rod}.face.stiffness_n_per_m", LESS),)
        soft = share_of_key("wall_soft", "the wall behind the stop is softer", f"{rod}.wall.stiffness_n_per_m", LESS)
        found += (soft,) if stop.wave.wall.kind == "loading" else ()
    return (
        *found,
        share_of_key("first_level", "the force of the first phase is off", "phase1_force_n", EITHER),
        share_of_key("second_level", "the force of the second phase is off", "phase2_force_n", EITHER),
        added_to_key("stop_moved", "the stop has moved", "stop_position_m", "m", (-0.02, -0.005, 0.005, 0.02)),
    )


GAP, ORIGIN = "linkage.memory.anchor_gap_m", "linkage.memory.origin_step_1"
ANCHORED_MOTION = AnchoredMotion(
    later={
        GAP: ("linkage.mass.position", -1.0),
        "linkage.memory.anchor_velocity_m_per_s": ("linkage.mass.velocity", 1.0),
        ORIGIN: (ORIGIN, 1.0),
    },
    origin=ORIGIN,
    tau="linkage.memory.anchor_tau_s",
    not_below_zero=(GAP,),  # the mass cannot be beyond the stop
    anchor_at=anchor_at,
)


def after_blow(cycle: OneImpactCycle, system: ImpactSystem) -> MassMotion:
    """Return the motion right after the blow of a one-impact cycle."""
    tau, speed, phase = cycle.impact_tau_s, cycle.impact_speed_m_per_s, float(cycle.phase)
    before = MassMotion(0.0, tau, phase, 0.0, speed, FLIGHT, 0.0, 0.0, 0.0)
    return after_impact(before, system, tau, speed)[1]


def admissible(cycle: OneImpactCycle, system: ImpactSystem) -> bool:
    """Return whether a one-impact cycle has no further impact in its period."""
    return strikes_once_a_period(after_blow(cycle, system), system, BLOW_TOLERANCE * system.period_s)


def cycle_metrics(parameters: ImpactMass) -> dict[str, float]:
    """Return the closed-form metrics: means, stability limits, one-impact motions, the first blow, and the contact."""
    system, mass_kg = parameters.system, parameters.mass_kg
    mean, share = mean_acceleration(system), phase1_chatter_share(system)
    cycles = {
        f"one_impact_phase{phase + 1}": cycle
        for phase in (0, 1)
        if (cycle := one_impact_cycle(system, phase))
        and 0.0 <= cycle.position_share <= 1.0
        and admissible(cycle, system)
    }
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
    for name, cycle in cycles.items():
        metrics[f"{name}_speed_m_per_s"] = cycle.impact_speed_m_per_s
        metrics[f"{name}_impact_tau_s"] = cycle.impact_tau_s
        metrics[f"{name}_largest_multiplier_1"] = abs(cycle.multipliers[0])
        metrics[f"{name}_blow_energy_j"] = 0.5 * mass_kg * cycle.impact_speed_m_per_s**2
    motion = parameters.start
    for _ in range(FIRST_EVENTS):
        event, motion = next_event(motion, system)
        if event.kind == IMPACT:
            metrics["first_impact_time_s"] = event.period * system.period_s + event.tau_s
            metrics["first_impact_speed_m_per_s"] = event.pre_m_per_s
            break
    if parameters.stop.model == "wave":
        metrics["stop_restitution"] = system.restitution
        for name, cycle in cycles.items():
            numbers = blow_numbers(parameters.stop.wave, mass_kg, cycle.impact_speed_m_per_s)
            metrics.update({f"{name}_{each}": value for each, value in numbers.items()})
    if parameters.contact_stiffness_n_per_m is None:
        return metrics
    return metrics | contact_metrics(system, mass_kg, parameters.contact_stiffness_n_per_m, cycles)


def contact_metrics(
    system: ImpactSystem, mass_kg: float, stiffness_n_per_m: float, cycles: Mapping[str, OneImpactCycle]
) -> dict[str, float]:
    """Return peak force, contact time and loss of the one-impact motions, and the speed below which contacts merge."""
    forces_n = (system.acceleration1 * mass_kg, system.acceleration2 * mass_kg)
    metrics = {}
    for name, cycle in cycles.items():
        force_n, speed = forces_n[cycle.phase], cycle.impact_speed_m_per_s
        found = contact_estimate(mass_kg, speed, system.restitution, stiffness_n_per_m, force_n)
        metrics[f"{name}_peak_force_n"] = found.peak_force_n
        metrics[f"{name}_contact_time_s"] = found.contact_time_s
        metrics[f"{name}_penetration_m"] = found.penetration_m
        metrics[f"{name}_contact_loss_j"] = found.loss_j
    for number, force_n in enumerate(forces_n, 1):
        merging = merging_speed(mass_kg, system.restitution, stiffness_n_per_m, force_n)
        metrics[f"phase{number}_merging_speed_m_per_s"] = merging
    return metrics


def position_metrics(parameters: ImpactMass, angle_rad: float) -> dict[str, Any]:
    """Return the state at phase angle 2 pi tau/T after a thousand periods from the configured start."""
    system, mass_kg, angle_rad = parameters.system, parameters.mass_kg, angle_rad % (2.0 * math.pi)
    motion = parameters.start
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
        "position_m": parameters.stop_position_m - gap,
        "gap_m": gap,
        "velocity_m_per_s": velocity,
        "acceleration_m_per_s2": 0.0 if stuck else a,
        "drive_force_n": a * mass_kg,
        "stop_force_n": a * mass_kg if stuck else 0.0,
        "kinetic_energy_j": 0.5 * mass_kg * velocity**2,
        "settled_periods": SETTLING_PERIODS,
    }
