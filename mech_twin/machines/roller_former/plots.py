# SPDX-License-Identifier: Apache-2.0
"""Plots of the roller former: reactions, rod forces, moments, coupling moment against damping, phase pictures."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from mech_twin.capabilities.plots import BLUE, COLOURS, GREY, INK, RED, Picture, published, sheet, turn_axis
from mech_twin.machines.roller_former.cart_statics import cart_load, load_moments
from mech_twin.machines.roller_former.drive_choice import STUDIED_DAMPING, SWEEP_DAMPING, damping_sweep
from mech_twin.machines.roller_former.parameters import RollerFormer, bank_of, former_of
from mech_twin.machines.roller_former.published import MAX_NM, TABLE_2, table_1_case, table_2_case, table_2_metrics
from mech_twin.machines.roller_former.steady import steady_turn

DEGREES = np.arange(0.0, 360.5, 0.5)
CARTS = (2, 3, 4)
TWISTS = (
    r"$\varphi_1 - \varphi_2$, mrad",
    r"$\dot\varphi_1 - \dot\varphi_2$, rad/s",
    r"$\ddot\varphi_1 - \ddot\varphi_2$, rad/s²",
)
DEVIATIONS = (  # in the order of the columns of Table 2
    r"$\Delta M$ per cart, N m",
    r"$\Delta(\varphi_1 - \varphi_2)$, rad",
    r"$\Delta(\dot\varphi_1 - \dot\varphi_2)$, rad/s",
    r"$\Delta(\ddot\varphi_1 - \ddot\varphi_2)$, rad/s²",
)


def pictures(parameters: RollerFormer) -> Iterator[Picture]:
    """Yield the plots."""
    yield _reactions(parameters)
    yield _rods(parameters)
    yield _moments(parameters)
    yield _largest(parameters)
    yield _damping(parameters)
    yield _phases(parameters)
    yield _deviations(parameters)


def _reactions(parameters: RollerFormer) -> Picture:
    bank = bank_of(table_1_case(parameters, 2))
    figure, (axes,) = sheet()
    for cart in range(2):
        loads = [cart_load(bank, cart, angle, 1.0) for angle in np.radians(DEGREES)]
        style = "-" if cart == 0 else "--"
        axes.plot(DEGREES, [load.front_n for load in loads], style, color=BLUE, label=f"$N_{{{cart + 1}1}}$")
        axes.plot(DEGREES, [load.rear_n for load in loads], style, color=RED, label=f"$N_{{{cart + 1}2}}$")
    turn_axis(axes)
    axes.set_ylabel("guide reaction, N")
    axes.set_title("Reactions of the guide rollers, two carts (Fig. 7)")
    axes.legend(ncols=4, loc="center", bbox_to_anchor=(0.5, 0.72))
    caption = "Loads divided by 4.5, as the paper's tables want; negative: the roller runs on the other rail."
    return Picture("roller_former_reactions", caption, figure)


def _rods(parameters: RollerFormer) -> Picture:
    bank = bank_of(table_1_case(parameters, 2))
    figure, (axes,) = sheet()
    for cart, colour in ((0, BLUE), (1, RED)):
        force = [cart_load(bank, cart, angle, 1.0).rod_force_n for angle in np.radians(DEGREES)]
        axes.plot(DEGREES, force, color=colour, label=f"$F_{cart + 1}$")
    turn_axis(axes)
    axes.set_ylabel("rod force, N")
    axes.set_title("Forces in the connecting rods, two carts (Fig. 8)")
    axes.legend(ncols=2)
    return Picture("roller_former_rods", "Eq. (12) as printed, constant sign, loads divided by 4.5.", figure)


def _moments(parameters: RollerFormer) -> Picture:
    figure, panels = sheet(2, 2, 8.6, 6.0, sharex=True, sharey=True)
    for axes, count in zip(panels, (1, 2, 3, 4), strict=True):
        bank = bank_of(table_1_case(parameters, count))
        for cart in range(count if count > 1 else 0):
            single = [cart_load(bank, cart, angle, 1.0).moment_nm for angle in np.radians(DEGREES)]
            label = "single carts" if cart == 0 else None
            axes.plot(DEGREES, single, color=COLOURS[cart + 1], linewidth=0.9, label=label)
        total = load_moments(bank, np.radians(DEGREES), 1.0)
        axes.plot(DEGREES, total, color=BLUE, label="total")
        most = MAX_NM[count]
        axes.axhline(most, color=INK, linewidth=0.9, linestyle="--", label=f"published maximum {most:g}")
        axes.set_ylim(0.0, 3000.0)
        turn_axis(axes, "crank angle, degrees" if count > 2 else "")
        axes.set_title(f"{count} cart{'s' if count > 1 else ''}: {total.max():.1f} N m (Figs. 9, 16, 17)")
        axes.legend(loc="upper right")
    for axes in panels[::2]:
        axes.set_ylabel("moment, N m")
    caption = "Moments of 1 to 4 carts, rectified (Figs. 9, 16, 17); the maximum of 3 carts is printed 0.62 % too high."
    return Picture("roller_former_moments", caption, figure)


def _largest(parameters: RollerFormer) -> Picture:
    counts = (1, 2, 3, 4)
    angles = np.linspace(0.0, 2.0 * np.pi, 7201)
    most = [load_moments(bank_of(table_1_case(parameters, n)), angles, 1.0).max() / n for n in counts]
    figure, (axes,) = sheet(1, 1, 5.6, 3.6)
    axes.bar(counts, most, width=0.55, color=BLUE, alpha=0.85, label="computed")
    published(axes, counts, [MAX_NM[n] / n for n in counts])
    for n, value in zip(counts, most, strict=True):
        axes.text(n, value / 2.0, f"{value:.1f}", ha="center", color="white", fontsize=9)
    axes.set_xticks(counts)
    axes.set_xlabel("carts")
    axes.set_ylabel("largest moment per cart, N m")
    axes.set_title("Largest moment per cart (Fig. 18)")
    axes.legend()
    return Picture("roller_former_per_cart", "Lowest for three carts, the energetically balanced drive.", figure)


def _damping(parameters: RollerFormer) -> Picture:
    figure, panels = sheet(1, 2, 8.6, 3.8)
    for count, colour in zip(CARTS, COLOURS, strict=False):
        points = damping_sweep(table_2_case(parameters, count, SWEEP_DAMPING[0]), SWEEP_DAMPING)
        for axes, name in zip(panels, ("coupling_max_nm", "coupling_rms_about_mean_nm"), strict=True):
            axes.plot(SWEEP_DAMPING, [getattr(p, name) for p in points], color=colour, label=f"{count} carts")
    for axes, name in zip(panels, ("largest moment", "RMS about the mean"), strict=True):
        for damping in STUDIED_DAMPING:
            axes.axvline(damping, color=GREY, linewidth=0.8, linestyle="--")
        axes.set_xlim(0.0, SWEEP_DAMPING[-1])
        axes.set_xlabel(r"damping $k$, N m s/rad")
        axes.set_ylabel(f"{name} in the coupling, N m")
        axes.set_ylim(bottom=0.0)
        low, high = axes.get_ylim()
        axes.set_ylim(low, 1.15 * high)
        axes.legend(loc="upper right", ncols=3)
    panels[0].set_title("Coupling moment against damping (Figs. 10, 11, 19, 20)")
    caption = "Without load, expanded kinematics; dashed: the two dampings studied. Gaps: no steady turn found."
    return Picture("roller_former_damping", caption, figure)


def _phases(parameters: RollerFormer) -> Picture:
    figure, panels = sheet(3, 3, 9.2, 8.2)
    pairs = ((0, 1), (1, 2), (0, 2))
    for row, count in enumerate(CARTS):
        for damping, colour in zip(STUDIED_DAMPING, (BLUE, RED), strict=True):
            turn = steady_turn(former_of(table_2_case(parameters, count, damping)))
            if turn is None:
                continue
            columns = (
                1000.0 * turn.columns.twist_rad,
                turn.columns.twist_rate_rad_per_s,
                turn.columns.twist_acceleration_rad_per_s2,
            )
            for place, (x, y) in enumerate(pairs):
                axes = panels[3 * row + place]
                axes.plot(
                    *(np.append(columns[i], columns[i][0]) for i in (x, y)), color=colour, label=f"$k = {damping:g}$"
                )
                axes.set_xlabel(TWISTS[x])
                axes.set_ylabel(TWISTS[y])
        panels[3 * row].set_title(f"{count} carts (Figs. 13 to 15, 22 to 24)")
    panels[2].legend(loc="upper right")
    caption = "Phase portraits of the coupling's twist, steady turn without load (Figs. 13 to 15 and 22 to 24)."
    return Picture("roller_former_phases", caption, figure)


def _deviations(parameters: RollerFormer) -> Picture:
    figure, panels = sheet(2, 2, 8.6, 5.6)
    for place, (axes, symbol) in enumerate(zip(panels, DEVIATIONS, strict=True)):
        for damping, colour, shift in zip(STUDIED_DAMPING, (BLUE, RED), (-0.19, 0.19), strict=True):
            spots = [count + shift for count in CARTS]
            found = [table_2_metrics(parameters, count, damping) for count in CARTS]
            values = [0.0 if numbers is None else numbers[place] for numbers in found]
            axes.bar(spots, values, width=0.34, color=colour, alpha=0.85, label=f"$k = {damping:g}$")
            theirs = [TABLE_2[count, damping][place] for count in CARTS]
            published(axes, spots, theirs, "published" if damping == STUDIED_DAMPING[0] else "")
        axes.set_xticks(CARTS)
        axes.set_xlabel("carts")
        axes.set_ylabel(symbol)
    panels[0].legend()
    panels[0].set_title("Deviations in the coupling, peak to peak (Figs. 25 to 28)")
    caption = "Table 2: no load, masses divided by 4.5, the moment read as 2 c (phi1 - phi2) per cart."
    return Picture("roller_former_deviations", caption, figure)
