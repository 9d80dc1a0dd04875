# SPDX-License-Identifier: Apache-2.0
"""Monitoring of the breaker: features of a turn of its crank, faults, and operating conditions."""

from __future__ import annotations

from math import pi

from mech_twin.capabilities.crank_features import speed_features
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
from mech_twin.capabilities.faults import MachineFault, added_to_key, share_of_key, supply_sag
from mech_twin.capabilities.gauge_features import gauge_features
from mech_twin.capabilities.operating_point import OperatingVariable, motor_variables, varying_key
from mech_twin.machines.mb10_breaker.parameters import BreakerParameters, ToolParameters


def operating(parameters: BreakerParameters) -> tuple[OperatingVariable, ...]:
    """Return supply, motor temperature, the tool within its tolerance, and the wall."""
    return (
        *motor_variables(),
        varying_key("tool_load", "mass that the blow meets", "tool.mass_kg", 0.1, "tool_mass"),
        varying_key("tool_face", "restitution of the tool's face", "tool.restitution", 0.05, "tool_restitution"),
        varying_key("wall", "force of the wall", "tool.wall_force_n", 0.2, "wall_range"),
    )


LESS = (-0.6, -0.5, -0.4, -0.3, -0.2, -0.1, -0.05)
WAVE = "tool.wave"
EITHER = (-0.4, -0.2, -0.1, 0.1, 0.2, 0.4)


RIGID_FAULTS = (
    share_of_key("tool_mass", "a tool of another mass", "tool.mass_kg", EITHER),
    share_of_key("tool_restitution", "the tool's face has changed", "tool.restitution", EITHER),
)


def wave_faults(tool: ToolParameters) -> tuple[MachineFault, ...]:
    """Return the faults of a tool whose blow is a wave: its face, its foot, the wall."""
    wall, found = tool.wave.wall.kind, []
    if tool.wave.face.kind == "linear":
        found.append(share_of_key("face_worn", "the struck face is softer", f"{WAVE}.face.stiffness_n_per_m", LESS))
    if tool.wave.foot.length_m > 0.0:
        found.append(added_to_key("foot_worn", "the foot has play", f"{WAVE}.foot_gap_m", "m", (1e-4, 2e-4, 5e-4)))
    if wall == "loading":
        found.append(share_of_key("wall_soft", "the wall is softer", f"{WAVE}.wall.stiffness_n_per_m", LESS))
    if wall == "yielding":
        found.append(share_of_key("wall_weak", "the wall gives way sooner", "tool.wall_force_n", LESS))
    return tuple(found)


def faults(parameters: BreakerParameters) -> tuple[MachineFault, ...]:
    """Return the faults of springs, collar, tool, bearings and supply."""
    return (
        share_of_key("spring_soft", "the body's springs are soft or broken", "body.spring_rate_n_per_m", LESS),
        share_of_key("preload_lost", "the springs have lost preload", "body.preload_deflection_m", LESS),
        share_of_key("collar_restitution", "the collar's seat has changed", "body.restitution", EITHER),
        share_of_key("tool_worn", "the tool is worn: the striker meets it later", "tool.overtravel_m", LESS),
        *(wave_faults(parameters.tool) if parameters.tool.model == "wave" else RIGID_FAULTS),
        added_to_key(
            "bearing_friction", "the crank's bearing rubs", "friction.coulomb_nm", "N.m", (0.5, 1.0, 2.0, 4.0)
        ),
        supply_sag(),
    )


CRANK, ROTOR, BODY = "linkage.crank.position", "motor.rotor.effort", "body.body.position"
BLOW, PRE, POST, IMPULSE = (f"event.blow.{what}" for what in ("time", "pre_velocity", "post_velocity", "impulse"))
BEGIN_RAD = 0.5 * pi  # between two blows, the body on its collar again or soon
SETTLING_CYCLES = 12  # the motor finds its new speed


def features(parameters: BreakerParameters) -> CycleFeatures:
    """Return the features of a turn: of crank, motor, body and blow."""
    return CycleFeatures(
        CycleReference(CRANK, "turn", BEGIN_RAD),
        (
            *speed_features(CRANK),
            mean("torque_mean_nm", "N.m", ROTOR, "mean motor torque"),
            upper("torque_peak_nm", "N.m", ROTOR, "largest motor torque"),
            harmonic("torque_cos_1_nm", "N.m", ROTOR, 1, "cos", "motor torque, cosine of the turn"),
            mean("body_mean_rad", "rad", BODY, "mean angle of the body off its collar"),
            upper("lift_rad", "rad", BODY, "largest angle of the body off its collar"),
            share_above("flight_share", BODY, 0.3, "share of the turn in which the body is up"),
            harmonic("body_cos_1_rad", "rad", BODY, 1, "cos", "body angle, cosine of the turn"),
            harmonic("body_sin_1_rad", "rad", BODY, 1, "sin", "body angle, sine of the turn"),
            harmonic("body_cos_2_rad", "rad", BODY, 2, "cos", "body angle, cosine of half a turn"),
            harmonic("body_sin_2_rad", "rad", BODY, 2, "sin", "body angle, sine of half a turn"),
            event_share("blow_share", BLOW, "when in the turn the blow comes"),
            event_ratio("blow_speed_ratio", POST, PRE, "speed of the striker after the blow over that before"),
            event_value("blow_impulse_ns", "N.s", IMPULSE, "impulse of the blow", "sum"),
            *(gauge_features("blow", "tool") if parameters.tool.model == "wave" else ()),
        ),
        SETTLING_CYCLES,
    )
