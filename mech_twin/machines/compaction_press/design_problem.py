# SPDX-License-Identifier: Apache-2.0
"""Design problem of the press: constraints and criteria of a design (r, l, h, R).

A design is a configuration's press with other lengths.  The plate is as long as the bearings are apart (R1 = l, the
paper's rule).  Masses and inertias follow the lengths by the configuration's own mass per metre.  Speed, working
force and required non-uniformity are the configuration's.

The mass of a link is proportional to its length, the inertia about the centroid to its cube (a bar's m L^2/12), and the
centroid stays at its share of the length.  The crank keeps its mass.  The part m1 r^2 of its inertia about O scales
with r^2, the rest stays (if J1O < m1 r^2 all of it scales with r^2).
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mech_twin.kernels.kernel import kernel
from mech_twin.machines.compaction_press.dynamics import Press, StrokeLoad
from mech_twin.machines.compaction_press.parameters import CompactionPress, press_constants
from mech_twin.parts.four_bar import FourBar, Link

Array = NDArray[np.float64]


class Lengths(NamedTuple):
    """Variables of a design (m): crank r, plate and distance of the bearings l, height h, pendulum R."""

    crank_m: float
    length_m: float
    height_m: float
    pendulum_m: float


class BarRule(NamedTuple):
    """A bar over its length L: mass/L (kg/m), inertia/L^3 (kg/m), centroid along/L (1) and across (m)."""

    kg_per_m: float
    inertia_kg_per_m: float
    along_share: float
    across_m: float


class MassRule(NamedTuple):
    """Crank for r = 1 m without ``crank_fixed_kg_m2``, bars, point of the working force, branch, gravity (m/s2)."""

    crank_kg: float
    crank_fixed_kg_m2: float
    crank_inertia_kg: float
    crank_along_share: float
    crank_across_m: float
    plate: BarRule
    pendulum: BarRule
    application_share: float
    application_across_m: float
    branch: float
    gravity: float


def mass_rule(parameters: CompactionPress) -> MassRule:
    """Return the rule that gives the configuration's own links at its own lengths; the fitted flywheel stays out."""
    press, _ = press_constants(parameters, fitted=False)
    crank, bar = press.crank, press.bar
    square = bar.crank_m * bar.crank_m
    fixed = max(0.0, crank.inertia_kg_m2 - crank.mass_kg * square)
    return MassRule(
        crank.mass_kg,
        fixed,
        (crank.inertia_kg_m2 - fixed) / square,
        crank.along_m / bar.crank_m,
        crank.across_m,
        _bar_rule(press.plate, bar.coupler_m),
        _bar_rule(press.pendulum, bar.rocker_m),
        press.along_m / bar.coupler_m,
        press.across_m,
        bar.branch,
        press.gravity,
    )


def _bar_rule(link: Link, length: float) -> BarRule:
    return BarRule(link.mass_kg / length, link.inertia_kg_m2 / length**3, link.along_m / length, link.across_m)


@kernel
def _bar(rule: BarRule, length: float) -> Link:
    cube = length * length * length
    return Link(rule.kg_per_m * length, rule.inertia_kg_per_m * cube, rule.along_share * length, rule.across_m)


@kernel
def scaled_press(rule: MassRule, lengths: Lengths) -> Press:
    """Return the press of a design, without a load."""
    r, l, h, R = lengths.crank_m, lengths.length_m, lengths.height_m, lengths.pendulum_m
    inertia = rule.crank_fixed_kg_m2 + rule.crank_inertia_kg * r * r
    return Press(
        FourBar(r, l, R, l, h, rule.branch),
        Link(rule.crank_kg, inertia, rule.crank_along_share * r, rule.crank_across_m),
        _bar(rule.plate, l),
        _bar(rule.pendulum, R),
        rule.application_share * l,
        rule.application_across_m,
        StrokeLoad(0.0, 1.0, 0.0, 1.0),
        rule.gravity,
    )


class Limits(NamedTuple):
    """Limits of the constraints (degrees, m), and constant torque (N m) of the mean force, as in the reference."""

    gamma_max_deg: float = 20.0
    stroke_m: float = 0.05
    transmission_deg: float = 50.0
    gamma_bottom_deg: float = 1.0
    alpha_bottom_deg: float = 85.0
    spare_m: float = 0.005
    constant_torque_nm: float = 250.0


class Duty(NamedTuple):
    """Duty of the press: speed (rad/s), required non-uniformity, working force (N, 1, 1), and friction's torque (N m).

    ``contact_fraction`` is nan if first contact is at 180 degrees of the crank (``working_quarter``).
    """

    speed_rad_per_s: float
    non_uniformity: float
    peak_n: float
    contact_fraction: float
    exponent: float
    drag_nm: float = 0.0


class Problem(NamedTuple):
    """The configuration's rule of masses, its duty, and the limits."""

    rule: MassRule
    duty: Duty
    limits: Limits


class Objectives(NamedTuple):
    """Peak of |torque| at constant speed (N m), flywheel (kg m2), mean press force at a constant torque (N)."""

    peak_torque_nm: float
    flywheel_inertia_kg_m2: float
    mean_press_force_n: float


class Margins(NamedTuple):
    """Margin of each constraint (negative: violated), degrees and m."""

    gamma_max_deg: float
    stroke_m: float
    transmission_angle_deg: float
    gamma_at_bottom_deg: float
    alpha_at_bottom_deg: float
    crank_plus_ground_m: float
    ground_minus_crank_m: float
    crank_shortest_m: float


OBJECTIVES = Objectives._fields
SENSES = Objectives(1.0, 1.0, -1.0)  # to be made small, small, large
CONSTRAINTS = Margins._fields


def packed(problem: Problem) -> Array:
    """Return a problem as a flat array, as a loop over all cores requires: bars one after the other, crank first."""
    rule = problem.rule
    return np.array([*rule[:5], *rule.plate, *rule.pendulum, *rule[7:], *problem.duty, *problem.limits])


@kernel
def unpacked(flat: Array) -> Problem:
    """Return the problem from the array of `packed`."""
    crank, plate, pendulum, shared = flat[:5], flat[5:9], flat[9:13], flat[13:17]
    rule = MassRule(
        crank[0], crank[1], crank[2], crank[3], crank[4],
        BarRule(plate[0], plate[1], plate[2], plate[3]),
        BarRule(pendulum[0], pendulum[1], pendulum[2], pendulum[3]),
        shared[0], shared[1], shared[2], shared[3],
    )  # fmt: skip
    duty, limits = flat[17:23], flat[23:30]
    return Problem(
        rule,
        Duty(duty[0], duty[1], duty[2], duty[3], duty[4], duty[5]),
        Limits(limits[0], limits[1], limits[2], limits[3], limits[4], limits[5], limits[6]),
    )
