# SPDX-License-Identifier: Apache-2.0
"""Laws of the induction motor: rated point, breakdown, generating branch, reduced supply, corrected curve."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from parameter_bounds import accepts, live_names
from pydantic import ValidationError

from mech_twin.parts import induction_motor
from mech_twin.parts.induction_motor import (
    InductionMotorParameters,
    breakdown_slip,
    kloss_torque,
    motor_command_slope,
    motor_constants,
    motor_in_step,
    motor_torque,
    motor_torque_slope,
    torque_in_step,
)

BREAKER = {
    "rated_power_w": 1500.0,
    "rated_speed_rpm": 1420.0,
    "synchronous_speed_rpm": 1500.0,
    "breakdown_torque_ratio": 2.2,
    "starting_torque_ratio": 2.0,
    "rotor_inertia_kg_m2": 0.0033,
}
FORMER = {
    "rated_power_w": 11000.0,
    "rated_speed_rpm": 975.0,
    "synchronous_speed_rpm": 1000.0,
    "breakdown_torque_ratio": 2.0,
    "starting_torque_ratio": 1.2,
    "rotor_inertia_kg_m2": 0.138,
}
KLOSS = motor_constants(InductionMotorParameters(**BREAKER))
CORRECTED = motor_constants(InductionMotorParameters(**BREAKER, torque_curve="starting_corrected"))
SINGLE = motor_constants(InductionMotorParameters(**BREAKER, torque_curve="single_phase"))
speeds = st.floats(-400.0, 400.0)
commands = st.floats(0.01, 1.0)


def test_the_breaker_motor_has_the_derived_figures_of_its_name_plate():
    assert KLOSS.rated_torque_nm == pytest.approx(10.087, abs=5e-4)
    assert KLOSS.rated_slip == pytest.approx(0.0533, abs=5e-5)
    assert KLOSS.breakdown_slip == pytest.approx(0.2218, abs=5e-5)
    assert KLOSS.breakdown_torque_nm == pytest.approx(22.19, abs=5e-3)
    assert motor_torque(KLOSS, 0.0, 1.0) / KLOSS.rated_torque_nm == pytest.approx(0.93, abs=5e-3)


def test_the_curve_passes_through_the_rated_point():
    assert motor_torque(KLOSS, KLOSS.rated_speed_rad_per_s, 1.0) == pytest.approx(KLOSS.rated_torque_nm, rel=1e-12)


def test_the_largest_torque_is_at_breakdown_slip():
    assert kloss_torque(KLOSS, KLOSS.breakdown_slip) == pytest.approx(KLOSS.breakdown_torque_nm, rel=1e-15)


@settings(deadline=None)  # the first call compiles
@given(speeds)
def test_no_speed_gives_more_than_the_breakdown_torque(speed):
    for curve in (KLOSS, CORRECTED):
        assert abs(motor_torque(curve, speed, 1.0)) <= curve.breakdown_torque_nm * (1.0 + 1e-15)


def test_torque_is_nought_at_synchronous_speed_and_odd_about_it():
    synchronous = KLOSS.synchronous_speed_rad_per_s
    assert motor_torque(KLOSS, synchronous, 1.0) == 0.0
    assert motor_torque(KLOSS, synchronous + 5.0, 1.0) == pytest.approx(
        -motor_torque(KLOSS, synchronous - 5.0, 1.0), rel=1e-12
    )


@settings(deadline=None)  # the first call compiles
@given(speeds, commands)
def test_reduced_supply_moves_the_curve_along_the_speed_axis(speed, command):
    moved = speed + (1.0 - command) * KLOSS.synchronous_speed_rad_per_s
    assert motor_torque(KLOSS, speed, command) == pytest.approx(motor_torque(KLOSS, moved, 1.0), rel=1e-9, abs=1e-9)


def test_supply_off_gives_no_torque():
    assert motor_torque(KLOSS, 100.0, 0.0) == 0.0


def test_the_corrected_curve_starts_with_the_catalogue_torque_and_keeps_the_working_branch():
    assert motor_torque(CORRECTED, 0.0, 1.0) == pytest.approx(2.0 * CORRECTED.rated_torque_nm, rel=1e-12)
    for slip in (-0.3, 0.0, 0.05, 0.2218):
        speed = (1.0 - slip) * KLOSS.synchronous_speed_rad_per_s
        assert motor_torque(CORRECTED, speed, 1.0) == pytest.approx(motor_torque(KLOSS, speed, 1.0), rel=1e-6)


def test_the_corrected_curve_has_no_kink_at_breakdown():
    synchronous = CORRECTED.synchronous_speed_rad_per_s
    at = (1.0 - CORRECTED.breakdown_slip) * synchronous
    below, above = (motor_torque(CORRECTED, at + side, 1.0) for side in (-1e-4, 1e-4))
    assert abs(above - below) < 1e-6


def test_printed_values_take_the_place_of_derived_ones():
    printed = motor_constants(
        InductionMotorParameters(**FORMER, rated_torque_nm=107.7, breakdown_torque_nm=215.4, breakdown_slip=0.0933)
    )
    assert (printed.rated_torque_nm, printed.breakdown_torque_nm, printed.breakdown_slip) == (107.7, 215.4, 0.0933)
    assert motor_torque(printed, 0.0, 1.0) == pytest.approx(39.85, abs=5e-3)
    assert printed.starting_torque_nm == pytest.approx(129.24, rel=1.5e-3)
    assert breakdown_slip(0.025, 2.0) == pytest.approx(0.0933, rel=1.5e-3)


def test_a_rated_speed_beyond_the_field_is_refused_with_its_numbers():
    with pytest.raises(ValidationError, match=r"rated_speed_rpm < synchronous_speed_rpm needed, got 1520.0 and 1500.0"):
        InductionMotorParameters(**{**BREAKER, "rated_speed_rpm": 1520.0})


def test_a_corrected_curve_above_breakdown_is_refused():
    with pytest.raises(ValidationError, match="starting torque <= breakdown torque"):
        InductionMotorParameters(**{**BREAKER, "starting_torque_ratio": 2.5}, torque_curve="starting_corrected")


@settings(deadline=None)
@given(speeds, commands, st.sampled_from((1.0, -1.0)))
def test_the_slope_is_the_derivative_of_the_torque(speed, command, sign):
    h = 1e-3
    for curve in (KLOSS, CORRECTED, SINGLE):
        at = [motor_torque(curve, speed + i * h, sign * command) for i in (-2, -1, 1, 2)]
        slope = (8.0 * (at[2] - at[1]) - (at[3] - at[0])) / (12.0 * h)
        assert motor_torque_slope(curve, speed, sign * command) == pytest.approx(slope, abs=2e-6)


@settings(deadline=None)
@given(speeds, st.floats(0.05, 1.0))
def test_the_slope_in_the_command_is_that_derivative(speed, command):
    h = 1e-4
    for curve in (KLOSS, CORRECTED, SINGLE):
        at = [motor_torque(curve, speed, command + i * h) for i in (-2, -1, 1, 2)]
        slope = (8.0 * (at[2] - at[1]) - (at[3] - at[0])) / (12.0 * h)
        assert motor_command_slope(curve, speed, command) == pytest.approx(slope, rel=1e-4, abs=1e-2)


def line_currents(slip: float, fraction: float) -> tuple[np.ndarray, float]:
    """Return the currents of the lines a, b, c and the torque (N m) of Kloss's circuit, the line a open.

    Solved from the terminals, not from the sequences in series: u_b - u_c is what is left of a symmetrical supply, no
    current enters at a, and those of b and c leave each other.  X = 1, u = 1 at f = 1; torques are referred to M_max.
    """
    a, resistance = np.exp(2j * np.pi / 3.0), SINGLE.breakdown_slip
    forward = resistance * fraction / slip + 1j * fraction
    backward = resistance * fraction / (2.0 * fraction - slip) + 1j * fraction
    to_lines = np.array([[1.0, 1.0, 1.0], [1.0, a * a, a], [1.0, a, a * a]])  # of zero, positive, negative sequence
    impedance = to_lines @ np.diag([1e9, forward, backward]) @ np.linalg.inv(to_lines)  # no wire to the star point
    equations = np.array([[1.0, 0.0, 0.0], [1.0, 1.0, 1.0], impedance[1] - impedance[2]])
    currents = np.linalg.solve(equations, [0.0, 0.0, fraction * (a * a - a)])
    _, positive, negative = np.linalg.inv(to_lines) @ currents
    left = abs(positive) ** 2 * resistance / slip - abs(negative) ** 2 * resistance / (2.0 * fraction - slip)
    return currents, 2.0 * SINGLE.breakdown_torque_nm * float(left)


@pytest.mark.parametrize("fraction", [1.0, 0.8])
@pytest.mark.parametrize("share", [-0.9, -0.3, 0.2, 0.7, 0.95, 1.2])
def test_with_a_line_open_the_torque_is_that_of_the_circuit_of_both_sequences(share, fraction):
    currents, torque = line_currents(fraction - share, fraction)
    assert abs(currents[0]) == pytest.approx(0.0, abs=1e-9)
    assert currents[1] == pytest.approx(-currents[2], rel=1e-6)
    speed = share * SINGLE.synchronous_speed_rad_per_s
    assert motor_torque(SINGLE, speed, fraction) == pytest.approx(torque, rel=1e-6)


def test_the_same_circuit_with_all_lines_has_the_torque_of_kloss():
    for slip in (-0.3, 0.05, 0.2, 1.0):
        square = 1.0 / abs(KLOSS.breakdown_slip / slip + 1j) ** 2
        torque = 2.0 * KLOSS.breakdown_torque_nm * square * KLOSS.breakdown_slip / slip
        assert kloss_torque(KLOSS, slip) == pytest.approx(torque, rel=1e-12)


def test_with_a_line_open_a_motor_at_rest_stays_there_and_one_that_turns_loses_half_its_largest_torque():
    synchronous = SINGLE.synchronous_speed_rad_per_s
    assert motor_torque(SINGLE, 0.0, 1.0) == 0.0
    largest = max(motor_torque(SINGLE, share * synchronous, 1.0) for share in np.linspace(0.0, 1.0, 1001))
    assert 0.4 * SINGLE.breakdown_torque_nm < largest < 0.5 * SINGLE.breakdown_torque_nm
    both = [motor_torque_slope(curve, synchronous, 1.0) for curve in (SINGLE, KLOSS)]
    assert both[0] == pytest.approx(both[1], rel=1e-12)


@settings(deadline=None)
@given(speeds, commands)
def test_swapped_phases_turn_the_curve_round(speed, command):
    for curve in (KLOSS, CORRECTED, SINGLE):
        assert motor_torque(curve, speed, -command) == -motor_torque(curve, -speed, command)


def test_the_torque_has_one_sign_on_either_side_of_synchronous_speed():
    synchronous = KLOSS.synchronous_speed_rad_per_s
    for curve in (KLOSS, CORRECTED):
        for share in (-0.5, 0.0, 0.3, 0.9):
            assert motor_torque(curve, share * synchronous, 1.0) > 0.0
        assert motor_torque(curve, 1.1 * synchronous, 1.0) < 0.0


def test_between_breakdown_and_standstill_the_correction_grows_from_none_to_all_and_stays():
    """Beyond standstill (turning against the field) the correction is the whole of what misses at standstill."""
    synchronous, s_kr = CORRECTED.synchronous_speed_rad_per_s, CORRECTED.breakdown_slip

    def added(slip):
        speed = (1.0 - slip) * synchronous
        return motor_torque(CORRECTED, speed, 1.0) - motor_torque(KLOSS, speed, 1.0)

    whole = added(1.0)
    assert whole == pytest.approx(2.0 * CORRECTED.rated_torque_nm - kloss_torque(KLOSS, 1.0), rel=1e-12)
    assert added(s_kr) == pytest.approx(0.0, abs=1e-12)
    assert added(0.5 * (1.0 + s_kr)) == pytest.approx(0.5 * whole, rel=1e-12)
    assert added(1.5) == pytest.approx(whole, rel=1e-12)
    shares = [added(s_kr + share * (1.0 - s_kr)) for share in (0.1, 0.3, 0.6, 0.9)]
    assert shares == sorted(shares)


def test_supply_off_has_no_slope():
    assert motor_torque_slope(KLOSS, 100.0, 0.0) == 0.0


def test_a_name_plate_has_sizes_above_zero():
    for key, smallest in (
        ("rated_power_w", 1e-6),
        ("starting_torque_ratio", 1e-9),
        ("rotor_inertia_kg_m2", 1e-12),
    ):
        assert accepts(InductionMotorParameters, BREAKER, key, 1.0)
        assert not accepts(InductionMotorParameters, BREAKER, key, math.nextafter(smallest, 0.0))
    for key in ("rated_speed_rpm", "synchronous_speed_rpm"):
        assert not accepts(InductionMotorParameters, BREAKER, key, 0.0)
    slow = InductionMotorParameters(**{**BREAKER, "rated_speed_rpm": 1.9, "synchronous_speed_rpm": 2.0})
    assert motor_constants(slow).rated_slip == pytest.approx(0.05, rel=1e-12)
    assert not accepts(InductionMotorParameters, BREAKER, "breakdown_torque_ratio", 1.0)
    assert accepts(InductionMotorParameters, BREAKER, "breakdown_torque_ratio", 1.001)
    assert not accepts(InductionMotorParameters, BREAKER, "breakdown_torque_ratio", 20.1)
    assert not accepts(InductionMotorParameters, BREAKER, "breakdown_slip", 0.0)
    assert not accepts(InductionMotorParameters, BREAKER, "breakdown_slip", 1.0)
    steep = {**BREAKER, "rated_speed_rpm": 1125.0, "breakdown_torque_ratio": 2.0}  # 0.933 from the name plate
    assert accepts(InductionMotorParameters, steep, "breakdown_slip", 0.999)
    assert live_names(InductionMotorParameters) == set()
    assert InductionMotorParameters(**BREAKER).torque_curve == "kloss"


def test_a_synchronous_rated_speed_is_refused():
    with pytest.raises(ValidationError, match=r"rated_speed_rpm < synchronous_speed_rpm needed, got 1500.0 and 1500.0"):
        InductionMotorParameters(**{**BREAKER, "rated_speed_rpm": 1500.0})


@pytest.mark.parametrize("slip", [0.05, 80.0 / 1500.0])
def test_a_breakdown_slip_at_or_below_the_rated_one_is_refused(slip):
    with pytest.raises(ValidationError, match="rated slip < breakdown slip < 1 needed"):
        InductionMotorParameters(**BREAKER, breakdown_slip=slip)


def test_a_derived_breakdown_slip_of_1_or_more_is_refused():
    with pytest.raises(ValidationError, match=r"rated slip < breakdown slip < 1 needed, got 0.3 and 1.248"):
        InductionMotorParameters(**{**BREAKER, "rated_speed_rpm": 1050.0})


def test_a_starting_torque_equal_to_the_breakdown_torque_is_allowed():
    equal = {**BREAKER, "starting_torque_ratio": BREAKER["breakdown_torque_ratio"]}
    assert (
        motor_constants(InductionMotorParameters(**equal, torque_curve="starting_corrected")).curve
        == induction_motor.CORRECTED
    )


def test_a_printed_value_is_a_rounding_of_what_follows_from_the_name_plate():
    """Torque of power and speed, breakdown torque of the ratio, breakdown slip through the rated point."""
    torque = BREAKER["rated_power_w"] / (BREAKER["rated_speed_rpm"] * math.pi / 30.0)
    largest = BREAKER["breakdown_torque_ratio"] * torque
    slip = breakdown_slip(1.0 - BREAKER["rated_speed_rpm"] / BREAKER["synchronous_speed_rpm"], 2.2)
    for key, value, within in (
        ("rated_torque_nm", torque, 1.25),
        ("breakdown_torque_nm", largest, 1.25),
        ("breakdown_slip", slip, 2.0),
    ):
        for factor in (0.999 * within, 1.001 / within):
            InductionMotorParameters(**{**BREAKER, key: factor * value})
        for factor in (1.001 * within, 0.999 / within):
            with pytest.raises(ValidationError, match=f"{key} must be within a factor of {within:g}"):
                InductionMotorParameters(**{**BREAKER, key: factor * value})


def test_a_rated_slip_is_that_of_a_motor():
    with pytest.raises(ValidationError, match=r"rated slip 0.0001 to 0.5 needed, got 5e-05"):
        InductionMotorParameters(**{**BREAKER, "rated_speed_rpm": 1499.925})
    with pytest.raises(ValidationError, match=r"rated slip 0.0001 to 0.5 needed, got 0.6"):
        InductionMotorParameters(**{**BREAKER, "rated_speed_rpm": 600.0})


def test_a_motor_in_a_step_follows_its_curve_from_the_torque_it_told():
    """Its own curve moves what another motor tells; a supply that rises adds its share; one without supply is held."""
    own = motor_in_step(KLOSS, 0.9, 70.0, motor_torque(KLOSS, 70.0, 0.9), 0.9, 1e-3)
    assert own.offset_nm == 0.0
    assert torque_in_step(own, 5e-4, 95.0) == motor_torque(KLOSS, 95.0, 0.9)
    rising = motor_in_step(KLOSS, 0.899, 70.0, motor_torque(KLOSS, 70.0, 0.9), 0.9, 1e-3)
    for t, command in ((0.0, 0.899), (1e-3, 0.9)):
        assert torque_in_step(rising, t, 70.0) == pytest.approx(motor_torque(KLOSS, 70.0, command), rel=1e-12)
    other = motor_in_step(KLOSS, 0.9, 70.0, 3.0, 0.9, 1e-3)
    assert torque_in_step(other, 5e-4, 70.0) == pytest.approx(3.0, abs=1e-12)
    moved = motor_torque(KLOSS, 95.0, 0.9) - motor_torque(KLOSS, 70.0, 0.9)
    assert torque_in_step(other, 0.0, 95.0) == pytest.approx(3.0 + moved, abs=1e-12)
    assert torque_in_step(motor_in_step(KLOSS, 0.0, 70.0, 5.0, 0.0, 1e-3), 1e-3, 95.0) == 5.0
