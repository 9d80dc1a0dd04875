# SPDX-License-Identifier: Apache-2.0
"""What sensors tell of a turn of a page's crank, what can go wrong with its elements, and what may vary."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from command_line import mech_twin
from machines.page.pages import BALL, page
from machines.page.test_page_machines import PAGES
from machines.page.test_page_machines import page as shipped

from mech_twin.capabilities.variation import varied
from mech_twin.errors import StudyError
from mech_twin.machines.page.metrics import faults, features, operating
from mech_twin.measurements.measurement_map import read_map
from mech_twin.parameters.load import machine
from mech_twin.results.opened_runs import columns_of
from mech_twin.studies.monitoring.sensing import MonitoredMachine, seen_run

ROD = "contacts.blow.rod"
SENSORS = """
machine: page
channels:
  - {source: {column: crank}, is: linkage.crank_bearing.position, rate_hz: 2000}
  - {source: {column: torque}, is: motor.motor.effort, rate_hz: 2000}
  - {source: {column: first}, is: event.impact.incident_energy, unit: J}
  - {source: {column: forth}, is: event.impact.forward_energy, unit: J}
  - {source: {column: back}, is: event.impact.reflected_energy, unit: J}
  - {source: {column: peak}, is: event.impact.peak_force, unit: N}
"""


def means(tmp_path, changes):
    """Return the mean features of turns of the rock hammer."""
    built = machine(shipped("rock_hammer"), None, changes)
    file = tmp_path / "sensors.yaml"
    file.write_text(SENSORS, encoding="utf-8")
    sensors = read_map(file, lambda name: columns_of(shipped("rock_hammer")))
    seen = MonitoredMachine(shipped("rock_hammer"), built.parameters, sensors)
    vectors = seen.vectors(seen_run(built, sensors, 1.0, begin_s=0.3))
    assert len(vectors) > 10
    assert all(np.isfinite(vector.values).all() for vector in vectors)
    return dict(zip(vectors[0].names, np.mean([vector.values for vector in vectors], axis=0), strict=True))


def test_a_softer_rock_sends_more_back_through_the_gauge_of_a_page(tmp_path):
    """The crank turns 30 times a second and strikes once a turn."""
    healthy = means(tmp_path, {})
    softer = means(tmp_path, {f"{ROD}.wall.stiffness_n_per_m": 1e7})
    assert healthy["period_s"] == pytest.approx(1.0 / 30.0, rel=1e-6)
    assert 0.0 < healthy["reflected_share"] < softer["reflected_share"] < 1.0
    assert healthy["incident_energy_j"] > 0.0
    assert healthy["gauge_peak_n"] > 0.0


@pytest.mark.parametrize("wall", ["loading", "yielding"])
def test_each_fault_of_a_rod_is_a_legal_page(wall):
    foot = {f"{ROD}.foot.length_m": 0.05, f"{ROD}.wall.kind": wall, f"{ROD}.wall.threshold_n": 1e4}
    parameters = machine(shipped("rock_hammer"), None, foot).parameters
    found = faults(parameters)
    walls = {"loading": "blow_wall_soft", "yielding": "blow_wall_weak"}
    assert {f.name for f in found} == {"blow_face_worn", "blow_foot_worn", walls[wall], "supply_frequency_range"}
    for fault in found:
        for size in fault.sizes:
            machine(shipped("rock_hammer"), None, {**foot, **fault.changes(parameters, size)})


def test_a_page_without_a_turning_drive_has_nothing_to_count_cycles_by():
    with pytest.raises(StudyError, match="no drive of a turning joint"):
        features(page(BALL))


@pytest.mark.parametrize("file", sorted(map(str, PAGES.glob("*.yaml"))), ids=lambda file: Path(file).stem)
def test_faults_and_operating_points_of_a_page_are_legal_pages_and_their_names_differ(file):
    parameters = machine(file).parameters
    found, variables = faults(parameters), operating(parameters)
    assert len({each.name for each in (*found, *variables)}) == len(found) + len(variables)
    asked = [each.changes(parameters, size) for each in found for size in each.sizes]
    asked += [each.changes(parameters, size) for each in variables for size in (-each.range, each.range)]
    for changes in asked:
        varied(parameters, changes)


HAMMER = """
machine: page
time: {column: time_s, unit: s}
channels:
  - {source: {column: crank}, is: linkage.crank_bearing.position, rate_hz: 1000, sigma: 0.001}
  - {source: {column: torque}, is: motor.motor.effort, rate_hz: 1000, sigma: 0.3}
  - {source: {column: ram}, is: linkage.ram_guide.position, rate_hz: 1000, sigma: 0.0003}
"""


@pytest.mark.slow
def test_a_soft_spring_of_a_page_is_named_and_sized_and_its_mains_is_no_fault(tmp_path):
    sensors, runs = tmp_path / "sensors.yaml", [tmp_path / "soft.csv", tmp_path / "slow.csv"]
    sensors.write_text(HAMMER, encoding="utf-8")
    for run, change in zip(runs, ("spring_soft=-10%@20", "supply_frequency=-2%@20"), strict=True):
        words = ("simulate", shipped("spring_hammer"), "--duration", 30, "--one-step", "--change", change)
        assert not mech_twin(*words, "--sensors", sensors, "--table", run, "--json").code
    asked = mech_twin("monitor", shipped("spring_hammer"), *runs, "--map", sensors, "--json")
    soft, slow = json.loads(asked.out)["runs"]
    (alarm,) = soft["alarms"]
    (named,) = alarm["candidates"]
    assert alarm["finding"] == "spring_soft"
    assert named["low_95"] <= -0.1 <= named["high_95"] < 0.0
    assert slow["alarms"] == []
    (point,) = slow["operating_point"]
    assert point["name"] == "supply_frequency"
    assert point["low_95"] - 1e-3 <= -0.02 <= point["high_95"] + 1e-3
