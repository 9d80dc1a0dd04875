# SPDX-License-Identifier: Apache-2.0
"""The constants of a machine's kernels as three flat arrays, and an expression that restores the tuples from them.

A unit without Python holds its constants as plain arrays, but its kernels take named tuples.  So the entry function
begins with an expression such as ``Models(Generator(reals[0], reals[1]), ...)``, which the compiler optimises away.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numba
import numpy as np
from llvmlite import ir  # type: ignore[import-untyped]
from numba.extending import intrinsic

from mech_twin.mechanics.straight_line import Generated, generated_at

types: Any = numba.types  # numba has incomplete type hints

KINDS = {"f": "reals", "i": "wholes", "b": "flags"}  # NumPy kind of an array, and its flat array


@dataclass
class PackedModels:
    """Constants of the kernels of one machine.

    Attributes
    ----------
    reals, wholes, flags : list
        Floats, integers (and single booleans as 0 or 1), and arrays of booleans.
    expression : str
        Python expression over arrays of these names that restores the constants.
    names : dict of str to object
        The named tuples in it, and the functions that return the address of each generated function.
    generated : dict of str to Generated
        The generated functions by symbol.
    """

    reals: list[float] = field(default_factory=list)
    wholes: list[int] = field(default_factory=list)
    flags: list[bool] = field(default_factory=list)
    expression: str = ""
    names: dict[str, Any] = field(default_factory=dict)
    generated: dict[str, Generated] = field(default_factory=dict)


def packed_models(models: Any) -> PackedModels:
    """Return the constants of a machine's kernels, packed."""
    packed = PackedModels()
    packed.expression = _expression(packed, models)
    return packed


def _expression(packed: PackedModels, value: Any) -> str:
    """Return the expression of one constant, and add its numbers to the arrays."""
    if isinstance(value, tuple):
        if type(value) is tuple:
            return f"({', '.join(_expression(packed, item) for item in value)},)"
        inner = ", ".join(_expression(packed, item) for item in value)
        name = f"{type(value).__module__}.{type(value).__name__}".replace(".", "_")
        packed.names[name] = type(value)
        return f"{name}({inner})"
    if isinstance(value, bool | np.bool_):
        packed.wholes.append(int(value))
        return f"(wholes[{len(packed.wholes) - 1}] != 0)"
    if isinstance(value, int):
        return _whole(packed, value)
    if isinstance(value, float):
        packed.reals.append(value)
        return f"reals[{len(packed.reals) - 1}]"
    name = KINDS[value.dtype.kind]
    into = getattr(packed, name)
    begin = len(into)
    into.extend(value.ravel().tolist())
    flat = f"{name}[{begin}:{len(into)}]"
    return flat if value.ndim == 1 else f"{flat}.reshape({value.shape})"


def _whole(packed: PackedModels, value: int) -> str:
    """Return the expression of an integer, or of the address of a generated function."""
    function = generated_at(value)
    if function is None:
        packed.wholes.append(value)
        return f"wholes[{len(packed.wholes) - 1}]"
    symbol = f"mech_generated_{len(packed.generated)}"
    packed.generated[symbol] = function
    packed.names[f"address_of_{symbol}"] = _address_of(symbol)
    return f"address_of_{symbol}()"


def _address_of(symbol: str) -> Any:
    """Return a numba intrinsic without arguments that returns the address of a symbol linked with the code."""

    def address(typing_context: Any) -> Any:
        def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
            module = builder.module
            known = module.globals.get(symbol)
            function = known or ir.Function(module, ir.FunctionType(ir.VoidType(), ()), symbol)
            return builder.ptrtoint(function, ir.IntType(64))

        return types.int64(), generate

    return intrinsic(address)
