# SPDX-License-Identifier: Apache-2.0
"""Plots of the breaker's body over spring, preload and excitation; with the blow as a wave those of the blow too."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from mech_twin.capabilities.plots import BLUE, GREEN, GREY, INK, ORANGE, OWN, RED, Picture, sheet
from mech_twin.capabilities.variation import varied
from mech_twin.machines.mb10_breaker.excitation_comparison import assumed_pulse, computed_pulse
from mech_twin.machines.mb10_breaker.parameters import BreakerParameters
from mech_twin.machines.mb10_breaker.pressed_body.free_swing import resonance_rate
from mech_twin.machines.mb10_breaker.pressed_body.metrics import preload_range, steady_metrics, with_preload
from mech_twin.machines.mb10_breaker.pressed_body.parameters import pressed_body
from mech_twin.machines.mb10_breaker.published import SOFT_TABLE, paper_body
from mech_twin.machines.mb10_breaker.spring_curves import swing_curve
from mech_twin.machines.mb10_breaker.wave_plots import wave_pictures

RATES = np.geomspace(100.0, 3.8e6, 1400)
PRELOAD_M = 0.01
SOFTNESS = 0.3


def pictures(parameters: BreakerParameters) -> Iterator[Picture]:
    """Yield the plots."""
    changed = paper_body(parameters)
    yield _spring(changed)
    yield _preload(changed)
    yield _pulses(changed, parameters)
    if parameters.tool.model == "wave":
        yield from wave_pictures(parameters)


def _spring(parameters: BreakerParameters) -> Picture:
    body, excitation = parameters.body, parameters.excitation
    figure, panels = sheet(2, 1, 7.6, 6.2, sharex=True)
    for preload, colour, style in ((0.0, BLUE, "-"), (PRELOAD_M, RED, "--")):
        points = swing_curve(body, excitation, [float(rate) for rate in RATES], preload)
        rates = [point.spring_rate_n_per_m / 1000.0 for point in points]
        label = rf"$a = {1000.0 * preload:g}$ mm"
        if preload == 0.0:
            amplitude = [min(1000.0 * point.amplitude_rad, 1e4) for point in points]
            panels[0].loglog(rates, amplitude, color=GREEN, label=f"periodic regime, {label}")
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
    panels[1].set_xlabel(r"spring rate $c$, kN/m")
    panels[0].set_title("Swing of the body against spring rate, no collar")
    caption = (
        "Undamped, from rest, it never settles but beats about the periodic regime. Dotted: resonances k = n omega."
    )
    return Picture("mb10_breaker_spring", f"{caption} {OWN}", figure)


def _preload(parameters: BreakerParameters) -> Picture:
    base = pressed_body(parameters.body, parameters.excitation)
    omega = 2.0 * np.pi / base.period
    ratios = np.linspace(0.05, 1.0, 191)
    found = [steady_metrics(with_preload(base, float(p), SOFTNESS * omega)).metrics for p in ratios]
    span = preload_range(base, SOFTNESS * omega)
    figure, panels = sheet(3, 1, 7.2, 6.8, sharex=True)
    for axes, curve, column, name, colour in (
        (panels[0], [1000.0 * f.gap_at_blow_m for f in found], 2, "gap at the blow, mm", BLUE),
        (panels[1], [f.return_speed_m_per_s for f in found], 3, "return speed, m/s", RED),
        (panels[2], [f.largest_force_n for f in found], 1, "pressing force, N", GREEN),
    ):
        axes.plot(ratios, curve, color=colour)
        axes.plot(
            *([row[i] for row in SOFT_TABLE] for i in (0, column)), "s", color=INK, markersize=5, label="worked table"
        )
        axes.axvspan(span.settled, 1.0, color=ORANGE, alpha=0.10, linewidth=0.0)
        axes.axvline(span.returned, color=ORANGE, linewidth=1.0, linestyle="--")
        axes.set_ylabel(name)
        axes.set_ylim(bottom=0.0)
    panels[0].legend(loc="upper right")
    panels[0].set_title("The body against its preload: the rational range, $k = 0.3 \\omega$, half sine")
    panels[2].set_xlabel(r"preload ratio $p = c\,a\,l/|H|$")
    panels[2].set_xlim(0.0, 1.02)
    caption = (
        "Shaded: settled before the next load. Dashed: the first return comes before the blow. Squares: worked table."
    )
    return Picture("mb10_breaker_preload", f"{caption} {OWN}", figure)


def _pulses(approximated: BreakerParameters, parameters: BreakerParameters) -> Picture:
    assumed = assumed_pulse(approximated)
    running = computed_pulse(varied(parameters, {"excitation.kind": "from_forces"}))
    figure, panels = sheet(1, 2, 8.6, 3.8, width_ratios=(2.4, 1.0))
    panels[0].plot(assumed.share, assumed.moment_nm, color=BLUE, label="half sine, as approximated")
    panels[0].plot(running.share, running.moment_nm, color=RED, label="running linkage, between blows")
    panels[0].plot([1.0, 1.0], [0.0, 60.0], color=RED, linewidth=4.0, alpha=0.5, label="blow")
    panels[0].set_xlim(0.0, 1.02)
    panels[0].set_xlabel(r"part of the cycle $t/T$")
    panels[0].set_ylabel("moment on the body, N m")
    panels[0].set_title("What loads the body (Fig. 3)")
    panels[0].legend(loc="lower center")
    impulses = (assumed.steady_impulse_nms, running.blow_impulse_nms)
    panels[1].bar((0, 1), impulses, width=0.6, color=(BLUE, RED), alpha=0.85)
    for place, value in enumerate(impulses):
        panels[1].text(place, value, f"{value:.3g}", ha="center", va="bottom")
    panels[1].set_xticks((0, 1), ("half sine", "blow"))
    panels[1].set_ylabel("lifting angular impulse, N m s")
    panels[1].grid(visible=False, axis="x")
    caption = "The assumed half sine carries some ten times less angular impulse than the blow of the running machine."
    return Picture("mb10_breaker_pulses", caption, figure)
