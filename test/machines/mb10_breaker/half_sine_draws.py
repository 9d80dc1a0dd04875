# SPDX-License-Identifier: Apache-2.0
"""Random legal bodies under the half sine, corners of every bound among them; run it for the long form.

python test/machines/mb10_breaker/half_sine_draws.py 2000
"""

import math
import sys
import time

import numpy as np
from pydantic import ValidationError

from mech_twin.machines.mb10_breaker.half_sine_body import HalfSineBody
from mech_twin.machines.mb10_breaker.pressed_body.free_swing import swing_regime
from mech_twin.machines.mb10_breaker.pressed_body.parameters import (
    BodyParameters,
    ExcitationParameters,
    pressed_body,
    stiffness_refusal,
)
from mech_twin.samples import ForceSample, Named

BODY = {  # smallest and largest, logarithmic where both are above zero
    "inertia_kg_m2": (1e-3, 1e6),
    "spring_arm_m": (1e-3, 10.0),
    "spring_rate_n_per_m": (1.0, 1e10),
    "preload_deflection_m": (0.0, 100.0),
    "restitution": (0.0, 0.99),
    "tool_radius_m": (1e-3, 10.0),
    "damping_ratio": (0.0, 0.99),
    "blow_impulse_nms": (0.0, 1e6),
}
EXCITATION = {"amplitude_nm": (-1e6, 1e6), "onset_fraction": (0.01, 0.999), "blow_rate_hz": (0.1, 100.0)}
USUAL = {
    "inertia_kg_m2": 0.35,
    "spring_arm_m": 0.2,
    "spring_rate_n_per_m": 3108.9,
    "preload_deflection_m": 0.03,
    "restitution": 0.4,
    "tool_radius_m": 0.25,
    "damping_ratio": 0.0,
    "blow_impulse_nms": 0.0,
    "amplitude_nm": 60.0,
    "onset_fraction": 0.9,
    "blow_rate_hz": 10.0,
}
STEP_S = 5e-3


def drawn(random, low, high, usual):
    kind = random.integers(6)
    if kind < 2:
        return (low, high)[kind]
    if kind == 2:
        return usual
    if low > 0.0 and high / low > 100.0:
        return float(np.exp(random.uniform(math.log(low), math.log(high))))
    if low == 0.0 and high > 1.0:
        return float(10.0 ** random.uniform(-9.0, math.log10(high)))
    return float(random.uniform(low, high))


def configuration(seed):
    """Legal parameters of this seed, or None where the draw is refused."""
    random = np.random.default_rng(seed)
    values = {name: drawn(random, *bounds, USUAL[name]) for name, bounds in (BODY | EXCITATION).items()}
    if random.integers(2):  # a preload of the order of the load
        share = random.uniform(0.0, 1.2)
        moment = values["spring_rate_n_per_m"] * values["spring_arm_m"]
        values["preload_deflection_m"] = min(share * abs(values["amplitude_nm"]) / moment, 100.0)
    try:
        body = BodyParameters(
            **{name: values[name] for name in BODY}, contact=("one_sided", "none")[int(random.integers(4) == 0)]
        )
        excitation = ExcitationParameters(
            kind="approximated",
            form=("shifted", "printed")[int(random.integers(2))],
            **{name: values[name] for name in EXCITATION},
        )
    except ValidationError:
        return None
    return None if stiffness_refusal(body, excitation) else (body, excitation)


def forces(step):
    return ForceSample(step, step * STEP_S, (), (), Named(), 0.0, Named())


def trouble(body, excitation, duration_s=0.5):
    """What is wrong with a run and the closed-form regime of this configuration; empty if nothing is."""
    role = HalfSineBody(body, excitation, STEP_S)
    sample, told = role.start(forces(0)), []
    for step in range(1, round(duration_s / STEP_S) + 1):
        sample = role.follow(sample, forces(step))
        numbers = (*sample.position, *sample.velocity, *sample.effort, sample.pressing_force_n, *sample.memory.values)
        if not all(math.isfinite(number) for number in numbers):
            told.append(f"not finite at {sample.time_s}: {sample}")
        for name, value in sample.residuals.as_dict().items():
            if not abs(value) <= role.residual_limits[name]:
                told.append(f"{name} {value:g} at {sample.time_s}")
        if body.contact == "one_sided" and sample.position[0] < 0.0:
            told.append(f"angle {sample.position[0]:g} below the collar at {sample.time_s}")
        if told:
            return told
    regime = swing_regime(pressed_body(body, excitation))
    if math.isnan(regime.largest_angle_rad):
        told.append("the regime of the free swing is not a number")
    return told


def main(count):
    tried = slowest = 0
    for seed in range(count):
        found = configuration(seed)
        if found is None:
            continue
        begun = time.monotonic()
        try:
            told = trouble(*found)
        except Exception as error:  # noqa: BLE001
            told = [repr(error)]
        taken = time.monotonic() - begun
        tried += 1
        slowest = max(slowest, taken)
        if told or taken > 5.0:
            print(seed, f"{taken:.1f} s", told[:1], *found)  # noqa: T201
    print(f"{tried} legal of {count}, slowest {slowest:.2f} s")  # noqa: T201


if __name__ == "__main__":
    main(int(sys.argv[1]))
