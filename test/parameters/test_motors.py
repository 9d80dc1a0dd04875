# SPDX-License-Identifier: Apache-2.0
"""Naming a catalogue motor in a configuration: one line, and no silent contradiction."""

import pytest

from mech_twin.declarations.configuration_tree import ConfigurationError, configuration_tree
from mech_twin.parameters.description import description, description_text
from mech_twin.parameters.load import catalogue_entry, machine_parameters, validated


def test_another_motor_is_one_line():
    motor = machine_parameters("roller_former", overrides={"motor.catalogue_name": "4A160M6U3"}).motor
    assert (motor.rated_power_w, motor.rotor_inertia_kg_m2, motor.rated_torque_nm) == (15000.0, 0.183, None)


def test_a_motor_the_table_does_not_have_is_refused_with_those_it_has():
    with pytest.raises(ConfigurationError, match=r"'4A1': expected one of .*4A160S6U3.*\(motors_4a.yaml\)"):
        machine_parameters("roller_former", overrides={"motor.catalogue_name": "4A1"})


def test_a_value_that_contradicts_the_named_motor_is_refused():
    with pytest.raises(
        ConfigurationError, match=r"key 'motor.rated_power_w', value 9000.0: the named motor 4A160S6U3 has 11000.0"
    ):
        machine_parameters("roller_former", overrides={"motor.rated_power_w": 9000.0})


def test_a_name_replaces_the_whole_data_of_another_motor():
    """So a sweep, a search and a configuration that was written with its data take another motor by its name."""
    named = machine_parameters("roller_former", overrides={"motor.catalogue_name": "4A160M6U3"})
    whole = configuration_tree(machine_parameters("roller_former"))
    renamed = {**whole, "motor": {**whole["motor"], "catalogue_name": "4A160M6U3"}}
    assert validated(catalogue_entry("roller_former"), renamed, "here") == named


PAGE = """
bodies: {wheel: {inertia_kg_m2: 1.0}}
joints: {shaft: {kind: revolute, between: [ground, wheel]}}
drives: {engine: {kind: induction_motor, joint: shaft, motor: {catalogue_name: 4A160M6U3}}}
"""


def test_a_drive_of_a_page_takes_its_motor_from_the_table(tmp_path):
    page = tmp_path / "wheel.yaml"
    page.write_text(PAGE, encoding="utf-8")
    motor = machine_parameters(str(page)).drives["engine"].motor
    assert motor == machine_parameters("roller_former", overrides={"motor.catalogue_name": "4A160M6U3"}).motor
    with pytest.raises(
        ConfigurationError, match=r"key 'drives.engine.motor.rated_power_w', value 9000.0: the named motor 4A160M6U3"
    ):
        machine_parameters(str(page), overrides={"drives.engine.motor.rated_power_w": 9000.0})


def test_a_described_configuration_keeps_the_motors_name_and_data():
    parameters = machine_parameters("roller_former")
    assert description(description_text("roller_former", parameters)).parameters == parameters


def test_the_printed_set_is_one_line_and_given_values_win():
    printed = machine_parameters("roller_former", overrides={"parameter_set": "printed"})
    assert (printed.carts.mass_kg, printed.carts.roller_force_x_n) == (1000.0, 7962.0)
    own = machine_parameters("roller_former", overrides={"parameter_set": "printed", "carts.mass_kg": 900.0})
    assert (own.carts.mass_kg, own.carts.weight_n) == (900.0, 10124.9)
