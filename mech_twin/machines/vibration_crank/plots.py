# SPDX-License-Identifier: Apache-2.0
"""Figures of the vibration crank: moments over a turn, polar diagram of the force on the frame, benefit with speed."""

from __future__ import annotations

from collections.abc import Iterator
from math import inf

import numpy as np

from mech_twin.capabilities.plots import BLUE, COLOURS, GREY, OWN, RED, Picture, sheet, turn_axis
from mech_twin.capabilities.variation import varied
from mech_twin.machines.vibration_crank.metrics import (
    PUBLISHED_PEAK_WITH_NM,
    PUBLISHED_PEAK_WITHOUT_NM,
    benefit_against_speed,
    frame_forces,
    polar_diagram,
    turn,
)
from mech_twin.machines.vibration_crank.parameters import VibrationCrank, slider_crank_constants

POSITIONS = 720


def pictures(parameters: VibrationCrank) -> Iterator[Picture]:
    """Yield the figures."""
    yield _moments(parameters)
    yield _polar(parameters)
    yield _speed(parameters)


def _moments(parameters: VibrationCrank) -> Picture:
    mechanism, speed = slider_crank_constants(parameters), parameters.drive.speed_rad_per_s
    angles = turn(POSITIONS)
    figure, (axes,) = sheet()
    for name, constants, colour, peak in (
        ("without counterweight", mechanism._replace(counter_mass=0.0), RED, PUBLISHED_PEAK_WITHOUT_NM),
        ("with counterweight", mechanism, BLUE, PUBLISHED_PEAK_WITH_NM),
    ):
        moment = frame_forces(constants, angles, speed)[2]
        axes.plot(np.degrees(angles), moment, color=colour, label=f"{name}, peak {np.abs(moment).max():.1f}")
        for side in (1.0, -1.0):
            axes.axhline(side * peak, color=colour, linewidth=0.9, linestyle=(0, (4, 3)))
        axes.text(178.0, peak + 10.0, f"published peak {peak:g} N m", color=colour, fontsize=8, va="bottom")
    turn_axis(axes)
    axes.set_ylim(-580.0, 520.0)
    axes.set_ylabel(r"drive moment $M$, N m")
    axes.set_title(f"Moment on the crank shaft at {parameters.drive.speed_rpm:g} rpm (Fig. 3)")
    axes.legend(loc="lower left", ncols=2)
    caption = (
        "Both published peaks (dashed) cannot come from the printed numbers: gravity of the counterweight changes "
    )
    return Picture(
        "vibration_crank_moments", caption + "the moment by 87.71 N m at most, the peaks differ by 103.87.", figure
    )


def _polar(parameters: VibrationCrank) -> Picture:
    figure, panels = sheet(1, 2, 8.2, 4.3)
    for axes, p, name in (
        (panels[0], varied(parameters, {"rod_m": inf}), "infinite rod"),
        (panels[1], parameters, rf"rod $l = {parameters.rod_m:g}$ m"),
    ):
        for (fraction, table), colour in zip(polar_diagram(p).items(), COLOURS, strict=False):
            x, y = (np.append(row, row[0]) / 1000.0 for row in table[:2])
            axes.plot(x, y, color=colour, label=rf"$\kappa = {fraction:g}$")
        axes.set_aspect("equal")
        axes.set_xlim(-5.5, 5.5)
        axes.set_ylim(-5.5, 5.5)
        axes.set_xlabel(r"force on the frame, horizontal $F_x$, kN")
        axes.set_ylabel(r"vertical $F_y$, kN")
        axes.set_title(name)
    panels[1].legend(loc="lower right")
    caption = (
        "Polar diagram of the force on the frame. An infinite rod gives ellipses, a circle at kappa = 0.5; "
        "a rod of finite length"
    )
    return Picture("vibration_crank_polar", f"{caption} adds even harmonics. {OWN}", figure)


def _speed(parameters: VibrationCrank) -> Picture:
    speeds = tuple(float(rpm) for rpm in np.linspace(30.0, 330.0, 61))
    figure, (axes,) = sheet()
    for p, name, colour in (
        (varied(parameters, {"rod_m": inf}), "infinite rod", BLUE),
        (parameters, rf"rod $l = {parameters.rod_m:g}$ m", RED),
    ):
        change = benefit_against_speed(slider_crank_constants(p), speeds)
        axes.plot(list(change), [100.0 * value for value in change.values()], color=colour, label=name)
    axes.axhline(0.0, color=GREY, linewidth=0.9)
    axes.set_xlabel("crank speed, rpm")
    axes.set_ylabel("change of the peak moment, %")
    axes.set_title("What the counterweight brings, against speed")
    axes.legend()
    caption = (
        "The counterweight balances gravity only, so its benefit decreases with speed; with a rod of finite length "
        "it becomes a disadvantage."
    )
    return Picture("vibration_crank_speed", f"{caption} {OWN}", figure)
