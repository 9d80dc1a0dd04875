# SPDX-License-Identifier: Apache-2.0
"""Winding drum: the dynamic torque of a winding or unwinding package, until it is full or empty."""

from __future__ import annotations

from functools import partial

from mech_twin.machines.drives import PrescribedSpeed
from mech_twin.machines.winding_drum.drawing import mechanism, package_drawing
from mech_twin.machines.winding_drum.drum_row import ENDED
from mech_twin.machines.winding_drum.metrics import DrumObserver, package_metrics, position_metrics
from mech_twin.machines.winding_drum.parameters import WindingDrum, package_constants
from mech_twin.machines.winding_drum.roles import JOINTS, DrumForces, DrumLinkage
from mech_twin.roles import Capabilities, Machine

PARAMETERS = WindingDrum


def build(parameters: WindingDrum) -> Machine:
    """Return the winding drum of these parameters."""
    constants = package_constants(parameters, parameters.direction == "winding")
    first, last = parameters.radii_m
    fraction = parameters.supply.initial_fraction
    linkage = DrumLinkage(
        constants,
        parameters.coupling.step_s,
        first,
        last,
        fraction * parameters.yarn_speed_m_per_s,
        fraction,
        "full" if parameters.direction == "winding" else "empty",
    )
    motor = PrescribedSpeed(
        parameters.yarn_speed_m_per_s,
        parameters.rate_per_s,
        parameters.coupling.step_s,
        "yarn",
        ENDED,
        linkage_joints=JOINTS,
    )

    return Machine(
        "winding_drum",
        parameters,
        parameters.coupling.step_s,
        motor,
        linkage,
        DrumForces(constants, first),
        None,
        lambda sample, _: package_drawing(constants, sample),
        partial(package_metrics, parameters, constants),
        partial(position_metrics, parameters, constants),
        DrumObserver,
        mechanism(constants, max(first, last)),
    )


def capabilities() -> Capabilities:
    """Return what the machine answers beside running."""
    from mech_twin.machines.winding_drum import metrics, published

    return Capabilities(
        published=published.rows,
        pictures=published.pictures,
        features=metrics.features,
        faults=metrics.faults,
        operating=metrics.operating,
    )
