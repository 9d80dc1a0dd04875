# SPDX-License-Identifier: Apache-2.0
"""Monitoring and shadowing of the machine: features of a cycle, faults, and the anchor of its motion."""

from __future__ import annotations

from mech_twin.capabilities.anchored_motion import AnchoredMotion
from mech_twin.capabilities.cycle import (
    CycleFeatures,
    CycleReference,
    event_ratio,
    event_share,
    event_value,
    harmonic,
    mean,
    share_above,
    upper,
)
from mech_twin.capabilities.faults import MachineFault, added_to_key, share_of_key
from mech_twin.capabilities.gauge_features import gauge_features
from mech_twin.machines.impact_mass.mass_row import anchor_at
from mech_twin.machines.impact_mass.parameters import ImpactMass
from mech_twin.machines.impact_mass.wave_stop import StopRod

FORCE, MASS = "motor.generator.effort", "linkage.mass.position"
TIME, PRE, POST, IMPULSE = (f"event.impact.{what}" for what in ("time", "pre_velocity", "post_velocity", "impulse"))
SETTLING_PERIODS = 8


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
        SETTLING_PERIODS,
    )


LESS = (-0.6, -0.5, -0.4, -0.3, -0.2, -0.1, -0.05)
EITHER = (-0.2, -0.1, -0.05, 0.05, 0.1, 0.2)


RIGID_FAULTS = (share_of_key("restitution", "the stop's face has changed", "restitution", EITHER),)


def wave_faults(stop: StopRod) -> tuple[MachineFault, ...]:
    """Return the faults of a stop that is a rod: its face, its wall."""
    found = [share_of_key("face_worn", "the stop's face is softer", "stop.wave.face.stiffness_n_per_m", LESS)]
    if stop.wall.kind == "loading":
        wall = "stop.wave.wall.stiffness_n_per_m"
        found.append(share_of_key("wall_soft", "the wall behind the stop is softer", wall, LESS))
    return tuple(found)


def faults(parameters: ImpactMass) -> tuple[MachineFault, ...]:
    """Return the faults of stop and generator."""
    return (
        *(wave_faults(parameters.stop.wave) if parameters.stop.model == "wave" else RIGID_FAULTS),
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
