# SPDX-License-Identifier: Apache-2.0
"""The breaker's two excitations side by side: the assumed half sine and the moment the running linkage gives."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mech_twin.capabilities.plots import BLUE, RED, Picture, sheet
from mech_twin.capabilities.variation import varied
from mech_twin.engine.run import frames
from mech_twin.machines.mb10_breaker import build
from mech_twin.machines.mb10_breaker.parameters import BreakerParameters
from mech_twin.machines.mb10_breaker.pressed_body.parameters import pressed_body
from mech_twin.machines.mb10_breaker.state import EventSide
from mech_twin.samples import Event

Array = NDArray[np.float64]
SETTLED_S = 5.0
# the scale that goes with the half sine: k = 0.3 omega and a preload of half the load's peak
PAPER_SCALE = {
    "excitation.kind": "approximated",
    "body.inertia_kg_m2": 0.35,
    "body.spring_rate_n_per_m": 3108.0,
    "body.preload_deflection_m": 0.0483,
}


class ExcitationPulse(NamedTuple):
    """One steady cycle on t/T, from blow to blow: moment on the body, lift at the tool, impulse of the blow."""

    share: Array
    moment_nm: Array
    lift_m: Array
    period_s: float
    blow_impulse_nms: float

    @property
    def steady_impulse_nms(self) -> float:
        """Angular impulse of the moment between the blows, N m s."""
        return float(np.trapezoid(self.moment_nm, self.share)) * self.period_s


def computed_pulse(parameters: BreakerParameters) -> ExcitationPulse:
    """Return the last whole cycle of a run from standstill, the moments on either side of events included."""
    radius = parameters.body.tool_radius_m
    blow_times, impulse = [0.0], 0.0
    points: list[tuple[float, float, float]] = []
    last: list[tuple[float, float, float]] = []
    for frame in frames(build(parameters), SETTLED_S):
        lifts = {event.time_s: radius * _body_angle(event) for event in frame.linkage.events if event.pre}
        for load in frame.forces.loads:
            lift = lifts.get(load.time_s, 0.0)
            points.append((load.time_s, load.moment_before_nm, lift))
            if load.kind == "blow":
                last, points = points, []
                blow_times.append(load.time_s)
                impulse = frame.forces.quantities.as_dict()["blow_impulse_on_body_nms"]
            points.append((load.time_s, load.moment_after_nm, lift))
        angle = frame.linkage.joint("body").position
        points.append((frame.linkage.time_s, frame.forces.body_moment_nm, radius * angle))
    begin, end = blow_times[-2:]
    times, moments, angles = np.array(last).T
    return ExcitationPulse((times - begin) / (end - begin), moments, angles, end - begin, impulse)


def _body_angle(event: Event) -> float:
    return EventSide(*event.pre).body.position


def assumed_pulse(parameters: BreakerParameters) -> ExcitationPulse:
    """Return the half sine and the steady lift it gives a body of the scale it belongs to."""
    body = pressed_body(parameters.body, parameters.excitation)
    share = np.linspace(0.0, 1.0, 2001)
    t = share * body.period
    moment = np.where(t > body.onset, body.amplitude * np.sin(body.mu * t + body.phase), 0.0)
    count = round(1.0 / parameters.excitation.blow_rate_hz / parameters.coupling.step_s)
    run = frames(build(parameters), 40 * count * parameters.coupling.step_s)
    taken = [frame.body.joint("body").position for frame in run if frame.body]
    cycle = np.array(taken[-count - 1 :]) * parameters.body.tool_radius_m
    lift = np.interp(share, np.linspace(0.0, 1.0, count + 1), cycle)
    return ExcitationPulse(share, moment, lift, body.period, parameters.body.blow_impulse_nms)


def excitation_picture(assumed: ExcitationPulse, computed: ExcitationPulse) -> Picture:
    """Return both pulses and what they do, on t/T."""
    figure, (moment, impulse, lift) = sheet(3, 1, 7.2, 7.4, sharex=True)
    for pulse, colour, name in ((assumed, BLUE, "assumed half sine"), (computed, RED, "from the running linkage")):
        moment.plot(pulse.share, pulse.moment_nm, color=colour, label=name)
        steps = 0.5 * np.diff(pulse.share) * (pulse.moment_nm[1:] + pulse.moment_nm[:-1]) * pulse.period_s
        total = np.concatenate(([0.0], np.cumsum(steps)))
        impulse.plot([*pulse.share, 1.0], [*total, total[-1] + pulse.blow_impulse_nms], color=colour)
        lift.plot(pulse.share, 1000.0 * pulse.lift_m, color=colour)
    impulse.annotate(
        f"blow: {computed.blow_impulse_nms:.2f} N m s at once",
        (1.0, 0.5 * computed.blow_impulse_nms),
        (0.66, 0.75 * computed.blow_impulse_nms),
        arrowprops={"arrowstyle": "->", "color": RED},
    )
    moment.set_ylabel("moment on the body, N m")
    impulse.set_ylabel("its angular impulse, N m s")
    lift.set_ylabel("lift at the tool, mm")
    lift.set_xlabel("part of the cycle t/T (the blow falls at 1)")
    lift.set_xlim(0.0, 1.02)
    moment.legend(loc="lower center")
    moment.set_title("Two excitations of the body, lifting positive")
    caption = (
        f"Half sine {assumed.steady_impulse_nms:.3f} N m s a cycle, on J 0.35 kg m^2; blow "
        f"{computed.blow_impulse_nms:.2f} N m s, on J 6 kg m^2: "
        f"{computed.blow_impulse_nms / assumed.steady_impulse_nms:.0f} times as much."
    )
    return Picture("mb10_breaker_excitations", caption, figure)


def compared_pulses(parameters: BreakerParameters) -> tuple[ExcitationPulse, ExcitationPulse]:
    """Return the assumed pulse, on the body it belongs to, and the computed one of this breaker."""
    running = varied(parameters, {"excitation.kind": "from_forces"})
    return assumed_pulse(varied(parameters, PAPER_SCALE)), computed_pulse(running)


def pulse_summary(name: str, pulse: ExcitationPulse) -> str:
    """Return moment, angular impulses and lift of a pulse in one line."""
    return (
        f"{name}: moment {pulse.moment_nm.min():.1f} to {pulse.moment_nm.max():.1f} N m, impulse between blows "
        f"{pulse.steady_impulse_nms:.3f}, of the blow {pulse.blow_impulse_nms:.3f} N m s, lift "
        f"{1000.0 * pulse.lift_m.max():.2f} mm"
    )
