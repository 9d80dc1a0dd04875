# SPDX-License-Identifier: Apache-2.0
"""Conversion of a configuration of the press to its design problem, and of a design back to a configuration."""

from __future__ import annotations

from collections.abc import Mapping
from math import nan, pi

from mech_twin.capabilities.design import Design
from mech_twin.capabilities.variation import varied
from mech_twin.machines.compaction_press.design_evaluation import continuous_press
from mech_twin.machines.compaction_press.design_problem import Duty, Limits, Problem
from mech_twin.machines.compaction_press.design_rule import Lengths, mass_rule, scaled_press
from mech_twin.machines.compaction_press.design_stroke import PressStroke
from mech_twin.machines.compaction_press.parameters import CompactionPress, press_constants

TURN = 2.0 * pi


def press_duty(parameters: CompactionPress) -> Duty:
    """Return speed, required non-uniformity and working force of a configuration."""
    force = parameters.working_force
    return Duty(
        parameters.drive.speed_rad_per_s,
        parameters.flywheel.non_uniformity,
        force.peak_n,
        nan if force.working_quarter else force.contact_fraction,
        force.exponent,
    )


def design_problem(parameters: CompactionPress, limits: Mapping[str, float]) -> Problem:
    """Return the design problem of a configuration under these limits (all of them, by name)."""
    return Problem(mass_rule(parameters), press_duty(parameters), Limits(**limits))


def configured_press(parameters: CompactionPress, lengths: Lengths) -> CompactionPress:
    """Return the configuration with a design's lengths and corresponding masses; the rest is unchanged."""
    press = scaled_press(mass_rule(parameters), lengths)
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
    stroke = PressStroke(found.bottom, contact, way, found.top_y_m, press.load.contact_y_m, press.load.bottom_y_m)
    objectives, margins = continuous_press(press, lengths, stroke, duty, limits)
    return Design(lengths._asdict(), objectives._asdict(), margins._asdict(), chosen)
