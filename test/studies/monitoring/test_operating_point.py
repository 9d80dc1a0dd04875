# SPDX-License-Identifier: Apache-2.0
"""A healthy machine at another operating point: told as that, with its size; faults are seen all the same."""

from __future__ import annotations

import json
from collections.abc import Mapping
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from mech_twin.capabilities.cycle import TURN
from mech_twin.capabilities.operating_point import motor_changes
from mech_twin.capabilities.variation import varied
from mech_twin.files.plain_values import plain
from mech_twin.measurements.measurement_map import read_map
from mech_twin.parameters.load import machine_parameters
from mech_twin.parts.induction_motor import motor_constants, motor_torque
from mech_twin.results.opened_runs import columns_of
from mech_twin.studies.monitoring.design import fitted_setup, simulated_vectors
from mech_twin.studies.monitoring.findings import Findings
from mech_twin.studies.monitoring.monitor import Monitor, MonitorSetup
from mech_twin.studies.monitoring.operating import (
    OperatingSurface,
    SurfaceVariable,
    chosen_variables,
    polynomial_terms,
    term_values,
)
from mech_twin.studies.monitoring.operating_fit import operated_run, parameters_at
from mech_twin.studies.monitoring.operating_track import OperatingTrack
from mech_twin.studies.monitoring.sensing import MonitoredMachine, seen_roll_out, seen_run
from mech_twin.studies.monitoring.setup_record import SetupRecord

SENSORS = Path(__file__).resolve().parents[3] / "benchmarks" / "monitoring" / "sensors"
Q, D = 2, 5
CYCLES = {"winding_drum": 90}  # then its package is empty


def surface() -> OperatingSurface:
    """Return a curved surface of two variables over five features."""
    random = np.random.default_rng(3)
    terms = polynomial_terms(Q)
    coefficients = random.standard_normal((len(terms), D)) * np.where(terms.sum(axis=1) == 1, 50.0, 3.0)[:, None]
    nothing = np.zeros(D - Q)
    return OperatingSurface(
        tuple("abcde"), ("supply", "load"), ("supply_sag", "overload"), (0, 3), np.array([0.05, 0.1]),
        np.arange(D) + 1.0, np.eye(D), coefficients, nothing, nothing, np.full(Q, 0.01), np.full(Q, 0.1),
        np.ones((Q, D - Q)), 3,
    )  # fmt: skip


def test_slopes_of_the_polynomial_are_its_differences() -> None:
    terms, u, small = polynomial_terms(3), np.array([0.3, -0.7, 1.1]), 1e-6
    slopes = term_values(terms, u)[1]
    for k, step in enumerate(small * np.eye(3)):
        differences = (term_values(terms, u + step)[0] - term_values(terms, u - step)[0]) / (2.0 * small)
        np.testing.assert_allclose(slopes[k], differences, atol=1e-8)


@pytest.mark.parametrize("u", [(0.0, 0.0), (0.9, -0.4), (-1.0, 1.0)])
def test_nothing_is_left_of_a_healthy_machine_at_another_point_and_the_point_is_found(u: tuple[float, float]) -> None:
    known = surface()
    left, point = known.rest(known.mean + known.response(np.array(u))[0])
    np.testing.assert_allclose(point, u, atol=2e-3)  # the prior pulls by a share of 1/50^2
    np.testing.assert_allclose(left, 0.0, atol=1e-2)
    np.testing.assert_allclose(known.annihilator(point) @ known.response(point)[1], 0.0, atol=1e-9)


def test_variables_that_do_the_same_are_one_group_and_what_is_not_seen_is_left_out() -> None:
    declared = [
        SurfaceVariable("voltage", "v", 0.05),
        SurfaceVariable("resistance", "r", 0.2),
        SurfaceVariable("wall", "w", 0.1),
    ]
    effects = np.array([[3.0, -6.0, 0.0], [1.0, -2.0, 0.0], [0.0, 0.01, 0.01]])
    kept, groups, rest = chosen_variables(declared, effects, np.eye(3))
    assert kept == [0]
    assert [group.name for group in groups] == ["voltage or resistance"]
    assert groups[0].range == pytest.approx(0.05 * (1.0 + 1.0 / 3.0))
    np.testing.assert_allclose(rest, 0.0, atol=1e-12)


def test_while_the_point_moves_the_charts_allow_for_the_transient() -> None:
    track = OperatingTrack(surface())
    for _ in range(60):
        still = track.advance(np.zeros(Q))
    np.testing.assert_array_equal(still, 0.0)
    moving = track.advance(np.array([0.4, 0.0]))
    np.testing.assert_allclose(moving, 0.4)
    for _ in range(60):
        settled = track.advance(np.array([0.4, 0.0]))
    np.testing.assert_array_equal(settled, 0.0)
    (value,) = track.changed()
    assert (value.name, value.share) == ("supply", pytest.approx(0.02))
    assert not value.is_outside


@cache
def commissioned(name: str) -> tuple[MonitoredMachine, MonitorSetup]:
    """Return a machine and its monitor, kept and read again, as a day later."""
    machine = MonitoredMachine(name, machine_parameters(name), read_map(SENSORS / f"{name}.yaml", columns_of))
    setup = fitted_setup(machine, simulated_vectors(machine, CYCLES.get(name, 400), 1), 24.0)
    return machine, SetupRecord.model_validate_json(json.dumps(plain(setup))).setup()


def another_day(name: str, point: Mapping[str, float], fault: Mapping[str, float] | None = None) -> list[Findings]:
    """Return what the monitor says of cycles at another operating point."""
    machine, setup = commissioned(name)
    variables = [variable for variable in machine.operating if variable.name in point]
    parameters = parameters_at(machine.parameters, variables, [point[variable.name] for variable in variables])
    assert parameters is not None
    begin_s, monitor = machine.declared.run_up_s, Monitor(setup)
    seen = seen_run(
        machine.entry.build(varied(parameters, fault or {})), machine.sensors,
        begin_s + min(CYCLES.get(name, 200), 200) * setup.baseline.period_s,
        random=np.random.default_rng(5), begin_s=begin_s,
    )  # fmt: skip
    return [monitor.observe(vector) for vector in machine.vectors(seen)]


@pytest.mark.slow
@pytest.mark.parametrize("name", ["mb10_breaker", "vibration_crank"])
@pytest.mark.parametrize("share", [-0.05, -0.02, 0.02, 0.05])
def test_mains_off_by_a_little_are_an_operating_point_and_no_fault(name: str, share: float) -> None:
    told = another_day(name, {"supply_frequency": share})
    assert not any(found.faults for found in told)
    assert {found.verdict for found in told[-50:]} == {"operating_point"}
    (value,) = (value for value in told[-1].operating if value.name == "supply_frequency")
    assert value.share == pytest.approx(share, abs=5e-4)
    assert value.low_95 <= value.share <= value.high_95


@pytest.mark.timeout(900)  # the first of a machine commissions it
@pytest.mark.slow
@pytest.mark.parametrize("share", [-0.9, 0.9])
@pytest.mark.parametrize(
    ("name", "variable"),
    [
        ("compaction_press", "supply_frequency"), ("compaction_press", "layer"),
        ("roller_former", "supply_frequency"), ("roller_former", "mix"),
        ("winding_drum", "yarn_weight"),
    ],
)  # fmt: skip
def test_each_machine_is_healthy_anywhere_in_its_ranges_and_the_variable_is_told(
    name: str, variable: str, share: float
) -> None:
    machine, _ = commissioned(name)
    (declared,) = (each for each in machine.operating if each.name == variable)
    told = another_day(name, {variable: share * declared.range})
    assert not any(found.faults for found in told)
    assert "operating_point" in {found.verdict for found in told[-50:]}
    (value,) = (value for value in told[-1].operating if variable in value.name.split(" or "))
    assert value.share == pytest.approx(share * declared.range, abs=0.35 * declared.range)


@pytest.mark.slow
def test_a_drift_of_the_yarns_speed_acts_on_the_torque_by_no_more_than_the_charts_allow() -> None:
    machine, setup = commissioned("winding_drum")
    step_s = machine.entry.build(machine.parameters).coupling_step_s
    at_s = np.arange(0.0, machine.declared.run_up_s + 40.0, 0.2)
    steps = round(at_s[-1] / step_s)
    means = []
    for swing in (0.0, 0.05):  # a sine of ten minutes, at its steepest
        shares = np.stack([swing * np.sin(TURN * at_s / 600.0), 0.0 * at_s], axis=1)
        run = operated_run(machine, machine.operating, at_s, shares, np.ones(steps + 1))
        seen = seen_roll_out(run, machine.sensors, step_s, np.random.default_rng(4), machine.declared.run_up_s)
        assert setup.operating is not None
        means.append(np.nanmean([setup.operating.reduced(v)[0].values for v in machine.vectors(seen)], axis=0))
    moved, spread = np.abs(means[1] - means[0]), np.sqrt(np.diag(setup.baseline.covariance))
    assert moved[0] > 0.4 * spread[0]
    assert (moved < 1.3 * setup.operating.drift + 0.3 * spread).all()


def test_a_motor_at_another_supply_has_the_torque_that_the_supply_gives_at_every_speed() -> None:
    parameters = machine_parameters("roller_former")
    healthy = motor_constants(parameters.motor)
    other = motor_constants(varied(parameters, motor_changes(parameters, torque=0.9, slip=1.2, field=0.95)).motor)
    for slip in np.linspace(-0.2, 0.8, 11) * healthy.synchronous_speed_rad_per_s:
        later = motor_torque(other, other.synchronous_speed_rad_per_s - 1.2 * slip, 1.0)
        before = motor_torque(healthy, healthy.synchronous_speed_rad_per_s - slip, 1.0)
        assert later == pytest.approx(0.9 * before, rel=1e-12)


@pytest.mark.slow
@pytest.mark.parametrize("share", [-0.1, 0.1])
def test_a_load_within_its_range_is_no_fault_and_beyond_it_is(share: float) -> None:
    within = another_day("vibration_crank", {"boom_load": share})
    assert not any(found.faults for found in within)
    (value,) = within[-1].operating
    assert (value.name, value.share) == ("boom_load", pytest.approx(share, abs=2e-3))
    beyond = another_day("vibration_crank", {"boom_load": 2.0 * share})
    assert beyond[-1].finding == "boom_load"
    (named,) = beyond[-1].candidates
    assert min(abs(named.low_95), abs(named.high_95)) > 0.1


@pytest.mark.slow
@pytest.mark.parametrize("share", [0.0, 0.02])
def test_a_fault_is_named_and_sized_at_another_operating_point_too(share: float) -> None:
    told = another_day("mb10_breaker", {"supply_frequency": share}, {"body.spring_rate_n_per_m": 0.8 * 53300.0})
    spring = next(candidate for candidate in told[-1].candidates if candidate.name == "spring_soft")
    assert spring.low_95 <= -0.2 <= spring.high_95 or spring.size == pytest.approx(-0.2, abs=0.02)
    assert {candidate.name for candidate in told[-1].candidates} <= {"spring_soft", "preload_lost"}
