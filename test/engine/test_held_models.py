# SPDX-License-Identifier: Apache-2.0
"""A role's constants in compiled memory are its constants: the same bits, and no part of what is copied."""

from __future__ import annotations

import pickle

import numpy as np
import pytest
from catalogue import NAMES, built

from mech_twin.engine.compiled_roles import CompiledForces, CompiledMotor, held
from mech_twin.engine.compiled_steps import force_step, motor_step
from mech_twin.engine.run import frames
from mech_twin.engine.sample_vectors import row_of
from mech_twin.kernels.cache import modules_of, signature_text
from mech_twin.kernels.dispatcher import kernel_of


@pytest.mark.parametrize("name", NAMES)
def test_a_motor_with_held_constants_answers_as_its_kernel(name: str) -> None:
    motor = built(name).motor
    assert isinstance(motor, CompiledMotor)
    for frame in frames(built(name), 0.02):
        out = np.empty(motor.layout.size)
        kernel_of(motor_step, type(motor.model))(motor.model, row_of(frame.linkage), 1.0, out)
        assert row_of(motor.respond(frame.linkage, 1.0)).tobytes() == out.tobytes()


def test_the_type_of_held_constants_tells_what_they_are_made_of() -> None:
    from numba import typeof

    forces = built("mb10_breaker").forces
    assert isinstance(forces, CompiledForces)
    kind = typeof(held(forces.model))
    model = type(forces.model)
    assert model.__module__ in modules_of((kind,))
    assert f"{model.__module__}.{model.__qualname__}(" in signature_text((kind,))
    assert " at 0x" not in signature_text((kind,))
    assert kernel_of(force_step, type(forces.model)) is not None


def test_a_role_that_has_computed_is_copied_without_its_compiled_memory() -> None:
    breaker = built("mb10_breaker")
    frame = list(frames(breaker, 0.01))[-1]
    expected = breaker.motor.respond(frame.linkage, 1.0)
    again = pickle.loads(pickle.dumps(breaker.motor))
    assert again == breaker.motor
    assert again.respond(frame.linkage, 1.0) == expected
