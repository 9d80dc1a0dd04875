# SPDX-License-Identifier: Apache-2.0
"""Objectives and constraint margins of many designs of the press (r, l, h, R) at once.

A design is evaluated at 72 crank positions, where very many are wanted, or on the continuous curve.  The mean press
force takes its contact travel from exact angles and heights in both.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import prange

from mech_twin.capabilities.design import Evaluation
from mech_twin.kernels.kernel import kernel, parallel_kernel
from mech_twin.machines.compaction_press.cycle_extremes import (
    asked_flywheel,
    cycle_extremes,
    one_turn,
    transmission_range,
)
from mech_twin.machines.compaction_press.design_problem import (
    CONSTRAINTS,
    OBJECTIVES,
    Array,
    Duty,
    Limits,
    Margins,
    Objectives,
    Problem,
    packed,
    unpacked,
)
from mech_twin.machines.compaction_press.design_rule import Lengths, scaled_press
from mech_twin.machines.compaction_press.design_stroke import (
    POSITIONS,
    TURN,
    PressStroke,
    bottom_angles,
    exact_stroke,
    mean_press_force,
)
from mech_twin.machines.compaction_press.dynamics import FREE, Press, loaded_height, press_reduced
from mech_twin.machines.compaction_press.stroke_load import StrokeLoad
from mech_twin.parts.four_bar import acute_angles, position

FEW = 8  # designs that one thread evaluates: beside other work, waiting for further ones takes 8 ms


class Samples(NamedTuple):
    """Columns in the order of motion: reduced inertia, its slope, M_pr, height of the loaded point, its slope."""

    inertia: Array
    slope: Array
    moment: Array
    y: Array
    y1: Array


@kernel
def turning_margins(lengths: Lengths, spare_m: float) -> tuple[float, float, float]:
    """Return the margins (m) of r + |OC| <= R1 + R, ||OC| - r| >= |R1 - R| and of the crank as the shortest link."""
    r, l, R = lengths.crank_m, lengths.length_m, lengths.pendulum_m
    ground = math.hypot(l, lengths.height_m)
    return (
        l + R - r - ground - spare_m,
        abs(ground - r) - abs(l - R) - spare_m,
        min(l, R, ground) - r - spare_m,
    )


@kernel
def _sampled_press(press: Press, direction: float) -> tuple[Samples, float, float, int, int]:
    """Return the unloaded samples, largest gamma and smallest transmission angle (rad), places of top and bottom."""
    n = POSITIONS
    at = Samples(np.empty(n), np.empty(n), np.empty(n), np.empty(n), np.empty(n))
    gamma_max, beta_min, top, bottom = 0.0, 10.0, 0, 0
    for k in range(n):
        f = direction * TURN * k / n
        _, beta, gamma = acute_angles(position(press.bar, f))
        gamma_max, beta_min = max(gamma_max, gamma), min(beta_min, beta)
        now = press_reduced(press, f, FREE)
        at.inertia[k], at.slope[k], at.moment[k], at.y[k], at.y1[k] = now.inertia, now.slope, now.moment, now.y, now.y1
        if at.y[k] > at.y[top]:
            top = k
        if at.y[k] < at.y[bottom]:
            bottom = k
    return at, gamma_max, beta_min, top, bottom


@kernel
def _load_samples(at: Samples, duty: Duty, top: int, bottom: int) -> None:
    """Add the layer's moment to the samples on the way down; the stroke is that of the samples."""
    y_t, y_b = at.y[top], at.y[bottom]
    y_c = y_t - duty.contact_fraction * (y_t - y_b)
    if math.isnan(duty.contact_fraction):
        y_c = at.y[POSITIONS // 2]
    for i in range((bottom - top) % POSITIONS + 1):
        k = (top + i) % POSITIONS
        if at.y[k] < y_c:
            at.moment[k] += duty.peak_n * ((y_c - at.y[k]) / (y_c - y_b)) ** duty.exponent * at.y1[k]


@kernel
def _sampled_objectives(at: Samples, duty: Duty) -> tuple[float, float]:
    """Return the peak of |torque| (N m) and the flywheel (kg m2), work by trapezoid on the samples."""
    n, w, delta = POSITIONS, abs(duty.speed_rad_per_s), duty.non_uniformity
    direction = 1.0 if duty.speed_rad_per_s >= 0.0 else -1.0
    fast, slow = 0.5 * (w * (1.0 + 0.5 * delta)) ** 2, 0.5 * (w * (1.0 - 0.5 * delta)) ** 2
    mean = at.moment.sum() / n
    work, peak, high, low = 0.0, 0.0, -1e300, 1e300
    for k in range(n):
        if k > 0:
            work += direction * (0.5 * (at.moment[k] + at.moment[k - 1]) - mean) * TURN / n
        high, low = max(high, work - fast * at.inertia[k]), min(low, work - slow * at.inertia[k])
        peak = max(peak, abs(0.5 * w * w * at.slope[k] - at.moment[k]))
    return peak, (high - low) / (delta * w * w)


@kernel
def sampled_design(lengths: Lengths, problem: Problem) -> tuple[Objectives, Margins]:
    """Return objectives and margins at 72 crank positions; the mean press force with exact angles and heights."""
    duty, limits = problem.duty, problem.limits
    direction = 1.0 if duty.speed_rad_per_s >= 0.0 else -1.0
    press = scaled_press(problem.rule, lengths)
    at, gamma_max, beta_min, top, bottom = _sampled_press(press, direction)
    stroke = exact_stroke(press, duty, TURN * top / POSITIONS, TURN * bottom / POSITIONS)
    gamma, alpha = bottom_angles(press.bar, direction * TURN * bottom / POSITIONS)
    height = at.y[top] - at.y[bottom]
    _load_samples(at, duty, top, bottom)
    peak, flywheel = _sampled_objectives(at, duty)
    return (
        Objectives(peak, flywheel, mean_press_force(stroke, limits.constant_torque_nm)),
        Margins(
            limits.gamma_max_deg - math.degrees(gamma_max),
            height - limits.stroke_m,
            math.degrees(beta_min) - limits.transmission_deg,
            limits.gamma_bottom_deg - math.degrees(gamma),
            math.degrees(alpha) - limits.alpha_bottom_deg,
            *turning_margins(lengths, limits.spare_m),
        ),
    )


@kernel
def continuous_press(
    press: Press, lengths: Lengths, stroke: PressStroke, duty: Duty, limits: Limits
) -> tuple[Objectives, Margins]:
    """Return objectives and margins of a loaded press on the continuous curve, its stroke given."""
    turn = one_turn(stroke.contact, stroke.bottom, duty.speed_rad_per_s, duty.non_uniformity)
    found = cycle_extremes(press, turn)
    least, most = transmission_range(press)
    gamma, alpha = bottom_angles(press.bar, stroke.bottom)
    return (
        Objectives(
            max(found.torque_max_nm, -found.torque_min_nm),
            asked_flywheel(found, turn),
            mean_press_force(stroke, limits.constant_torque_nm),
        ),
        Margins(
            limits.gamma_max_deg - math.degrees(found.gamma_max_rad),
            stroke.top_y - stroke.bottom_y - limits.stroke_m,
            math.degrees(min(least, math.pi - most)) - limits.transmission_deg,
            limits.gamma_bottom_deg - math.degrees(gamma),
            math.degrees(alpha) - limits.alpha_bottom_deg,
            *turning_margins(lengths, limits.spare_m),
        ),
    )


@kernel
def continuous_design(lengths: Lengths, problem: Problem) -> tuple[Objectives, Margins]:
    """Return objectives and margins on the continuous curve."""
    duty = problem.duty
    direction = 1.0 if duty.speed_rad_per_s >= 0.0 else -1.0
    bare = scaled_press(problem.rule, lengths)
    heights = np.empty(POSITIONS)
    for k in range(POSITIONS):
        heights[k], _ = loaded_height(bare, direction * TURN * k / POSITIONS)
    step = TURN / POSITIONS
    stroke = exact_stroke(bare, duty, heights.argmax() * step, heights.argmin() * step)
    load = StrokeLoad(duty.peak_n, stroke.contact_y, stroke.bottom_y, duty.exponent)
    press = Press(bare.bar, bare.crank, bare.plate, bare.pendulum, bare.along_m, bare.across_m, load, bare.gravity)
    return continuous_press(press, lengths, stroke, duty, problem.limits)


@kernel
def _evaluate(d: Array, flat: Array, continuous: bool, objectives: Array, margins: Array) -> None:
    """Fill objectives (3,) and margins (8,) of one design."""
    problem, lengths = unpacked(flat), Lengths(d[0], d[1], d[2], d[3])
    objectives[:], margins[:] = np.inf, -np.inf
    turning = turning_margins(lengths, 0.0)
    for k in range(len(turning)):
        margins[len(CONSTRAINTS) - len(turning) + k] = turning[k] - problem.limits.spare_m
    if turning[0] > 0.0 and turning[1] > 0.0:
        reached, held = continuous_design(lengths, problem) if continuous else sampled_design(lengths, problem)
        for k in range(len(OBJECTIVES)):
            objectives[k] = reached[k]
        for k in range(len(CONSTRAINTS)):
            margins[k] = held[k]


@kernel
def _evaluate_in_turn(designs: Array, flat: Array, continuous: bool, objectives: Array, margins: Array) -> None:
    for i in range(designs.shape[0]):
        _evaluate(designs[i], flat, continuous, objectives[i], margins[i])


@parallel_kernel
def _evaluate_together(designs: Array, flat: Array, continuous: bool, objectives: Array, margins: Array) -> None:
    for i in prange(designs.shape[0]):
        _evaluate(designs[i], flat, continuous, objectives[i], margins[i])


def evaluation(designs: Array, problem: Problem, *, continuous: bool = False) -> Evaluation:
    """Return objectives, shape (n, 3), and constraint margins, shape (n, 8), of designs (r, l, h, R), m, shape (n, 4).

    A design that cannot turn fully has infinite objectives, and margins of minus infinity but for the three of
    lengths.

    Parameters
    ----------
    designs : ndarray
        Crank, length, height and pendulum (m), shape (n, 4).
    problem : Problem
        Rule of masses, duty and limits.
    continuous : bool
        On the continuous curve; else at 72 crank positions, work by trapezoid, heights and angles of the stroke those
        of the samples but in the mean press force.
    """
    evaluate = _evaluate_in_turn if len(designs) < FEW else _evaluate_together
    objectives, margins = np.empty((len(designs), len(OBJECTIVES))), np.empty((len(designs), len(CONSTRAINTS)))
    evaluate(np.ascontiguousarray(designs, dtype=np.float64), packed(problem), continuous, objectives, margins)
    return Evaluation(objectives, margins)
