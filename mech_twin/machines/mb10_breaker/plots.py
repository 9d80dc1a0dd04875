# SPDX-License-Identifier: Apache-2.0
"""Plots of the breaker's body over spring, preload and excitation; with the blow as a wave those of the blow too.

Plots of the blow as a wave: energy into the wall, force in the tool, energy through it.
"""

from collections.abc import Iterator

import numpy as np

from mech_twin.capabilities.plots import BLUE, GREEN, GREY, INK, ORANGE, OWN, RED, Picture, sheet
from mech_twin.capabilities.variation import varied
from mech_twin.machines.mb10_breaker.dynamics import striker
from mech_twin.machines.mb10_breaker.impacts import impact_direction
from mech_twin.machines.mb10_breaker.metrics import rated_crank_speed, striking_angle
from mech_twin.machines.mb10_breaker.parameters import BreakerParameters
from mech_twin.machines.mb10_breaker.pressed_body.free_swing import resonance_rate, swing_regime
from mech_twin.machines.mb10_breaker.pressed_body.metrics import preload_range
from mech_twin.machines.mb10_breaker.pressed_body.parameters import pressed_body
from mech_twin.machines.mb10_breaker.published import SOFT_TABLE, assumed_pulse, computed_pulse, paper_body, soft_spring
from mech_twin.machines.mb10_breaker.sizing import SOFTNESS, seating
from mech_twin.machines.mb10_breaker.state import breaker
from mech_twin.parts.rod_waves.blow import (
    STRIKERS,
    RodBlow,
    share_of_mass,
    share_of_rectangle,
    simulated_share_of_mass,
    simulated_share_of_rectangle,
    simulated_share_of_steps,
)
from mech_twin.parts.rod_waves.struck_tool import gauge_piece, rod_blow

STIFFNESSES = np.geomspace(1e6, 1e10, 41)  # N/m
RATIOS = (2.0, 4.0, 100.0)  # k_u/k_l
SHOWN_S = 2.5e-3


def as_wave(parameters: BreakerParameters, changes: dict[str, object]) -> BreakerParameters:
    """Return the parameters with the blow as a wave, and other changes."""
    return varied(parameters, {"tool.model": "wave", **changes})


def rated_rod_blow(
    parameters: BreakerParameters, seated: bool = True, steps: int = 0
) -> tuple[RodBlow, np.ndarray, np.ndarray]:
    """Return the blow at rated speed, the body at rest; p, q at the gauge and the force in each cell, a row a step."""
    b = breaker(parameters)
    q, u = striking_angle(b), rated_crank_speed(parameters)
    along = impact_direction(b, q, 0.0, True, b.held)
    cells = b.wave.head.cells + b.wave.rod.cells + b.wave.tip.cells + b.wave.foot.cells
    gauge, forces = np.zeros((steps, 2)), np.zeros((steps, cells))
    found = rod_blow(b.wave, along.effective_kg, striker(b, q)[1] * u, 0.0, seated, gauge, forces)
    return found, gauge, forces


def wave_pictures(parameters: BreakerParameters) -> Iterator[Picture]:
    """Yield the plots of the blow as a wave."""
    yield _efficiency(parameters)
    yield _force_over_place_and_time(parameters)
    yield _force_at_gauge(parameters)
    yield _energy_through_gauge(parameters)


def _efficiency(parameters: BreakerParameters) -> Picture:
    figure, panels = sheet(1, 2, 9.0, 3.8)
    middle = np.geomspace(0.05, 50.0, 40)
    fine, coarse = np.geomspace(0.05, 50.0, 200), np.geomspace(0.05, 50.0, 13)
    for closed, simulated, colour, label in (
        (share_of_rectangle, simulated_share_of_rectangle, BLUE, "rod of the tool's impedance, $x = 2Lk/cZ$"),
        (share_of_mass, simulated_share_of_mass, RED, "rigid mass, $a = kM/Z^2$"),
    ):
        panels[0].semilogx(fine, [closed(float(x)) for x in fine], color=colour, label=label)
        panels[0].semilogx(coarse, [simulated(float(x)) for x in coarse], "o", color=colour, markersize=4)
    for (label, steps), style in zip(STRIKERS.items(), ("-", "--", "-.", ":"), strict=True):
        shares = [simulated_share_of_steps(steps, float(x), 100) for x in middle]
        panels[0].semilogx(middle, shares, color=INK, linestyle=style, linewidth=1.0, label=label)
    panels[0].set_xlabel("dimensionless wall stiffness, $x = 2Tk/Z$ or $a$")
    panels[0].set_title("First wave, long tool: lines closed form, dots integrated")
    for ratio, colour in zip(RATIOS, (BLUE, GREEN, ORANGE), strict=True):
        shares = []
        for k in STIFFNESSES:
            wall = {"tool.wave.wall.kind": "loading", "tool.wave.wall.stiffness_n_per_m": float(k)}
            found, _, _ = rated_rod_blow(as_wave(parameters, {**wall, "tool.wave.wall.unloading_ratio": ratio}))
            shares.append(found.transmitted_energy_j / found.striker_energy_j)
        panels[1].semilogx(STIFFNESSES / 1e6, shares, color=colour, label=f"$k_u/k_l$ = {ratio:g}")
    panels[1].set_xlabel("wall stiffness $k_l$, kN/mm")
    panels[1].set_title("Whole blow of the breaker at rated speed")
    for axes in panels:
        axes.set_ylabel("share of the striker's energy in the wall")
        axes.set_ylim(0.0, 1.6)
        axes.legend(loc="upper right", fontsize=7)
    caption = "The wall keeps what loading and unloading enclose; a short tool brings the wave to it again and again."
    return Picture("mb10_breaker_blow_efficiency", f"{caption} {OWN}", figure)


def _force_over_place_and_time(parameters: BreakerParameters) -> Picture:
    figure, panels = sheet(1, 2, 9.0, 4.2, sharey=True)
    for axes, wall, title in (
        (panels[0], "yielding", "Wall that yields"),
        (panels[1], "loading", "Wall of stiffness $k_l$"),
    ):
        p = as_wave(parameters, {"tool.wave.wall.kind": wall})
        b = breaker(p)
        steps = int(SHOWN_S / b.wave.span_s)
        found, _, forces = rated_rod_blow(p, steps=steps)
        shown = forces[: min(steps, found.steps)] / 1000.0
        most = float(np.abs(shown).max())
        length = 1000.0 * (b.wave.rod.length_m + b.wave.tip.length_m + b.wave.foot.length_m)
        image = axes.imshow(
            shown, origin="lower", aspect="auto", cmap="RdBu_r", vmin=-most, vmax=most,
            extent=(0.0, length, 0.0, 1000.0 * len(shown) * b.wave.span_s),
        )  # fmt: skip
        figure.colorbar(image, ax=axes, label="force, kN (compression positive)")
        axes.grid(visible=False)
        axes.set_xlabel("distance from the struck face, mm")
        axes.set_title(title)
    panels[0].set_ylabel("time since the first touch, ms")
    caption = "Force in the tool over place and time at rated speed, the body at rest."
    return Picture("mb10_breaker_blow_xt", f"{caption} {OWN}", figure)


def _force_at_gauge(parameters: BreakerParameters) -> Picture:
    figure, panels = sheet(1, 1, 7.2, 3.6)
    for wall, seated, colour, label in (
        ("loading", True, BLUE, "wall of stiffness $k_l$"),
        ("yielding", True, RED, "wall that yields"),
        ("loading", False, INK, "tool not pressed on the wall"),
    ):
        p = as_wave(parameters, {"tool.wave.wall.kind": wall})
        grid = breaker(p).wave
        steps = int(SHOWN_S / grid.span_s)
        found, gauge, _ = rated_rod_blow(p, seated, steps)
        force = gauge[: min(steps, found.steps)].sum(axis=1)
        time_ms = 1000.0 * grid.span_s * np.arange(1, len(force) + 1)
        style = "-" if seated else "--"
        panels[0].plot(time_ms, force / 1000.0, color=colour, linestyle=style, label=label)
    area = gauge_piece(breaker(as_wave(parameters, {})).wave).area_m2
    low, high = panels[0].get_ylim()
    stress = panels[0].twinx()
    stress.set_ylim(low / area / 1000.0, high / area / 1000.0)
    stress.set_ylabel("stress, MPa")
    stress.grid(visible=False)
    stress.spines["right"].set_visible(True)
    panels[0].set_xlabel("time since the first touch, ms")
    panels[0].set_ylabel("force at the gauge, kN")
    panels[0].set_title("Force at the strain gauge")
    panels[0].legend(loc="upper left")
    caption = "Force at the gauge at rated speed, the body at rest; compression positive."
    return Picture("mb10_breaker_blow_gauge", f"{caption} {OWN}", figure)


def _energy_through_gauge(parameters: BreakerParameters) -> Picture:
    figure, panels = sheet(1, 2, 9.0, 3.6, sharey=True)
    for axes, wall, title in ((panels[0], "yielding", "Wall that yields"), (panels[1], "loading", "Wall of $k_l$")):
        p = as_wave(parameters, {"tool.wave.wall.kind": wall})
        grid = breaker(p).wave
        found, gauge, _ = rated_rod_blow(p, steps=int(SHOWN_S / grid.span_s))
        own = gauge[: found.steps]
        time_ms = 1000.0 * grid.span_s * np.arange(1, len(own) + 1)
        forth, back = (np.cumsum(own[:, i] ** 2) * grid.span_s / gauge_piece(grid).impedance for i in (0, 1))
        axes.plot(time_ms, forth, color=BLUE, label="forward")
        axes.plot(time_ms, back, color=RED, label="back")
        axes.plot(time_ms, forth - back, color=INK, label="gone through")
        axes.axhline(found.striker_energy_j, color=INK, linestyle=":", linewidth=1.0, label="the striker's")
        axes.set_xlabel("time since the first touch, ms")
        axes.set_title(title)
    panels[0].set_ylabel("energy through the gauge, J")
    panels[0].legend(loc="upper left")
    caption = "Energy that waves carry past the gauge, counted from the first touch; rated speed, the body at rest."
    return Picture("mb10_breaker_blow_energy", f"{caption} {OWN}", figure)


RATES = np.geomspace(100.0, 3.8e6, 1400)
PRELOAD_M = 0.01


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
        springs = ({"spring_rate_n_per_m": rate, "preload_deflection_m": preload} for rate in RATES.tolist())
        regimes = [swing_regime(pressed_body(varied(body, spring), excitation)) for spring in springs]
        rates = RATES / 1000.0
        label = rf"$a = {1000.0 * preload:g}$ mm"
        if preload == 0.0:
            amplitude = [min(1000.0 * regime.amplitude_rad, 1e4) for regime in regimes]
            panels[0].loglog(rates, amplitude, color=GREEN, label=f"periodic regime, {label}")
        bound = [min(regime.largest_force_n, 1e6) for regime in regimes]
        panels[1].loglog(rates, bound, color=colour, linestyle=style, label=f"from rest (bound of the beat), {label}")
        if preload == 0.0:
            periodic = [min(regime.periodic_force_n, 1e6) for regime in regimes]
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
    ratios = np.linspace(0.05, 1.0, 96)
    found = [seating(soft_spring(parameters, p)) for p in ratios.tolist()]
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
