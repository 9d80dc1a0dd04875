# SPDX-License-Identifier: Apache-2.0
"""The breaker's two excitations on one picture, from its installed configuration.

python benchmarks/breaker_excitations.py docs/images
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

from mech_twin.capabilities.plots import BLUE, RED, Picture, house_style, sheet, written
from mech_twin.capabilities.variation import varied
from mech_twin.machines.mb10_breaker.parameters import BreakerParameters
from mech_twin.machines.mb10_breaker.published import ExcitationPulse, assumed_pulse, computed_pulse
from mech_twin.parameters.load import machine_parameters

# the scale that goes with the half sine: k = 0.3 omega and a preload of half the load's peak
PAPER_SCALE = {
    "excitation.kind": "approximated",
    "body.inertia_kg_m2": 0.35,
    "body.spring_rate_n_per_m": 3108.0,
    "body.preload_deflection_m": 0.0483,
}


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


def main() -> None:
    """Write the picture and print the numbers that go with it."""
    asked = argparse.ArgumentParser(description="the breaker's two excitations on one picture")
    asked.add_argument("directory", type=Path)
    directory = asked.parse_args().directory
    parameters = machine_parameters("mb10_breaker")
    if not isinstance(parameters, BreakerParameters):
        raise TypeError(f"expected the breaker's parameters, got {type(parameters).__name__}")
    assumed, computed = compared_pulses(parameters)
    with house_style():
        picture = excitation_picture(assumed, computed)
    for file in written(picture, directory):
        if file.suffix == ".svg":
            file.unlink()
    for line in (picture.caption, pulse_summary("assumed", assumed), pulse_summary("computed", computed)):
        print(line)


if __name__ == "__main__":
    main()
