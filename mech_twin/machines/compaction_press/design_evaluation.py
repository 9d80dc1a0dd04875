# SPDX-License-Identifier: Apache-2.0
"""Objectives and constraint margins of many designs of the press (r, l, h, R) at once.

A design is evaluated at 72 crank positions, where very many are wanted, or on the continuous curve.  The mean press
force takes its contact travel from exact angles and heights in both.

The stroke (crank angles of first contact and bottom, heights, mean force) is exact.  A configuration becomes a design
problem, and a design a configuration again.
"""

import math
from collections.abc import Mapping
from math import nan
from typing import NamedTuple

import numpy as np
from numba import prange

from mech_twin.capabilities.design import Design, Evaluation
from mech_twin.capabilities.variation import varied
from mech_twin.engine.sample_vectors import Array
from mech_twin.kernels.kernel import kernel, parallel_kernel
from mech_twin.machines.compaction_press.cycle import (
    asked_flywheel,
    cycle_extremes,
    one_turn,
    transmission_range,
)
from mech_twin.machines.compaction_press.design_problem import (
    CONSTRAINTS,
    OBJECTIVES,
    PROBLEM,
    Duty,
    Lengths,
    Limits,
    Margins,
    Objectives,
    Problem,
    scaled_press,
)
from mech_twin.machines.compaction_press.dynamics import FREE, Press, Stroke, StrokeLoad, loaded_height, press_reduced
from mech_twin.machines.compaction_press.parameters import EQUAL, CompactionPress, press_constants
from mech_twin.parts.four_bar import acute_angles, position

TURN = 2.0 * math.pi
POSITIONS = 72  # of the crank, between two of which an extreme is sought
ROOT_STEPS = 60
FEW = 8  # designs that one thread evaluates: beside other work, waiting for further ones takes 8 ms


@kernel
def _miss(press: Press, f: float, height: float, rate: bool) -> float:
    y, y1 = loaded_height(press, f)
    return y1 if rate else y - height


@kernel
def path_root(press: Press, low: float, high: float, height: float, rate: bool) -> float:
    """Return the crank angle (rad) between two others at which the loaded point passes ``height`` (m).

    With ``rate`` that of its extreme height.  Illinois method; without a change of sign the middle.
    """
    at_low, at_high = _miss(press, low, height, rate), _miss(press, high, height, rate)
    if at_low * at_high > 0.0:
        return 0.5 * (low + high)
    for _ in range(ROOT_STEPS):
        if abs(high - low) < 1e-14 or at_high == at_low:
            break
        middle = high - at_high * (high - low) / (at_high - at_low)
        at_middle = _miss(press, middle, height, rate)
        if at_middle * at_high <= 0.0:
            low, at_low = high, at_high
        else:
            at_low *= 0.5
        if abs(middle - high) < 1e-15:
            break
        high, at_high = middle, at_middle
    return high


@kernel
def _dead_centre(press: Press, y: Array, direction: float, sign: float, after: float) -> tuple[int, float]:
    """Return place among the samples and angle (rad) of the least ``sign`` times height.

    Of extremes that are equal, the first after an angle turning forward, as `press_stroke` has it.
    """
    n, step = POSITIONS, TURN / POSITIONS
    angles, found = np.empty(n), np.full(n, np.inf)
    for k in range(n):
        if sign * y[k] <= min(sign * y[k - 1], sign * y[(k + 1) % n]):
            at = direction * k * step  # on the side where it falls: another extreme may lie on the other
            beside = at - step if sign * loaded_height(press, at)[1] > 0.0 else at + step
            angles[k] = path_root(press, min(at, beside), max(at, beside), 0.0, True)
            found[k] = sign * loaded_height(press, angles[k])[0]
    equal, first, least_way = found.min() + EQUAL * (y.max() - y.min()), 0, np.inf
    for k in range(n):
        way = (angles[k] - after) % TURN
        if found[k] <= equal and way < least_way:
            first, least_way = k, way
    return first, angles[first]


@kernel
def exact_stroke(press: Press, duty: Duty, top: float, bottom: float) -> tuple[Stroke, float]:
    """Return the stroke as the crank turns, and the angle from contact to bottom, by those of top and bottom (rad)."""
    direction = 1.0 if duty.speed_rad_per_s >= 0.0 else -1.0
    top_y, _ = loaded_height(press, top)
    bottom_y, _ = loaded_height(press, bottom)
    contact_y = top_y - duty.contact_fraction * (top_y - bottom_y)
    if math.isnan(duty.contact_fraction):
        contact_y, _ = loaded_height(press, math.pi)
    down = direction * ((direction * (bottom - top)) % TURN)
    contact = path_root(press, top, top + down, contact_y, False) if contact_y < top_y else top
    return Stroke(top, bottom, contact, contact, top_y, bottom_y, contact_y, 0.0), abs(top + down - contact)


@kernel
def mean_press_force(stroke: Stroke, way: float, constant_torque_nm: float) -> float:
    """Return the mean force (N) over the contact travel at a constant drive torque: torque times angle over travel.

    The work on the layer at that mean force equals the work of the drive from first contact to the bottom.
    """
    return constant_torque_nm * way / (stroke.contact_y_m - stroke.bottom_y_m)


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
def _sampled_press(press: Press, direction: float) -> tuple[Samples, float, float]:
    """Return the unloaded samples, largest gamma and smallest transmission angle (rad)."""
    n = POSITIONS
    at = Samples(np.empty(n), np.empty(n), np.empty(n), np.empty(n), np.empty(n))
    gamma_max, beta_min = 0.0, 10.0
    for k in range(n):
        f = direction * TURN * k / n
        _, beta, gamma = acute_angles(position(press.bar, f))
        gamma_max, beta_min = max(gamma_max, gamma), min(beta_min, beta)
        now = press_reduced(press, f, FREE)
        at.inertia[k], at.slope[k], at.moment[k], at.y[k], at.y1[k] = now.inertia, now.slope, now.moment, now.y, now.y1
    return at, gamma_max, beta_min


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
        peak = max(peak, abs(0.5 * w * w * at.slope[k] - at.moment[k] + duty.drag_nm))
    return peak, (high - low) / (delta * w * w)


@kernel
def sampled_design(lengths: Lengths, problem: Problem) -> tuple[Objectives, Margins]:
    """Return objectives and margins at 72 crank positions; the mean press force with exact angles and heights."""
    duty, limits = problem.duty, problem.limits
    direction = 1.0 if duty.speed_rad_per_s >= 0.0 else -1.0
    press = scaled_press(problem.press, lengths)
    at, gamma_max, beta_min = _sampled_press(press, direction)
    top, top_angle = _dead_centre(press, at.y, direction, -1.0, 0.0)
    bottom, bottom_angle = _dead_centre(press, at.y, direction, 1.0, top_angle)
    stroke, way = exact_stroke(press, duty, top_angle, bottom_angle)
    alpha, _, gamma = acute_angles(position(press.bar, direction * TURN * bottom / POSITIONS))
    height = at.y[top] - at.y[bottom]
    _load_samples(at, duty, top, bottom)
    peak, flywheel = _sampled_objectives(at, duty)
    return (
        Objectives(peak, flywheel, mean_press_force(stroke, way, limits.constant_torque_nm)),
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
    press: Press, lengths: Lengths, stroke: Stroke, way: float, duty: Duty, limits: Limits
) -> tuple[Objectives, Margins]:
    """Return objectives and margins of a loaded press on the continuous curve, its stroke given."""
    turn = one_turn(stroke.contact, stroke.bottom, duty.speed_rad_per_s, duty.non_uniformity)
    found = cycle_extremes(press, turn)
    least, most = transmission_range(press)
    alpha, _, gamma = acute_angles(position(press.bar, stroke.bottom))
    return (
        Objectives(
            max(abs(found.torque_max_nm + duty.drag_nm), abs(found.torque_min_nm + duty.drag_nm)),
            asked_flywheel(found, turn),
            mean_press_force(stroke, way, limits.constant_torque_nm),
        ),
        Margins(
            limits.gamma_max_deg - math.degrees(found.gamma_max_rad),
            stroke.top_y_m - stroke.bottom_y_m - limits.stroke_m,
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
    bare = scaled_press(problem.press, lengths)
    heights = np.empty(POSITIONS)
    for k in range(POSITIONS):
        heights[k], _ = loaded_height(bare, direction * TURN * k / POSITIONS)
    _, top = _dead_centre(bare, heights, direction, -1.0, 0.0)
    _, bottom = _dead_centre(bare, heights, direction, 1.0, top)
    stroke, way = exact_stroke(bare, duty, top, bottom)
    load = StrokeLoad(duty.peak_n, stroke.contact_y_m, stroke.bottom_y_m, duty.exponent)
    press = Press(bare.bar, bare.crank, bare.plate, bare.pendulum, bare.along_m, bare.across_m, load, bare.gravity)
    return continuous_press(press, lengths, stroke, way, duty, problem.limits)


@kernel
def _evaluate(d: Array, problems: Array, continuous: bool, objectives: Array, margins: Array) -> None:
    """Fill objectives (3,) and margins (8,) of one design."""
    problem, lengths = problems[0], Lengths(d[0], d[1], d[2], d[3])
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
def _evaluate_in_turn(designs: Array, problems: Array, continuous: bool, objectives: Array, margins: Array) -> None:
    for i in range(designs.shape[0]):
        _evaluate(designs[i], problems, continuous, objectives[i], margins[i])


@parallel_kernel
def _evaluate_together(designs: Array, problems: Array, continuous: bool, objectives: Array, margins: Array) -> None:
    for i in prange(designs.shape[0]):
        _evaluate(designs[i], problems, continuous, objectives[i], margins[i])


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
    problems = np.array([problem], dtype=PROBLEM)  # a loop over all cores takes arrays alone
    evaluate(np.ascontiguousarray(designs, dtype=np.float64), problems, continuous, objectives, margins)
    return Evaluation(objectives, margins)


def press_duty(parameters: CompactionPress) -> Duty:
    """Return speed, required non-uniformity, working force and friction of a configuration."""
    force = parameters.working_force
    return Duty(
        parameters.drive.speed_rad_per_s,
        parameters.flywheel.non_uniformity,
        force.peak_n,
        nan if force.working_quarter else force.contact_fraction,
        force.exponent,
        parameters.drag_nm,
    )


def design_problem(parameters: CompactionPress, limits: Mapping[str, float]) -> Problem:
    """Return the design problem of a configuration under these limits (all of them, by name)."""
    return Problem(press_constants(parameters, fitted=False)[0], press_duty(parameters), Limits(**limits))


def configured_press(parameters: CompactionPress, lengths: Lengths) -> CompactionPress:
    """Return the configuration with a design's lengths and corresponding masses; the rest is unchanged."""
    press = scaled_press(press_constants(parameters, fitted=False)[0], lengths)
    changes: dict[str, float | str] = {
        "linkage.crank_m": press.bar.crank_m,
        "linkage.coupler_m": press.bar.coupler_m,
        "linkage.pendulum_m": press.bar.rocker_m,
        "linkage.pivot_x_m": press.bar.pivot_x_m,
        "linkage.pivot_y_m": press.bar.pivot_y_m,
        "working_force.application_from_a_m": press.along_m,
    }
    for name, link in (("crank", press.crank), ("plate", press.plate), ("pendulum", press.pendulum)):
        changes[f"links.{name}.mass_kg"] = link.mass_kg
        changes[f"links.{name}.inertia_kg_m2"] = link.inertia_kg_m2
        changes[f"links.{name}.centroid_along_m"] = link.along_m
    return varied(parameters, changes)


def described(parameters: CompactionPress, lengths: Lengths, limits: Limits) -> Design:
    """Return a design with its configuration; objectives and margins are computed from that configuration alone."""
    chosen = configured_press(parameters, lengths)
    press, found = press_constants(chosen, fitted=False)
    duty = press_duty(chosen)
    forward = duty.speed_rad_per_s >= 0.0
    contact = found.contact if forward else found.contact_reversed
    way = (found.bottom - contact if forward else contact - found.bottom) % TURN
    objectives, margins = continuous_press(press, lengths, found._replace(contact=contact), way, duty, limits)
    return Design(lengths._asdict(), objectives._asdict(), margins._asdict(), chosen)
