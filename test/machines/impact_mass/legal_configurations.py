# SPDX-License-Identifier: Apache-2.0
"""Random legal configurations of the impact mass, corners of every range included, and what each must keep.

Run ``python test/machines/impact_mass/legal_configurations.py 2000`` from the project's root for the long form.
"""

from __future__ import annotations

import math
import sys
import time
from itertools import islice

import numpy as np

from mech_twin.declarations.configuration_tree import ConfigurationError
from mech_twin.engine.run import frames
from mech_twin.engine.trajectory import frame_numbers
from mech_twin.machines.impact_mass import build
from mech_twin.parameters.load import machine_parameters

MOST_STEPS = 500
LARGEST = {"n": 1e9, "m": 1e4, "m_per_s": 1e4}


def _either(random: np.random.Generator, corners: tuple[float, ...], value: float) -> float:
    """Return a corner in one draw of four, else the value."""
    return float(random.choice(corners)) if random.random() < 0.25 else float(value)


def _sized(random: np.random.Generator, low: float, high: float) -> float:
    return float(math.exp(random.uniform(math.log(low), math.log(high))))


def _signed(random: np.random.Generator, high: float) -> float:
    size = _sized(random, 1e-9, high) if random.random() < 0.5 else _sized(random, 1e-2, 1e4)
    return _either(random, (0.0, high, -high, 1e-300, -1e-300), math.copysign(min(size, high), random.uniform(-1, 1)))


def drawn(random: np.random.Generator) -> dict[str, float | None]:
    """Return overrides of one configuration, within the range of each key."""
    period = _either(random, (1e-9, 1e6, 1e-3), _sized(random, 1e-6, 1e3))
    share = _either(random, (1e-9, 1.0 - 1e-9, 0.5), random.uniform(0.0, 1.0))
    stop = _either(random, (0.0, 1e4, -1e4), random.uniform(-1.0, 1.0))
    gap = _either(random, (0.0, 1e-300, 1e-12), _sized(random, 1e-9, 10.0))
    return {
        "mass_kg": _either(random, (1e-9, 1e7), _sized(random, 1e-3, 1e4)),
        "stop_position_m": stop,
        "restitution": _either(random, (1e-6, 0.999999, 0.99999, 0.5), random.uniform(0.01, 0.999)),
        "period_s": period,
        "phase1_duration_s": period * share,
        "phase1_force_n": _signed(random, 1e9),
        "phase2_force_n": _signed(random, 1e9),
        "initial_position_m": max(stop - gap, -1e4),
        "initial_velocity_m_per_s": _signed(random, 1e4),
        "chatter_cutoff": _either(random, (0.0, 1e-300, 1.0 - 1e-9), 0.0 if random.random() < 0.5 else random.random()),
        "contact_stiffness_n_per_m": _either(random, (1e-9, 1e13), _sized(random, 1e3, 1e10)),
        "supply.initial_fraction": _either(random, (0.0, 1.0), random.random()),
        "supply.rate_per_s": _sized(random, 1e-3, 1e3),
        "coupling.step_s": min(_either(random, (100.0 * period, period), _sized(random, 1e-5, 1.0)), 1.0),
    }


def broken_by(overrides: dict[str, float | None]) -> str:
    """Return what a configuration breaks: nothing (empty), or why; a refusal must be one line that names a key."""
    try:
        parameters = machine_parameters("impact_mass", overrides=overrides)
    except ConfigurationError as error:
        text = str(error)
        return "" if "\n" not in text and any(key.split(".")[-1] in text for key in overrides) else f"refusal: {text}"
    machine = build(parameters)
    figures = {**machine.report(), **{k: v for k, v in machine.analyse(1.0).items() if isinstance(v, float)}}
    endless = [name for name, value in figures.items() if not math.isfinite(value)]
    if endless:
        return f"not finite in the report: {endless}"
    observer, limits = machine.observer(), machine.linkage.residual_limits
    for frame in islice(frames(machine, 0.5), MOST_STEPS):
        observer.observe(frame)
        for name, number in frame_numbers(frame):
            if not math.isfinite(number):
                return f"{name} = {number} at step {frame.linkage.step}"
        for name, number in frame.linkage.residuals.as_dict().items():
            if not abs(number) <= limits[name]:
                return f"{name} = {number} at step {frame.linkage.step}"
    if not all(math.isfinite(number) for number in observer.numbers().values()):
        return f"not finite in the metrics: {observer.numbers()}"
    return ""


def main(count: int) -> int:
    """Try so many configurations; print what breaks, and the slowest."""
    random, broken, slowest = np.random.default_rng(20261122), 0, 0.0
    for number in range(count):
        overrides = drawn(random)
        begun = time.perf_counter()
        try:
            why = broken_by(overrides)
        except Exception as error:  # noqa: BLE001 - a trace is what is looked for
            why = f"{type(error).__name__}: {error}"
        spent = time.perf_counter() - begun
        if spent > max(slowest, 1.0):
            sys.stdout.write(f"{number}: {spent:.1f} s {overrides}\n")
        slowest = max(slowest, spent)
        if why:
            broken += 1
            sys.stdout.write(f"{number}: {why} {overrides}\n")
    sys.stdout.write(f"{count} configurations, {broken} broken, slowest {slowest:.2f} s\n")
    return 1 if broken else 0


if __name__ == "__main__":
    sys.exit(main(int(sys.argv[1])))
