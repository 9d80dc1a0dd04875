# SPDX-License-Identifier: Apache-2.0
"""What runs within a step makes no array: told by the compiler and read from its code, not from the source."""

from __future__ import annotations

import re

import pytest
from numba import config, typeof, types

from mech_twin.engine.compiled_machine import compiled_machine
from mech_twin.engine.compiled_steps import Work, body_step, force_step, linkage_step, motor_step
from mech_twin.engine.hybrid import laws
from mech_twin.engine.hybrid.loop import advance
from mech_twin.kernels.dispatcher import _by_type, kernel_of
from mech_twin.machines.catalog import CATALOGUE
from mech_twin.parameters.load import machine

compiled_only = pytest.mark.skipif(bool(config.DISABLE_JIT), reason="nothing is compiled")
ROW, TABLE = types.float64[::1], types.float64[:, ::1]
WORK = types.NamedTuple((ROW, types.int64[::1]), Work)
ARGUMENTS = {
    "motor": (motor_step, (ROW, types.float64, ROW)),
    "linkage": (linkage_step, (types.int64, ROW, ROW, ROW, ROW, TABLE, WORK)),
    "forces": (force_step, (types.int64, ROW, TABLE, types.int64, ROW, TABLE, WORK)),
    "body": (body_step, (types.int64, ROW, ROW, TABLE, types.int64, ROW, TABLE)),
}
LOOP = (
    laws.evaluate, laws.accumulate, laws.fill_signals, laws.begin_piece, laws.end_piece, laws.pass_signal,
    laws.change_regimes, laws.note_impact,
)  # fmt: skip
MAKES_ARRAYS = {("mb10_breaker", "linkage")}  # for a blow that runs as a wave


@compiled_only
def test_no_function_of_the_loop_can_make_an_array():
    """Compiled without counting references: the compiler refuses one that makes an array."""
    for name in CATALOGUE:
        machine(name)
    of_loop = [kernel for law in LOOP for kernel in _by_type[law].values() if kernel]
    assert len(of_loop) >= 3 * len(LOOP)
    assert {kernel.targetoptions["_nrt"] for kernel in (advance, *of_loop)} == {False}


@pytest.mark.slow
@compiled_only
@pytest.mark.parametrize("name", CATALOGUE)
def test_steps_make_no_array_but_for_a_wave(name):
    models = compiled_machine(machine(name)).models
    making = set()
    for role, (generic, arguments) in ARGUMENTS.items():
        model = getattr(models, role)
        kernel, signature = kernel_of(generic, type(model)), (typeof(model), *arguments)
        kernel.compile(signature)
        code = str(kernel.overloads[signature].library._get_module_for_linking())
        assert "define" in code
        if re.search(r"(call|invoke)[^\n]*@NRT_(Allocate|MemInfo_alloc|MemInfo_new)", code):
            making.add((name, role))
    assert making == {place for place in MAKES_ARRAYS if place[0] == name}
