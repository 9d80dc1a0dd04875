"""Motor, stiffness and damping of the roller former."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from mech_twin.capabilities.errors import StudyError
from mech_twin.capabilities.sizing import Constraint, Sizing, Table, binding_of
from mech_twin.capabilities.variation import varied
from mech_twin.configuration_tree import configuration_tree
from mech_twin.machines.roller_former.coupling_choice import (
    SWEEP_DAMPING,
    SWEEP_STIFFNESS,
    CouplingPoint,
    coupling_point,
)
from mech_twin.machines.roller_former.motor_choice import MotorVerdict, motor_selection
from mech_twin.machines.roller_former.parameters import RollerFormer

# share of the coupling's rated moment; twist peak to peak (published: 0.003 to 0.008); what more damping may gain
LIMITS: dict[str, float] = {"share_of_rated": 1.0, "twist_range_rad": 0.005, "damping_gain": 0.02}
MOTOR_TABLE = "motors_4a"
OBJECTIVES = ("coupling_max_nm",)


def motor_of(parameters: RollerFormer, table: Mapping[str, Any]) -> tuple[RollerFormer, MotorVerdict]:
    """Return the configuration with the weakest motor of the table that carries the mean load and runs steadily."""
    verdicts = motor_selection(parameters, table)
    for found in verdicts:
        if found.rated_enough and found.runs:
            motor = {"catalogue_name": found.name, "torque_curve": parameters.motor.torque_curve, **table[found.name]}
            tree = {**configuration_tree(parameters), "motor": motor}
            return type(parameters).model_validate(tree), found
    need = verdicts[-1].power_required_w / 1000.0
    raise StudyError(f"no motor of the table suits: {need:.1f} kW needed, the strongest has {verdicts[-1].text}")


def within(point: CouplingPoint, limits: Mapping[str, float]) -> bool:
    """Return whether the coupling and its twist keep their limits (false where there is no steady turn)."""
    return point.share_of_rated <= limits["share_of_rated"] and point.twist_range_rad <= limits["twist_range_rad"]


def damped(p: RollerFormer, stiffness: float, gain: float) -> CouplingPoint:
    """Return the coupling at the least damping from which more lowers its RMS about the mean by at most ``gain``.

    The RMS is asked, since it falls with damping throughout; the largest moment has chance minima.
    """
    low, high = coupling_point(p, stiffness, SWEEP_DAMPING[0]), coupling_point(p, stiffness, SWEEP_DAMPING[-1])
    goal = high.coupling_rms_about_mean_nm * (1.0 + gain)
    if low.coupling_rms_about_mean_nm <= goal:
        return low
    while high.damping_nms_per_rad - low.damping_nms_per_rad > 1e-3 * high.damping_nms_per_rad:
        middle = coupling_point(p, stiffness, (low.damping_nms_per_rad * high.damping_nms_per_rad) ** 0.5)
        low, high = (low, middle) if middle.coupling_rms_about_mean_nm <= goal else (middle, high)
    return high


def stiffness_and_damping(p: RollerFormer, limits: Mapping[str, float]) -> tuple[CouplingPoint, list[CouplingPoint]]:
    """Return the coupling with the least largest moment within the limits, and the sweep it was found in.

    Between the best stiffness of the sweep and a neighbour that breaks a limit, the limit itself is looked for.
    """
    sweep = [damped(p, stiffness, limits["damping_gain"]) for stiffness in SWEEP_STIFFNESS[::2]]
    allowed = [i for i, point in enumerate(sweep) if within(point, limits)]
    if not allowed:
        least = min(sweep, key=lambda point: point.twist_range_rad)
        raise StudyError(
            f"no stiffness keeps share_of_rated <= {limits['share_of_rated']:g} and twist_range_rad <= "
            f"{limits['twist_range_rad']:g}: at {least.stiffness_nm_per_rad:.0f} N m/rad they are "
            f"{least.share_of_rated:.3g} and {least.twist_range_rad:.3g}"
        )
    place = min(allowed, key=lambda i: sweep[i].coupling_max_nm)
    best = sweep[place]
    for side in (place - 1, place + 1):
        if 0 <= side < len(sweep) and not within(sweep[side], limits):
            inside, outside = sweep[place].stiffness_nm_per_rad, sweep[side].stiffness_nm_per_rad
            while abs(outside - inside) > 1e-3 * inside:
                middle = damped(p, 0.5 * (inside + outside), limits["damping_gain"])
                if within(middle, limits):
                    inside = middle.stiffness_nm_per_rad
                    best = min(best, middle, key=lambda point: point.coupling_max_nm)
                else:
                    outside = middle.stiffness_nm_per_rad
    return best, sweep


def sizing(
    parameters: RollerFormer, limits: Mapping[str, float], objective: str, table: Table, tolerance: float = 0.0
) -> Sizing:
    """Return motor (the weakest of the table that carries the load), stiffness and damping of the coupling."""
    p, motor = motor_of(parameters, table(MOTOR_TABLE))
    best, sweep = stiffness_and_damping(p, limits)
    stiffness, damping = best.stiffness_nm_per_rad, best.damping_nms_per_rad
    reached = coupling_point(p, stiffness, SWEEP_DAMPING[-1]).coupling_rms_about_mean_nm
    constraints = (
        Constraint("share_of_rated", best.share_of_rated, limits["share_of_rated"]),
        Constraint("twist_range_rad", best.twist_range_rad, limits["twist_range_rad"]),
        Constraint("damping_gain", best.coupling_rms_about_mean_nm / reached - 1.0, limits["damping_gain"]),
        Constraint("motor_power_w", motor.rated_power_w, motor.power_required_w, "above"),
    )
    shown = ("stiffness_nm_per_rad", "damping_nms_per_rad", "coupling_max_nm", "twist_range_rad", "share_of_rated")
    binding = binding_of(constraints, "none: the least moment of the sweep; its minima over stiffness are flat")
    return Sizing(
        "roller_former",
        objective,
        {
            "motor.catalogue_name": motor.name,
            "drive.stiffness_nm_per_rad": stiffness,
            "drive.damping_nms_per_rad": damping,
        },
        varied(p, {"drive.stiffness_nm_per_rad": stiffness, "drive.damping_nms_per_rad": damping}),
        {
            "coupling_max_nm": best.coupling_max_nm,
            "coupling_rms_nm": best.coupling_rms_nm,
            "twist_range_rad": best.twist_range_rad,
            "share_of_rated": best.share_of_rated,
            "motor_power_required_w": motor.power_required_w,
        },
        constraints,
        f"{binding}; {motor.text}",
        tuple({name: getattr(point, name) for name in shown} for point in sweep[::2]),
    )
