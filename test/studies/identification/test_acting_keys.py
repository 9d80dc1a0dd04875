# SPDX-License-Identifier: Apache-2.0
"""A free key acts on the machine, or is refused in one line: what the machine fills in from it follows."""

from __future__ import annotations

import pickle
from typing import Any

import numpy as np
import pytest
from rollout_cases import CASES, IDS

from mech_twin import rollout
from mech_twin.declarations.configuration_tree import (
    ConfigurationError,
    configuration_tree,
    merged_tree,
    tree_from_flat,
)
from mech_twin.engine.compiled_machine import compiled_machine
from mech_twin.machines.catalog import CATALOGUE
from mech_twin.parameters.load import machine_parameters, validated
from mech_twin.roles import Machine
from mech_twin.studies.identification.keyed_configuration import (
    KeyedConfiguration,
    assumed_keys,
    machine_keys,
    numbers_of,
)
from mech_twin.studies.identification.verdicts import sensitivity


def test_a_load_set_fills_the_carts_anew_when_one_of_its_numbers_changes() -> None:
    base = machine_parameters("roller_former")
    keyed = KeyedConfiguration("roller_former", base, ("load_sets.table.weight_n",))
    moved = keyed.parameters([2000.0])
    assert moved.carts.weight_n == 2000.0  # type: ignore[attr-defined]
    assert moved.carts.mass_kg == base.carts.mass_kg  # type: ignore[attr-defined]
    assert keyed.parameters(keyed.values()) == base


def test_a_number_of_a_catalogue_motor_is_refused_with_the_reason() -> None:
    base = machine_parameters("roller_former")
    with pytest.raises(ConfigurationError, match=r"motor\.rotor_inertia_kg_m2: the machine accepts no other value.*4A"):
        KeyedConfiguration("roller_former", base, ("motor.rotor_inertia_kg_m2",)).check()


@pytest.mark.parametrize("name", CATALOGUE)
def test_the_configuration_itself_comes_back_from_its_own_values(name: str) -> None:
    base = machine_parameters(name)
    keyed = KeyedConfiguration(name, base, assumed_keys(name, base))
    assert keyed.parameters(keyed.values()) == base


@pytest.mark.slow
@pytest.mark.parametrize("name", CATALOGUE)
def test_the_motion_depends_on_no_key_that_all_keys_leave_out(name: str) -> None:
    base = machine_parameters(name)
    found, run = machine_keys(name, base), rollout(name, 0.3)
    of_other_models = (
        "load_sets.printed.",
        "tool.wave.",
        "stop.wave.",
        "excitation.a",
        "excitation.b",
        "masses.crank",
        "masses.pin",
    )
    left = [key for key in numbers_of(configuration_tree(base)) if key.startswith(of_other_models)]
    assert not set(found) & set(left)
    for key in left:
        changed = rollout(name, 0.3, {key: KeyedConfiguration(name, base, ()).other_value(key)})
        assert [column for column in run.columns if changed[column].tobytes() != run[column].tobytes()] == [], key


def test_of_keys_that_repeat_each_other_the_one_with_the_larger_effect_is_estimated() -> None:
    random = np.random.default_rng(0)
    shared, own = random.standard_normal((2, 200))
    jacobian = np.column_stack([1.0 * shared, 10.0 * shared, 5.0 * own])
    seen = sensitivity(jacobian, jacobian, np.arange(3), np.ones(3))
    assert seen.estimated(range(3)) == [1, 2]
    assert seen.groups() == [[0, 1]]


def test_no_direction_that_is_not_seen_is_left_free() -> None:
    random = np.random.default_rng(1)
    shared, own, apart = random.standard_normal((3, 200))
    jacobian = np.column_stack([10.0 * shared + 0.05 * apart, 5.0 * shared, 5.0 * own])
    seen = sensitivity(jacobian, jacobian + 0.05 * np.column_stack([own, -apart, apart]), np.arange(3), np.ones(3))
    assert seen.groups() == [[0, 1]]  # told apart by less than the two step lengths differ
    assert seen.estimated(range(3)) == [0, 2]


def models(machine: Machine) -> bytes:
    compiled = compiled_machine(machine)
    assert compiled is not None
    return pickle.dumps(compiled.models)


@pytest.mark.parametrize(("name", "overrides"), CASES, ids=IDS)
def test_every_fault_and_operating_variable_changes_the_motion(name: str, overrides: dict[str, Any]) -> None:
    base, entry = machine_parameters(name, overrides=overrides), CATALOGUE[name]
    healthy, able = models(entry.build(base)), entry.capabilities
    faults = [(fault, fault.sizes[-1]) for fault in (able.faults(base) if able.faults else ())]
    operating = [(variable, variable.range) for variable in (able.operating(base) if able.operating else ())]
    for offered, size in (*faults, *operating):
        moved = validated(
            entry, merged_tree(configuration_tree(base), tree_from_flat(offered.changes(base, size))), name
        )
        assert models(entry.build(moved)) != healthy, offered.name


@pytest.mark.slow
def test_the_mass_of_a_rigid_tool_is_no_assumed_key_of_one_in_which_the_blow_is_a_wave() -> None:
    rigid = machine_parameters("mb10_breaker")
    assert {"tool.mass_kg", "tool.restitution"} <= {*assumed_keys("mb10_breaker", rigid)}
    wave = machine_parameters("mb10_breaker", overrides={"tool.model": "wave"})
    assert not {"tool.mass_kg", "tool.restitution"} & {*assumed_keys("mb10_breaker", wave)}
