# SPDX-License-Identifier: Apache-2.0
"""Type erasure of hybrid systems by function pointer, so that the loop is compiled once and not for each machine.

The functions of a system (`laws`) are compiled behind one entry function.  `Declared` holds the address of that
function, of the system's constants and of the equations it fills.  An indirect call costs some nanoseconds, and is
not inlined.
"""

from typing import Any, NamedTuple

from llvmlite import ir  # type: ignore[import-untyped]
from numba.extending import intrinsic

from mech_twin.engine.addresses import build, number_of, place_of, types, value_at
from mech_twin.engine.hybrid.laws import (
    Array,
    Equations,
    Indices,
    begin_impact,
    begin_piece,
    change_regimes,
    declares,
    end_piece,
    evaluate,
    fill_signals,
    note_impact,
    pass_signal,
)
from mech_twin.engine.hybrid.motion import fill_rates, motion_rates
from mech_twin.kernels.dispatcher import on_processor, overload
from mech_twin.kernels.kernel import borrowing_kernel, inline_kernel

EVALUATE, RATES, SIGNALS, BEGIN, END, PASS, CHANGE, STRIKE, IMPACT = range(9)
NUMBERS, MARKS, TABLE = types.float64[::1], types.int64[::1], types.float64[:, ::1]


def entry_types(system: Any, equations: Any) -> tuple[Any, ...]:
    """Return the argument types of `enter`."""
    at = [types.CPointer(kind) for kind in (system, equations, NUMBERS, MARKS, NUMBERS, NUMBERS, MARKS, TABLE)]
    return (types.int64, types.int64, types.float64, *at, types.int64)


def _call(typing_context: Any, entry: Any, *arguments: Any) -> Any:
    """Call the compiled `enter` through its address (numba intrinsic); pointers are passed as integers."""
    opaque = entry_types(types.void, types.void)

    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        word = ir.IntType(64)
        kinds = [types.float64 if kind == types.float64 else types.int64 for kind in opaque]
        function = builder.inttoptr(values[0], context.call_conv.get_function_type(types.int64, kinds).as_pointer())
        given = [builder.extract_value(values[1], i) for i in range(len(kinds))]
        given = [
            v if kind == types.float64 or v.type == word else builder.sext(v, word)
            for v, kind in zip(given, kinds, strict=True)
        ]
        status, result = context.call_conv.call_function(builder, function, types.int64, kinds, given)
        with build.if_unlikely(builder, status.is_error):
            context.call_conv.return_status_propagate(builder, status)
        return result

    return types.int64(entry, types.StarArgTuple(arguments)), generate


call: Any = intrinsic(_call)


@inline_kernel
def address_of(value: Any) -> int:
    """Return the address of a value as an integer."""
    return number_of(place_of(value))  # type: ignore[no-any-return]


@borrowing_kernel
def _enter(
    phase: int, which: int, t: float, system: Any, equations: Any, y: Any, regimes: Any, first: Any, second: Any,
    past: Any, log: Any, count: int,
) -> int:  # fmt: skip
    """Call the function of `laws` that the phase names; arrays and constants are passed by address."""
    if phase == EVALUATE:
        evaluate(value_at(system), t, value_at(y), value_at(regimes), value_at(equations))
    elif phase == RATES:
        motion_rates(value_at(system), t, value_at(y), value_at(regimes), value_at(equations), value_at(first))
    elif phase == SIGNALS:
        fill_signals(
            value_at(system), t, value_at(y), value_at(regimes), value_at(equations), value_at(first), value_at(second)
        )
    elif phase == BEGIN:
        begin_piece(value_at(system), t, value_at(y), value_at(regimes))
    elif phase == END:
        end_piece(value_at(system), t, value_at(first), value_at(y), value_at(regimes))
    elif phase == PASS:
        return pass_signal(value_at(system), which, t, value_at(y), value_at(regimes), value_at(log), count)
    elif phase == CHANGE:
        return change_regimes(
            value_at(system), t, value_at(y), value_at(past), value_at(regimes), value_at(equations), value_at(log),
            count,
        )  # fmt: skip
    elif phase == STRIKE:
        begin_impact(value_at(system), t, value_at(y), value_at(regimes), value_at(equations))
    elif phase == IMPACT:
        return note_impact(value_at(system), t, value_at(first), value_at(y), value_at(equations), value_at(log), count)
    return count


enter: Any = _enter


def _entry(typing_context: Any, system: Any, equations: Any) -> Any:
    """Return the address of `enter` compiled for a system and linked into the calling code (numba intrinsic)."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        kinds = entry_types(system, equations)
        compiled = enter.compile_for_kernel(kinds)
        context.active_code_library.add_linking_library(compiled.library)
        return builder.ptrtoint(context.declare_function(builder.module, compiled.fndesc), ir.IntType(64))

    return types.int64(system, equations), generate


entry_of: Any = intrinsic(_entry)


class Declared(NamedTuple):
    """A system by the addresses of its entry function, its constants, and its `Equations`."""

    entry: int
    system: int
    equations: int


def at_address(system: Any, at: Equations, place: Any, equations: Any) -> Any:
    """Return a system as `Declared` with the addresses given; itself where code has no addresses."""
    return system


@overload(at_address, forceinline=True)
def _at_address(system: Any, at: Any, place: Any, equations: Any) -> Any:
    def by_address(system: Any, at: Any, place: Any, equations: Any) -> Any:
        return Declared(entry_of(system, at), number_of(place), number_of(equations))

    def itself(system: Any, at: Any, place: Any, equations: Any) -> Any:
        return system

    return by_address if on_processor() else itself


@inline_kernel
def declared(system: Any, at: Equations) -> Any:
    """Return a system as `Declared`, valid while the calling kernel runs; itself on a graphics processor."""
    return at_address(system, at, place_of(system), place_of(at))


@declares(evaluate, Declared)
def _evaluate(system: Declared, t: float, y: Array, regimes: Indices, at: Equations) -> None:
    call(
        system.entry, EVALUATE, 0, t, system.system, system.equations, address_of(y), address_of(regimes), 0, 0, 0, 0, 0
    )


@declares(fill_rates, Declared)
def _fill_rates(system: Declared, t: float, y: Array, regimes: Indices, at: Equations, out: Array) -> None:
    call(
        system.entry, RATES, 0, t, system.system, system.equations, address_of(y), address_of(regimes),
        address_of(out), 0, 0, 0, 0,
    )  # fmt: skip


@declares(fill_signals, Declared)
def _fill_signals(
    system: Declared, t: float, y: Array, regimes: Indices, at: Equations, values: Array, rates: Array
) -> None:
    call(
        system.entry, SIGNALS, 0, t, system.system, system.equations, address_of(y), address_of(regimes),
        address_of(values), address_of(rates), 0, 0, 0,
    )  # fmt: skip


@declares(begin_piece, Declared)
def _begin_piece(system: Declared, t: float, y: Array, regimes: Indices) -> None:
    call(system.entry, BEGIN, 0, t, system.system, 0, address_of(y), address_of(regimes), 0, 0, 0, 0, 0)


@declares(end_piece, Declared)
def _end_piece(system: Declared, t: float, before: Array, y: Array, regimes: Indices) -> None:
    call(system.entry, END, 0, t, system.system, 0, address_of(y), address_of(regimes), address_of(before), 0, 0, 0, 0)


@declares(pass_signal, Declared)
def _pass_signal(system: Declared, which: int, t: float, y: Array, regimes: Indices, log: Array, count: int) -> int:
    return call(  # type: ignore[no-any-return]
        system.entry, PASS, which, t, system.system, 0, address_of(y), address_of(regimes), 0, 0, 0, address_of(log),
        count,
    )  # fmt: skip


@declares(change_regimes, Declared)
def _change_regimes(
    system: Declared, t: float, y: Array, past: Indices, regimes: Indices, at: Equations, log: Array, count: int
) -> int:
    return call(  # type: ignore[no-any-return]
        system.entry, CHANGE, 0, t, system.system, system.equations, address_of(y), address_of(regimes), 0, 0,
        address_of(past), address_of(log), count,
    )  # fmt: skip


@declares(begin_impact, Declared)
def _begin_impact(system: Declared, t: float, y: Array, regimes: Indices, at: Equations) -> None:
    call(system.entry, STRIKE, 0, t, system.system, system.equations, address_of(y), address_of(regimes), 0, 0, 0, 0, 0)


@declares(note_impact, Declared)
def _note_impact(system: Declared, t: float, before: Array, y: Array, at: Equations, log: Array, count: int) -> int:
    return call(  # type: ignore[no-any-return]
        system.entry, IMPACT, 0, t, system.system, system.equations, address_of(y), 0, address_of(before), 0, 0,
        address_of(log), count,
    )  # fmt: skip
