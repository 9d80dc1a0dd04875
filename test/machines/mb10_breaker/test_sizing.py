# SPDX-License-Identifier: Apache-2.0
"""Spring and preload: seated means one thing, the choice holds over its tolerances, a little less does not."""

import pytest

from mech_twin.capabilities.errors import StudyError
from mech_twin.capabilities.tolerance_box import inner_points, scaled
from mech_twin.machines.mb10_breaker import half_sine_sizing, running_sizing
from mech_twin.machines.mb10_breaker.pressed_body.metrics import SEATED_GAP_M, steady_metrics
from mech_twin.machines.mb10_breaker.pressed_body.parameters import pressed_body
from mech_twin.machines.mb10_breaker.running_sizing import seats
from mech_twin.machines.mb10_breaker.settled_run import Seating, seating, settled_run_metrics, with_rest_force
from mech_twin.machines.mb10_breaker.sizing import LIMITS
from mech_twin.parameters.load import machine_parameters
from mech_twin.studies import size

HALF_SINE = {"excitation.kind": "approximated", "body.inertia_kg_m2": 0.35}
TOLERANCE = 0.05


def half_sine():
    return machine_parameters("mb10_breaker", None, HALF_SINE)


def gap_of(parameters):
    return steady_metrics(pressed_body(parameters.body, parameters.excitation)).metrics.gap_at_blow_m


@pytest.fixture(scope="module")
def chosen():
    return size("mb10_breaker", half_sine())


def test_the_spring_under_the_half_sine_lies_in_the_rational_range(chosen):
    metrics = chosen.metrics
    assert chosen.tolerance == TOLERANCE  # the usual one
    assert metrics["rational_from_ratio"] <= metrics["preload_ratio"] <= 1.0
    assert metrics["gap_at_blow_m"] <= SEATED_GAP_M
    assert "gap_at_blow_m" in chosen.binding


def test_the_half_sine_s_choice_holds_at_points_the_search_did_not_see(chosen):
    for factors in inner_points(half_sine_sizing.ASSUMED, TOLERANCE, 200, seed=99):
        assert gap_of(scaled(chosen.parameters, factors)) <= SEATED_GAP_M


def test_the_nominal_edge_has_no_margin(chosen):
    edge = size("mb10_breaker", half_sine(), tolerance=0.0)
    assert edge.metrics["preload_ratio"] == chosen.metrics["nominal_edge_ratio"] < chosen.metrics["preload_ratio"]
    assert gap_of(edge.parameters) <= SEATED_GAP_M
    assert any(
        gap_of(scaled(edge.parameters, {key: factor})) > SEATED_GAP_M
        for key in half_sine_sizing.ASSUMED
        for factor in (0.95, 1.05)
    )


def test_the_gentlest_return_is_where_the_body_never_lifts():
    gentle = size("mb10_breaker", half_sine(), objective="return_speed_m_per_s", tolerance=0.0)
    assert gentle.metrics["preload_ratio"] == pytest.approx(1.0)


def test_limits_that_cannot_be_met_are_named():
    with pytest.raises(StudyError, match="largest_force_n <= 10 "):
        size("mb10_breaker", half_sine(), limits={"largest_force_n": 10.0})


def test_seated_is_the_same_gap_in_both_excitations():
    assert LIMITS["gap_at_blow_m"] == SEATED_GAP_M
    assert seats(Seating(80, 0, SEATED_GAP_M, 0.1, 600.0), SEATED_GAP_M)
    assert not seats(Seating(80, 0, 1.01 * SEATED_GAP_M, 0.1, 600.0), SEATED_GAP_M)
    assert not seats(Seating(80, 1, 0.0, 0.1, 600.0), SEATED_GAP_M)
    assert not seats(Seating(0, 0, 0.0, 0.0, 600.0), SEATED_GAP_M)


def test_motor_and_linkage_alone_seat_as_the_whole_machine_does():
    parameters = with_rest_force(machine_parameters("mb10_breaker"), 741.0)
    alone, whole = seating(parameters, 4.0), settled_run_metrics(parameters, 4.0)
    assert alone.blows == whole["blows"]
    assert alone.missed == whole["missed_blows"]
    assert alone.gap_at_blow_m == pytest.approx(whole["run_largest_gap_at_blow_m"], abs=1e-7)
    assert alone.return_speed_m_per_s == pytest.approx(whole["steady_largest_return_speed_m_per_s"], rel=1e-3)
    assert alone.largest_force_n == pytest.approx(whole["steady_largest_spring_force_n"], rel=1e-3)


def test_the_nominal_edge_of_the_running_machine_has_no_margin():
    """508 N, once the answer, seats the machine as configured; with tool, body and restitution 5 % off it does not."""
    edge = with_rest_force(machine_parameters("mb10_breaker"), 508.0)
    off = scaled(edge, {"body.restitution": 1.05, "tool.mass_kg": 1.05, "body.inertia_kg_m2": 1.05})
    assert seating(edge).gap_at_blow_m == 0.0
    assert not seats(seating(off), SEATED_GAP_M)


@pytest.mark.slow
@pytest.mark.timeout(1200)
def test_the_running_breaker_is_seated_over_the_whole_box():
    found = size("mb10_breaker")
    assert found.tolerance == TOLERANCE
    assert found.metrics["nominal_edge_rest_force_n"] == pytest.approx(502.0, abs=3.0)
    assert found.metrics["rest_force_n"] >= found.metrics["nominal_edge_rest_force_n"] + 20.0
    assert "in the worst case" in found.binding
    for factors in inner_points(running_sizing.ASSUMED, TOLERANCE, 12, seed=99):
        assert seats(seating(scaled(found.parameters, factors)), SEATED_GAP_M)
    assert next(row for row in found.trade_off if row["rest_force_n"] == 500.0)["seated"] == "no"
