# SPDX-License-Identifier: Apache-2.0
"""Loveikin, Pochka, Romasevych, Loveikin 2018: Tables 1 and 2, the motor, the inertia, what the print does not give."""

from functools import cache

import numpy as np
import pytest
from roller_former_cases import machine_for, parameters_for

from mech_twin.machines.roller_former.cart_statics import load_moments
from mech_twin.machines.roller_former.metrics import moment_metrics
from mech_twin.machines.roller_former.parameters import former_of
from mech_twin.machines.roller_former.published import table_1_case, table_2_metrics
from mech_twin.parts.induction_motor import breakdown_slip, motor_constants, motor_torque

CARTS = (1, 2, 3, 4)
# the print, spelled here a second time on purpose: Table 1, largest moment of all carts together (N m)
LARGEST_NM = {1: 734.5, 2: 1186.2, 4: 2011.2}
# Table 2, by carts and damping (N m s/rad): moment per cart (N m), twist (rad), its rate (rad/s), acceleration (rad/s2)
TABLE_2 = {
    (2, 2000.0): (630.0, 0.0059, 0.17, 5.7),
    (3, 2000.0): (776.6, 0.0077, 0.25, 8.1),
    (4, 2000.0): (69.0, 0.00068, 0.029, 1.25),
    (2, 8000.0): (350.0, 0.00315, 0.08, 2.3),
    (3, 8000.0): (386.7, 0.004, 0.127, 4.1),
    (4, 8000.0): (33.0, 0.00033, 0.014, 0.6),
}


@cache
def table_1(carts: int, parameter_set: str = "table") -> dict[str, float]:
    return moment_metrics(former_of(table_1_case(parameters_for(2, {"parameter_set": parameter_set}), carts)))


@cache
def table_2(carts: int, damping: float) -> tuple[float, ...]:
    found = table_2_metrics(parameters_for(2), carts, damping)
    assert found is not None
    return found


@pytest.mark.parametrize("carts", LARGEST_NM)
def test_table_1_largest_moment(carts):
    assert table_1(carts)["moment_max_nm"] == pytest.approx(LARGEST_NM[carts], rel=5e-4)


@pytest.mark.parametrize("carts", CARTS)
def test_table_1_mean_moment(carts):
    assert table_1(carts)["moment_mean_per_cart_nm"] == pytest.approx(452.4, rel=1e-3)


def test_the_printed_largest_moment_of_three_carts_is_that_of_a_crank_a_degree_short():
    """Three even cranks miss the print by 0.62 %; with the third at 239 degrees instead of 240 it is met."""
    assert table_1(3)["moment_max_nm"] / 1475.8 - 1.0 == pytest.approx(-0.00624, abs=1e-5)
    off = {"load": "rectified", "carts.offsets_deg": [0.0, 120.0, 239.0]}
    assert moment_metrics(former_of(parameters_for(3, off)))["moment_max_nm"] == pytest.approx(1475.8, abs=0.05)


def test_the_printed_mean_is_that_of_a_five_degree_grid():
    bank = former_of(parameters_for(1, {"load": "rectified"})).bank
    moments = load_moments(bank, np.radians(np.arange(0.0, 360.0, 5.0)), 1.0)
    assert float(np.mean(moments)) == pytest.approx(452.4, abs=0.05)
    assert table_1(1)["moment_mean_per_cart_nm"] != pytest.approx(452.4, abs=0.05)


@pytest.mark.parametrize(("carts", "damping"), TABLE_2)
def test_table_2(carts, damping):
    tolerance = {2: 0.10, 3: 0.03, 4: 0.03}[carts]
    assert table_2(carts, damping) == pytest.approx(TABLE_2[carts, damping], rel=tolerance)


def test_the_printed_loads_do_not_give_table_1():
    """The print contradicts itself: its loads give a mean of 2037 N m per cart, its table says 452.4."""
    for carts in CARTS:
        assert table_1(carts, "printed")["moment_mean_per_cart_nm"] == pytest.approx(2037.0, abs=0.5)


def test_the_motors_catalogue_data_agree_with_kloss():
    motor = parameters_for(2).motor
    constants, rated_slip = motor_constants(motor), 1.0 - motor.rated_speed_rpm / motor.synchronous_speed_rpm
    slip = breakdown_slip(rated_slip, motor.breakdown_torque_ratio)
    rated_nm = motor.rated_power_w / constants.rated_speed_rad_per_s
    derived = (rated_slip, slip, constants.synchronous_speed_rad_per_s * (1.0 - slip), rated_nm)
    assert derived == pytest.approx((0.025, 0.0933, 94.95, 107.7), rel=1.5e-3)
    assert motor.starting_torque_ratio * rated_nm == pytest.approx(129.24, rel=1.5e-3)


def test_the_one_cage_curve_has_a_third_of_the_catalogues_starting_torque():
    motor = former_of(parameters_for(2)).motor
    assert motor_torque(motor, 0.0, 1.0) == pytest.approx(39.85, abs=5e-3)
    assert motor.starting_torque_nm == pytest.approx(129.24, rel=1e-12)


def test_motors_of_three_and_four_carts_scale_with_the_carts():
    for carts in CARTS:
        motor = former_of(parameters_for(carts)).motor
        assert motor.breakdown_torque_nm == pytest.approx(215.4 * carts / 2.0, rel=1e-12)
        assert motor.breakdown_slip == 0.0933


@pytest.mark.parametrize("carts", CARTS)
def test_reduced_inertias(carts):
    former = former_of(parameters_for(carts))
    assert former.motor_inertia_kg_m2 == pytest.approx(48.385, abs=5e-4)
    assert former.bank.crank_inertia_kg_m2 == pytest.approx(1.28 * carts, rel=1e-12)
    assert former.bank.mass_kg == pytest.approx([229.3333] * carts, abs=5e-5)
    printed = former_of(parameters_for(carts, {"parameter_set": "printed"}))
    assert printed.bank.mass_kg == pytest.approx([1032.0] * carts, rel=1e-12)


def test_the_published_motor_fits_the_table_set_alone():
    assert machine_for(2).report()["power_required_w"] < 11000.0
    printed = machine_for(2, {"parameter_set": "printed"}).report()
    assert printed["power_required_w"] > 40000.0
    assert printed["steady_1"] == 0.0


def test_most_moment_per_cart_is_lowest_for_three_carts_and_the_dynamic_part_for_four():
    most = {carts: moment_metrics(former_of(parameters_for(carts)))["moment_max_per_cart_nm"] for carts in CARTS}
    assert min(most, key=lambda carts: most[carts]) == 3
    for damping in (2000.0, 8000.0):
        dynamic = {carts: table_2(carts, damping)[0] for carts in (2, 3, 4)}
        assert min(dynamic, key=lambda carts: dynamic[carts]) == 4
