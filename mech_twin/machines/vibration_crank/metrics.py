# SPDX-License-Identifier: Apache-2.0
"""Numbers of the vibration crank (position, cycle, balance, influence of speed), and what a monitor asks of it."""

import math
from math import pi
from typing import Any

import numpy as np

from mech_twin.capabilities.cycle import Array, CycleFeatures, CycleReference, crank_features, harmonic, mean, swing
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
from mech_twin.engine.crank_state import Memory
from mech_twin.kernels.kernel import kernel
from mech_twin.machines.crank_run import CrankRun
from mech_twin.machines.vibration_crank.parameters import VibrationCrank, slider_crank_constants
from mech_twin.machines.vibration_crank.slider_crank import (
    BOOM,
    SliderCrank,
    drive_moment,
    follower,
    pin_forces,
    reduced,
    stored_energy,
)
from mech_twin.parts.induction_motor import MotorConstants

CRANK, TORQUE, SLIDER = "linkage.crank.position", "linkage.crank.effort", "linkage.slider.position"
COLUMN_X, COLUMN_Y = "forces.shaking_force_x_n", "forces.shaking_force_y_n"
GRID = 3600
HARMONICS = 256
FRAME_X, FRAME_Y, DRIVE_MOMENT = 0, 1, 2  # rows of a table of forces on the frame
MOMENT, FORCE, LITTLE_FORCE = 0, 1, 2
PUBLISHED_PEAK_WITHOUT_NM = 435.804  # [vibration_crank], 150 rpm, 50 kg tree
PUBLISHED_PEAK_WITH_NM = 331.931


def features(parameters: VibrationCrank) -> CycleFeatures:
    """Return the features of a turn of the crank."""
    return CycleFeatures(
        CycleReference(CRANK),
        (
            *crank_features(CRANK, TORQUE),
            swing("stroke_m", "m", SLIDER, "stroke of the slider"),
            mean("slider_mean_m", "m", SLIDER, "mean place of the slider"),
            mean("frame_x_mean_n", "N", COLUMN_X, "mean force on the frame across"),
            mean("frame_y_mean_n", "N", COLUMN_Y, "mean force on the frame along"),
            harmonic("frame_x_sin_1_n", "N", COLUMN_X, 1, "sin", "force on the frame across, sine of the turn"),
            harmonic("frame_x_cos_1_n", "N", COLUMN_X, 1, "cos", "force on the frame across, cosine of the turn"),
            harmonic("frame_y_sin_1_n", "N", COLUMN_Y, 1, "sin", "force on the frame along, sine of the turn"),
            harmonic("frame_y_cos_2_n", "N", COLUMN_Y, 2, "cos", "force on the frame along, cosine of half a turn"),
        ),
    )


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
        beyond_range(drive_variables(parameters.drive.kind)[0]),
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


@kernel
def _size(s: SliderCrank, th: float, w: float, what: int, drag: float) -> float:
    if what == MOMENT:
        return abs(drive_moment(s, th, w, 0.0) + drag)
    at = pin_forces(s, th, w, 0.0)
    size = math.hypot(at.frame_x, at.frame_y)
    return size if what == FORCE else -size


@kernel
def extreme(s: SliderCrank, w: float, what: int, drag: float = 0.0) -> float:
    """Return the largest |M| (N m), largest force on the frame (N) or minus the smallest, over a turn at speed w.

    The best of 3600 positions, refined by golden sections between its neighbours; ``drag`` (N m) is friction's part.
    """
    best, place, step = -1e300, 0.0, 2.0 * np.pi / GRID
    for i in range(GRID):
        value = _size(s, i * step, w, what, drag)
        if value > best:
            best, place = value, i * step
    low, high, golden = place - step, place + step, 0.6180339887498949
    left, right = high - golden * (high - low), low + golden * (high - low)
    at_left, at_right = _size(s, left, w, what, drag), _size(s, right, w, what, drag)
    for _ in range(40):
        if at_left > at_right:
            high, right, at_right = right, left, at_left
            left = high - golden * (high - low)
            at_left = _size(s, left, w, what, drag)
        else:
            low, left, at_left = left, right, at_right
            right = low + golden * (high - low)
            at_right = _size(s, right, w, what, drag)
    return max(best, at_left, at_right)


@kernel
def frame_forces(s: SliderCrank, angles: Array, w: float) -> Array:
    """Return the force on the frame (N) and the drive moment (N m), rows (x, y, moment), at crank angles (rad)."""
    table = np.empty((3, angles.size))
    for i in range(angles.size):
        at = pin_forces(s, angles[i], w, 0.0)
        table[FRAME_X, i], table[FRAME_Y, i], table[DRIVE_MOMENT, i] = at.frame_x, at.frame_y, at.moment
    return table


def turn(count: int = GRID) -> Array:
    """Return ``count`` crank angles spread over one turn (rad)."""
    return np.asarray(np.arange(count) * (2.0 * pi / count), dtype=np.float64)


def polar_diagram(parameters: VibrationCrank) -> dict[float, Array]:
    """Return the force on the frame at 360 angles, rows (x, y, moment), for each of five balancing fractions.

    The counterweight is the derived one, m_p = (m_r + kappa m_s) r/r_p, whatever mass is configured.
    """
    speed = parameters.drive.speed_rad_per_s
    fractions = (0.0, 0.25, 0.5, 0.75, 1.0)
    return {fraction: frame_forces(balanced(parameters, fraction), turn(360), speed) for fraction in fractions}


def balanced(parameters: VibrationCrank, fraction: float) -> SliderCrank:
    """Return the constants with the counterweight derived for a balancing fraction."""
    return slider_crank_constants(parameters)._replace(counter_mass=parameters.balancing_kg(fraction))


def lanchester_metrics(s: SliderCrank, speed: float) -> dict[str, float]:
    """Return the parts of the frame force that a counter-rotating mass at w and a pair at 2w would cancel.

    Fx + i Fy = sum of c_n exp(i n th): c_-1 rotates against the crank and is cancelled by one counter-rotating mass.
    A pair of counter-rotating masses at 2w gives a force along a line and cancels the vertical second harmonic.
    """
    angles = turn(HARMONICS)
    x, y, _ = frame_forces(s, angles, speed)
    lines = np.fft.fft(x + 1j * y) / HARMONICS
    once = x + 1j * y - lines[-1] * np.exp(-1j * angles)
    vertical = np.fft.fft(y) / HARMONICS
    twice = once - 2j * np.real(vertical[2] * np.exp(2j * angles))
    height = 2.0 * np.abs(vertical)
    return {
        "forward_rotating_force_n": float(np.abs(lines[1])),
        "counter_rotating_force_n": float(np.abs(lines[-1])),
        "second_harmonic_force_n": float(height[2]),
        "fourth_harmonic_force_n": float(height[4]),
        "sixth_harmonic_force_n": float(height[6]),
        "shaking_force_max_after_counter_mass_n": float(np.max(np.abs(once))),
        "shaking_force_max_after_pair_n": float(np.max(np.abs(twice))),
    }


def peaks(s: SliderCrank, speed: float, drag: float = 0.0) -> tuple[float, float]:
    """Return the largest |M| without and with the counterweight (N m), friction's part ``drag`` (N m) included."""
    return extreme(s._replace(counter_mass=0.0), speed, MOMENT, drag), extreme(s, speed, MOMENT, drag)


def benefit_against_speed(s: SliderCrank, speeds_rpm: tuple[float, ...]) -> dict[float, float]:
    """Return the relative change of the largest |M| by the counterweight (negative: a benefit), by speed in rpm."""
    both = {rpm: peaks(s, rpm * pi / 30.0) for rpm in speeds_rpm}
    return {rpm: with_it / without - 1.0 for rpm, (without, with_it) in both.items()}


def compromise_rod(parameters: VibrationCrank) -> tuple[float, float, float, float]:
    """Return the rod (m) with the smallest larger error of the two published peaks, both peaks (N m), that error.

    A question about the print, not a setting: no rod makes both fit (`cycle_metrics`).
    """
    s, speed = slider_crank_constants(parameters), parameters.drive.speed_rad_per_s

    def error(rod: float) -> float:
        without, with_it = peaks(s._replace(kind=1, rod_m=rod), speed)
        return max(abs(without / PUBLISHED_PEAK_WITHOUT_NM - 1.0), abs(with_it / PUBLISHED_PEAK_WITH_NM - 1.0))

    from scipy.optimize import minimize_scalar  # 0.2 s

    rods = np.linspace(1.05 * (s.crank_m + abs(s.offset_m)), 20.0 * s.crank_m, 400)
    best = float(min(rods, key=error))
    width = float(rods[1] - rods[0])
    found = minimize_scalar(error, bounds=(best - width, best + width), method="bounded", options={"xatol": 1e-10})
    rod = float(found.x)
    return (rod, *peaks(s._replace(kind=1, rod_m=rod), speed), float(found.fun))


def cycle_metrics(parameters: VibrationCrank, s: SliderCrank) -> dict[str, float]:
    """Return the metrics of one cycle at rated speed."""
    speed = parameters.drive.speed_rad_per_s
    without, with_it = peaks(s, speed, parameters.drag_nm)
    bound = s.counter_mass * s.gravity * s.counter_m
    published = PUBLISHED_PEAK_WITHOUT_NM - PUBLISHED_PEAK_WITH_NM
    moments = frame_forces(s, turn(), speed)[2] + parameters.drag_nm
    return {
        "reciprocating_mass_kg": s.joint_mass + s.load_mass,
        "rotating_mass_kg": s.rotating_mass,
        "rotating_mass_from_parts_kg": parameters.masses.rotating_from_parts,
        "counterweight_mass_kg": s.counter_mass,
        "counterweight_mass_derived_kg": balanced(parameters, parameters.counterweight.balancing_fraction).counter_mass,
        "counterweight_volume_m3": s.counter_mass / parameters.counterweight.density_kg_per_m3,
        "drive_torque_peak_nm": with_it,
        "drive_torque_peak_without_counterweight_nm": without,
        "drive_torque_max_nm": float(moments.max()),
        "drive_torque_min_nm": float(moments.min()),
        "drive_torque_mean_nm": float(moments.mean()),
        "peak_change_with_counterweight_1": (with_it / without - 1.0) if without > 0.0 else 0.0,
        "peak_difference_bound_nm": bound,
        "peak_difference_nm": without - with_it,
        "peak_difference_published_nm": published,
        "published_peaks_possible_1": 1.0 if published <= bound else 0.0,
        "peak_without_error_against_print_1": without / PUBLISHED_PEAK_WITHOUT_NM - 1.0,
        "peak_with_error_against_print_1": with_it / PUBLISHED_PEAK_WITH_NM - 1.0,
        "shaking_force_max_n": extreme(s, speed, FORCE),
        "shaking_force_min_n": -extreme(s, speed, LITTLE_FORCE),
        **lanchester_metrics(s, speed),
    }


def position_metrics(s: SliderCrank, speed: float, drag: float, th: float) -> dict[str, Any]:
    """Return coordinates, forces and moments at crank angle ``th`` (rad), rated speed and a friction ``drag`` (N m)."""
    at = follower(s, th)
    inertia, slope, load = reduced(s, th)
    forces = pin_forces(s, th, speed, 0.0)
    unit = "rad" if s.kind == BOOM else "m"
    return {
        "crank_angle_rad": th,
        f"follower_{unit}": at.z,
        f"follower_speed_{unit}_per_s": at.z1 * speed,
        f"follower_acceleration_{unit}_per_s2": at.z2 * speed * speed,
        "rod_joint_m": (at.x, at.y),
        "bearing_force_n": (forces.bearing_x, forces.bearing_y),
        "crank_pin_force_n": (forces.pin_x, forces.pin_y),
        "ground_force_n": (forces.ground_x, forces.ground_y),
        "ground_moment_nm": forces.ground_moment,
        "shaking_force_n": (forces.frame_x, forces.frame_y),
        "drive_torque_nm": drive_moment(s, th, speed, 0.0) + drag,
        "drive_torque_from_pins_nm": forces.moment + drag,
        "drive_work_from_zero_j": stored_energy(s, th, speed) - stored_energy(s, 0.0, speed) + drag * th,
        "kinetic_energy_j": 0.5 * inertia * speed * speed,
        "drive_torque_without_counterweight_nm": drive_moment(s._replace(counter_mass=0.0), th, speed, 0.0) + drag,
        "reduced_inertia_kg_m2": inertia,
        "reduced_inertia_slope_kg_m2_per_rad": slope,
        "reduced_moment_nm": load,
    }


def crank_run(motor: MotorConstants | None) -> CrankRun:
    """Return the numbers of a run: those of every crank machine, the force on the frame, the torque's greatest size."""

    def peak(numbers: dict[str, float], memory: Memory) -> dict[str, float]:
        ends = numbers["run_drive_torque_min_nm"], numbers["run_drive_torque_max_nm"]
        return {"run_drive_torque_peak_nm": max(map(abs, ends))}

    return CrankRun(motor, lambda at: {"shaking_force_{}_n": at.forces.quantities.as_dict()["shaking_force_n"]}, peak)
