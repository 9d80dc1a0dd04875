# SPDX-License-Identifier: Apache-2.0
"""What a monitor asks of the machine: features of a cycle, faults, the operating point."""

from __future__ import annotations

from typing import Any

from mech_twin.capabilities.crank_features import crank_features
from mech_twin.capabilities.cycle import CycleFeatures, CycleReference, harmonic, mean, swing
from mech_twin.capabilities.faults import MachineFault, share_of_key, supply_sag
from mech_twin.capabilities.operating_point import OperatingVariable, motor_changes, motor_variables, varying_key
from mech_twin.machines.roller_former.parameters import RollerFormer

CRANK, TORQUE, TWIST = "linkage.crank.position", "motor.rotor.effort", "linkage.twist.position"
SETTLING_TURNS = 4
RUN_UP_S = 5.0


def features(parameters: RollerFormer) -> CycleFeatures:
    """Return the features of a turn of the crank shaft."""
    return CycleFeatures(
        CycleReference(CRANK),
        (
            *crank_features(CRANK, TORQUE),
            harmonic("torque_cos_4_nm", "N.m", TORQUE, 4, "cos", "driving torque, cosine of a quarter of a turn"),
            harmonic("torque_sin_4_nm", "N.m", TORQUE, 4, "sin", "driving torque, sine of a quarter of a turn"),
            mean("twist_mean_rad", "rad", TWIST, "mean twist of the coupling"),
            swing("twist_range_rad", "rad", TWIST, "range of the coupling's twist"),
            harmonic("twist_cos_2_rad", "rad", TWIST, 2, "cos", "twist, cosine of half a turn"),
            harmonic("twist_sin_2_rad", "rad", TWIST, 2, "sin", "twist, sine of half a turn"),
            harmonic("twist_cos_4_rad", "rad", TWIST, 4, "cos", "twist, cosine of a quarter of a turn"),
            harmonic("twist_sin_4_rad", "rad", TWIST, 4, "sin", "twist, sine of a quarter of a turn"),
        ),
        SETTLING_TURNS,
        RUN_UP_S,
    )


LESS = (-0.6, -0.4, -0.2, -0.1)
LESS_TORQUE = (-0.4, -0.3, -0.2, -0.1)
EITHER = (-0.4, -0.2, -0.1, 0.1, 0.2, 0.4)


def faults(parameters: RollerFormer) -> tuple[MachineFault, ...]:
    """Return the faults of coupling, carts, guides, motor and supply."""
    found = [
        share_of_key("coupling_stiffness", "the coupling has gone soft", "drive.stiffness_nm_per_rad", LESS),
        share_of_key("coupling_damping", "the coupling damps less or more", "drive.damping_nms_per_rad", EITHER),
        share_of_key("cart_load", "the mix is stiffer or softer", "carts.roller_force_x_n", EITHER),
        share_of_key("guide_friction", "the guide rollers run hard", "carts.friction", (0.25, 0.5, 1.0, 2.0)),
        MachineFault("phase_loss", "the motor has lost torque, as of a phase", "1", LESS_TORQUE, _weaker_motor),
        supply_sag(),
    ]
    states = parameters.carts.cart_states
    return (*found, *(_empty(cart, states) for cart, state in enumerate(states) if state == "loaded"))


def _weaker_motor(parameters: RollerFormer, size: float) -> dict[str, Any]:
    """Return the motor with its torque at every slip changed by a relative amount."""
    return motor_changes(parameters, torque=1.0 + size)


def _empty(cart: int, states: tuple[Any, ...]) -> MachineFault:
    """Return the fault of a cart without mix; its size is 1."""
    changed = [*states[:cart], "empty", *states[cart + 1 :]]

    def changes(parameters: RollerFormer, size: float) -> dict[str, Any]:
        return {"carts.states": changed}

    return MachineFault(f"cart_{cart + 1}_empty", f"cart {cart + 1} has no mix under its rollers", "1", (1.0,), changes)


MIX_X, MIX_Y = "carts.roller_force_x_n", "carts.roller_force_y_n"


def operating(parameters: RollerFormer) -> tuple[OperatingVariable, ...]:
    """Return supply, motor temperature and mix, whose force on a roller keeps its direction."""
    return (*motor_variables(), varying_key("mix", "force of the mix on the rollers", MIX_X, 0.1, "cart_load", MIX_Y))
