"""Figures of the breaker's body: amplitude and pressing force against the spring, the trade of the preload."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from mech_twin.machines.mb10_breaker_parameters import BreakerParameters
from mech_twin.parts.pressed_body.owner import preload_range, steady_figures, with_preload
from mech_twin.parts.pressed_body.parameters import pressed_body
from mech_twin.parts.pressed_body.published import resonance_rate
from mech_twin.studies.figures.canvas import BLUE, GREEN, GREY, ORANGE, RED, Picture, published, sheet
from mech_twin.studies.pressing import swing_curve
from mech_twin.studies.reproduction.mb10_breaker import SOFT_TABLE, paper_body

RATES = np.geomspace(100.0, 3.8e6, 1400)
PRELOAD_M = 0.01
SOFTNESS = 0.3


def pictures(parameters: BreakerParameters) -> Iterator[Picture]:
    """Yield the figures."""
    changed = paper_body(parameters)
    yield _spring(changed)
    yield _preload(changed)
    yield _pulse(changed)


def _spring(parameters: BreakerParameters) -> Picture:
    body, excitation = parameters.body, parameters.excitation
    figure, panels = sheet(2, 1, 7.6, 6.2, sharex=True)
    for preload, colour, style in ((0.0, BLUE, "-"), (PRELOAD_M, RED, "--")):
        points = swing_curve(body, excitation, [float(rate) for rate in RATES], preload)
        rates = [point.spring_rate_n_per_m / 1000.0 for point in points]
        label = f"a = {1000.0 * preload:g} mm"
        if preload == 0.0:
            amplitude = [min(1000.0 * point.amplitude_rad, 1e4) for point in points]
            panels[0].loglog(rates, amplitude, color=colour, linestyle=style, label=f"periodic regime, {label}")
        bound = [min(point.regime.largest_force_n, 1e6) for point in points]
        panels[1].loglog(rates, bound, color=colour, linestyle=style, label=f"from rest (bound of the beat), {label}")
        if preload == 0.0:
            periodic = [min(point.largest_force_n, 1e6) for point in points]
            panels[1].loglog(rates, periodic, color=GREEN, label=f"periodic regime, {label}")
    constants = pressed_body(body, excitation)
    for axes in panels:
        for order in range(1, 11):
            axes.axvline(resonance_rate(constants, order) / 1000.0, color=GREY, linewidth=0.5, linestyle=":")
        axes.legend(loc="lower left" if axes is panels[0] else "upper left")
    panels[0].set_ylim(0.05, 3000.0)
    panels[1].set_ylim(5.0, 2e4)
    panels[0].set_ylabel("amplitude of the swing, mrad")
    panels[1].set_ylabel("largest pressing force, N")
    panels[1].set_xlabel("spring rate c, kN/m")
    panels[0].set_title("Swing of the body against spring rate, no collar")
    caption = (
        "Undamped, from rest, it never settles but beats about the periodic regime. Dotted: resonances k = n omega."
    )
    return Picture("mb10_breaker_spring", caption, figure)


def _preload(parameters: BreakerParameters) -> Picture:
    base = pressed_body(parameters.body, parameters.excitation)
    omega = 2.0 * np.pi / base.period
    ratios = np.linspace(0.05, 1.0, 191)
    found = [steady_figures(with_preload(base, float(p), SOFTNESS * omega)).figures for p in ratios]
    span = preload_range(base, SOFTNESS * omega)
    figure, panels = sheet(3, 1, 7.2, 6.8, sharex=True)
    for axes, curve, column, name, colour in (
        (panels[0], [1000.0 * f.gap_at_blow_m for f in found], 2, "gap at the blow, mm", BLUE),
        (panels[1], [f.return_speed_m_per_s for f in found], 3, "return speed, m/s", RED),
        (panels[2], [f.largest_force_n for f in found], 1, "pressing force, N", GREEN),
    ):
        axes.plot(ratios, curve, color=colour)
        published(axes, [row[0] for row in SOFT_TABLE], [row[column] for row in SOFT_TABLE], "worked table")
        axes.axvspan(span.settled, 1.0, color=ORANGE, alpha=0.10, linewidth=0.0)
        axes.axvline(span.returned, color=ORANGE, linewidth=1.0, linestyle="--")
        axes.set_ylabel(name)
        axes.set_ylim(bottom=0.0)
    panels[0].legend(loc="upper right")
    panels[0].set_title("What preload buys: the rational range, k = 0.3 omega, half sine")
    panels[2].set_xlabel("preload ratio p = c a l/|H|")
    panels[2].set_xlim(0.0, 1.02)
    caption = "Shaded: settled before the next load. Dashed: the first return comes before the blow. Steady cycles."
    return Picture("mb10_breaker_preload", caption, figure)


def _pulse(parameters: BreakerParameters) -> Picture:
    body = pressed_body(parameters.body, parameters.excitation)
    share = np.linspace(0.0, 1.0, 2001)
    t = share * body.period
    moment = np.where(t > body.onset, body.amplitude * np.sin(body.mu * t + body.phase), 0.0)
    impulse = float(np.trapezoid(moment, t))
    figure, (axes,) = sheet(1, 1, 7.2, 3.4)
    axes.plot(share, moment, color=BLUE, label=f"half sine, {impulse:.3g} N m s a cycle")
    axes.fill_between(share, moment, color=BLUE, alpha=0.15, linewidth=0.0)
    axes.set_xlim(0.0, 1.0)
    axes.set_xlabel("part of the cycle t/T")
    axes.set_ylabel("moment on the body, N m")
    axes.set_title("The load on the body as approximated (Fig. 3)")
    axes.legend(loc="upper left")
    caption = "M = 0 to t1 = 0.9 T, then half a period of mu = 5 omega."
    return Picture("mb10_breaker_pulse", caption, figure)
