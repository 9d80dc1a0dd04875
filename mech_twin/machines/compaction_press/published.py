# SPDX-License-Identifier: Apache-2.0
"""Published claims of the press, and the numbers of the assumed press behind them."""

from __future__ import annotations

from collections.abc import Iterator
from math import radians

from mech_twin.capabilities.published import DIFFERS, Literature, PublishedRow
from mech_twin.machines.compaction_press.metrics import cycle_metrics, position_metrics
from mech_twin.machines.compaction_press.parameters import CompactionPress
from mech_twin.machines.compaction_press.sizing import flywheel_run

PAPER = "Asfandiyarov et al. 2019"
WORKED = "worked for the assumed press"
NON_UNIFORMITY = 0.05  # asked of the assumed press
ASSUMED = "assumed press: the paper prints no dimensions"


def rows(parameters: CompactionPress) -> Iterator[PublishedRow]:
    """Yield the rows, the gain formula first."""
    report = cycle_metrics(parameters)
    yield from _gain(parameters, report)
    yield from _claims(report)
    yield from _cycle(report)
    yield from _flywheel(parameters, report)


def _gain(parameters: CompactionPress, report: dict[str, float]) -> Iterator[PublishedRow]:
    at = position_metrics(parameters, radians(225.0))
    paper = Literature(PAPER, "Q = P k1 k2", f"{ASSUMED}; crank at 225 degrees")
    why = "k1 k2 holds only while B is at rest; the exact gain is the inverse velocity ratio"
    yield paper.formula("gain, load normal to the plate", at["k1_k2"], at["gain_exact_normal"], why)
    yield paper.formula("gain, vertical load", at["k1_k2"], at["gain_exact_vertical"], why)
    worked = Literature(WORKED, "gain", "crank at 225 degrees")
    for name, value, key in (
        ("k1 k2", 2.9143, "k1_k2"),
        ("normal gain", 2.6001, "gain_exact_normal"),
        ("vertical gain", 2.4656, "gain_exact_vertical"),
    ):
        yield worked.gated(name, value, at[key], "each by its own formula", absolute=5e-5)
    twofold = Literature(PAPER, "two-fold gain", f"{ASSUMED}; 180 to 270 degrees")
    yield twofold.limit(
        "least k1 k2", 2.0, report["paper_gain_min_in_quarter"], "by the paper's own formula, a = l/2", "above"
    )
    for kind, least, share in (("vertical", 1.9273, 73.3), ("normal", 1.9891, 91.0)):
        yield twofold.reported(
            f"least {kind} gain", 2.0, report[f"{kind}_gain_min_in_quarter"], DIFFERS, "two-fold on a part of it only"
        )
        quarter = Literature(WORKED, "two-fold gain", "180 to 270 degrees")
        yield quarter.gated(
            f"least {kind} gain", least, report[f"{kind}_gain_min_in_quarter"], "exact velocity ratio", absolute=5e-5
        )
        yield quarter.gated(
            f"{kind} gain of two or more, % of the quarter",
            share,
            100.0 * report[f"{kind}_gain_two_share_of_quarter"],
            "exact velocity ratio",
            absolute=0.05,
        )


def _claims(report: dict[str, float]) -> Iterator[PublishedRow]:
    paper = Literature(PAPER, "conditions", ASSUMED)
    yield paper.limit("gamma_max, degrees", 20.0, report["gamma_max_deg"], "holds with room", "below")
    yield paper.gated("alpha at the bottom, degrees", 90.0, report["alpha_at_bottom_deg"], "R = h + r", absolute=1e-6)
    yield paper.gated("crank turns fully (1 yes)", 1.0, report["crank_rocker_1"], "crank-rocker", absolute=0.0)
    yield paper.unknown("stroke, mm", 1000.0 * report["stroke_m"], "10-250 mm is the layer's setting, not the stroke")
    yield paper.unknown("dimensions of the links", None, "none are printed: the size is assumed, with reasons")


def _cycle(report: dict[str, float]) -> Iterator[PublishedRow]:
    worked = Literature(WORKED, "one cycle", "300 rpm, 10 kN, 3600 positions")
    for name, value, key, tolerance in (
        ("gamma_max, degrees", 13.85186, "gamma_max_deg", 1e-5),
        ("stroke, m", 0.060217832, "stroke_m", 1e-8),
        ("top, degrees", 93.33089, "top_deg", 1e-7),
        ("work per cycle, J", 150.544579, "work_per_cycle_j", 1e-8),
        ("mean torque, N m", 23.9599, "drive_torque_mean_nm", 1e-5),
        ("peak torque, N m", 197.5977, "drive_torque_peak_nm", 1e-5),
        ("least torque, N m", -54.5294, "drive_torque_min_nm", 1e-5),
        ("mean power, W", 752.7, "power_mean_w", 1e-4),
        ("peak power, W", 6208.0, "power_peak_w", 1e-4),
        ("least transmission angle, degrees", 71.47, "transmission_angle_min_deg", 1e-4),
        ("largest transmission angle, degrees", 97.23, "transmission_angle_max_deg", 1e-4),
    ):
        yield worked.gated(
            name, value, report[key], "exact kinematics, one equilibrium of the dyad", relative=tolerance
        )


def _flywheel(parameters: CompactionPress, report: dict[str, float]) -> Iterator[PublishedRow]:
    paper = Literature(PAPER, "energy-mass diagram", ASSUMED)
    yield paper.limit(
        "non-uniformity without a flywheel above the asked one",
        NON_UNIFORMITY,
        report["non_uniformity_without_flywheel"],
        "a flywheel is needed, as the paper says",
        "above",
    )
    worked = Literature(WORKED, "flywheel", f"delta {NON_UNIFORMITY:g}, 300 rpm")
    inertia = report["flywheel_inertia_kg_m2"]
    for name, value, key, tolerance in (
        ("exact, kg m2", 2.963918, "", 1e-6),
        ("Wittenbauer, kg m2", 2.963918, "wittenbauer_", 1e-6),
        ("textbook, kg m2", 2.963325, "textbook_", 1e-6),
        ("Mertsalov, kg m2", 3.085584, "mertsalov_", 1e-6),
        ("12 positions, kg m2", 2.9035, "12_positions_", 2e-5),
    ):
        full = f"flywheel_inertia_{key}kg_m2"
        yield worked.gated(name, value, report[full], "work in closed form, 36000 positions", relative=tolerance)
    yield worked.gated(
        "delta without a flywheel", 1.505, report["non_uniformity_without_flywheel"], "same curve", absolute=5e-4
    )
    shown = flywheel_run(parameters, inertia, step_s=5e-4).non_uniformity
    yield worked.gated(
        "delta shown by a time run", NON_UNIFORMITY, shown, "integrated with that flywheel", relative=1e-3
    )
