# SPDX-License-Identifier: Apache-2.0
"""Published claims of the press and the numbers of the assumed press behind them, in rows and figures."""

from collections.abc import Iterator
from math import radians

import numpy as np

from mech_twin.capabilities.plots import BLUE, COLOURS, GREEN, GREY, ORANGE, OWN, RED, Picture, sheet, turn_axis
from mech_twin.capabilities.published import DIFFERS, Literature, PublishedRow
from mech_twin.machines.compaction_press.cycle import POSITIONS, PressCycle, gain_rows, press_cycle
from mech_twin.machines.compaction_press.dynamics import Press, Stroke, press_pins, press_reduced, regime_at
from mech_twin.machines.compaction_press.metrics import cycle_metrics, position_metrics
from mech_twin.machines.compaction_press.parameters import CompactionPress, press_constants
from mech_twin.machines.compaction_press.sizing import flywheel_run
from mech_twin.parts.flywheel import wittenbauer

PAPER = "Asfandiyarov et al. 2019"
WORKED = "worked for the assumed press"
NON_UNIFORMITY = 0.05  # asked of the assumed press
ASSUMED = "assumed press: the paper prints no dimensions"


def pictures(parameters: CompactionPress) -> Iterator[Picture]:
    """Yield the figures."""
    press, stroke = press_constants(parameters, fitted=False)
    speed = parameters.drive.speed_rad_per_s
    cycle = press_cycle(press, stroke, speed, POSITIONS, kinks=False)
    few = press_cycle(press, stroke, speed, 12, kinks=False)
    yield _gain_picture(press)
    yield _diagrams(cycle, few)
    yield _energy_mass(parameters, cycle, few)
    yield _reactions(press, stroke, speed)


def _gain_picture(press: Press) -> Picture:
    degrees = np.linspace(182.0, 268.0, 345)
    k1, k2, normal, vertical = gain_rows(press, np.radians(degrees))
    figure, (axes,) = sheet()
    axes.plot(degrees, k1 * k2, color=RED, label=r"paper: $k_1 k_2$ (B at rest)")
    axes.plot(degrees, normal, color=BLUE, label="exact, load normal to the plate")
    axes.plot(degrees, vertical, color=GREEN, label="exact, vertical load")
    axes.axhline(2.0, color=GREY, linewidth=0.9, linestyle="--")
    axes.text(264.0, 2.07, "two-fold", color=GREY, fontsize=8)
    axes.set_xlim(180.0, 270.0)
    axes.set_ylim(1.6, 8.0)
    axes.set_xlabel("crank angle, degrees")
    axes.set_ylabel(r"gain $Q/P$")
    axes.set_title("Gain over the working quarter (Fig. 3b)")
    axes.legend(loc="upper left")
    caption = "The paper's k1 k2 holds only while B is at rest; the exact gains, inverse velocity ratios, stay below."
    return Picture("compaction_press_gain", caption, figure)


def _diagrams(cycle: PressCycle, few: PressCycle) -> Picture:
    degrees, marks = np.degrees(cycle.angle_rad), np.degrees(few.angle_rad)
    figure, panels = sheet(3, 1, 7.2, 7.0, sharex=True)
    panels[0].plot(degrees, cycle.drive_torque_nm, color=BLUE, label="drive at constant speed")
    panels[0].plot(degrees, cycle.load_torque_nm, color=ORANGE, label="reduced moment of the loads")
    panels[0].axhline(cycle.drive_torque_nm.mean(), color=GREY, linewidth=0.9, linestyle="--", label="mean")
    panels[1].plot(degrees, cycle.work_j, color=GREEN, label="work of drive and loads")
    panels[1].plot(marks, few.work_j, "o", color=GREEN, markersize=4, label="12 positions")
    panels[2].plot(degrees, cycle.kinetic_j, color=RED, label="kinetic energy of the links")
    panels[2].plot(marks, few.kinetic_j, "o", color=RED, markersize=4, label="12 positions")
    for axes, name in zip(panels, ("torque, N m", "work, J", "energy, J"), strict=True):
        turn_axis(axes, "")
        axes.set_ylabel(name)
        axes.legend(ncols=3, loc="upper left")
        low, high = axes.get_ylim()
        axes.set_ylim(low, high + 0.22 * (high - low))
    panels[0].set_title("Torque, work and energy over a turn")
    panels[2].set_xlabel("crank angle, degrees")
    caption = "The three diagrams from which the energy-mass curve is made, with the paper's 12 crank positions marked."
    return Picture("compaction_press_diagrams", f"{caption} {OWN}", figure)


def _energy_mass(parameters: CompactionPress, cycle: PressCycle, few: PressCycle) -> Picture:
    delta, w = parameters.flywheel.non_uniformity, abs(parameters.drive.speed_rad_per_s)
    cuts = wittenbauer(cycle.work_j, cycle.inertia_kg_m2, delta, w)
    figure, (axes,) = sheet(1, 1, 7.2, 4.8)
    whole = (np.append(values, values[0]) for values in (cycle.inertia_kg_m2, cycle.work_j))
    axes.plot(*whole, color=BLUE, label=r"$W(I)$")
    axes.plot(few.inertia_kg_m2, few.work_j, "o", color=BLUE, markersize=4.5, label="12 positions")
    width = np.array([0.0, 1.15 * cycle.inertia_kg_m2.max()])
    for cut, speed, place, name, colour in (
        (cuts.upper_j, w * (1.0 + 0.5 * delta), cuts.upper_position, "fastest", RED),
        (cuts.lower_j, w * (1.0 - 0.5 * delta), cuts.lower_position, "slowest", GREEN),
    ):
        axes.plot(width, cut + 0.5 * speed * speed * width, color=colour, linewidth=1.1, label=f"tangent, {name}")
        axes.plot([cycle.inertia_kg_m2[place]], [cycle.work_j[place]], "D", color=colour, markersize=5, zorder=5)
        axes.plot([0.0], [cut], "s", color=colour, markersize=5)
    axes.set_xlim(0.0, width[1])
    axes.set_xlabel(r"reduced inertia $I$, kg m²")
    axes.set_ylabel(r"work $W$, J")
    axes.set_title(rf"Energy-mass curve: flywheel $J = {cuts.inertia_kg_m2:.4f}$ kg m² for $\delta = {delta:g}$")
    axes.legend(loc="upper left", ncols=2)
    caption = (
        "Wittenbauer's construction: the tangents cut the axis a distance of J delta w_m² apart "
        "(squares; diamonds: where they touch)."
    )
    return Picture("compaction_press_energy_mass", f"{caption} {OWN}", figure)


def _reactions(press: Press, stroke: Stroke, speed: float) -> Picture:
    angles = np.arange(720) * (2.0 * np.pi / 720)
    loads = [press_reduced(press, f, regime_at(stroke, f, speed)).force for f in angles]
    pins = np.array([press_pins(press, f, speed, 0.0, load) for f, load in zip(angles, loads, strict=True)])
    figure, (axes,) = sheet()
    for i, (name, colour) in enumerate(zip("OABC", COLOURS, strict=False)):
        size = np.hypot(pins[:, 2 * i], pins[:, 2 * i + 1]) / 1000.0
        axes.plot(np.degrees(angles), size, color=colour, label=f"pin {name}", linestyle="--" if name == "A" else "-")
    turn_axis(axes)
    axes.set_ylabel("pin force, kN")
    axes.set_title("Reactions in the pins")
    axes.legend(ncols=4)
    caption = "Size of every pin reaction over a turn at constant speed, from one equilibrium of plate and pendulum."
    return Picture("compaction_press_reactions", f"{caption} {OWN}", figure)


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
