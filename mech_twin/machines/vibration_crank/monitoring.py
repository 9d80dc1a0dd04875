# SPDX-License-Identifier: Apache-2.0
"""What a monitor asks of the machine: features of a cycle, faults, the operating point."""

from __future__ import annotations

from mech_twin.capabilities.crank_features import crank_features
from mech_twin.capabilities.cycle import CycleFeatures, CycleReference, harmonic, mean, swing
from mech_twin.capabilities.faults import MachineFault, added_to_key, share_of_key, supply_sag
from mech_twin.capabilities.operating_point import OperatingVariable, drive_variables, varying_key
from mech_twin.machines.vibration_crank.parameters import VibrationCrank

CRANK, TORQUE, SLIDER = "linkage.crank.position", "linkage.crank.effort", "linkage.slider.position"
FRAME_X, FRAME_Y = "forces.shaking_force_x_n", "forces.shaking_force_y_n"


def features(parameters: VibrationCrank) -> CycleFeatures:
    """Return the features of a turn of the crank."""
    return CycleFeatures(
        CycleReference(CRANK),
        (
            *crank_features(CRANK, TORQUE),
            swing("stroke_m", "m", SLIDER, "stroke of the slider"),
            mean("slider_mean_m", "m", SLIDER, "mean place of the slider"),
            mean("frame_x_mean_n", "N", FRAME_X, "mean force on the frame across"),
            mean("frame_y_mean_n", "N", FRAME_Y, "mean force on the frame along"),
            harmonic("frame_x_sin_1_n", "N", FRAME_X, 1, "sin", "force on the frame across, sine of the turn"),
            harmonic("frame_x_cos_1_n", "N", FRAME_X, 1, "cos", "force on the frame across, cosine of the turn"),
            harmonic("frame_y_sin_1_n", "N", FRAME_Y, 1, "sin", "force on the frame along, sine of the turn"),
            harmonic("frame_y_cos_2_n", "N", FRAME_Y, 2, "cos", "force on the frame along, cosine of half a turn"),
        ),
    )


EITHER = (-0.4, -0.2, -0.1, 0.1, 0.2, 0.4)


def faults(parameters: VibrationCrank) -> tuple[MachineFault, ...]:
    """Return the faults of counterweight (where its mass is given), boom load, bearings and supply."""
    found = [
        share_of_key("boom_load", "the boom carries another load", "masses.tree_kg", EITHER),
        added_to_key(
            "working_force", "a steady force on the boom", "working_force_n", "N", (-400.0, -100.0, 100.0, 400.0)
        ),
        added_to_key(
            "crank_friction", "the crank's bearing rubs", "friction.coulomb_nm", "N.m", (2.0, 5.0, 20.0, 50.0)
        ),
        supply_sag(),
    ]
    if parameters.counterweight.mass_kg is not None:
        sizes = (-0.6, -0.4, -0.2, -0.1, -0.05)
        found.append(
            share_of_key("counterweight_lost", "part of the counterweight is gone", "counterweight.mass_kg", sizes)
        )
    return tuple(found)


def operating(parameters: VibrationCrank) -> tuple[OperatingVariable, ...]:
    """Return supply and load."""
    load = varying_key("boom_load", "mass that the boom carries", "masses.tree_kg", 0.1, "boom_load")
    return (*drive_variables(parameters.drive.kind), load)
