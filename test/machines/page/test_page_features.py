# SPDX-License-Identifier: Apache-2.0
"""What sensors tell of a turn of a page's crank, and what can go wrong with the rod it strikes."""

from __future__ import annotations

import numpy as np
import pytest
from machines.page.pages import BALL, page
from machines.page.test_page_machines import page as shipped

from mech_twin.errors import StudyError
from mech_twin.machines.page.metrics import faults, features
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
    assert {fault.name for fault in found} == {"blow_face_worn", "blow_foot_worn", walls[wall]}
    for fault in found:
        for size in fault.sizes:
            machine(shipped("rock_hammer"), None, {**foot, **fault.changes(parameters, size)})


def test_a_page_without_a_turning_drive_has_nothing_to_count_cycles_by():
    with pytest.raises(StudyError, match="no drive of a turning joint"):
        features(page(BALL))
