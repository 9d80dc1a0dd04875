# SPDX-License-Identifier: Apache-2.0
"""Scaling of a design's links with its lengths, by the mass per metre of the initial configuration.

The mass of a link is proportional to its length, the inertia about the centroid to its cube (a bar's m L^2/12), and the
centroid stays at its share of the length.  The crank keeps its mass.  The part m1 r^2 of its inertia about O scales
with r^2, the rest stays (if J1O < m1 r^2 all of it scales with r^2).
"""

from __future__ import annotations

from typing import NamedTuple

from mech_twin.kernels.kernel import kernel
from mech_twin.machines.compaction_press.dynamics import Press
from mech_twin.machines.compaction_press.parameters import CompactionPress, press_constants
from mech_twin.machines.compaction_press.stroke_load import StrokeLoad
from mech_twin.parts.four_bar import FourBar, Link


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
