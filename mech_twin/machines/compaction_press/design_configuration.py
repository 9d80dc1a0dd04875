"""A design of the search as a configuration of the press."""

from __future__ import annotations

from mech_twin.capabilities.variation import varied
from mech_twin.machines.compaction_press.design_problem import Limits, design_press
from mech_twin.machines.compaction_press.design_search import Design
from mech_twin.machines.compaction_press.parameters import CompactionPress


def configured_press(parameters: CompactionPress, design: Design, limits: Limits) -> CompactionPress:
    """Return the configuration with a design's lengths, the masses that go with them, and the problem's duty."""
    press = design_press(design.crank_m, design.length_m, design.height_m, design.pendulum_m)
    changes: dict[str, float | str] = {
        "linkage.crank_m": press.bar.crank_m,
        "linkage.coupler_m": press.bar.coupler_m,
        "linkage.pendulum_m": press.bar.rocker_m,
        "linkage.pivot_x_m": press.bar.pivot_x_m,
        "linkage.pivot_y_m": press.bar.pivot_y_m,
        "linkage.branch": "open",
        "working_force.peak_n": limits.peak_n,
        "working_force.application_from_a_m": press.along_m,
        "working_force.application_across_m": press.across_m,
        "working_force.contact_fraction": limits.contact_fraction,
        "working_force.exponent": limits.exponent,
        "flywheel.non_uniformity": limits.non_uniformity,
    }
    for name, link in (("crank", press.crank), ("plate", press.plate), ("pendulum", press.pendulum)):
        changes[f"links.{name}.mass_kg"] = link.mass_kg
        changes[f"links.{name}.inertia_kg_m2"] = link.inertia_kg_m2
        changes[f"links.{name}.centroid_along_m"] = link.along_m
        changes[f"links.{name}.centroid_across_m"] = link.across_m
    return varied(parameters, changes)
