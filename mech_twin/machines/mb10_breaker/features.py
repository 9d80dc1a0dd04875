# SPDX-License-Identifier: Apache-2.0
"""What sensors tell of one turn of the breaker's crank."""

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
from mech_twin.capabilities.gauge_features import gauge_features
from mech_twin.machines.mb10_breaker.parameters import BreakerParameters

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
