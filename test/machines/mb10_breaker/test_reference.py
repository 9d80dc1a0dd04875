# SPDX-License-Identifier: Apache-2.0
"""The coupled run against the motion solved as one by other means, for random machines: blows, crank and body."""

import ast
import math
from pathlib import Path

import numpy as np
import pytest
from machines.mb10_breaker import breaker_reference as second_implementation
from machines.mb10_breaker.breaker_reference import BreakerReference

from mech_twin.engine.run import frames
from mech_twin.machines.mb10_breaker import build
from mech_twin.machines.mb10_breaker.state import BreakerMemory
from mech_twin.parameters.load import machine_parameters

DURATION_S = 0.8
DRAWN = 20


def drawn(seed):
    """Return a machine of random lengths, masses, spring, tool and mount around the configuration's."""
    rng = np.random.default_rng(seed)
    near = lambda value, spread: float(value * rng.uniform(1.0 - spread, 1.0 + spread))  # noqa: E731
    rocker_mass = near(3.0, 0.3)
    along = near(0.10, 0.3)
    return {
        "linkage.crank_m": near(0.03, 0.1),
        "linkage.coupler_m": near(0.20, 0.1),
        "linkage.rocker_m": near(0.08, 0.1),
        "linkage.ground_m": near(0.20, 0.1),
        "linkage.crank_inertia_kg_m2": near(0.3, 0.4),
        "linkage.crank_centroid_along_m": float(rng.uniform(-0.002, 0.002)),
        "linkage.coupler_mass_kg": near(0.8, 0.5),
        "linkage.coupler_centroid_across_m": float(rng.uniform(-0.02, 0.02)),
        "linkage.rocker_mass_kg": rocker_mass,
        "linkage.rocker_centroid_along_m": along,
        "linkage.rocker_centroid_across_m": float(rng.uniform(-0.02, 0.02)),
        "linkage.rocker_inertia_kg_m2": near(0.08, 0.2),
        "body.inertia_kg_m2": near(6.0, 0.4),
        "body.preload_deflection_m": near(0.0139, 0.3),
        "body.spring_rate_n_per_m": near(53300.0, 0.3),
        "body.restitution": float(rng.uniform(0.1, 0.6)),
        "body.damping_ratio": float(rng.choice([0.0, 0.05])),
        "tool.mass_kg": near(10.0, 0.3),
        "tool.restitution": float(rng.uniform(0.1, 0.6)),
        "tool.wall_force_n": 50.0,
        "gravity_m_per_s2": float(rng.choice([0.0, 9.80665])),
        "drive_mount": str(rng.choice(["frame", "body"])),
        "coupling.step_s": 0.00025,
    }


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(DRAWN))
def test_coupled_run_is_the_motion_solved_as_one(seed):
    parameters = machine_parameters("mb10_breaker", overrides=drawn(seed))
    run = list(frames(build(parameters), DURATION_S))
    reference = BreakerReference(parameters).run(np.array([frame.linkage.time_s for frame in run]))
    blows = np.array([(e.time_s, e.impulse_ns) for f in run for e in f.linkage.events if e.kind == "blow"])
    assert len(blows) == len(reference.blows) >= 2
    assert np.abs(blows[:, 0] - reference.blows[:, 0]).max() <= 5e-6
    assert np.abs(blows[:, 1] / reference.blows[:, 1] - 1.0).max() <= 2e-5
    turned = [f.linkage.position[0] + 2.0 * math.pi * BreakerMemory(*f.linkage.memory.values).turns for f in run]
    assert np.abs(np.array(turned) - reference.samples[:, 0]).max() <= 1e-4
    assert np.abs(np.array([f.linkage.position[3] for f in run]) - reference.samples[:, 2]).max() <= 1e-5


@pytest.mark.parametrize(
    ("module", "taken"),
    [
        (Path(second_implementation.__file__), {"mech_twin.machines.mb10_breaker.parameters"}),
        (Path(__file__).parents[1] / "impact_mass" / "release_reference.py", set()),
    ],
    ids=["breaker", "impact_mass"],
)
def test_a_second_implementation_takes_nothing_from_the_twin_but_a_configuration(module, taken):
    tree = ast.walk(ast.parse(module.read_text(encoding="utf-8")))
    found = [
        [node.module] if isinstance(node, ast.ImportFrom) else [a.name for a in node.names]
        for node in tree
        if isinstance(node, ast.Import | ast.ImportFrom)
    ]
    assert {name for names in found for name in names if name.startswith("mech_twin")} == taken
