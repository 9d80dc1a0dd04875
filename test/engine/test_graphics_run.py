# SPDX-License-Identifier: Apache-2.0
"""A run on a graphics processor is that of the processor: in numba-cuda's simulator, and compiled without a device."""

from __future__ import annotations

import os
import pickle
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from engine.graphics_cases import CASES, numbers_of

import mech_twin as mt
from mech_twin.engine.compiled_machine import compiled_machine, packed_models
from mech_twin.engine.graphics_run import NEEDS, NONE_HERE, kernel_function, kernel_of
from mech_twin.errors import StudyError
from mech_twin.machines.catalog import CATALOGUE
from mech_twin.parameters.load import machine

pytest.importorskip("numba_cuda")
PROGRAM = Path(__file__).with_name("graphics_cases.py")


@pytest.fixture(scope="module")
def simulated(tmp_path_factory: pytest.TempPathFactory) -> dict[str, list[Any]]:
    out = tmp_path_factory.mktemp("simulated") / "numbers.pickle"
    environment = {**os.environ, "NUMBA_ENABLE_CUDASIM": "1", "NUMBA_DISABLE_JIT": "1"}
    subprocess.run([sys.executable, PROGRAM, out], check=True, env=environment, timeout=300)
    numbers: dict[str, list[Any]] = pickle.loads(out.read_bytes())
    return numbers


@pytest.fixture(scope="module")
def computed() -> dict[str, list[Any]]:
    return numbers_of("cpu")


@pytest.mark.slow
@pytest.mark.parametrize("name", [name for name in CASES if name != "a step full of events"])
def test_numbers_events_and_last_frame_are_those_of_the_processor_to_the_bit(
    name: str, simulated: dict[str, list[Any]], computed: dict[str, list[Any]]
) -> None:
    assert simulated[name] == computed[name]


@pytest.mark.slow
def test_a_member_with_too_many_events_in_a_step_ends_and_the_others_go_on(
    simulated: dict[str, list[Any]], computed: dict[str, list[Any]]
) -> None:
    full, other = simulated["a step full of events"]
    assert "more than 32 events in a step" in full[-1]
    assert other == computed["a step full of events"][1]


@pytest.mark.slow
@pytest.mark.parametrize("name", list(CATALOGUE))
def test_the_steps_of_a_machine_compile_for_a_graphics_processor(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    from numba import cuda, types
    from numba.cuda import dispatcher

    monkeypatch.setattr(dispatcher, "get_current_device", lambda: SimpleNamespace(compute_capability=(9, 0)))
    compiled = compiled_machine(machine(name))
    assert compiled is not None
    numbers, tables = types.float64[:, ::1], types.float64[:, :, ::1]
    steps, whole = types.int64[::1], types.int64[:, ::1]
    constants = (numbers, whole, types.boolean[:, ::1])
    signature = types.void(
        *constants, steps, steps, numbers, numbers, steps, tables, steps, numbers, numbers, whole, tables, whole
    )
    kernel = kernel_function(cuda, kernel_of(compiled, packed_models(compiled.models)))
    code, _ = cuda.compile(kernel, signature, device=False, abi="numba", cc=(9, 0), opt=False)
    assert ".target sm_90" in code
    assert ".visible .entry" in code


@pytest.mark.parametrize(
    ("settings", "said"),
    [
        ({"machine": "config/pages/rammer.yaml"}, "generated for the processor"),
        ({"machine": "mb10_breaker", "settings": [{"tool.model": "wave"}]}, "makes the cells of its rods"),
        ({"machine": "winding_drum", "device": "gpu"}, "device 'gpu': expected 'cpu' or 'cuda'"),
    ],
)
def test_what_a_graphics_processor_cannot_run_is_refused_in_one_line(
    settings: dict[str, Any], said: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("mech_twin.engine.graphics_run.cuda", object)
    asked = {"duration_s": 0.01, "settings": [{}], "device": "cuda", **settings}
    with pytest.raises(StudyError, match=said) as refused:
        mt.rollouts(**asked)
    assert "\n" not in str(refused.value)


@pytest.mark.slow
def test_without_a_graphics_processor_one_line_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("CUDA_VISIBLE_DEVICES", "-1")  # where there is one, it is not to be seen
    with pytest.raises(StudyError) as refused:
        mt.rollouts("winding_drum", 0.01, [{}], device="cuda")
    assert str(refused.value) == NONE_HERE


def test_without_the_package_one_line_says_which_extra_brings_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "numba_cuda", None)
    with pytest.raises(StudyError) as refused:
        mt.rollouts("winding_drum", 0.01, [{}], device="cuda")
    assert str(refused.value) == NEEDS
