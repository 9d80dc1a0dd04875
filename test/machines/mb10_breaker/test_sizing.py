# SPDX-License-Identifier: Apache-2.0
"""Spring and preload: seated means one thing, the choice holds over its tolerances, a little less does not."""

import pytest
from machines.mb10_breaker.pressed_body_cases import walked_cycle

from mech_twin.capabilities.variation import inner_points, scaled
from mech_twin.errors import StudyError
from mech_twin.machines.mb10_breaker import sizing
from mech_twin.machines.mb10_breaker.metrics import SEATED_GAP_M, SEATED_REST, is_seated
from mech_twin.machines.mb10_breaker.pressed_body.parameters import pressed_body
from mech_twin.machines.mb10_breaker.sizing import LIMITS, Seating, seating, seats, settled_run_metrics, with_rest_force
from mech_twin.parameters.load import configuration_file, machine_parameters
from mech_twin.studies import size

HALF_SINE = {"excitation.kind": "approximated", "body.inertia_kg_m2": 0.35}
TOLERANCE = 0.05


def half_sine():
    return machine_parameters("mb10_breaker", None, HALF_SINE)


def gap_of(parameters):
    return walked_cycle(pressed_body(parameters.body, parameters.excitation), 20).gap_at_blow_m


@pytest.fixture(scope="module")
def chosen():
    return size("mb10_breaker", half_sine())


@pytest.mark.slow
def test_the_spring_under_the_half_sine_lies_in_the_rational_range(chosen):
    metrics = chosen.metrics
    assert chosen.tolerance == TOLERANCE  # the usual one
    assert metrics["rational_from_rest_force_n"] <= metrics["rest_force_n"] <= 300.0
    assert metrics["gap_at_blow_m"] <= SEATED_GAP_M
    assert "gap_at_blow_m" in chosen.binding


@pytest.mark.slow
def test_the_half_sine_s_choice_holds_at_points_the_search_did_not_see(chosen):
    for factors in inner_points(sizing.ASSUMED["approximated"], TOLERANCE, 200, seed=99):
        assert gap_of(scaled(chosen.parameters, factors)) <= SEATED_GAP_M


@pytest.mark.slow
def test_the_nominal_edge_has_no_margin(chosen):
    edge = size("mb10_breaker", half_sine(), tolerance=0.0)
    assert edge.metrics["rest_force_n"] == chosen.metrics["nominal_edge_rest_force_n"] < chosen.metrics["rest_force_n"]
    assert gap_of(edge.parameters) <= SEATED_GAP_M
    assert any(
        gap_of(scaled(edge.parameters, {key: factor})) > SEATED_GAP_M
        for key in sizing.ASSUMED["approximated"]
        for factor in (0.95, 1.05)
    )


@pytest.mark.slow
def test_the_gentlest_return_is_where_the_body_never_lifts():
    gentle = size("mb10_breaker", half_sine(), objective="return_speed_m_per_s", tolerance=0.0)
    assert gentle.metrics["rest_force_n"] == pytest.approx(300.0)


@pytest.mark.slow
def test_limits_that_cannot_be_met_are_named():
    with pytest.raises(StudyError, match="largest_force_n <= 10 "):
        size("mb10_breaker", half_sine(), limits={"largest_force_n": 10.0})


def test_without_a_collar_nothing_seats_the_tool():
    with pytest.raises(StudyError, match=r"body\.contact is none; expected one_sided"):
        size("mb10_breaker", machine_parameters("mb10_breaker", None, HALF_SINE | {"body.contact": "none"}))


def test_seated_means_one_thing_everywhere():
    """At most 0.02 mm off the collar at the blow, and at rest on it for a twentieth of the cycle before."""
    rest = 1.0 - SEATED_REST
    assert LIMITS["gap_at_blow_m"] == SEATED_GAP_M
    assert LIMITS["flight_share"] == rest
    for gap_m, flight in ((SEATED_GAP_M, rest), (1.01 * SEATED_GAP_M, rest), (SEATED_GAP_M, 0.96), (0.0, 1.0)):
        assert seats(Seating(80, 0, gap_m, flight, 0.1, 600.0)) == is_seated(gap_m, 1.0 - flight), (gap_m, flight)
    assert not seats(Seating(80, 1, 0.0, 0.5, 0.1, 600.0))
    assert not seats(Seating(0, 0, 0.0, 0.0, 0.0, 600.0))


@pytest.mark.slow
@pytest.mark.parametrize("force_n", [480.0, 520.0, 560.0])
def test_a_run_counts_unseated_what_sizing_calls_so(force_n):
    """At 520 N the body has just come to rest when the striker comes: no gap, and no margin either."""
    parameters = with_rest_force(machine_parameters("mb10_breaker"), force_n)
    alone, whole = seating(parameters), settled_run_metrics(parameters)
    assert seats(alone) == (whole["unseated_blows"] == 0.0) == (force_n == 560.0)
    assert alone.gap_at_blow_m > 0.0 or whole["off_collar_blows"] == 0.0


def test_motor_and_linkage_alone_seat_as_the_whole_machine_does():
    parameters = with_rest_force(machine_parameters("mb10_breaker"), 741.0)
    alone, whole = seating(parameters, 4.0), settled_run_metrics(parameters, 4.0)
    assert alone.blows == whole["blows"]
    assert alone.missed == whole["missed_blows"]
    assert alone.gap_at_blow_m == pytest.approx(whole["run_largest_gap_at_blow_m"], abs=1e-7)
    assert alone.flight_share == pytest.approx(1.0 - whole["steady_contact_share"], abs=1e-3)
    assert alone.return_speed_m_per_s == pytest.approx(whole["steady_largest_return_speed_m_per_s"], rel=1e-3)
    assert alone.largest_force_n == pytest.approx(whole["steady_largest_spring_force_n"], rel=1e-3)


def test_the_nominal_edge_of_the_running_machine_has_no_margin():
    """545 N seats the machine as configured; with tool, body and restitution 5 % off it does not."""
    edge = with_rest_force(machine_parameters("mb10_breaker"), 545.0)
    off = scaled(edge, {"body.restitution": 1.05, "tool.mass_kg": 1.05, "body.inertia_kg_m2": 1.05})
    assert seats(seating(edge))
    assert not seats(seating(off))


@pytest.mark.slow
def test_a_limit_between_the_forces_tried_first_is_used_up():
    found = size("mb10_breaker", objective="flight_share", limits={"largest_force_n": 900.0}, tolerance=0.0)
    assert 895.0 < found.metrics["largest_force_n"] <= 900.0
    assert found.binding.startswith("largest_force_n <= 900")


@pytest.mark.slow
def test_no_preload_beside_the_gentlest_is_gentler():
    found = size("mb10_breaker", objective="return_speed_m_per_s", tolerance=0.0)
    for beside_n in (-20.0, 20.0):
        other = seating(with_rest_force(found.parameters, found.metrics["rest_force_n"] + beside_n))
        assert other.return_speed_m_per_s >= found.metrics["return_speed_m_per_s"]


@pytest.mark.slow
def test_on_crust_over_rock_every_blow_is_seated_and_the_feed_is_that_of_rock():
    """As `config/breaker_on_crust.yaml` says; the preload of the yielding wall does not hold that machine."""
    parameters = machine_parameters("mb10_breaker", configuration_file("breaker_on_crust"))
    found = settled_run_metrics(parameters, 4.0)
    assert found["blows"] > 30.0
    assert found["missed_blows"] == found["unseated_blows"] == found["stalled"] == 0.0
    assert 1e-3 < found["steady_feed_per_blow_m"] < 5e-3
    assert found["steady_motor_rms_torque_over_rated"] < 1.0
    weak = settled_run_metrics(with_rest_force(parameters, 741.0), 4.0)
    assert weak["missed_blows"] > weak["blows"]


@pytest.mark.slow
@pytest.mark.timeout(1200)
def test_the_running_breaker_is_seated_over_the_whole_box():
    found = size("mb10_breaker")
    assert found.tolerance == TOLERANCE
    assert found.metrics["nominal_edge_rest_force_n"] == pytest.approx(540.0, abs=3.0)
    assert found.metrics["rest_force_n"] >= found.metrics["nominal_edge_rest_force_n"] + 20.0
    assert found.metrics["flight_share"] <= 1.0 - SEATED_REST
    assert "in the worst case" in found.binding
    for factors in inner_points(sizing.ASSUMED["from_forces"], TOLERANCE, 12, seed=99):
        assert seats(seating(scaled(found.parameters, factors)))
    assert next(row for row in found.trade_off if row["rest_force_n"] == 500.0)["seated"] == "no"
