# SPDX-License-Identifier: Apache-2.0
"""Tool and striker for most energy in the wall: limits hold, nothing tried is better, a yielding wall is refused."""

from __future__ import annotations

import pytest

from mech_twin.errors import StudyError
from mech_twin.machines.mb10_breaker import tool_sizing
from mech_twin.machines.mb10_breaker.state import breaker
from mech_twin.parameters.load import machine_parameters
from mech_twin.studies import size

LOADING = {"tool.wave.wall.kind": "loading"}
NAME, OBJECTIVE = "mb10_breaker", tool_sizing.OBJECTIVE


@pytest.fixture(autouse=True, scope="module")
def coarse():
    """Try fewer sizes."""
    patch = pytest.MonkeyPatch()
    for name in ("DIAMETERS_M", "LENGTHS_M", "STRIKERS"):
        patch.setattr(tool_sizing, name, getattr(tool_sizing, name)[::3])
    yield
    patch.undo()


def sized(limits, tolerance=0.0):
    return size(NAME, machine_parameters(NAME, None, LOADING), limits=limits, objective=OBJECTIVE, tolerance=tolerance)


def test_the_limits_hold_for_the_configuration_that_is_written():
    found = sized({"peak_stress_pa": 6e7}, 0.05)
    p = found.parameters
    again = tool_sizing.sized_blow(p, breaker(p), p.tool.wave, 0.0)
    assert again.peak_stress_pa <= 6e7
    assert again.blow_power_w <= p.motor.rated_power_w
    assert again.transmitted_energy_j >= found.metrics[OBJECTIVE] * (1.0 - 1e-9)
    assert p.tool.mass_kg == pytest.approx(again.tool_mass_kg, rel=1e-12)
    assert p.tool.model == "wave"


def test_a_lower_stress_takes_energy_from_the_wall():
    """What is within the lower limit was within the higher one, so the best can only be less."""
    energies = [sized({"peak_stress_pa": limit}).metrics[OBJECTIVE] for limit in (2.5e8, 4e7, 2.8e7)]
    assert energies == sorted(energies, reverse=True)
    assert energies[-1] < energies[0]


def test_nothing_tried_within_the_limits_is_better():
    found = sized({"peak_stress_pa": 4e7})
    kept = [row for row in found.trade_off if row["kept"] == "yes"]
    assert found.metrics[OBJECTIVE] == max(row[OBJECTIVE] for row in kept)


def test_limits_that_no_size_keeps_are_named():
    with pytest.raises(StudyError, match="no tool and striker meet the limits: peak_stress_pa <= 1e"):
        sized({"peak_stress_pa": 1e6})


def test_a_wall_that_yields_has_no_energy_of_one_blow():
    with pytest.raises(StudyError, match=r"wall\.kind is yielding; expected loading"):
        size(NAME, objective=OBJECTIVE)
