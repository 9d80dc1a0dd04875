# SPDX-License-Identifier: Apache-2.0
"""Metrics of the press (one position, one cycle, the paper's closing conditions), and what a monitor asks of it."""

from math import degrees, hypot, pi
from typing import Any

import numpy as np

from mech_twin.capabilities.cycle import CycleFeatures, CycleReference, crank_features, mean, swing
from mech_twin.capabilities.faults import (
    EITHER,
    MachineFault,
    OperatingVariable,
    added_to_key,
    beyond_range,
    drive_variables,
    share_of_key,
    varying_key,
)
from mech_twin.capabilities.sizing import Constraint
from mech_twin.machines.compaction_press.cycle import (
    cycle_extremes,
    flywheel_metrics,
    gain_rows,
    layer_work_on_the_way,
    mean_torque,
    transmission_range,
    turn_at,
    turn_flywheel,
)
from mech_twin.machines.compaction_press.dynamics import (
    Press,
    gains,
    layer_work,
    press_pins,
    press_reduced,
    press_weights,
    regime_at,
)
from mech_twin.machines.compaction_press.parameters import CompactionPress, press_constants
from mech_twin.machines.crank_run import CrankRun
from mech_twin.parts.four_bar import acute_angles, coefficients, failing_inequality, motion, position
from mech_twin.parts.induction_motor import MotorConstants
from mech_twin.samples import Frame

CRANK, TORQUE, PENDULUM = "linkage.crank.position", "linkage.crank.effort", "linkage.pendulum.position"
GAMMA_LIMIT_DEG = 20.0  # published
ALPHA_TOLERANCE_DEG = 5.0  # the design search's reading of "near 90"
ROUNDING = 1e-12  # of a flywheel: less than this is not missing


def features(parameters: CompactionPress) -> CycleFeatures:
    """Return the features of a turn of the crank."""
    return CycleFeatures(
        CycleReference(CRANK),
        (
            *crank_features(CRANK, TORQUE),
            mean("pendulum_mean_rad", "rad", PENDULUM, "mean angle of the pendulum"),
            swing("pendulum_swing_rad", "rad", PENDULUM, "angle the pendulum swings through"),
        ),
    )


def faults(parameters: CompactionPress) -> tuple[MachineFault, ...]:
    """Return the faults of layer, joints, flywheel (where one is fitted) and supply."""
    found = [
        share_of_key("layer_force", "the layer is stiffer or softer", "working_force.peak_n", EITHER),
        added_to_key("joint_friction", "a joint rubs", "friction.coulomb_nm", "N.m", (1.0, 3.0, 10.0, 30.0)),
        beyond_range(drive_variables(parameters.drive.kind)[0]),
    ]
    if parameters.flywheel.inertia_kg_m2 > 0.0:
        sizes = (-0.8, -0.5, -0.2, -0.1)
        found.append(share_of_key("flywheel_loose", "the flywheel slips", "flywheel.inertia_kg_m2", sizes))
    return tuple(found)


def operating(parameters: CompactionPress) -> tuple[OperatingVariable, ...]:
    """Return supply and layer."""
    layer = varying_key("layer", "force of the layer at the bottom", "working_force.peak_n", 0.1, "layer_force")
    return (*drive_variables(parameters.drive.kind), layer)


def position_metrics(parameters: CompactionPress, f: float) -> dict[str, Any]:
    """Return every angle, speed, force and constant at crank angle ``f`` (rad) and rated constant speed."""
    press, stroke = press_constants(parameters)
    w, drag = parameters.drive.speed_rad_per_s, parameters.drag_nm
    at = position(press.bar, f)
    alpha, beta, gamma = acute_angles(at)
    by = motion(press.bar, press.crank, press.plate, press.pendulum, at, coefficients(at), w, 0.0)
    now = press_reduced(press, f, regime_at(stroke, f, w))
    pins = press_pins(press, f, w, 0.0, now.force)
    k1, k2, normal, vertical = gains(press, f)
    start = press_reduced(press, 0.0, regime_at(stroke, 0.0, w))
    kinetic = 0.5 * now.inertia * w * w
    gained = kinetic - 0.5 * start.inertia * w * w + press_weights(press, f) - press_weights(press, 0.0)
    return {
        "crank_angle_rad": f,
        "crank_angle_deg": degrees(f),
        "a_m": (at.a_x, at.a_y),
        "b_m": (at.b_x, at.b_y),
        "alpha_deg": degrees(alpha),
        "beta_deg": degrees(beta),
        "gamma_deg": degrees(gamma),
        "transmission_angle_deg": degrees(float(np.arctan2(abs(at.det), at.u_x * at.v_x + at.u_y * at.v_y))),
        "w2_rad_per_s": by.w2,
        "w3_rad_per_s": by.w3,
        "e2_rad_per_s2": by.e2,
        "e3_rad_per_s2": by.e3,
        "pin_o_force_on_crank_n": (pins.o_x, pins.o_y),
        "pin_a_force_on_plate_n": (pins.a_x, pins.a_y),
        "pin_b_force_on_plate_n": (pins.b_x, pins.b_y),
        "pin_c_force_on_pendulum_n": (pins.c_x, pins.c_y),
        "working_force_n": now.force,
        "loaded_point_height_m": now.y,
        "drive_torque_nm": pins.moment + drag,
        "drive_torque_reduced_nm": 0.5 * w * w * now.slope - now.moment + drag,
        "drive_power_w": (pins.moment + drag) * w,
        "drive_work_from_zero_j": gained + drag * f + layer_work_on_the_way(press, stroke, f, 1.0 if w > 0.0 else -1.0),
        "kinetic_energy_j": kinetic,
        "i_pr_kg_m2": now.inertia,
        "i_pr_slope_kg_m2_per_rad": now.slope,
        "m_pr_nm": now.moment,
        "k1": k1,
        "k2": k2,
        "k1_k2": k1 * k2,
        "gain_exact_normal": normal,
        "gain_exact_vertical": vertical,
    }


def working_quarter(press: Press) -> dict[str, float]:
    """Return the smallest gains over 180-270 degrees, and the share of it on which each exact gain is two or more."""
    angles = np.asarray(pi + (np.arange(9000) + 0.5) * (0.5 * pi / 9000), dtype=np.float64)
    k1, k2, normal, vertical = gain_rows(press, angles)
    return {
        "paper_gain_min_in_quarter": float((k1 * k2).min()),
        "normal_gain_min_in_quarter": float(normal.min()),
        "vertical_gain_min_in_quarter": float(vertical.min()),
        "normal_gain_two_share_of_quarter": float(np.mean(normal >= 2.0)),
        "vertical_gain_two_share_of_quarter": float(np.mean(vertical >= 2.0)),
    }


def conditions(parameters: CompactionPress) -> tuple[Constraint, Constraint, Constraint]:
    """Return the paper's three closing conditions with their margins.

    gamma_max < 20 degrees; alpha near 90 degrees at the end of the working stroke; a flywheel, unless the machine
    keeps the asked non-uniformity without one (then nothing is missing).
    """
    press, stroke = press_constants(parameters)
    speed, delta = parameters.drive.speed_rad_per_s, parameters.flywheel.non_uniformity
    turn = turn_at(stroke, speed, delta)
    gamma = degrees(cycle_extremes(press, turn).gamma_max_rad)
    alpha = degrees(acute_angles(position(press.bar, stroke.bottom))[0])
    missing = turn_flywheel(press, stroke, speed, delta)
    if missing <= ROUNDING * parameters.flywheel.inertia_kg_m2:  # also of one that is sized to the last digit
        missing = 0.0
    return (
        Constraint("gamma_max_deg", gamma, GAMMA_LIMIT_DEG),
        Constraint("alpha_at_bottom_deg", alpha, 90.0 - ALPHA_TOLERANCE_DEG, "above"),
        Constraint("flywheel_missing_kg_m2", missing, 0.0),
    )


def cycle_metrics(parameters: CompactionPress) -> dict[str, float]:
    """Return the metrics of one cycle at rated constant speed; those of the flywheel are for the bare press."""
    press, stroke = press_constants(parameters, fitted=False)
    speed = parameters.drive.speed_rad_per_s
    extremes = cycle_extremes(press, turn_at(stroke, speed, parameters.flywheel.non_uniformity))
    torque_max = extremes.torque_max_nm + parameters.drag_nm
    torque_min = extremes.torque_min_nm + parameters.drag_nm
    torques = torque_max, torque_min
    least, most = (degrees(angle) for angle in transmission_range(press))
    gamma_check, alpha_check, flywheel_check = checks = conditions(parameters)
    mean = mean_torque(press, stroke, speed) + parameters.drag_nm
    return {
        "gamma_max_deg": gamma_check.value,
        "drive_torque_mean_nm": mean,
        "drive_torque_peak_nm": max(abs(torque) for torque in torques),
        "drive_torque_max_nm": torque_max,
        "drive_torque_min_nm": torque_min,
        "power_mean_w": mean * speed,
        "power_peak_w": max(torque * speed for torque in torques),
        "transmission_angle_min_deg": least,
        "transmission_angle_max_deg": most,
        **flywheel_metrics(press, stroke, speed, parameters.flywheel.non_uniformity),
        "work_per_cycle_j": float(layer_work(press.load, stroke.bottom_y_m)),
        "stroke_m": stroke.top_y_m - stroke.bottom_y_m,
        "top_deg": degrees(stroke.top),
        "bottom_deg": degrees(stroke.bottom),
        "contact_deg": degrees(stroke.contact),
        "crank_rocker_1": 1.0 if failing_inequality(press.bar, crank_rocker=True) is None else 0.0,
        "gamma_margin_deg": gamma_check.margin,
        "gamma_at_bottom_deg": degrees(acute_angles(position(press.bar, stroke.bottom))[2]),
        "alpha_at_bottom_deg": alpha_check.value,
        "alpha_margin_deg": alpha_check.margin,
        "flywheel_missing_kg_m2": flywheel_check.value,
        "conditions_hold_1": float(all(check.margin >= 0.0 for check in checks)),
        **working_quarter(press),
    }


def press_run(motor: MotorConstants | None) -> CrankRun:
    """Return the numbers of a run: those of every crank machine, the largest pin force, the layer's work."""

    def pin_force(frame: Frame) -> dict[str, float]:
        return {"pin_force_{}_n": max(hypot(pin.force_x_n, pin.force_y_n) for pin in frame.forces.wrenches)}

    return CrankRun(motor, pin_force, lambda numbers, memory: {"run_layer_work_j": memory.load_work_j})
