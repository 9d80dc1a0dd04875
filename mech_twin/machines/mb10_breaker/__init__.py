# SPDX-License-Identifier: Apache-2.0
"""The MB-10 breaker: motor, gear, percussion mechanism MO-10, tool, and the body its springs press on the tool."""

import math
from functools import partial

from mech_twin.capabilities.blow_gauge import blow_remarks
from mech_twin.engine.compiled_roles import StepForces
from mech_twin.machines.catalog import usual_capabilities
from mech_twin.machines.mb10_breaker.drawing import drawing, mechanism
from mech_twin.machines.mb10_breaker.forces import LoadedBreaker
from mech_twin.machines.mb10_breaker.half_sine_body import half_sine_body
from mech_twin.machines.mb10_breaker.metrics import position_metrics, static_metrics, tool_gauge
from mech_twin.machines.mb10_breaker.parameters import BreakerParameters
from mech_twin.machines.mb10_breaker.roles import (
    ACTS_ON,
    FORCE_RESIDUALS,
    FORCES,
    BreakerLinkage,
    DrivenBody,
    breaker_motor,
)
from mech_twin.machines.mb10_breaker.run_metrics import BreakerObserver, blow_energy
from mech_twin.machines.mb10_breaker.state import breaker
from mech_twin.machines.mb10_breaker.step import LedBreaker
from mech_twin.parts.induction_motor import motor_constants
from mech_twin.parts.rod_waves.parameters import rounded_lengths
from mech_twin.roles import BodyRole, Capabilities, Machine, no_remarks

PARAMETERS = BreakerParameters


def build(p: BreakerParameters) -> Machine:
    """Return the breaker of these parameters."""
    constants, curve, step_s = breaker(p), motor_constants(p.motor), p.coupling.step_s
    loaded = LoadedBreaker(constants)
    body: BodyRole = DrivenBody(loaded, step_s)
    if constants.held:
        body = half_sine_body(p.body, p.excitation, step_s)
    start_rad, start_command = math.radians(p.linkage.initial_crank_deg), p.supply.initial_fraction
    return Machine(
        name="mb10_breaker",
        parameters=p,
        coupling_step_s=step_s,
        motor=breaker_motor(constants, curve, p.supply.rate_per_s, step_s),
        linkage=BreakerLinkage(LedBreaker(constants, curve, step_s), step_s, start_rad, start_command),
        forces=StepForces(loaded, FORCES, ACTS_ON, dict.fromkeys(FORCE_RESIDUALS, 1e-10)),
        body=body,
        draw=drawing(constants, p.linkage.striker_angle_deg),
        report=lambda: static_metrics(p, constants),
        analyse=lambda crank_rad: position_metrics(p, constants, crank_rad),
        observer=lambda: BreakerObserver(p, constants),
        goes_on=lambda observer: observer.use(p, constants) if isinstance(observer, BreakerObserver) else None,
        mechanism=mechanism(constants, p.linkage.striker_angle_deg),
        blow_energy=lambda event: blow_energy(constants, event),
        gauge=tool_gauge(constants, p.tool.wave.gauge_curve),
        remarks=partial(blow_remarks, rounded_lengths(p.tool.wave, "tool.wave")) if constants.waves else no_remarks,
    )


def capabilities() -> Capabilities:
    """Return the machine's capabilities beyond running."""
    from mech_twin.machines.mb10_breaker import metrics, plots, published, sizing

    return usual_capabilities(metrics, published, sizing, pictures=plots.pictures, works_taken=("wall_work_j",))
