# SPDX-License-Identifier: Apache-2.0
"""A stop that is a rod: one restitution for all speeds, its balances, what it tells, what is refused."""

from __future__ import annotations

import numpy as np
import pytest

import mech_twin
from mech_twin.declarations.configuration_tree import ConfigurationError
from mech_twin.engine.rollout import roll_out
from mech_twin.machines.impact_mass.parameters import ImpactMass
from mech_twin.machines.impact_mass.wave_stop import blow_numbers, unit_blow
from mech_twin.parameters.load import machine
from mech_twin.parts.rod_waves.parameters import wave_grid
from mech_twin.parts.rod_waves.struck_tool import rod_blow

WAVE = {"stop.model": "wave"}
NAME = "impact_mass"


def parameters(overrides: dict[str, object]) -> ImpactMass:
    found = machine(NAME, None, WAVE | overrides).parameters
    assert isinstance(found, ImpactMass)
    return found


@pytest.mark.parametrize(
    "overrides",
    [
        {},
        {"stop.wave.wall.kind": "rigid", "stop.wave.face.restitution": 0.6},
        {"stop.wave.wall.damping_ns_per_m": 2e4, "stop.wave.foot.length_m": 0.1},
        {"stop.wave.head.length_m": 0.02, "stop.wave.tip.length_m": 0.1},
    ],
)
@pytest.mark.parametrize("speed", [1e-3, 0.3, 20.0])
def test_the_restitution_is_the_same_at_every_speed(overrides: dict[str, object], speed: float) -> None:
    p = parameters(overrides)
    rod, mass = p.stop.wave, p.mass_kg
    found = rod_blow(wave_grid(rod, 0.0), mass, speed, 0.0, True, np.empty((0, 2)), np.empty((0, 1)))
    assert found.impulse_ns / (mass * speed) - 1.0 == pytest.approx(p.rebound, rel=1e-9)
    assert abs(found.energy_error) < 1e-12
    told = blow_numbers(rod, mass, speed)
    assert told["transmitted_energy_j"] == pytest.approx(found.transmitted_energy_j, rel=1e-8)
    assert told["peak_stress_pa"] == pytest.approx(found.peak_stress_pa, rel=1e-9)


def test_the_energy_of_a_blow_is_in_wall_stop_and_rebound() -> None:
    p = parameters({})
    unit = unit_blow(p.stop.wave, p.mass_kg)
    told = blow_numbers(p.stop.wave, p.mass_kg, 1.0)
    rebound = 0.5 * p.mass_kg * p.rebound**2
    assert told["transmitted_energy_j"] + told["stop_energy_j"] + rebound == pytest.approx(
        0.5 * p.mass_kg - unit.contact_loss_j, rel=1e-10
    )


def test_a_stiff_stop_on_a_rigid_wall_rebounds_by_its_face() -> None:
    """Its restitution tends to that of the face, as 1/e^2 times its stiffness when it unloads."""
    missed = []
    for stiffness in (1e8, 1e7, 1e6):
        overrides = {"wall.kind": "rigid", "face.stiffness_n_per_m": stiffness, "face.restitution": 0.5}
        missed.append(abs(parameters({f"stop.wave.{k}": v for k, v in overrides.items()}).rebound - 0.5))
    assert missed[0] > missed[1] > missed[2]
    assert missed[2] < 2e-3


def test_a_run_is_that_of_a_rigid_stop_of_this_restitution() -> None:
    waves = machine(NAME, None, WAVE)
    assert isinstance(waves.parameters, ImpactMass)
    rigid = machine(NAME, None, {"restitution": waves.parameters.rebound})
    first, other = (roll_out(built, 1.0) for built in (waves, rigid))
    assert [e[:6] for e in first.events] == [e[:6] for e in other.events]
    for residual in first.residuals.values():
        assert residual.worst <= residual.limit


def test_a_gauge_on_the_stop_tells_of_each_impact() -> None:
    built = machine(NAME, None, WAVE | {"stop.wave.gauge_curve": True})
    found = roll_out(built, 0.3)
    hits = [event for event in found.events if event.kind == "impact"]
    strains = found.gauge_numbers("impact", "peak_strain")
    assert len(strains) == len(hits) > 0
    speeds = np.array([event.pre_velocity_m_per_s for event in hits])
    np.testing.assert_allclose(strains / speeds, strains[0] / speeds[0], rtol=1e-12)
    assert built.gauge is not None
    assert built.gauge.curve(hits[0]).strain.max() == pytest.approx(strains[0], rel=1e-9)


def test_metrics_of_the_steady_impacts_are_told() -> None:
    numbers = mech_twin.simulate(NAME, 3.0, WAVE).summary
    p = parameters({})
    told = blow_numbers(p.stop.wave, p.mass_kg, numbers["steady_impact_speed_m_per_s"])
    assert numbers["steady_transmitted_energy_j"] == told["transmitted_energy_j"] > 0.0
    hardest = blow_numbers(p.stop.wave, p.mass_kg, numbers["hardest_blow_m_per_s"])
    assert numbers["peak_contact_force_n"] == pytest.approx(hardest["peak_force_n"], rel=1e-12)
    assert numbers["stop_restitution"] == p.rebound


@pytest.mark.parametrize(
    ("overrides", "message"),
    [
        ({"stop.wave.wall.kind": "yielding"}, "wave.wall.kind must be loading or rigid"),
        ({"stop.wave.wall.threshold_n": 10.0}, "wave.wall.threshold_n must be 0"),
        ({"stop.wave.face.kind": "hertz"}, "wave.face.kind must be linear"),
        ({"stop.wave.foot_gap_m": 1e-3}, "wave.foot_gap_m must be 0"),
        ({"stop.wave.head.length_m": 0.1}, r"stop.wave.head must have at most 0\.9 of mass_kg"),
        ({"contact_stiffness_n_per_m": 1e8}, "contact_stiffness_n_per_m must be left out"),
        ({"stop.wave.wall.stiffness_n_per_m": 1e4}, "window_s = 0.02 s is over"),
        ({"stop.wave.gauge_m": 1.0}, "wave.gauge_m must be at most 0.45 m"),
    ],
)
def test_a_stop_without_one_restitution_is_refused_in_one_line(overrides: dict[str, object], message: str) -> None:
    with pytest.raises(ConfigurationError, match=message) as told:
        machine(NAME, None, WAVE | overrides)
    assert "\n" not in str(told.value)
