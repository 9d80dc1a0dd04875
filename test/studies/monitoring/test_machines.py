# SPDX-License-Identifier: Apache-2.0
"""Every machine under its sensors: features that are numbers, faults that are configurations, one answer live."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from mech_twin.declarations.configuration_tree import ConfigurationError
from mech_twin.machines.catalog import CATALOGUE
from mech_twin.measurements.measurement_map import read_map
from mech_twin.measurements.units import UNITS
from mech_twin.parameters.live_change import ChangingMachine, live_changes
from mech_twin.parameters.load import machine_parameters
from mech_twin.parts.induction_motor import motor_constants, motor_torque
from mech_twin.results.opened_runs import columns_of
from mech_twin.studies.monitoring.sensing import MonitoredMachine, seen_run, without_noise
from mech_twin.studies.monitoring.sensor_design import _of_sensors

SENSORS = Path(__file__).resolve().parents[3] / "benchmarks" / "monitoring" / "sensors"
MONITORED = [name for name in CATALOGUE if (SENSORS / f"{name}.yaml").exists()]
SIX = {"mb10_breaker", "compaction_press", "vibration_crank", "impact_mass", "roller_former", "winding_drum"}


def monitored(name: str) -> MonitoredMachine:
    return MonitoredMachine(name, machine_parameters(name), read_map(SENSORS / f"{name}.yaml", columns_of))


def test_the_six_machines_are_monitored() -> None:
    assert set(MONITORED) >= SIX


@pytest.mark.parametrize("name", MONITORED)
def test_each_feature_of_a_machine_is_a_number_with_a_unit(name: str) -> None:
    machine = monitored(name)
    exact = MonitoredMachine(name, machine.parameters, without_noise(machine.sensors))
    begin_s = exact.declared.run_up_s
    seen = seen_run(exact.entry.build(exact.parameters), exact.sensors, begin_s + 3.0, begin_s=begin_s)
    feed = exact.feed()
    declared = {feature.name for feature in exact.declared.features}
    assert len(declared) == len(exact.declared.features)
    assert {feature.unit for feature in feed.features} <= {*UNITS, "1"}
    vectors = exact.vectors(seen)
    assert len(vectors) >= 2 and len(vectors[0].values) >= 5
    assert all(np.isfinite(vector.values).all() for vector in vectors)
    numbers = np.array([vector.values for vector in vectors])
    scale = np.maximum(np.abs(numbers).max(axis=0), 1e-3)
    assert (np.ptp(numbers, axis=0) / scale).max() < 2.1  # a steady machine: nothing runs away


@pytest.mark.timeout(60)
@pytest.mark.parametrize("name", MONITORED)
def test_a_feature_of_a_channel_that_tells_nothing_or_nonsense_is_a_number_or_missing(name: str) -> None:
    machine = monitored(name)
    begin_s = machine.declared.run_up_s
    seen = seen_run(machine.entry.build(machine.parameters), machine.sensors, begin_s + 2.0, begin_s=begin_s)
    for column, (times, values) in seen.items():
        odd = [np.full(len(values), x) for x in (0.0, values[0], -1.0, 1e300, np.nan)]
        odd += [-values, 1e-300 * values, np.where(np.arange(len(values)) % 7 == 3, 1e300, values)]
        for shown in odd:
            for vector in machine.vectors({**seen, column: (times, shown)}):
                assert not np.isinf(vector.values).any()


def test_only_a_sensor_that_a_feature_needs_can_be_found_wrong(tmp_path: Path) -> None:
    """A wrong sensor that moves no feature would look like everything."""
    sensors = tmp_path / "sensors.yaml"
    force = "  - {source: {topic: /plant/force, field: data}, is: body.pressing_force_n, rate_hz: 1000.0, sigma: 5.0}\n"
    sensors.write_text((SENSORS / "mb10_breaker.yaml").read_text(encoding="utf-8") + force, encoding="utf-8")
    machine = MonitoredMachine("mb10_breaker", machine_parameters("mb10_breaker"), read_map(sensors, columns_of))
    assert "body.pressing_force_n" in machine.columns
    seen = seen_run(machine.entry.build(machine.parameters), machine.sensors, 0.5)
    causes = _of_sensors(machine, [seen], tuple(feature.name for feature in machine.feed().features), 0.1)
    assert {cause.key for cause in causes} == set(machine.columns) - {"body.pressing_force_n"}


@pytest.mark.parametrize("name", MONITORED)
def test_each_fault_is_a_legal_configuration_at_every_size(name: str) -> None:
    machine = monitored(name)
    assert len({fault.name for fault in machine.faults}) == len(machine.faults) >= 3
    for fault in machine.faults:
        assert list(fault.sizes) == sorted(fault.sizes) and 0.0 not in fault.sizes
        for size in fault.sizes:
            changes = fault.changes(machine.parameters, size)
            assert machine.varied(changes) != machine.parameters, (fault.name, size)


@pytest.mark.parametrize("name", sorted(SIX - {"impact_mass"}))
def test_a_supply_beyond_its_range_is_one_fault_on_both_sides_of_it(name: str) -> None:
    machine = monitored(name)
    (variable,) = (each for each in machine.operating if each.name == "supply_frequency")
    (fault,) = (each for each in machine.faults if each.name == variable.beyond)
    assert min(fault.sizes) < -variable.range and max(fault.sizes) > variable.range
    assert all(abs(size) > variable.range for size in fault.sizes)
    for size in fault.sizes:
        assert fault.changes(machine.parameters, size) == variable.changes(machine.parameters, size)


def test_the_size_of_a_fault_is_asked_for_in_its_unit() -> None:
    drum = monitored("winding_drum")
    with pytest.raises(ConfigurationError, match=r"eccentricity=20%@1: expected a size, a number of unit m"):
        ChangingMachine(drum.entry.build(drum.parameters), live_changes(["eccentricity=20%@1"]))


def test_a_motor_that_has_lost_a_share_of_its_torque_has_lost_it_at_every_slip() -> None:
    machine = monitored("roller_former")
    loss = next(fault for fault in machine.faults if fault.name == "phase_loss")
    healthy, weak = (
        motor_constants(parameters.motor)
        for parameters in (machine.parameters, machine.varied(loss.changes(machine.parameters, -0.4)))
    )
    for speed in np.linspace(0.0, 1.2, 13) * healthy.synchronous_speed_rad_per_s:
        assert motor_torque(weak, speed, 1.0) == pytest.approx(0.6 * motor_torque(healthy, speed, 1.0), rel=1e-12)


@pytest.mark.parametrize("direction", ["unwinding", "winding"])
def test_another_density_of_a_package_is_told_alike_however_much_yarn_is_on_it(direction: str) -> None:
    drum = monitored("winding_drum")
    usual = drum.varied({"direction": direction})
    heavy = drum.varied({"direction": direction, "package_density_kg_per_m3": 1.1 * 450.0})
    sensors, begin_s = without_noise(drum.sensors), drum.declared.run_up_s
    machine = MonitoredMachine("winding_drum", usual, sensors)
    rows = []
    for parameters in (usual, heavy):
        seen = seen_run(drum.entry.build(parameters), sensors, begin_s + 40.0, begin_s=begin_s)
        rows.append(np.array([vector.values for vector in machine.vectors(seen)])[10:-1])
    speed, density, *others = (rows[1] - rows[0]).T
    np.testing.assert_allclose(speed, 0.0, atol=1e-4)
    np.testing.assert_allclose(density, density.mean(), rtol=0.03)
    assert density.mean() == pytest.approx(0.1, rel=0.03)
    for name, other, noise in zip(machine.vectors(seen)[0].names[2:], others, (0.02, 0.03, 4e-5, 3e-5), strict=True):
        assert np.abs(other).max() < 0.2 * noise, name
