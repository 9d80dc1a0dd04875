# SPDX-License-Identifier: Apache-2.0
"""Random legal configurations of the roller former, corners included, and what each must keep.

``python test/roller_former_random.py 2000`` runs the long form.
"""

from __future__ import annotations

import math
import sys
import time
from collections import Counter
from typing import Any

import numpy as np
from roller_former_cases import file_for

from mech_twin.declarations.configuration_tree import ConfigurationError
from mech_twin.engine.run import frames
from mech_twin.engine.trajectory import frame_numbers
from mech_twin.parameters.load import machine
from mech_twin.roles import Machine

RUN_S = 0.5


def log_uniform(rng: np.random.Generator, low: float, high: float) -> float:
    return float(math.exp(rng.uniform(math.log(low), math.log(high))))


def drawn(rng: np.random.Generator) -> tuple[int, dict[str, Any]]:
    """Return a number of carts, whose file is the base, and what is laid over it."""
    carts = int(rng.integers(1, 5))
    crank = log_uniform(rng, 0.02, 1.0)
    ratio = rng.choice([rng.uniform(0.05, 0.9), 0.979, 0.01])
    size = (crank / 0.2) ** 3
    over: dict[str, Any] = {
        "carts.crank_m": crank,
        "carts.rod_m": crank / float(ratio),
        "carts.mass_kg": float(rng.choice([0.0, log_uniform(rng, 1.0, 2e3) * size])),
        "carts.rod_mass_kg": float(rng.choice([0.0, log_uniform(rng, 0.1, 300.0) * size])),
        "carts.roller_force_x_n": float(rng.choice([0.0, log_uniform(rng, 10.0, 2e4)])),
        "carts.roller_force_y_n": float(rng.choice([0.0, log_uniform(rng, 10.0, 2e4)])),
        "carts.weight_n": float(rng.choice([0.0, log_uniform(rng, 10.0, 2e4)])),
        "carts.friction": float(rng.choice([0.0, 0.008, rng.uniform(0.0, 0.4999)])),
        "carts.guide_roller_m": log_uniform(rng, 1e-3, 1.0),
        "carts.a_m": log_uniform(rng, 1e-3, 10.0),
        "carts.b_m": log_uniform(rng, 1e-2, 10.0),
        "carts.p_m": float(rng.choice([0.0, rng.uniform(0.0, 2.0)])),
        "carts.e_m": float(rng.choice([0.0, rng.uniform(0.0, 2.0)])),
        "carts.crank_inertia_kg_m2": float(rng.choice([0.0, log_uniform(rng, 1e-3, 100.0)])),
        "carts.gravity_m_per_s2": float(rng.choice([0.0, 9.81, 100.0])),
        "load": str(rng.choice(["none", "reversing", "resist", "rectified", "printed"])),
        "guide_friction": str(rng.choice(["signed", "rail_change"])),
        "kinematics": str(rng.choice(["exact", "expanded"])),
        "motor.torque_curve": str(rng.choice(["kloss", "starting_corrected"])),
        "drive.efficiency": float(rng.choice([1.0, 0.9, rng.uniform(0.05, 1.0)])),
        "drive.gear_loss": str(rng.choice(["power", "printed"])),
        "drive.inertia_factor": float(rng.choice([1.0, rng.uniform(1.0, 5.0)])),
        "drive.coupling_inertia_kg_m2": float(rng.choice([0.0, 0.32, log_uniform(rng, 1e-3, 50.0)])),
        "drive.ratio": log_uniform(rng, 0.5, 100.0),
        "drive.stiffness_nm_per_rad": log_uniform(rng, 1.0, 1e8),
        "drive.damping_nms_per_rad": float(rng.choice([0.0, log_uniform(rng, 0.1, 1e5)])),
        "friction.coulomb_nm": float(rng.choice([0.0, log_uniform(rng, 0.1, 1e4)])),
        "friction.viscous_nms_per_rad": float(rng.choice([0.0, log_uniform(rng, 0.01, 1e3)])),
        "supply.initial_fraction": float(rng.choice([0.0, 1.0, rng.uniform(0.0, 1.0)])),
        "supply.rate_per_s": log_uniform(rng, 0.05, 1e4),
        "start.crank_deg": float(rng.choice([0.0, 180.0, rng.uniform(-3600.0, 3600.0)])),
        "start.speed_fraction": float(rng.choice([0.0, 1.0, rng.uniform(0.0, 1.0)])),
        "start.load_from_fraction": float(rng.choice([0.0, 0.9, rng.uniform(0.0, 0.9999)])),
        "start.load_rise_s": float(rng.choice([0.0, 1e-3, 0.5, 100.0])),
        "stall.speed_fraction": float(rng.choice([0.05, 1e-6, 0.9999])),
        "stall.time_s": float(rng.choice([1.0, 1e-6, 0.1])),
        "integrator.tolerance": float(rng.choice([1e-9, 1e-13, 1e-7])),
        "coupling.step_s": float(rng.choice([1e-3, 1e-4, 1e-2, log_uniform(rng, 1e-5, 1e-2)])),
    }
    over["carts.states"] = [
        str(state) for state in rng.choice(["loaded", "empty", "missing"], carts, p=[0.7, 0.2, 0.1])
    ]
    if rng.random() < 0.3:
        over["carts.offsets_deg"] = [float(angle) for angle in rng.uniform(-3600.0, 3600.0, carts)]
    if rng.random() < 0.3:
        over["carts.masses_kg"] = [float(rng.choice([0.0, log_uniform(rng, 1.0, 1e4)])) for _ in range(carts)]
    kept = rng.random(len(over)) < rng.choice([0.15, 0.4, 1.0])
    return carts, {key: value for (key, value), keep in zip(over.items(), kept, strict=True) if keep}


def built_or_refused(carts: int, over: dict[str, Any]) -> Machine | str:
    """Return the machine, or the one line with which it is refused."""
    try:
        return machine("roller_former", file_for(carts), over)
    except ConfigurationError as refusal:
        message = str(refusal)
        assert "\n" not in message
        return message


def broken(twin: Machine, commands: tuple[float, ...]) -> str:
    """Return what a run of half a second and the analyses break first, or nothing."""
    try:
        for name, value in twin.report().items():
            if not math.isfinite(value):
                return f"report: {name} {value}"
        twin.analyse(1.0)
        steps = round(RUN_S / twin.coupling_step_s)
        for frame in frames(twin, RUN_S, lambda step: commands[step * len(commands) // (steps + 1)]):
            for column, value in frame_numbers(frame):
                if not math.isfinite(value):
                    return f"{column} {value} at {frame.linkage.time_s} s"
            for role, sample in ((twin.linkage, frame.linkage), (twin.forces, frame.forces)):
                for name, value in sample.residuals.as_dict().items():
                    if not abs(value) <= role.residual_limits[name]:
                        return f"{name} {value} at {frame.linkage.time_s} s"
    except Exception as error:  # noqa: BLE001 - what a legal input must never end in
        return f"{type(error).__name__}: {error}"
    return ""


def main() -> None:
    """Run so many configurations from a seed, and say what broke."""
    count, seed = int(sys.argv[1]), int(sys.argv[2]) if len(sys.argv) > 2 else 1
    outcome: Counter[str] = Counter()
    for number in range(count):
        rng = np.random.default_rng([seed, number])
        carts, over = drawn(rng)
        twin = built_or_refused(carts, over)
        if isinstance(twin, str):
            outcome[" ".join(twin.split(":")[1:3])[:60]] += 1
            continue
        begun = time.perf_counter()
        found = broken(twin, (1.0, float(rng.uniform()), 0.0, 1.0))
        outcome["ran" if not found else "BROKEN"] += 1
        spent = time.perf_counter() - begun
        if found or spent > 20.0:
            sys.stdout.write(f"{seed}/{number} carts {carts} {spent:.1f} s {found} {over}\n")
            sys.stdout.flush()
    for name, times in outcome.most_common():
        sys.stdout.write(f"{times:6d} {name}\n")


if __name__ == "__main__":
    main()
