# SPDX-License-Identifier: Apache-2.0
"""Design problem of the press: constraints and criteria of a design (r, l, h, R).

A design is a configuration's press with other lengths.  The plate is as long as the bearings are apart (R1 = l, the
paper's rule).  Masses and inertias follow the lengths by the configuration's own mass per metre.  Speed, working
force and required non-uniformity are the configuration's.

The mass of a link is proportional to its length, the inertia about the centroid to its cube (a bar's m L^2/12), and the
centroid stays at its share of the length.  The crank keeps its mass.  The part m1 r^2 of its inertia about O scales
with r^2, the rest stays (if J1O < m1 r^2 all of it scales with r^2).
"""

import math
from typing import Any, NamedTuple, get_type_hints

import numpy as np

from mech_twin.kernels.kernel import kernel
from mech_twin.machines.compaction_press.dynamics import Press, StrokeLoad
from mech_twin.parts.four_bar import FourBar, Link


class Lengths(NamedTuple):
    """Variables of a design (m): crank r, plate and distance of the bearings l, height h, pendulum R."""

    crank_m: float
    length_m: float
    height_m: float
    pendulum_m: float


@kernel
def _scaled(link: Link, own: float, length: float) -> Link:
    """Return a link of its own length at another one (m)."""
    inertia = link.inertia_kg_m2 / math.pow(own, 3.0) * (length * length * length)
    return Link(link.mass_kg / own * length, inertia, link.along_m / own * length, link.across_m)


@kernel
def scaled_press(press: Press, lengths: Lengths) -> Press:
    """Return a press at the lengths of a design, without a load; at its own lengths it has its own links."""
    r, l, h, R = lengths.crank_m, lengths.length_m, lengths.height_m, lengths.pendulum_m
    bar, crank = press.bar, press.crank
    square = bar.crank_m * bar.crank_m
    fixed = max(0.0, crank.inertia_kg_m2 - crank.mass_kg * square)
    inertia = fixed + (crank.inertia_kg_m2 - fixed) / square * r * r
    return Press(
        FourBar(r, l, R, l, h, bar.branch),
        Link(crank.mass_kg, inertia, crank.along_m / bar.crank_m * r, crank.across_m),
        _scaled(press.plate, bar.coupler_m, l),
        _scaled(press.pendulum, bar.rocker_m, R),
        press.along_m / bar.coupler_m * l,
        press.across_m,
        StrokeLoad(0.0, 1.0, 0.0, 1.0),
        press.gravity,
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
    """The configuration's press without a fitted flywheel, its duty, and the limits."""

    press: Press
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


def record_type(kind: type) -> Any:
    """Return the numpy dtype of a `NamedTuple` of numbers and further such tuples."""
    if kind is float:
        return np.float64
    return np.dtype((np.record, [(name, record_type(part)) for name, part in get_type_hints(kind).items()]))


PROBLEM = record_type(Problem)
