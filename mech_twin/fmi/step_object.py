# SPDX-License-Identifier: Apache-2.0
"""The coupling scheme of one machine, compiled ahead of time to an object file for any x86-64 processor.

One function, ``mech_step``, contains all kernels of the machine.  It is the code of the compiled run
(`engine.compiled_steps`), so a unit computes the same as `simulate`.
"""

import hashlib
import pickle
import re
from collections.abc import Sequence
from functools import cached_property
from types import CodeType
from typing import Any, NamedTuple

import llvmlite.binding as llvm  # type: ignore[import-untyped]
import numba
import numpy as np
from numba import types

from mech_twin.engine.compiled_machine import CompiledMachine, PackedModels
from mech_twin.engine.compiled_steps import (
    FROM_BODY,
    SOURCE,
    TABLE_EXTRA,
    Models,
    Widths,
    force_step,
    motor_step,
    run_steps,
    work_for,
)
from mech_twin.engine.sample_vectors import (
    IMPULSE,
    KIND,
    LOAD_WIDTH,
    POST_VELOCITY,
    PRE_VELOCITY,
    TIME,
    Places,
)
from mech_twin.kernels.cache import is_known_module, load, module_key, save
from mech_twin.kernels.dispatcher import compiled_ahead
from mech_twin.mechanics.code_generation import Code

_numba: Any = numba  # its type hints lack the names used here

SYMBOL = "mech_step"
PROCESSOR = "x86-64"  # the oldest; without contraction (FMA), results do not depend on it
EVENT_FIELDS = ("count", "time_s", "pre_velocity_m_per_s", "post_velocity_m_per_s", "impulse_ns")

_PICKLED = re.compile(r'^(@\.const\.pickle\S+ = .* constant \[\d+ x i8\]) c"[^"\n]*"', re.MULTILINE)
# names of blocks that LLVM makes in merging functions, and whose text it does not read
_LONG_NAME = re.compile(r"(?<=%)[-$\w.]{200,}|^[-$\w.]{200,}(?=:)", re.MULTILINE)

# arguments of a call: constants, whether to begin, step, command, frame vector, and the last event of each kind
_SOURCE = """
def mech_step(reals_at, wholes_at, flags_at, begin, step, target, row_at, events_at):
    reals = carray(reals_at, ({reals},), float64)
    wholes = carray(wholes_at, ({wholes},), int64)
    flags = carray(flags_at, ({flags},), bool_)
    row = carray(row_at, ({row},), float64)
    events = carray(events_at, ({kinds}, {fields}), float64)
    models = {models}
    if begin:
        motor_step(models.motor, row[{at.linkage}:{at.motor}], target, row[{at.motor}:{at.forces}])
        log, loads = empty((0, {widths.linkage})), empty((0, {load_width}))
        work = work_for(models.forces)
        force_step(models.forces, step, row[{at.linkage}:{at.motor}], log, 0, row[{at.forces}:{at.body}], loads, work)
        return 0
    targets = empty(1)
    targets[0] = target
    table, event_count, steps, failed, status = run_steps(
        models, Places({places}), Widths({width_list}), step, {step_s!r}, targets, row, empty(0, int64), empty((1, 0)),
        empty(0, int64), empty(0)
    )
    if failed != 0:
        return status
    for i in range(event_count):
        kind = int(table[i, {extra} + {kind}])
        if table[i, {source}] == {from_body}:
            kind += {linkage_kinds}
        events[kind, 0] += 1.0
        events[kind, 1] = table[i, {extra} + {time}]
        events[kind, 2] = table[i, {extra} + {pre}]
        events[kind, 3] = table[i, {extra} + {post}]
        events[kind, 4] = table[i, {extra} + {impulse}]
    return event_count
"""


class ObjectFile(NamedTuple):
    """Compiled code: bytes of the object file, and its undefined functions and variables."""

    content: bytes
    functions: tuple[str, ...]
    variables: tuple[str, ...]


class _StepText(NamedTuple):
    """The step as LLVM IR: its name, its text, and the code of each generated function by symbol."""

    name: str
    text: str
    generated: dict[str, Code]


class StepCode:
    """The compiled step of a machine, with its constants, independent of the target platform."""

    def __init__(self, compiled: CompiledMachine, packed: PackedModels) -> None:
        layout, widths = compiled.layout, compiled.widths
        of_body = () if layout.body is None else layout.body.events.kinds
        places = layout.places
        self._packed = packed
        self._source = _SOURCE.format(
            reals=len(packed.reals), wholes=len(packed.wholes), flags=len(packed.flags), row=places.end,
            kinds=max(1, len(layout.linkage.events.kinds) + len(of_body)), fields=len(EVENT_FIELDS),
            models=packed.expression, at=places, places=", ".join(map(str, places)), widths=widths,
            width_list=", ".join(map(str, widths)), load_width=LOAD_WIDTH,
            step_s=float(compiled.machine.coupling_step_s), extra=TABLE_EXTRA, source=SOURCE, from_body=FROM_BODY,
            linkage_kinds=len(layout.linkage.events.kinds), kind=KIND, time=TIME, pre=PRE_VELOCITY,
            post=POST_VELOCITY, impulse=IMPULSE,
        )  # fmt: skip

    def object_file(self, triple: str) -> ObjectFile:
        """Return the object file for a platform, such as ``x86_64-unknown-linux-gnu``; cached by its sources.

        It does not contain the numbers of a configuration, so a machine that was exported before is only linked.
        """
        modules = sorted({each.__module__ for each in self._packed.names.values() if isinstance(each, type)})
        if not all(map(is_known_module, modules)):
            return self._made(triple)
        generated = [repr(_identity(each.function.__code__)) for each in self._packed.generated.values()]
        processor = _numba.core.registry.cpu_target.target_context.codegen().magic_tuple()
        key = (self._source, triple, processor, [module_key(each) for each in modules], generated)
        folder = f"{__name__}-{module_key(__name__)}"
        name = f"{SYMBOL}-{hashlib.sha256(repr(key).encode()).hexdigest()[:32]}"
        kept = load(folder, name)
        if kept is not None:
            return ObjectFile(*pickle.loads(kept))
        made = self._made(triple)
        save(folder, name, pickle.dumps(tuple(made)))
        return made

    @cached_property
    def _compiled(self) -> _StepText:
        """The step as intermediate code, optimised."""
        packed = self._packed
        named: dict[str, Any] = {
            "carray": _numba.carray, "empty": np.empty, "float64": np.float64, "int64": np.int64, "bool_": np.bool_,
            "motor_step": motor_step, "force_step": force_step, "run_steps": run_steps, "work_for": work_for,
            "Places": Places, "Widths": Widths, Models.__name__: Models, **packed.names,
        }  # fmt: skip
        exec(compile(self._source, "<entry of the unit>", "exec"), named)  # only numbers and names of this package
        pointer, whole, real = types.voidptr, types.int64, types.float64
        arguments = (pointer, pointer, pointer, whole, whole, real, pointer, pointer)
        name, text = compiled_ahead(named[SYMBOL], whole, arguments)
        # unused exception texts contain file names of the exporting computer: blank them
        text = _LONG_NAME.sub(_short_name, _PICKLED.sub(r"\1 zeroinitializer", text))
        generated = {symbol: function.code() for symbol, function in packed.generated.items()}
        return _StepText(name, text, generated)

    def _made(self, triple: str) -> ObjectFile:
        llvm.initialize_all_targets()
        llvm.initialize_all_asmprinters()
        machine = llvm.Target.from_triple(triple).create_target_machine(
            cpu=PROCESSOR, opt=3, reloc="pic", codemodel="default"
        )
        step = self._compiled
        module = llvm.parse_assembly(step.text)
        for symbol, code in step.generated.items():
            other = llvm.parse_assembly(code.text)
            other.get_function(code.symbol).name = symbol
            module.link_in(other)
        module.triple, module.data_layout = triple, str(machine.target_data)
        for symbol in (*module.functions, *module.global_variables):
            if not symbol.is_declaration:
                symbol.linkage = "external" if symbol.name == step.name else "internal"
        module.get_function(step.name).name = SYMBOL
        _drop_unused(module, machine)
        functions = sorted(each.name for each in module.functions if each.is_declaration)
        variables = sorted(each.name for each in module.global_variables if each.is_declaration)
        return ObjectFile(machine.emit_object(module), tuple(functions), tuple(variables))


def _short_name(found: re.Match[str]) -> str:
    return f"block_{hashlib.sha256(found.group().encode()).hexdigest()[:32]}"


def _identity(code: CodeType) -> tuple[object, ...]:
    """Return the code of a generated function without file name and line numbers."""
    inner = tuple(_identity(each) if isinstance(each, CodeType) else each for each in code.co_consts)
    return (code.co_code, inner, code.co_names, code.co_varnames)


def _drop_unused(module: Any, machine: Any) -> None:
    passes = llvm.create_new_module_pass_manager()
    passes.add_global_dead_code_eliminate_pass()
    passes.run(module, llvm.create_pass_builder(machine, llvm.create_pipeline_tuning_options()))


def of_interpreter(names: Sequence[str]) -> list[str]:
    """Return the names of the Python C API among undefined symbols, which would create exceptions for Python.

    Code without Python never calls them, but the exception tables contain their addresses.
    """
    return [name for name in names if re.match(r"_?Py[A-Z]", name)]
