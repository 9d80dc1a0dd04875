# SPDX-License-Identifier: Apache-2.0
"""Winding drum: the dynamic torque of a winding or unwinding package, until it is full or empty."""

from functools import partial

from mech_twin.engine.compiled_roles import StepForces, StepMotor
from mech_twin.machines.catalog import usual_capabilities
from mech_twin.machines.drives import SpeedDrive
from mech_twin.machines.winding_drum.drawing import mechanism, package_drawing
from mech_twin.machines.winding_drum.metrics import DrumObserver, package_metrics, position_metrics
from mech_twin.machines.winding_drum.parameters import WindingDrum, package_constants
from mech_twin.machines.winding_drum.roles import ENDED, FORCES, JOINTS, Drum, DrumLinkage
from mech_twin.roles import Capabilities, Machine

PARAMETERS = WindingDrum


def build(parameters: WindingDrum) -> Machine:
    """Return the winding drum of these parameters."""
    constants = package_constants(parameters, parameters.direction == "winding")
    (first, last), step_s, speed = parameters.radii_m, parameters.coupling.step_s, parameters.yarn_speed_m_per_s
    fraction = parameters.supply.initial_fraction
    drum = Drum(constants, first, last, step_s)
    linkage = DrumLinkage(drum, step_s, fraction * speed, fraction)
    drive = SpeedDrive(speed, parameters.rate_per_s, step_s, JOINTS.index("yarn"), ENDED)
    return Machine(
        "winding_drum",
        parameters,
        step_s,
        StepMotor(drive, ("motor",)),
        linkage,
        StepForces(drum, FORCES, ("package",), {"drive_torque_routes": 1e-10}),
        None,
        lambda sample, _: package_drawing(constants, sample),
        partial(package_metrics, parameters, constants),
        partial(position_metrics, parameters, constants),
        DrumObserver,
        mechanism(constants, max(first, last)),
    )


def capabilities() -> Capabilities:
    """Return the machine's capabilities beyond running."""
    from mech_twin.machines.winding_drum import metrics, published

    return usual_capabilities(metrics, published)
