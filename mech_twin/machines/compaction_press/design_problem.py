# SPDX-License-Identifier: Apache-2.0
"""Design problem of the press: constraints and criteria of a design (r, l, h, R).

A design is a configuration's press with other lengths.  The plate is as long as the bearings are apart (R1 = l, the
paper's rule).  Masses and inertias follow the lengths by the configuration's own mass per metre.  Speed, working
force and required non-uniformity are the configuration's.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mech_twin.kernels.kernel import kernel
from mech_twin.machines.compaction_press.design_rule import BarRule, MassRule

Array = NDArray[np.float64]


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
    """Duty of the press: speed (rad/s), required non-uniformity, and the working force (N, 1, 1).

    ``contact_fraction`` is nan if first contact is at 180 degrees of the crank (``working_quarter``).
    """

    speed_rad_per_s: float
    non_uniformity: float
    peak_n: float
    contact_fraction: float
    exponent: float


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
# the numbers of a problem by name: bars one after the other, crank first
_CRANK, _SHARED = MassRule._fields[:5], MassRule._fields[7:]
_BARS = tuple(f"{bar}_{name}" for bar in ("plate", "pendulum") for name in BarRule._fields)
FLAT = np.dtype(
    (np.record, [(name, np.float64) for name in (*_CRANK, *_BARS, *_SHARED, *Duty._fields, *Limits._fields)])
)


def packed(problem: Problem) -> Array:
    """Return a problem as a flat array, as a loop over all cores requires."""
    rule = problem.rule
    numbers = (*rule[:5], *rule.plate, *rule.pendulum, *rule[7:], *problem.duty, *problem.limits)
    return np.array([numbers], dtype=FLAT).view(np.float64)


@kernel
def unpacked(flat: Array) -> Problem:
    """Return the problem from the array of `packed`."""
    n = flat.view(FLAT)[0]
    rule = MassRule(
        n.crank_kg,
        n.crank_fixed_kg_m2,
        n.crank_inertia_kg,
        n.crank_along_share,
        n.crank_across_m,
        BarRule(n.plate_kg_per_m, n.plate_inertia_kg_per_m, n.plate_along_share, n.plate_across_m),
        BarRule(n.pendulum_kg_per_m, n.pendulum_inertia_kg_per_m, n.pendulum_along_share, n.pendulum_across_m),
        n.application_share,
        n.application_across_m,
        n.branch,
        n.gravity,
    )
    duty = Duty(n.speed_rad_per_s, n.non_uniformity, n.peak_n, n.contact_fraction, n.exponent)
    limits = Limits(
        n.gamma_max_deg,
        n.stroke_m,
        n.transmission_deg,
        n.gamma_bottom_deg,
        n.alpha_bottom_deg,
        n.spare_m,
        n.constant_torque_nm,
    )
    return Problem(rule, duty, limits)
